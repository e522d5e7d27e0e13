"""What stands out must repeat: over stretches of the flights, and over operating points."""

from __future__ import annotations

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan

from enginediag_cli.mismatch.explain.repeated import repeated
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, driver_values, identify_with, nuisance
from enginediag_cli.mismatch.fit.noise import estimated_noise, with_noise
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import Gates, remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.registry import candidate_effects

ANY = Gates(5.0, 5.0, 5.0)


def scored(recorded):
    known = evidence(recorded)
    along = nuisance(known)
    found = identify_with(known, NULL_HYPOTHESIS, along)
    base = HypothesisFit((), found, Projection(found))
    library = [effect_option(e) for e in candidate_effects(known.engine)]
    left = remainder(base, library, driver_values(known, found.theta))
    return left, repeated(left, base.projection, ANY)


def largest(left):
    return max(*(s.surprise for s in left.scores), *(c.surprise for c in left.cells))


@pytest.fixture(scope="module")
def everywhere():
    return scored(flights(carried(("reynolds_efficiency", "hpc", {"exponent": 0.1})), np.random.default_rng(1)))


def test_an_effect_that_is_there_on_every_flight_keeps_its_place_and_most_of_its_weight(everywhere):
    before, after = everywhere
    assert after.scores[0].option.label == before.scores[0].option.label == "reynolds_efficiency@hpc"
    assert largest(after) > 0.5 * largest(before) > 20.0


def test_what_is_not_over_its_gate_stays_as_it_is_and_nothing_rises(everywhere):
    before, after = everywhere
    was = {s.option.label: s.score for s in before.scores}
    for s in after.scores:
        old = was[s.option.label]
        assert s.score is old if old.surprise <= ANY.effects else s.score.surprise <= old.surprise


def test_a_transient_at_full_power_of_one_flight_is_no_finding():
    recorded, engine = list(flights([], np.random.default_rng(2))), turbofan()
    order = np.argsort(recorded[1].columns["Wf_kg_s"])
    c = {k: v[order].copy() for k, v in recorded[1].columns.items()}
    inputs = {i: c[i][-4:] for i in engine.inputs}
    off = engine.predict(inputs, {"hpc.efficiency": 0.94}).y - engine.predict(inputs).y
    for j, s in enumerate(engine.sensors):
        c[s][-4:] += off[:, j]
    recorded[1] = Flight(recorded[1].label, "", c)
    before, after = scored(recorded)
    assert largest(before) > 20.0
    assert largest(after) < 0.4 * largest(before)


def test_correlation_that_a_fit_knew_is_not_lost_where_noise_is_estimated_again():
    rho, engine = 0.6, turbofan()
    rng = np.random.default_rng(3)
    recorded = []
    for f in flights([], rng, noise=0.0):
        c = dict(f.columns)
        for s, sensor in engine.sensors.items():
            e = rng.standard_normal(len(f))
            for k in range(1, len(e)):
                e[k] = rho * e[k - 1] + np.sqrt(1.0 - rho**2) * e[k]
            c[s] = c[s] + sensor.noise_sigma * e
        recorded.append(Flight(f.label, "", c))
    known = evidence(recorded)
    along = nuisance(known)
    for _ in range(4):
        found = identify_with(known, NULL_HYPOTHESIS, along)
        noise = estimated_noise(Projection(found), [])
        known = with_noise(known, noise)
        assert np.median(list(noise.rho.values())) == pytest.approx(rho, abs=0.12)
        shares = [noise.sigma[s] / sensor.noise_sigma for s, sensor in engine.sensors.items()]
        assert np.median(shares) == pytest.approx(1.0, abs=0.12)
