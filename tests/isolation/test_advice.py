"""What to record next so that two rivals part."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from score_makers import linear_score, sensitivities

from enginediag_cli.isolation.planned_flights import conditions_grid
from enginediag_cli.isolation.results import (
    RecordingOption,
    advise,
    condition_options,
    sensor_options,
    separable_information,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "residuals"))
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.physics.engine_file import load_engine

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"


def alike(seed=1, change=0.02):
    """Score of four parameters of which p0 and p1 are nearly alike; p0 has changed."""
    rng = np.random.default_rng(seed)
    J = sensitivities(rng, p=4)
    J[:, :, 1] = J[:, :, 0] + 0.02 * J[:, :, 1]
    return linear_score(rng, J, [change, 0, 0, 0])


def along(*rows):
    G = np.array(rows, float)
    return G.T @ G


def test_records_that_tell_the_rivals_apart_come_before_records_that_do_not():
    blind = RecordingOption("blind", {}, along([100, 100, 0, 0]))
    sharp = RecordingOption("sharp", {}, along([100, 0, 0, 0], [0, 50, 0, 0]))
    found = advise(alike(), (["p0"], ["p1"]), [blind, sharp], np.zeros((4, 4)))
    assert [a.label for a in found] == ["sharp", "blind"]
    assert found[0].records < np.inf and found[0].noncentrality > found[1].noncentrality >= 0


def test_the_records_needed_are_the_fewest_that_promise_the_odds():
    score, option = alike(), RecordingOption("sharp", {}, along([20, 0, 0, 0], [0, 15, 0, 0]))
    (found,) = advise(score, (["p0"], ["p1"]), [option], np.zeros((4, 4)), odds=20)

    def gain(n, own, other):
        _, I = score.scaled()
        b = score.scaled()[0]
        estimate = b[own] / I[own, own]
        # one parameter: the least favourable change allowed is the estimate less 1.28 standard errors
        change = estimate - np.sign(estimate) * 1.2816 / np.sqrt(I[own, own])
        D = score.prior_sigma
        with_more = I + n * D[:, None] * option.information * D
        short = [separable_information(X, np.array([own]), np.array([other]))[0, 0] for X in (with_more, I)]
        return change**2 * (short[0] - short[1])

    def both(n):
        return min(gain(n, 0, 1), gain(n, 1, 0))

    assert both(found.records) >= 2 * np.log(20) * (1 - 1e-3)
    assert both(found.records - 1) < 2 * np.log(20) * (1 + 1e-3)


def test_uncertain_sensitivities_of_a_nuisance_parameter_make_the_advice_dearer():
    option = RecordingOption("sharp", {}, along([20, 0, 0, 0, 9], [0, 15, 0, 0, -9]))
    certain, doubtful = np.zeros((5, 5)), np.diag([0, 0, 0, 0, 0.05**2])
    (sure,) = advise(alike(), (["p0"], ["p1"]), [option], certain)
    (unsure,) = advise(alike(), (["p0"], ["p1"]), [option], doubtful)
    assert unsure.records > sure.records


def test_a_rival_contained_in_the_other_counts_in_one_direction_only():
    option = RecordingOption("sharp", {}, along([20, 0, 0, 0], [0, 15, 0, 0]))
    (found,) = advise(alike(change=0.05), (["p0"], ["p0", "p2"]), [option], np.zeros((4, 4)))
    assert found.noncentrality >= 0
    with pytest.raises(ValueError, match="same set"):
        advise(alike(), (["p0"], ["p0"]), [option], np.zeros((4, 4)))


def test_conditions_of_the_toy_engine_become_options_with_their_information():
    monitor = toy_monitor()
    conditions = {"altitude_m": np.array([0.0, 9e3, 14e3]), "mach": np.full(3, 0.5), "Wf_kg_s": np.ones(3)}
    options = condition_options(monitor, conditions)
    assert [o.values["altitude_m"] for o in options] == [0.0, 9e3]  # the engine cannot compute 14 km
    for option in options:
        assert np.linalg.eigvalsh(option.information).min() > -1e-6 * np.trace(option.information)


def test_a_further_sensor_adds_information_and_less_noise_adds_more():
    monitor = toy_monitor()
    recording = toy_recording(np.random.default_rng(1), 50)
    inputs = {c: recording.columns[c] for c in monitor.engine.inputs}
    base, sharp = sensor_options(monitor, inputs, {"T5_K": 0.5})
    _, coarse = sensor_options(monitor, inputs, {"T5_K": 5.0})
    i = 3
    assert base.information[i, i] < coarse.information[i, i] < sharp.information[i, i]


def test_the_grid_of_the_turbofan_lies_in_its_envelope_and_where_aircraft_fly():
    engine = load_engine(ENGINE)
    grid = conditions_grid(engine)
    assert set(grid) == set(engine.inputs) and 20 < len(grid["mach"]) < 200
    for column, (low, high) in engine.envelope.items():
        assert grid[column].min() >= low and grid[column].max() <= high
    high = grid["altitude_m"] > 8000
    assert grid["mach"][high].min() > 0.3 and grid["mach"][~high].max() < 0.7


def test_without_a_further_sensor_there_are_only_the_present_ones():
    monitor = toy_monitor()
    recording = toy_recording(np.random.default_rng(1), 50)
    (only,) = sensor_options(monitor, {c: recording.columns[c] for c in monitor.engine.inputs}, {})
    assert only.label == "present sensors" and only.information.any()
