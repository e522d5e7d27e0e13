"""Missing physics without a nominal file: the flights that are searched are identified first, as `-n` would have it."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refine_flights import ENGINE, flights, write_csv

from enginediag_cli.__main__ import main
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.load import MismatchQuery, RecordedCase, load_case
from enginediag_cli.mismatch.fit.noise import LEAST_RHO
from enginediag_cli.mismatch.fit.self_identified import LARGEST_RHO, SelfIdentified, robust_noise, self_identified
from enginediag_cli.mismatch.unrecorded.own_noise import freed_of_switches
from enginediag_cli.physics.engine_file import load_engine

BLOCK = '\nidentification:\n  parameters: ["*.efficiency", "*.flow_capacity"]\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An engine file that asks for identification, flights in which a bleed of 2 % switches, and their nominal file."""
    made = tmp_path_factory.mktemp("self")
    (made / "engine.yaml").write_text(ENGINE.read_text(encoding="utf-8") + BLOCK, encoding="utf-8")
    flown, _ = flights("customer_bleed@hpc", {"fraction": 0.02}, count=3, records=40, seed=1, switch=0.08)
    write_csv(flown, made / "flown.csv")
    words = ["identify", str(made / "engine.yaml"), str(made / "flown.csv"), "-q", "-o", str(made / "nominal.yaml")]
    assert main(words) == 0
    return made


def evidence(folder, nominal):
    case = RecordedCase(str(folder / "engine.yaml"), RecordingSource((str(folder / "flown.csv"),)), nominal)
    return load_case(case).evidence


def test_without_a_nominal_file_the_evidence_is_what_that_file_would_have_made_it_but_for_priors(folder):
    own, given = evidence(folder, None), evidence(folder, str(folder / "nominal.yaml"))
    alike = replace(given.settings, prior_mean=own.settings.prior_mean, nuisance=own.settings.nuisance)
    assert own.noise == given.noise and own.settings == alike
    values = [{n: p.nominal for n, p in e.engine.parameters.items()} for e in (own, given)]
    assert values[0] == values[1]
    assert own.settings.noise == "estimate"  # what the fit leaves holds the bleed, too
    for a, b in zip(own.flights, given.flights, strict=True):
        assert a.label == b.label and all(np.array_equal(a.columns[c], b.columns[c]) for c in a.columns)


def test_priors_about_what_the_searched_flights_have_bent_stay_where_the_file_has_them_and_hold_both(folder):
    own, given = evidence(folder, None).settings, evidence(folder, str(folder / "nominal.yaml")).settings
    assert own.prior_mean == {}
    moved = {n: abs(given.prior_mean[n] - 1.0) for n in own.nuisance if n in given.prior_mean}
    assert max(moved.values()) > 0.001
    assert all(s == pytest.approx(max(given.nuisance[n], moved.get(n, 0.0))) for n, s in own.nuisance.items())


@pytest.mark.slow
def test_explain_finds_the_bleed_that_switches_without_a_nominal_file(folder, capsys):
    out = folder / "answer.csv"
    assert main(["explain", str(folder / "engine.yaml"), str(folder / "flown.csv"), "--no-header", "-o", str(out)]) == 0
    said = capsys.readouterr().err
    assert "customer bleed at HPC switches between two states that no column records" in said
    with out.open(encoding="utf-8", newline="") as stream:
        first = next(csv.DictReader(stream))
    assert "customer_bleed" in json.dumps(first)


def test_an_engine_file_without_identification_is_taken_at_its_word(folder):
    given = load_case(RecordedCase(str(ENGINE), RecordingSource((str(folder / "flown.csv"),)))).evidence
    stated = load_engine(str(ENGINE))
    assert given.noise.sigma == {c: s.noise_sigma for c, s in stated.sensors.items()} and not given.noise.rho
    assert given.settings.prior_mean == {} and given.settings.noise == "specified"


@pytest.mark.slow
def test_a_known_design_keeps_its_priors_and_takes_noise_instruments_and_maps_from_the_flights(folder):
    case = RecordedCase(str(ENGINE), RecordingSource((str(folder / "flown.csv"),)))
    found, stated = load_case(case, identified=True).evidence, load_case(case).evidence
    assert found.settings.prior_mean == {} and found.settings.nuisance == stated.settings.nuisance
    assert found.noise.estimated and found.settings.maps is not None and found.settings.instruments
    assert all(found.noise.sigma[c] >= v for c, v in stated.noise.sigma.items())
    assert found.owed is not None and found.owed.least == stated.noise and not found.owed.priors


