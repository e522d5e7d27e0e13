"""One free amplitude per record: found where it is, as it is, and predicted from one sensor alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.wrapped import WarmEngine
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.freeform import Location, list_locations
from enginediag_cli.mismatch.fit.identified import Hypothesis, nuisance
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.unrecorded.control_law import find_stop, held_readings
from enginediag_cli.mismatch.unrecorded.per_record import (
    amplitudes_at,
    fit_per_record,
    inlet_temperature,
    scan,
    thin_records,
)
from enginediag_cli.mismatch.unrecorded.per_record_effects import effects_beside, similar_effects
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects, effect
from enginediag_cli.report.tables.location import per_record_rows, per_record_sentences

POWER_PLANT = Path(__file__).resolve().parents[2] / "configs" / "power_plant.yaml"
N, STOP, HELD_AT = 90, 0.02, 823.15
PLACE = "compressor.flow_capacity"


def simulated(seed: int, held: bool) -> tuple[Dataset, np.ndarray]:
    """Hours of the power plant with flow that varies by up to 22 %, and the flow's amplitude. `held`: at low power
    the flow is what keeps T5 at HELD_AT, else drawn at random; a third of the hours is at the stop."""
    rng = np.random.default_rng(seed)
    engine = load_engine(POWER_PLANT)
    full = np.arange(N) % 3 == 0
    u = {
        "ambient_temperature_K": rng.uniform(278, 303, N),
        "ambient_pressure_Pa": rng.normal(101300, 700, N),
        "dP_inlet_Pa": rng.uniform(300, 550, N),
        "T4_K": np.where(full, 1373.0, rng.uniform(1330, 1360, N)),
    }
    a = np.where(full, STOP, rng.uniform(-0.2, 0.0, N))
    carried = WarmEngine(engine.replace_effects([effect(engine, "computed_reading", "T4")]))
    theta = {"turbine.efficiency": 1.01, "compressor.efficiency": 0.99, "computed_reading.T4.ignored": 0.9}
    if held:
        low, high = np.full(N, -0.25), np.full(N, STOP)
        for _ in range(12):
            middle = 0.5 * (low + high)
            T5 = carried.predict(u, {**theta, PLACE: 1.0 + middle}, sensors=("T5_K",)).y[:, 0]
            # less flow, less pressure ratio, a hotter exhaust
            low, high = np.where(T5 > HELD_AT, middle, low), np.where(T5 > HELD_AT, high, middle)
        a = np.where(full, STOP, high)
    y = carried.predict(u, {**theta, PLACE: 1.0 + a})
    assert y.ok.all()
    sigma = np.array([engine.sensors[s].noise_sigma for s in y.columns])
    measured = y.y + sigma * rng.standard_normal(y.y.shape)
    columns = {**u, **dict(zip(y.columns, measured.T, strict=True))}
    return build_dataset(engine, [Flight("hours", "", columns)], MismatchQuery(model_error=0.0)), a


def place(evidence: Dataset, name: str = PLACE) -> Location:
    return next(p for p in list_locations(evidence.engine, tuple(evidence.noise.sigma)) if p.name == name)


@pytest.fixture(scope="module")
def random_flow():
    return simulated(3, held=False)


@pytest.fixture(scope="module")
def scanned(random_flow):
    evidence, _ = random_flow
    names = (PLACE, "turbine.flow_capacity", "sensor.P3")
    return scan(evidence, [place(evidence, n) for n in names], nuisance(evidence))


def test_the_place_that_varies_fits_to_the_noise_and_no_other_does(scanned):
    found = scanned
    assert found[0].name == PLACE
    assert found[0].converged
    assert found[0].per_record < 6.0
    assert all(f.per_record > 3.0 * found[0].per_record for f in found[1:])


def test_the_amplitude_is_found_within_its_standard_error(random_flow):
    evidence, a = random_flow
    fit = fit_per_record(evidence, place(evidence), nuisance(evidence))
    off = fit.amplitude - a
    # identification shares a constant with the amplitude; about it each record is as good as its standard error says
    assert np.std(off) < 2.0 * np.median(fit.standard_error)
    assert fit.failed == 0


def test_sensors_left_out_are_predicted_from_one(random_flow):
    evidence, _ = random_flow
    fit = fit_per_record(evidence, place(evidence), nuisance(evidence))
    found = amplitudes_at(evidence, fit, nuisance(evidence), ("P3_Pa",))
    assert np.abs(found.residual[:, found.sensors.index("P3_Pa")]).max() < 0.05
    assert np.sqrt(np.mean(found.residual[:, found.sensors.index("T5_K")] ** 2)) < 2.0


def test_an_effect_beside_the_amplitude_is_scored_first_and_fitted(random_flow):
    evidence, _ = random_flow
    along = nuisance(evidence)
    fit = fit_per_record(evidence, place(evidence), along)
    effects = [effect(evidence.engine, "computed_reading", s) for s in ("T4", "T5")]
    effects.append(effect(evidence.engine, "egt_profile", "T5"))
    first = effects_beside(evidence, fit, effects, block=15)[0]
    assert first.effect.label == "computed_reading@T4"
    new = fit_per_record(evidence, fit.location, along, Hypothesis((first.effect,)), (fit,))
    assert new.theta["computed_reading.T4.ignored"] == pytest.approx(0.9, abs=0.15)
    assert new.objective < fit.objective - 9.0


def test_a_stop_and_the_reading_that_is_held_are_seen():
    evidence, a = simulated(5, held=True)
    along = nuisance(evidence)
    fit = fit_per_record(evidence, place(evidence), along)
    stop = find_stop(fit, evidence.flights[0].columns["ambient_temperature_K"], count=3)
    assert stop.upper
    assert np.mean(stop.at == (a == STOP)) > 0.9
    best = held_readings(evidence, fit, along, stop)[0]
    assert best.sensor == "T5_K"
    assert best.held
    assert best.value == pytest.approx(HELD_AT, abs=1.0)


def test_a_fit_without_a_place_has_no_amplitude(random_flow):
    evidence, _ = random_flow
    few = replace(evidence, flights=(Flight("few", "", {c: v[:20] for c, v in evidence.flights[0].columns.items()}),))
    fit = fit_per_record(few, None, nuisance(few))
    assert np.isnan(fit.amplitude).all()
    assert fit.name == "nothing"


def test_the_answer_is_told_in_rows_and_sentences(random_flow, scanned):
    evidence, _ = random_flow
    best = scanned[0]
    rows = list(per_record_rows(scanned))
    assert [r["rank"] for r in rows] == [1, 2, 3, 4]
    assert rows[0]["location"] == PLACE and rows[0]["times_best"] == 1.0
    assert {r["location"] for r in rows} >= {"nothing", "sensor.P3"}
    stop = find_stop(best, inlet_temperature(evidence, best), count=3)
    acting = similar_effects(evidence, best, list(candidate_effects(evidence.engine)))
    told = " ".join(per_record_sentences(scanned, stop, (), acting))
    assert "compressor flow capacity" in told
    assert "guide_vanes_load@compressor" in told
    assert {a.effect.label for a in acting} >= {"guide_vanes_load@compressor", "fouling@compressor"}


def test_every_nth_record_is_taken(random_flow):
    evidence, _ = random_flow
    few = thin_records(evidence, 4)
    assert len(few.flights[0].columns["T4_K"]) == -(-N // 4)


def test_flow_cut_by_a_third_is_solved_from_a_cold_start():
    """Closed vanes: at the design point's flow the compressor would be beyond choking."""
    engine = load_engine(POWER_PLANT)
    u = {
        "ambient_temperature_K": np.array([275.0, 288.0, 305.0]),
        "ambient_pressure_Pa": 101300.0,
        "dP_inlet_Pa": 400.0,
        "T4_K": 1340.0,
    }
    for factor in (1.0, 0.8, 0.67):
        assert engine.predict(u, {PLACE: factor}).ok.all()
