"""Physics with memory is named from recordings of transients: which kind it is, and its numbers."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.isolation.planned_flights import DURATION_S, MANOEUVRE
from enginediag_cli.mismatch.explain.answer import IDENTIFIED, NO_DISCREPANCY, Coefficient, Explanation
from enginediag_cli.mismatch.explain.plan import advise_flights_for_explanations
from enginediag_cli.mismatch.explain.story import explain_mismatch
from enginediag_cli.mismatch.fit.attempt import attempt, begun
from enginediag_cli.mismatch.fit.evidence import Noise
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.mismatch.refine.refine import refine
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.report.tables.explanation_text import sentences
from enginediag_cli.report.tables.formulas import suggestion
from enginediag_cli.shipped import shipped

ENGINE = str(shipped("micro_gas_turbine.yaml"))
RECORDS = 400


@cache
def engine():
    return load_engine(ENGINE)


def voltage(rng):
    """Steps of several sizes and a ramp."""
    at = np.sort(rng.choice(np.arange(20, RECORDS - 20), 5, replace=False))
    x = rng.uniform(3.0, 10.0, 6)[np.searchsorted(at, np.arange(RECORDS))]
    k = int(rng.integers(40, RECORDS - 80))
    x[k : k + 60] = np.linspace(x[k], x[k + 60], 60)
    return x


def recorded(folder, truth, seed):
    """Three runs of an engine with these effects, as files."""
    rng = np.random.default_rng(seed)
    true = engine().replace_effects([effect(engine(), *label.split("@"), values) for label, values in truth.items()])
    files = []
    for run in range(3):
        columns = {
            "time_s": np.arange(float(RECORDS)),
            "ambient_pressure_Pa": np.full(RECORDS, 101325.0),
            "ambient_temperature_K": np.full(RECORDS, 288.15),
            "input_voltage_V": voltage(rng),
        }
        inputs = {c: v for c, v in columns.items() if c in true.inputs}
        past = {MOMENT: true.tapes.add(columns)} if truth else {}
        power = true.predict({**inputs, **past}, sensors=("el_power_W",)).y[:, 0]
        columns["el_power_W"] = power + rng.normal(scale=50.0, size=RECORDS)
        path = folder / f"run_{run}.csv"
        table = np.column_stack(list(columns.values()))
        np.savetxt(path, table, fmt="%.8g", delimiter=",", header=",".join(columns), comments="")
        files.append(str(path))
    return tuple(files)


def explained(files):
    evidence = load_case(RecordedCase(ENGINE, RecordingSource(files)), identified=True).evidence
    return explain_mismatch(evidence, advise=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "truth",
    [
        {"load_rate_limit@generator": {"rise": 120.0, "fall": 80.0}},
        {"load_control_lag@generator": {"time_constant": 20.0}},
        {"load_control_delay@generator": {"delay": 8.0}},
    ],
    ids=["rate limit", "lag", "delay"],
)
def test_the_kind_of_memory_and_its_numbers_are_named(truth, tmp_path):
    story = explained(recorded(tmp_path, truth, seed=5))
    (label, values) = next(iter(truth.items()))
    best = story.answer.explanations[0]
    assert story.answer.status == IDENTIFIED and best.label == label
    for c in best.coefficients:
        true = values[c.name.rpartition(".")[2]]
        assert c.low - 3.0 * c.standard_error < true < c.high + 3.0 * c.standard_error


def test_nothing_is_named_where_power_follows_its_set_point(tmp_path):
    assert explained(recorded(tmp_path, {}, seed=6)).answer.status == NO_DISCREPANCY


@pytest.mark.slow
def test_a_rate_limit_is_told_as_rates_and_refined_on_unseen_runs(tmp_path):
    files = recorded(tmp_path, {"load_rate_limit@generator": {"rise": 120.0, "fall": 80.0}}, seed=7)
    assert any(" W/s (" in line for line in sentences(explained(files)))
    evidence = load_case(RecordedCase(ENGINE, RecordingSource(files))).evidence
    found = refine(evidence, [2], [effect(engine(), "load_rate_limit", "generator")])
    assert found.effects[0].values["rise"] == pytest.approx(120.0, rel=0.1)
    assert found.effects[0].values["fall"] == pytest.approx(80.0, rel=0.1)
    assert found.unseen is not None and found.unseen.chi2_after < 0.3 * found.unseen.chi2_before


RECORDER = """kind: recorder
description: the runs as they are, where nothing moves
sources: ["this test"]
columns:
  time_s: {from: time_s, unit: s}
  ambient_pressure_Pa: {from: ambient_pressure_Pa, unit: Pa}
  ambient_temperature_K: {from: ambient_temperature_K, unit: K}
  input_voltage_V: {from: input_voltage_V, unit: V}
  el_power_W: {from: el_power_W, unit: W}
