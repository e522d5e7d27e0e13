"""Explanations that the records cannot tell apart are one answer with members, and what would tell them is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turbofan_trials import ENGINE, faulty_window, turbofan_monitor, window_score
from white_statistics import white_noise

from enginediag_cli.engine.instrument_errors import InputErrors
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose
from enginediag_cli.isolation.nonlinear import WindowModel
from enginediag_cli.isolation.results import CONVINCED, ODDS, AmbiguityGroup, ambiguity_group
from enginediag_cli.isolation.windows import find_separating_sensors
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.sentences import ambiguity_words
from enginediag_cli.simulation.flights import ColumnNoise
from enginediag_cli.validation.studies import known_nominal

NAMES = ("a", "b", "c", "d")
FEW = ("N1_rpm", "N2_rpm", "T45_K")


def posterior(*sets):
    """Masks and probabilities of sets, written as (letters, probability)."""
    masks = np.array([[name in letters for name in NAMES] for letters, _ in sets])
    return masks, np.array([p for _, p in sets])


def test_sets_that_exchange_a_member_are_a_class_with_a_summed_probability():
    found = ambiguity_group(NAMES, *posterior(("ab", 0.5), ("ac", 0.3), ("ad", 0.15), ("abc", 0.05)))
    assert found == AmbiguityGroup((("b",), ("c",), ("d",)), ("a",), pytest.approx(0.95))
    assert found.leading_pair == (("a", "b"), ("a", "c"))


def test_a_larger_set_that_exchanges_adds_its_probability_and_no_member():
    found = ambiguity_group(NAMES, *posterior(("a", 0.5), ("b", 0.3), ("bc", 0.1), ("ab", 0.1)))
    assert found is not None and found.members == (("a",), ("b",))
    assert found.probability == pytest.approx(0.9)


@pytest.mark.parametrize(
    "sets",
    [
        (("a", CONVINCED + 0.01), ("b", 0.09)),
        (("a", 0.6), ("ab", 0.4)),  # whether there is more, not which
        (("", 0.6), ("a", 0.4)),
        (("a", 0.6), ("b", 0.6 / ODDS - 0.001), ("ab", 0.371)),
    ],
    ids=["told apart", "more or less", "nothing", "far behind"],
)
def test_what_is_told_apart_or_adds_or_is_nothing_is_no_class(sets):
    assert ambiguity_group(NAMES, *posterior(*sets)) is None


def few_sensors(monitor):
    """The same with three sensors, as an airline records them, and their errors alone."""
    kept = [monitor.sensors.index(column) for column in FEW]
    own = {f"sensor.{column.rsplit('_', 1)[0]}.bias" for column in FEW}
    monitor = monitor.drop_parameters([n for n, p in monitor.meaning.items() if p.belongs_to_sensor and n not in own])
    return replace(monitor, sensors=FEW, noise=white_noise(monitor.noise.sigma[kept]))


def test_with_three_sensors_two_faults_are_never_one_name_with_a_high_probability():
    monitor, rng = few_sensors(turbofan_monitor(sensors=True)), np.random.default_rng(5)
    health = [n for n, p in monitor.meaning.items() if not p.belongs_to_sensor]
    classes = 0
    for _ in range(12):
        change = {str(n): -rng.uniform(0.008, 0.02) for n in rng.choice(health, 2, replace=False)}
        inputs, y = faulty_window(rng, monitor, change, n=20)
        result = diagnose(window_score(monitor, inputs, y), DiagnosisOptions()).result
        assert not (len(result.isolated) == 1 and result.probability > 0.9), (change, result.isolated)
        classes += result.ambiguity is not None
    assert classes > 6


def test_the_sensor_that_would_tell_a_class_is_one_that_the_engine_file_describes_and_does_tell():
    monitor, rng = few_sensors(turbofan_monitor(sensors=True)), np.random.default_rng(1)
    inputs, y = faulty_window(rng, monitor, {"hpc.efficiency": -0.01}, n=20)
    score = window_score(monitor, inputs, y)
    asked = AmbiguityGroup((("hpc.efficiency",), ("hpt.efficiency",)), (), 0.9)
    told = find_separating_sensors(monitor, score, asked, inputs, len(y))
    assert told and set(told) <= set(monitor.engine.sensors) - set(FEW)
    # of a change too small for one record nothing tells
    assert find_separating_sensors(monitor, replace(score, b=1e-4 * score.b), asked, inputs, 1) == ()


def test_where_all_described_sensors_are_recorded_another_place_may_tell():
    monitor, rng = turbofan_monitor(sensors=True), np.random.default_rng(2)
    inputs, y = faulty_window(rng, monitor, {"fan.efficiency": -0.01}, n=20)
    asked = AmbiguityGroup((("fan.efficiency",), ("sensor.N1.bias",)), (), 0.9)
    told = find_separating_sensors(monitor, window_score(monitor, inputs, y), asked, inputs, len(y))
    assert not set(told) & set(monitor.sensors) and not set(told) & set(monitor.engine.inputs)


def test_a_reading_of_an_input_and_one_of_an_output_that_read_alike_are_a_class_not_a_name():
    """Fuel flow sets the power: N1 alone is recorded, and one of the two is wrong."""
    engine = InputErrors.wrap(load_engine(ENGINE))
    noise = {c: ColumnNoise("gaussian", sigma=s.noise_sigma) for c, s in engine.sensors.items()}
    monitor = known_nominal(engine, ("sensor.N1.bias", "input.Wf.scale"), noise)
    monitor = replace(monitor, sensors=("N1_rpm",), noise=white_noise(monitor.noise.sigma[:1]))
    inputs, _ = faulty_window(np.random.default_rng(3), turbofan_monitor(), {}, n=1)
    inputs = {column: np.tile(values, 30) for column, values in inputs.items()}
    truth = monitor.theta0 + np.where(np.array(monitor.names) == "input.Wf.scale", 0.015, 0.0)
    y = monitor.predict(inputs, truth)[0]
    result = diagnose(
        window_score(monitor, inputs, y), DiagnosisOptions(), lambda: WindowModel(monitor, inputs, y)
    ).result
    assert result.ambiguity is not None and result.probability < 0.9
    assert {m for member in result.ambiguity.members for m in member} == {"sensor.N1.bias", "input.Wf.scale"}


def test_the_sentence_names_all_members_and_what_would_tell():
    found = AmbiguityGroup((("a",), ("b", "c")), ("d",), 0.97, 2, ("T3_K",))
    assert ambiguity_words(found, lambda names: [n.upper() for n in names]) == (
        "ambiguous: A or B and C, or one of 2 more beside D (together probability 0.97); T3 would separate them"
    )
