"""Health of one flight from its statistics; the readings of a series and what they wander by."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.detection.series import (
    EpochStatistics,
    InputReadings,
    build_readings,
    estimate_flight_change,
    level_step,
)
from enginediag_cli.detection.wander import LOCAL, ScatterLaws, structure_functions
from enginediag_cli.isolation.events import UNRECORDED
from enginediag_cli.isolation.timeline import TrendOptions, judge_series
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.statistics import LocalStatistics

SENSORS = ("sensor.T3.bias", "sensor.P3.bias", "sensor.T5.bias", "sensor.N2.bias")
HEALTH = ("fan.efficiency", "hpc.efficiency", "hpt.efficiency")
EFFECT = np.array([[1.0, 4.0, 0.5], [3.0, -2.0, 1.0], [-2.0, -3.0, 4.0], [1.0, 1.0, 3.0]])  # of one prior sigma
MEANING = {
    **{
        n: Parameter(n, "health", 1.0, 0.5, 1.5, 0.02, component=n.split(".")[0], quantity="efficiency") for n in HEALTH
    },
    **{n: Parameter(n, "sensor", 0.0, -9, 9, 3.0, component=n[: n.rindex(".")], quantity="bias") for n in SENSORS},
}


def flights(rng, changes, wander=0.0):
    """Statistics of flights in which the parameters have the changes (n, 7), in prior sigmas; readings of noise 1
    wander by so much from flight to flight."""
    changes = np.asarray(changes)
    sigma = np.array([MEANING[name].prior_sigma for name in MEANING])
    J = np.concatenate([EFFECT, 3 * np.eye(4)], axis=1) / sigma
    off = np.cumsum(wander * rng.standard_normal((len(changes), 4)), axis=0)
    e = (changes * sigma) @ J.T + rng.standard_normal((len(changes), 4)) + off
    F = J.T @ J
    fixed = {"theta0": np.zeros(7), "prior_sigma": sigma, "F": F, "V": F, "n": 1, "chi2": 4.0, "dof": 4.0}
    return [LocalStatistics(parameters=tuple(MEANING), s=J.T @ row, **fixed) for row in e]


def judged(statistics):
    clock = np.arange(len(statistics), dtype=float)
    return judge_series(build_readings(statistics, list(MEANING.values()), clock), MEANING)


def test_summed_flights_are_estimated_as_generalised_least_squares_does():
    rng = np.random.default_rng(1)
    one, two = flights(rng, np.zeros((2, 7)))
    prior = np.diag(one.prior_sigma**-2.0)
    expected = np.linalg.solve(one.F + two.F + prior, one.s + two.s)
    found = estimate_flight_change(one + two)
    np.testing.assert_allclose(found.change, expected)
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(np.linalg.inv(one.F + two.F + prior))))


def test_statistics_with_all_sensors_hold_the_readings_themselves():
    rng = np.random.default_rng(2)
    changes = np.zeros((6, 7))
    changes[3:, 4] = 2.0  # of the second sensor
    found = build_readings(flights(rng, changes), list(MEANING.values()), np.arange(6.0))
    again = np.random.default_rng(2)
    again.standard_normal((6, 4))  # what the readings wander by
    noise = again.standard_normal((6, 4))
    expected = noise.copy()
    expected[3:, 1] += 6.0
    np.testing.assert_allclose(found.z, expected, atol=1e-9)
    np.testing.assert_allclose(found.J[0, :, :3], EFFECT, atol=1e-9)


def test_rows_of_the_biases_alone_hold_the_same_readings():
    rng = np.random.default_rng(4)
    whole = flights(rng, rng.standard_normal((6, 7)))
    whole = [a + b for a, b in zip(whole, whole[::-1], strict=True)]
    parts = [EpochStatistics.from_statistics(x, SENSORS) for x in whole]
    assert parts[0].information.shape == (4, 7)
    expected, found = (build_readings(x, list(MEANING.values()), np.arange(6.0)) for x in (whole, parts))
    np.testing.assert_array_equal(found.z, expected.z)
    np.testing.assert_array_equal(found.J, expected.J)
    one, two = (EpochStatistics.from_statistics(x, SENSORS) for x in whole[:2])
    np.testing.assert_array_equal((one + two).information, one.information + two.information)


def test_a_step_of_one_reading_is_told_as_one_of_that_instrument_with_its_onset():
    changes = np.zeros((60, 7))
    changes[35:, 5] = -2.0
    (event,) = judged(flights(np.random.default_rng(3), changes)).events
    assert (event.members[0].component, event.kind, event.onset) == ("sensor.T5", "step", 36)
    assert event.probability > 0.99 and abs(event.members[0].change[0] + 6.0) < 3 * event.members[0].deviation[0]


def test_a_step_of_one_reading_stands_out_where_all_readings_wander():
    changes = np.zeros((200, 7))
    changes[120:, 5] = 4.0
    (event,) = judged(flights(np.random.default_rng(4), changes, wander=0.5)).events
    assert (event.members[0].component, event.kind) == ("sensor.T5", "step") and abs(event.onset - 121) <= 2


def test_wear_is_told_as_wear_of_its_component_with_its_size():
    changes = np.zeros((60, 7))
    changes[:, 1] = -0.05 * np.maximum(np.arange(60) - 19, 0)
    (event,) = judged(flights(np.random.default_rng(5), changes)).events
    member = event.members[0]
    assert (member.component, event.kind) == ("hpc", "deterioration") and event.low <= 21 <= event.high + 1
    assert abs(member.change[0] + 0.04) < 0.006


def test_nothing_is_told_of_flights_in_which_nothing_changed():
    stories = [judged(flights(np.random.default_rng(k), np.zeros((40, 7)), w)) for k in range(8) for w in (0.0, 0.5)]
    assert sum(bool(story.events) for story in stories) <= 2


def test_a_step_is_not_learnt_as_scatter_of_neighbours():
    rng = np.random.default_rng(6)
    z = rng.standard_normal((300, 2))
    stepped = z + np.where(np.arange(300) < 150, 0.0, 30.0)[:, None] * [1.0, 0.0]
    _, plain = structure_functions(np.arange(300.0), z, np.eye(2))
    _, found = structure_functions(np.arange(300.0), stepped, np.eye(2))
    assert found[0][0, 0] < 1.2 * plain[0][0, 0]


@pytest.mark.parametrize("stated", [1.0, 100.0])
def test_what_is_stated_of_the_noise_does_not_stand_for_scatter_that_many_epochs_show(stated):
    """An error of the model that is the same in all epochs is in the stated noise, and not in their differences."""
    z = np.random.default_rng(20).standard_normal((300, 3)) * [1.0, 0.5, 0.2]
    _, found = structure_functions(np.arange(300.0), z, stated * np.eye(3))
    assert np.all(np.abs(np.sqrt(np.diag(found[0])) / [1.0, 0.5, 0.2] - 1) < 0.15)


def test_of_few_epochs_scatter_is_held_by_what_is_stated_of_the_noise():
    z = 0.01 * np.random.default_rng(21).standard_normal((6, 3))
    _, found = structure_functions(np.arange(6.0), z, np.eye(3))
    assert np.all(np.diag(found[0]) > 0.3)


def test_scatter_that_is_larger_for_a_while_counts_as_larger_there():
    rng = np.random.default_rng(22)
    n, some = 10 * LOCAL, slice(6 * LOCAL, 8 * LOCAL)
    changes = np.zeros((n, 7))
    changes[some, 3:] = rng.standard_normal((2 * LOCAL, 4))  # three times the noise
    series = build_readings(flights(rng, changes), list(MEANING.values()), np.arange(float(n)))
    (law,) = ScatterLaws(series).estimate(np.zeros_like(series.z), [True])
    own = np.einsum("kii->ki", law.inverse)
    assert np.all(own[:, some].mean(axis=1) < 0.4 * own[:, : 5 * LOCAL].mean(axis=1))


def test_no_event_is_told_of_a_while_in_which_readings_wander_more():
    told = []
    for seed in range(3):
        rng = np.random.default_rng(30 + seed)
        changes = np.zeros((200, 7))
        changes[140:180, 3:] = np.cumsum(0.3 * rng.standard_normal((40, 4)), axis=0)
        told.append(bool(judged(flights(rng, changes)).events))
    assert sum(told) <= 1


def test_a_large_step_of_one_reading_is_its_instruments_and_no_components_where_readings_wander():
    changes = np.zeros((200, 7))
    changes[120:, 5] = 20.0
    (event,) = judged(flights(np.random.default_rng(23), changes, wander=0.5)).events
    assert [m.component for m in event.named] == ["sensor.T5"] and event.onset == 121


def test_wear_that_is_slow_at_first_and_fast_at_last_is_told_as_wear_of_its_component_alone():
    t = np.arange(80) / 79
    changes = np.zeros((80, 7))
    changes[:, 1] = -0.6 * t - 1.5 * t**8
    story = judged(flights(np.random.default_rng(24), changes))
    assert [[m.component for m in e.named] for e in story.events] == [["hpc"]]
    assert story.events[0].kind == "deterioration"


def test_a_level_that_steps_is_found_with_its_size_and_no_step_in_what_wanders():
    rng = np.random.default_rng(25)
    level = 1373.0 + 0.2 * rng.standard_normal(300) - 5.0 * (np.arange(300) >= 210)
    assert abs(level_step(level) + 5.0) < 0.1
    assert level_step(np.cumsum(rng.standard_normal(300))) == 0.0 == level_step(level[:8])


def test_joined_epochs_do_not_reach_over_long_times_without_any():
    clock = np.arange(100.0) + np.where(np.arange(100) >= 53, 1000.0, 0.0)
    series = build_readings(flights(np.random.default_rng(26), np.zeros((100, 7))), list(MEANING.values()), clock)
    joined = series.merge_epochs(20)
    assert len(joined) <= 20 and 53 in joined.first and joined.flights.sum() == 100


def test_a_walk_of_few_flights_seldom_tells_of_a_change():
    rngs = [np.random.default_rng(500 + k) for k in range(20)]
    assert sum(bool(judged(flights(rng, np.zeros((8, 7)), wander=1.0)).events) for rng in rngs) <= 3


INPUT = "input.T0.bias"
OF_INPUT = np.array([1.0, -2.0, 1.5, 0.5])  # of one prior sigma


def judged_with_an_input(rng, in_readings, in_input, governed=(), n=80):
    """Flights of which an input is read as well; both step at the fiftieth."""
    step = (np.arange(n) >= 50).astype(float)
    e = rng.standard_normal((n, 4)) + in_readings * step[:, None] * OF_INPUT
    known = {**MEANING, INPUT: Parameter(INPUT, "input", 0.0, -9, 9, 1.0, component="input.T0", quantity="bias")}
    J = np.concatenate([EFFECT / 0.02, np.eye(4), OF_INPUT[:, None]], axis=1)
    sigma = np.array([p.prior_sigma for p in known.values()])
    fixed = {"theta0": np.zeros(8), "prior_sigma": sigma, "F": J.T @ J, "V": J.T @ J, "n": 1, "chi2": 4.0, "dof": 4.0}
    statistics = [LocalStatistics(parameters=tuple(known), s=J.T @ row, **fixed) for row in e]
    read = {"T0_K": InputReadings(0.1 * rng.standard_normal(n) + in_input * step, {INPUT: np.ones(n)})}
    series = build_readings(statistics, list(known.values()), np.arange(float(n)), None, read)
    return judge_series(series, known, TrendOptions(governed=governed))


def test_an_input_whose_own_readings_step_with_the_others_is_named():
    (event,) = judged_with_an_input(np.random.default_rng(8), 1.5, 1.5).events
    assert (event.members[0].component, event.kind, event.onset) == ("input.T0", "step", 51)
    assert event.members[0].probability > 0.99 and abs(event.members[0].change[0] - 1.5) < 0.2


def test_an_input_whose_own_readings_stay_has_not_stepped_but_where_a_governor_holds_it():
    told = {governed: judged_with_an_input(np.random.default_rng(9), 3.0, 0.0, governed) for governed in ((), (INPUT,))}
    free, held = ({m.component: m.probability for e in story.events for m in e.members} for story in told.values())
    assert free.get("input.T0", 0.0) < 0.01 and held["input.T0"] > 0.5


def test_a_true_change_of_an_input_that_the_model_follows_is_no_event():
    assert not judged_with_an_input(np.random.default_rng(10), 0.0, 1.5).events


def test_a_component_that_steps_where_readings_wander_is_told_beside_operation_that_nobody_recorded():
    changes = np.zeros((200, 7))
    changes[120:, 1] = -2.0
    (event,) = judged(flights(np.random.default_rng(11), changes, wander=0.5)).events
    assert {m.component for m in event.named} == {"hpc", UNRECORDED}


@pytest.mark.parametrize("wander", [0.0, 0.5])
def test_healthy_series_of_any_length_seldom_tell_of_a_change(wander):
    told = [
        bool(judged(flights(np.random.default_rng(100 * n + k), np.zeros((n, 7)), wander)).events)
        for n in (12, 20, 60)
        for k in range(10)
    ]
    assert sum(told) <= 5  # 99 % point of the binomial law for 30 series at 5 %


def test_two_flights_are_no_trend():
    with pytest.raises(ValueError, match="three flights"):
        judged(flights(np.random.default_rng(7), np.zeros((2, 7))))


def test_three_flights_are_judged():
    assert judged(flights(np.random.default_rng(12), np.zeros((3, 7)))).flights == 3


def test_readings_that_wander_leave_open_what_readings_that_scatter_settle():
    """What a walk of the readings does, wear does, too: nothing is named, and nothing called steady."""
    calm = [judged(flights(np.random.default_rng(5100 + k), np.zeros((40, 7)))) for k in range(4)]
    assert all(not story.events and story.undecided is None for story in calm)
    walks = [judged(flights(np.random.default_rng(5200 + k), np.zeros((40, 7)), 1.0)) for k in range(4)]
    assert sum(story.undecided is not None for story in walks) >= 3