def test_who_vouches_for_the_noise_is_believed(folder):
    case = RecordedCase(
        str(ENGINE), RecordingSource((str(folder / "flown.csv"),)), asked=MismatchQuery(noise="specified")
    )
    found, stated = load_case(case, identified=True).evidence, load_case(case).evidence
    assert (found.noise, found.settings, found.owed) == (stated.noise, stated.settings, None)


def test_where_identification_ends_far_from_any_optimum_the_engine_files_state_stays_and_noise_is_robust(tmp_path):
    path = tmp_path / "engine.yaml"
    path.write_text(ENGINE.read_text(encoding="utf-8") + BLOCK + "  max_iterations: 1\n", encoding="utf-8")
    engine = load_engine(str(path))
    flown, _ = flights("customer_bleed@hpc", {"fraction": 0.02}, count=2, records=40, seed=1, switch=0.08)
    found = self_identified(engine, [Flight(f.label, "", f.columns) for f in flown])
    assert isinstance(found, SelfIdentified) and found.engine_values == found.theta0 == {}
    assert all(found.sigma[c] >= s.noise_sigma for c, s in engine.sensors.items())
    assert all(0 <= r <= LARGEST_RHO for r in found.rho1.values())


def noise_of(e, sigma=1.0, recording=None):
    recording = np.zeros(len(e), int) if recording is None else recording
    problem = SimpleNamespace(recording=recording, sensors=("T3_K",), sigma=np.array([sigma]))
    s, r = robust_noise(problem, np.asarray(e, float)[:, None])
    return s["T3_K"], r["T3_K"]


def test_white_noise_is_as_large_as_it_is_and_not_correlated():
    e = 2.0 * np.random.default_rng(1).standard_normal(20_000)
    sigma, rho = noise_of(e)
    assert sigma == pytest.approx(2.0, rel=0.03) and rho <= max(LEAST_RHO, 0.05)


def test_correlation_comes_from_neighbours_and_level_from_the_middle_of_the_readings():
    rng, rho = np.random.default_rng(2), 0.8
    e = np.zeros(40_000)
    for k in range(1, len(e)):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * rng.standard_normal()
    sigma, found = noise_of(e, 0.1)
    # 1 − w²/σ² with w² the variance of half a difference: σ²(1 − ρ)
    assert sigma == pytest.approx(1.0, rel=0.05) and found == pytest.approx(rho, abs=0.03)


def test_a_state_that_switches_in_few_records_does_not_make_the_noise():
    e = np.random.default_rng(3).standard_normal(2000)
    e[300:500] += 50.0
    sigma, rho = noise_of(e)
    assert sigma < 1.3 and rho < 0.5


def test_noise_is_never_below_what_the_sensor_is_said_to_have_and_steps_between_flights_do_not_count():
    assert noise_of(np.zeros(50), 3.0) == (3.0, pytest.approx(LARGEST_RHO))
    jumps = np.repeat([0.0, 9.0, -9.0], 2)
    one, _ = noise_of(np.tile(jumps, 20), 0.1, np.repeat(np.arange(60), 2))
    other, _ = noise_of(np.tile(jumps, 20), 0.1)
    assert one <= other


def test_a_sensor_without_readings_keeps_what_is_stated():
    assert noise_of(np.full(20, np.nan), 0.7) == (0.7, 0.0)


@pytest.mark.slow
def test_engines_of_an_aircraft_are_identified_one_by_one(folder):
    engine = load_engine(folder / "engine.yaml")
    flown = evidence(folder, None).flights[:2]
    sides = [Flight(f.label, side, f.columns) for f, side in zip(flown, "lr", strict=True)]
    both = self_identified(engine, sides)
    alone = [self_identified(engine, [f]) for f in sides]
    assert isinstance(both, SelfIdentified)
    for s in both.sigma:
        assert both.sigma[s] == max(a.sigma[s] for a in alone)
    for n, v in both.theta0.items():
        assert v == pytest.approx(np.mean([a.engine_values[n] for a in alone]))


@pytest.mark.slow
def test_noise_is_freed_of_what_switches_and_of_nothing_else(folder):
    found = evidence(folder, None)
    stated = found.owed.least
    loud = replace(found.noise, sigma={s: 6.0 * v for s, v in found.noise.sigma.items()})
    rng = np.random.default_rng(0)
    freed = freed_of_switches(replace(found, noise=loud), level=0.01, rng=rng)
    for s, v in freed.noise.sigma.items():
        assert stated.sigma[s] * 0.99 <= v < 0.5 * loud.sigma[s]
    elsewhere = replace(found, noise=loud, owed=None)
    assert freed_of_switches(elsewhere, level=0.01, rng=rng) is elsewhere
