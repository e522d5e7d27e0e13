"""Histories from windows, and what the account of an engine may never say."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.detection.series import Series
from enginediag_cli.errors import DataError
from enginediag_cli.history.background import History, learn_offsets, marginalise_offsets, step_visibility
from enginediag_cli.history.engines import (
    CANNOT_TELL,
    CHANGED,
    EPOCHS,
    OWN_HEALTH,
    STEADY,
    EngineSums,
    EngineTrend,
    HistoryOptions,
    HistoryWindows,
    add_engine_level,
    departing_epochs,
    judge_engine_history,
    judge_engines,
)
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.statistics import LocalStatistics

HEALTH = ("hpc.efficiency", "hpc.flow_capacity", "hpt.efficiency")
SENSORS = ("sensor.T3.bias", "sensor.P3.bias", "sensor.T5.bias", "sensor.N2.bias")
NORMALS = ("nominal.1", "nominal.2")
EFFECT = np.array([[4.0, 1.0, 0.5], [-2.0, 3.0, 1.0], [-3.0, 1.0, 4.0], [1.0, -2.0, 3.0]])
COMMON = np.array([[0.5, 0.1], [0.2, -0.4], [0.1, 0.3], [-0.3, 0.2]])
MEANING = {
    n: Parameter(n, "health", 1.0, 0.5, 1.5, 0.02, component=n.split(".")[0], quantity=n.split(".")[1]) for n in HEALTH
} | {n: Parameter(n, "sensor", 0.0, -9, 9, 3.0, component=n[: n.rindex(".")], quantity="bias") for n in SENSORS}


def statistics(rng: np.random.Generator, change: dict[str, float] | None = None) -> LocalStatistics:
    """Of one flight with four readings of noise one, changed by so many prior standard deviations."""
    sigma = np.array([*(MEANING[n].prior_sigma for n in MEANING), 1.0, 1.0])
    J = np.concatenate([EFFECT, 3 * np.eye(4), COMMON], axis=1) / sigma
    x = np.array([(change or {}).get(n, 0.0) for n in (*MEANING, *NORMALS)]) * sigma
    e = J @ x + rng.standard_normal(4)
    F = J.T @ J
    names = (*MEANING, *NORMALS)
    return LocalStatistics(
        names, np.zeros(9), sigma, J.T @ e, F, F, 1, 4.0, 4.0, additive=True, common=NORMALS, meaning=MEANING
    )


def sums_of(flights: list[LocalStatistics]) -> EngineSums:
    found = EngineSums(flights[0])
    for k, one in enumerate(flights):
        found.add(k, one)
    return found


def calm_history(flights: list[LocalStatistics]) -> History:
    history, _ = sums_of(flights).history(MEANING)
    return marginalise_offsets(history, learn_offsets(history))


@dataclass(frozen=True)
class StubWindow:
    """As much of a window as the sums look at."""

    engine: str
    source: str
    flight: str
    statistics: LocalStatistics | None
    silent: tuple[str, ...] = field(default=())


def trend_of(flights: list[LocalStatistics]) -> EngineTrend:
    sums = sums_of(flights)
    series = Series({"": [SimpleNamespace() for _ in flights]}, MEANING, 0)  # type: ignore[list-item]
    ((_, found),) = judge_engines({"": sums}, series)
    return found


def test_windows_of_a_flight_are_one_epoch_and_keep_what_is_monitored_alone() -> None:
    rng = np.random.default_rng(0)
    flights = [statistics(rng) for _ in range(6)]
    windows = [(StubWindow("A", "a.csv", str(k // 2), x), MEANING) for k, x in enumerate(flights)]
    source = HistoryWindows(SimpleNamespace(windows=lambda: iter(windows), monitor=None, summed=True))  # type: ignore[arg-type]
    kept = [window.statistics for window, _ in source.windows()]
    assert {x.parameters for x in kept if x is not None} == {tuple(MEANING)}
    epochs = source.engines["A"].epochs
    assert [e.first for e in epochs] == [0, 1, 2]
    D = flights[0].prior_sigma
    np.testing.assert_allclose(epochs[1].F, D[:, None] * (flights[2].F + flights[3].F) * D)
    np.testing.assert_allclose(epochs[1].s, D * (flights[2].s + flights[3].s))


def test_statistics_of_other_parameters_are_refused_with_the_engine() -> None:
    rng = np.random.default_rng(0)
    one = statistics(rng)
    windows = [
        (StubWindow("A", "a.csv", "1", one), MEANING),
        (StubWindow("A", "a.csv", "2", one.drop_parameters(["hpt.efficiency"])), MEANING),
    ]
    source = HistoryWindows(SimpleNamespace(windows=lambda: iter(windows), monitor=None, summed=True))  # type: ignore[arg-type]
    with pytest.raises(DataError, match="engine A: statistics of different parameters"):
        list(source.windows())


def test_long_histories_are_summed_over_neighbours_and_lose_nothing() -> None:
    rng = np.random.default_rng(1)
    one = statistics(rng)
    count = 4 * EPOCHS + 7
    sums = sums_of([one] * count)
    history, first = sums.history(MEANING)
    assert len(history) <= EPOCHS + EPOCHS // 2 and first[0] == 0 and list(first) == sorted(set(first))
    D = one.prior_sigma
    whole, F = count * D[:, None] * one.F * D, history.information.sum(axis=0)
    np.testing.assert_allclose(F[:7, :7], whole[:7, :7])
    # unit normals are held along other directions
    np.testing.assert_allclose(F[:7, 7:] @ F[7:, :7], whole[:7, 7:] @ whole[7:, :7], atol=1e-6 * whole.max())
    np.testing.assert_allclose(np.linalg.eigvalsh(F), np.linalg.eigvalsh(whole), atol=1e-6 * whole.max())
    np.testing.assert_allclose(history.score.sum(axis=0)[:7], count * (D * one.s)[:7])


def test_an_engines_own_level_counts_as_a_uniform_change_of_that_size() -> None:
    """Marginal covariance of the scores with the added columns against the dense sum."""
    rng = np.random.default_rng(2)
    history, _ = sums_of([statistics(rng) for _ in range(3)]).history(MEANING)
    p = history.width
    wide = add_engine_level(history)
    assert wide.information.shape[1] == history.information.shape[1] + p
    cross = wide.information[:, :p, history.information.shape[1] :]
    share = np.array([OWN_HEALTH] * 3 + [1.0] * 4)
    np.testing.assert_allclose(cross, history.information[:, :p, :p] * share)
    values = np.linalg.eigvalsh(wide.information)
    assert values.min() > -1e-9 * values.max()


def test_healthy_flights_do_not_depart_and_a_large_error_of_one_does() -> None:
    rng = np.random.default_rng(3)
    flights = [statistics(rng) for _ in range(20)]
    assert departing_epochs(calm_history(flights)) == ()
    flights[7] = statistics(rng, {"sensor.T5.bias": 20.0})
    assert departing_epochs(calm_history(flights)) == (7,)


def test_a_flight_that_departs_is_never_beside_steady() -> None:
    rng = np.random.default_rng(4)
    flights = [statistics(rng) for _ in range(20)]
    assert trend_of(flights).verdict == STEADY
    flights[12] = statistics(rng, {"sensor.P3.bias": 15.0})
    found = trend_of(flights)
    assert found.departures == (13,) and found.verdict in (CHANGED, CANNOT_TELL)


@pytest.mark.parametrize("size", [2.0, 20.0])
def test_a_step_has_its_first_flight_and_its_size(size: float) -> None:
    rng = np.random.default_rng(5)
    found = trend_of([statistics(rng, {"sensor.T3.bias": size} if k >= 9 else {}) for k in range(20)])
    (event,) = found.events
    assert event.group == ("sensor.T3",) and found.family(event) == "step"
    assert found.flight_number(event.onset_set[0]) <= 10 <= found.last_number(event.onset_set[-1])
    (part,) = event.changes
    assert part.now_low <= 3.0 * size <= part.now_high and part.sign == 1


def test_events_of_maintenance_are_places_in_the_history() -> None:
    rng = np.random.default_rng(6)
    course = [min(k - 5, 8) * 0.2 if 5 < k < 16 else 0.0 for k in range(24)]
    flights = [statistics(rng, {"hpc.efficiency": -c, "hpc.flow_capacity": -c}) for c in course]
    sums = sums_of(flights)
    series = Series({"": [SimpleNamespace() for _ in flights]}, MEANING, 0)  # type: ignore[list-item]
    ((_, found),) = judge_engines({"": sums}, series, maintenance={"": [17]})
    (event,) = found.events
    assert event.group == ("hpc",) and found.flight_number(event.end) == 17
    assert replace(found, departures=()).verdict == CHANGED


def test_a_history_needs_a_unit_for_each_parameter() -> None:
    with pytest.raises(ValueError, match="unit"):
        History(tuple(MEANING.values()), np.ones(2), np.zeros((3, 7)), np.zeros((3, 7, 7)))


def test_a_known_move_is_no_change_and_one_elsewhere_is() -> None:
    rng = np.random.default_rng(7)
    flights = [statistics(rng, {"hpt.efficiency": 1.2 if k >= 12 else 0.0}) for k in range(24)]
    sums = sums_of(flights)
    known = HistoryOptions(6, shifts=((13, {"hpt.efficiency": 1.5, "hpt.flow_capacity": 1.5}),))
    assert judge_engine_history(sums, MEANING, known).verdict == STEADY
    assert judge_engine_history(sums, MEANING, HistoryOptions(6)).changes[0].group == ("hpt",)


def test_the_probability_of_a_change_leaves_out_what_was_there_from_the_start() -> None:
    rng = np.random.default_rng(8)
    found = trend_of([statistics(rng, {"sensor.T5.bias": 8.0}) for _ in range(20)])
    assert found.differs_from_start and found.probability < 0.5 < found.posterior.probability
    assert not found.changes


def test_a_step_shows_the_more_the_more_flights_follow_it() -> None:
    rng = np.random.default_rng(9)
    calm = calm_history([statistics(rng) for _ in range(24)])
    plain = [step_visibility(calm, k).squared for k in (12, 18, 22, 24)]
    assert plain == sorted(plain, reverse=True) and plain[-1] == 0.0


def scaled(one: LocalStatistics, share: float) -> LocalStatistics:
    """The same with so small a share of its information."""
    return replace(one, s=one.s * share**0.5, F=one.F * share, V=one.V * share)


def test_flights_that_could_not_have_shown_a_change_do_not_say_that_there_was_none() -> None:
    rng = np.random.default_rng(31)
    flights = [statistics(rng) for _ in range(12)]
    known = trend_of(flights)
    assert known.verdict == STEADY and known.reason == "" and not known.undecided
    assert {known.calm_kind(name) for name in MEANING} == {STEADY}
    blind = trend_of([scaled(one, 1e-3) for one in flights])
    assert blind.verdict == CANNOT_TELL and blind.undecided and blind.visible is not None
    assert "12 flights cannot show a change: even " in blind.reason
    assert {blind.calm_kind(name) for name in MEANING} == {CANNOT_TELL}
    # information is a thousandth of what it was: the same is seen where it is larger by about the root of that
    assert known.visible is not None
    for name, size in known.visible.smallest.items():
        assert blind.visible.smallest[name] > 10 * size


def test_a_parameter_that_no_reading_shows_is_not_called_steady() -> None:
    rng = np.random.default_rng(32)
    flights = []
    for _ in range(10):
        one = statistics(rng)
        i = one.parameters.index("hpt.efficiency")
        F = one.F.copy()
        F[i], F[:, i] = 0.0, 0.0
        s = one.s.copy()
        s[i] = 0.0
        flights.append(replace(one, s=s, F=F, V=F))
    found = trend_of(flights)
    assert found.verdict == STEADY and found.visible is not None
    assert found.calm_kind("hpt.efficiency") == CANNOT_TELL and found.calm_kind("hpc.efficiency") == STEADY
    assert found.visible.smallest["hpt.efficiency"] == np.inf


def test_what_no_component_can_do_is_nothing_that_is_listed() -> None:
    """As of a column in another unit: a compressor that lost half of its efficiency does not run."""
    rng = np.random.default_rng(33)
    flights = [statistics(rng, {"hpc.efficiency": -25.0} if k >= 8 else {}) for k in range(16)]
    found = trend_of(flights)
    assert found.verdict == CANNOT_TELL and not found.events and found.posterior.changed and not found.undecided
    assert found.posterior.unlisted > 0.9 and "hpc.efficiency by −" in found.reason
    assert "outside what a component can do: check units and engine file" in found.reason
    assert found.parameter_probability("hpc.efficiency", "hpc") < 0.5


def test_each_parameter_of_a_component_that_changed_has_its_own_probability() -> None:
    rng = np.random.default_rng(34)
    flights = [statistics(rng, {"hpc.efficiency": -2.0} if k >= 10 else {}) for k in range(24)]
    found = trend_of(flights)
    (event,) = found.changes
    assert event.group == ("hpc",) and found.posterior.inclusion["hpc"] > 0.99
    assert found.parameter_probability("hpc.efficiency", "hpc") > 0.99
    own = {part.name: part.probability for part in event.changes}.get("hpc.flow_capacity", 0.0)
    assert found.parameter_probability("hpc.flow_capacity", "hpc") == pytest.approx(own, abs=1e-3) and own < 0.5


def test_a_history_begins_anew_where_an_engine_was_renewed() -> None:
    rng = np.random.default_rng(10)
    flights = [statistics(rng) for _ in range(12)]
    later, alone = sums_of(flights).since(5), sums_of(flights[5:])
    assert later.flights == alone.flights == 7 and [e.first for e in later.epochs] == list(range(7))
    np.testing.assert_allclose(later.history(MEANING)[0].score, alone.history(MEANING)[0].score, rtol=1e-9)


def test_wear_that_is_slow_at_first_and_fast_at_last_is_wear_of_its_component_alone() -> None:
    rng = np.random.default_rng(24)
    t = np.arange(60) / 59
    found = trend_of([statistics(rng, {"hpc.efficiency": -0.6 * x - 1.5 * x**8}) for x in t])
    assert [event.group for event in found.events] == [("hpc",)] and found.family(found.events[0]) == "deterioration"


def test_healthy_series_of_any_length_seldom_tell_of_a_change() -> None:
    found = [
        trend_of([statistics(rng) for _ in range(n)])
        for n in (8, 12, 20, 40)
        for rng in (np.random.default_rng(100 * n + k) for k in range(8))
    ]
    assert sum(x.verdict != STEADY for x in found) <= 2  # of 32 at 1 %, exceeded once in 300 times