masks: {outlier_sigma: 0, stuck_records: 0}
"""
GATE = """steady:
  window_s: 20
  spread: {input_voltage_V: 0.01}
"""


def test_what_a_gate_has_left_out_is_told_and_not_called_absorbed(tmp_path):
    files = recorded(tmp_path, {"load_control_delay@generator": {"delay": 8.0}}, seed=8)
    (tmp_path / "gated.yaml").write_text(RECORDER + GATE)
    loaded = load_case(
        RecordedCase(ENGINE, RecordingSource(files, recorder=str(tmp_path / "gated.yaml"))), identified=True
    )
    story = explain_mismatch(loaded.evidence, advise=False, intake=loaded.intake)
    assert story.gated is not None and story.gated.of == 3 * RECORDS
    assert story.gated.records == 3 * RECORDS - loaded.evidence.records > 0
    assert "load_control_delay@generator" in story.gated.effects
    told = [line for line in sentences(story) if "load_control_delay@generator" in line]
    assert len(told) == 1 and f"{story.gated.records:,} of {story.gated.of:,} records" in told[0]


def test_no_gate_is_told_where_there_is_none(tmp_path):
    files = recorded(tmp_path, {}, seed=6)
    loaded = load_case(RecordedCase(ENGINE, RecordingSource(files)), identified=True)
    assert explain_mismatch(loaded.evidence, advise=False, intake=loaded.intake).gated is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "first, second", [("load_control_lag", "load_rate_limit"), ("load_rate_limit", "load_control_lag")]
)
def test_two_effects_on_one_thing_are_fitted_in_the_order_in_which_they_act(first, second, tmp_path):
    sizes = {"load_control_lag": {"time_constant": 15.0}, "load_rate_limit": {"rise": 250.0, "fall": 180.0}}
    truth = {f"{name}@generator": sizes[name] for name in (first, second)}
    evidence = load_case(RecordedCase(ENGINE, RecordingSource(recorded(tmp_path, truth, seed=9)))).evidence
    evidence = replace(evidence, noise=Noise({"el_power_W": 50.0}))
    along = nuisance(evidence)
    base = identify_with(evidence, NULL_HYPOTHESIS, along)
    for order in ((first, second), (second, first)):
        trial = attempt(begun([effect(engine(), name, "generator") for name in order], base), base, along)
        assert trial.converged
        assert [o.label for o in trial.options] == list(truth)


@pytest.mark.slow
def test_the_interval_of_a_limit_that_nothing_met_ends_where_it_would_have_been_met(tmp_path):
    story = explained(recorded(tmp_path, {"load_rate_limit@generator": {"rise": 0.0, "fall": 80.0}}, seed=7))
    rise = next(c for c in story.answer.explanations[0].coefficients if c.name.endswith("rise"))
    assert rise.value == pytest.approx(0.0, abs=5.0)
    assert rise.low >= 0.0
    assert rise.high < 50.0


def fitted(base, along, label):
    """An explanation by one effect, as a search would tell it."""
    trial = attempt(begun([effect(engine(), *label.split("@"))], base), base, along)
    parameters = trial.found.model.parameters
    told = [Coefficient(n, parameters[n].unit, v, s, v - 2 * s, v + 2 * s) for n, (v, s) in trial.coefficients.items()]
    return Explanation(trial.options, tuple(told), trial.objective, 0.0, 0.5, 0.0, np.nan)


def test_a_step_of_another_size_tells_a_rate_limit_from_a_lag(tmp_path):
    files = recorded(tmp_path, {"load_control_lag@generator": {"time_constant": 20.0}}, seed=9)
    evidence = load_case(RecordedCase(ENGINE, RecordingSource(files))).evidence
    along = nuisance(evidence)
    base = identify_with(evidence, NULL_HYPOTHESIS, along)
    lag, limit = (fitted(base, along, f"{name}@generator") for name in ("load_control_lag", "load_rate_limit"))
    advice = advise_flights_for_explanations(base, [lag, limit])
    assert advice is not None and advice.separates
    best = next(s for s in advice.suggestions if s.kind == MANOEUVRE)
    assert best.records <= DURATION_S and best.chance > 0.9
    assert "of power" in suggestion(best) or "power raised" in suggestion(best)
    # the same thing twice is told apart by nothing
    twice = advise_flights_for_explanations(base, [lag, lag])
    assert twice is not None and not twice.separates
