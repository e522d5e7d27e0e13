"""The judgement of a fleet: ranking, discoveries, what is common, remaining flights."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import binom, norm
from turbofan_fleet import SETTINGS, engine_history, geometry, judged, known, lost, scale

from enginediag_cli.fleets.findings import CHANGED, HEALTHY, NO_VERDICT, EngineFinding, FleetSettings
from enginediag_cli.fleets.margin import add_forecasts, learnt_limit
from enginediag_cli.fleets.run import flag_engines, fleet_probabilities, judge_fleet, random_effects

FLIGHTS = 90


@pytest.fixture(scope="module")
def fleet():
    """Twelve engines, three of which wear by one, two and three prior standard deviations of HPT efficiency; one with
    two flights."""
    rng = np.random.default_rng(11)
    course = np.clip((np.arange(FLIGHTS) - 20) / (FLIGHTS - 21), 0, 1)
    worn = {"9": 1.0, "10": 2.0, "11": 3.0}
    changes = {str(k): lost(FLIGHTS, {"hpt.efficiency": -worn.get(str(k), 0.0)}, course) for k in range(12)}
    found = [judged(engine_history(rng, serial, FLIGHTS, change)) for serial, change in changes.items()]
    return [*found, judged(engine_history(rng, "short", 2))]


def test_engines_are_ranked_by_what_they_have_used_and_flagged_by_their_probabilities(fleet):
    found = judge_fleet(fleet, SETTINGS, known().parameters)
    assert [f.serial for f in found.engines[:3]] == ["11", "10", "9"]
    assert set(found.flagged.engines) == {"9", "10", "11"}
    assert all({r.component for r in f.health if r.onset} == {"hpt"} for f in found.engines if f.discovery)
    assert {f.serial for f in found.engines if f.discovery} == set(found.flagged.engines)
    assert "(false discovery rate ≤ 5 %)" in found.flagged.words
    assert [serial for serial, _ in found.excluded] == ["short"]
    assert found.engines[-1].verdict == NO_VERDICT


def test_what_one_engine_has_is_not_common(fleet):
    assert not any(c.common for c in judge_fleet(fleet, SETTINGS, known().parameters).common)


def test_what_all_engines_have_alike_is_told_as_common():
    rng = np.random.default_rng(12)
    step = np.arange(60) >= 20
    drifted = [
        judged(engine_history(rng, str(k), 60, lost(60, {"sensor.P3.bias": 1.0 + 0.1 * rng.standard_normal()}, step)))
        for k in range(10)
    ]
    common = [c for c in judge_fleet(drifted, SETTINGS, known().parameters).common if c.common]
    assert [c.parameter for c in common] == ["sensor.P3.bias"] and "recorder" in common[0].reading
    sigma = geometry().monitor.meaning["sensor.P3.bias"].prior_sigma
    assert common[0].mean.low < sigma < common[0].mean.high and common[0].alike > 0.95


def test_the_mean_of_random_effects_is_that_of_its_closed_form():
    rng = np.random.default_rng(13)
    x, v = rng.normal(2.0, 1.0, 50), np.full(50, 1e-9)
    mean, error, spread = random_effects(x, v)
    assert mean == pytest.approx(x.mean()) and spread == pytest.approx(x.std(ddof=1), rel=1e-3)
    assert error == pytest.approx(x.std(ddof=1) / np.sqrt(50), rel=1e-2)
    mean, error, spread = random_effects(np.array([1.0, 1.2, 0.9]), np.ones(3))
    assert spread == 0.0 and error == pytest.approx(1 / np.sqrt(3))


def test_engines_that_wear_faster_have_fewer_flights_left(fleet):
    settings = FleetSettings(consumed_limit_K=(80.0, 5.0))
    limited = [f for f in add_forecasts([_without_limit(f) for f in fleet], settings) if f.serial in ("9", "10", "11")]
    left = {f.serial: f.margin.remaining_flights for f in limited}
    assert left["11"].value < left["10"].value < left["9"].value
    assert all(x.low <= x.value <= x.high for x in left.values())
    per_flight = -scale().slope["hpt.efficiency"] * 0.02 * 3.0 / (FLIGHTS - 21)
    rate = next(f.margin.rate_K_per_flight for f in limited if f.serial == "11")
    assert rate.value == pytest.approx(per_flight, rel=0.3)


def test_without_a_limit_it_is_said_why_nothing_is_forecast(fleet):
    found = add_forecasts([_without_limit(f) for f in fleet], FleetSettings())
    assert all(f.margin.reason for f in found) and not any(np.isfinite(f.margin.remaining_flights.value) for f in found)


def test_an_empty_fleet_is_a_fleet():
    found = judge_fleet([], SETTINGS)
    assert found.engines == () and found.flagged.engines == ()


def _without_limit(finding: EngineFinding) -> EngineFinding:
    from dataclasses import replace

    return replace(finding, margin=replace(finding.margin, limit_K=float("nan")))


def test_the_limit_is_learnt_from_engines_that_were_taken_off(fleet):
    worn = [f for f in fleet if f.serial in ("9", "10", "11")]
    mean, spread = learnt_limit(worn)
    per_sigma = -scale().slope["hpt.efficiency"] * 0.02
    assert mean == pytest.approx(2.0 * per_sigma, abs=4.0) and spread == pytest.approx(per_sigma, rel=0.3)
    with pytest.raises(ValueError, match="3 lives at least, and 2"):
        learnt_limit(worn[:2])


def in_this_fleet(p: np.ndarray, prior: float) -> list[float]:
    """Probabilities of a change with the odds of changes free within a factor of three, by quadrature."""
    after, before = p / (1 - p), prior / (1 - prior)

    def weight(x: float) -> float:
        rate = np.exp(np.log(3.0) * x)
        return float(norm.pdf(x) * np.prod((1 + rate * after) / (1 + rate * before)))

    whole = quad(weight, -8, 8, epsabs=0)[0]

    def mean(odds: float) -> float:
        def changed(x: float) -> float:
            rate = np.exp(np.log(3.0) * x)
            return weight(x) * float(rate * odds / (1 + rate * odds))

        return float(quad(changed, -8, 8, epsabs=0)[0]) / whole

    return [mean(odds) for odds in after]


def test_the_list_is_the_longest_whose_expected_share_of_healthy_engines_is_small_enough():
    rng = np.random.default_rng(3)
    for _ in range(20):
        p = np.append(rng.uniform(0.5, 1.0, 8), 0.4)
        kinds = [CHANGED] * 8 + [HEALTHY]
        fleet = [
            EngineFinding(str(k), "", 9, 9, kind, "", probability=float(x), prior=0.25)
            for k, (x, kind) in enumerate(zip(p, kinds, strict=True))
        ]
        names, expected = flag_engines(fleet, 0.1)
        chances = np.array(in_this_fleet(p, 0.25))
        order = np.sort(chances[:8])[::-1]
        shares = [np.mean(1 - order[:k]) for k in range(1, 9)]
        most = sum(share <= 0.1 for share in shares)
        assert len(names) == most and expected == pytest.approx(shares[most - 1] if most else 0.0, rel=1e-4)
        assert [chances[int(name)] for name in names] == order[:most].tolist()
    assert flag_engines(fleet[-1:], 0.1) == ((), 0.0)


def test_flagged_engines_are_healthy_as_often_as_stated_however_many_changed():
    """Engines that read x ~ N(0, 1), or N(3, 1) where they changed: half as many, or twice as many, as was expected."""
    rng = np.random.default_rng(5)
    for share in (0.1, 0.4):
        false = flagged = 0
        for _ in range(20):
            changed = rng.random(200) < share
            x = rng.standard_normal(200) + 3 * changed
            p = expit(np.log(0.2 / 0.8) + 3 * x - 4.5)
            verdicts = np.where(p >= 0.5, CHANGED, HEALTHY)
            fleet = [
                EngineFinding(str(k), "", 9, 9, str(verdicts[k]), "", probability=float(p[k]), prior=0.2)
                for k in range(200)
            ]
            names, _ = flag_engines(fleet, 0.2)
            flagged += len(names)
            false += sum(not changed[int(name)] for name in names)
        assert binom.sf(false - 1, flagged, 0.2) > 1e-3
        chances = fleet_probabilities(p, np.full(200, 0.2))
        assert chances.sum() == pytest.approx(changed.sum(), abs=15)


def test_a_change_that_is_too_doubtful_for_the_list_says_so():
    fleet = [EngineFinding("A", "", 9, 9, CHANGED, "", probability=0.6, prior=0.25)]
    (found,) = judge_fleet(fleet, FleetSettings()).engines
    assert not found.discovery and found.verdict == CHANGED and "not flagged" in found.reason
