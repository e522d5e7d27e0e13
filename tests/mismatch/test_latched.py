"""States of a switch that no column records are given back by two thresholds of something recorded, where they are."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.filters import FilterClock
from enginediag_cli.mismatch.unrecorded.latched import Latched, States, SwitchingDirection, latched

RECORDS, STRETCH, OTHERS = 600, 200, 12
LOWER, UPPER = 0.75, 0.82
FIRST = np.arange(RECORDS) % STRETCH == 0


def course(rng: np.random.Generator) -> np.ndarray:
    """Held for eight records, then elsewhere."""
    return np.repeat(rng.uniform(0.6, 1.0, RECORDS // 8), 8) + 0.005 * rng.normal(size=RECORDS)


def states_of(x: np.ndarray, way: SwitchingDirection) -> np.ndarray:
    """Record by record, as a valve would do it; off at first where nothing tells."""
    on = np.zeros(RECORDS, bool)
    came_from_above = False
    for k, v in enumerate(x):
        came_from_above = v >= UPPER or (came_from_above and v > LOWER and not FIRST[k])
        between = LOWER < v < UPPER
        on[k] = {
            SwitchingDirection.ABOVE: came_from_above,
            SwitchingDirection.BELOW: not came_from_above,
            SwitchingDirection.FALLING: between and came_from_above,
            SwitchingDirection.RISING: between and not came_from_above,
        }[way]
    return on


def found(on: np.ndarray, x: np.ndarray, rng: np.random.Generator, unsure: float = 0.03) -> list[Latched]:
    """With some states that nobody can tell, among other variables that have nothing to do with it, `x` the last."""
    probability = np.where(rng.random(RECORDS) < unsure, 0.5, np.where(on, 0.99, 0.01))
    states = States.of(probability, FilterClock(20.0 * np.arange(RECORDS), FIRST))
    return latched(states, [*(course(rng) for _ in range(OTHERS)), x])


@pytest.mark.parametrize("way", list(SwitchingDirection))
def test_thresholds_and_way_are_read_off_the_states(way: SwitchingDirection) -> None:
    rng = np.random.default_rng(3)
    x = course(rng)
    first, *others = found(states_of(x, way), x, rng)
    assert first.variable == OTHERS and first.way is way and not others
    assert (first.lower, first.upper) == pytest.approx((LOWER, UPPER), abs=0.005)
    assert first.wrong <= 2 and first.sure > 0.9 * RECORDS


@pytest.mark.slow
def test_states_that_come_and_go_by_themselves_follow_nothing() -> None:
    """In at most one of 40 recordings, of some that switch often and some that do seldom: twenty to one in each."""
    rng, told = np.random.default_rng(5), 0
    for k in range(40):
        length = (10, 20, 40, 100)[k % 4]
        on = np.repeat(rng.random(RECORDS // length) < 0.5, length)
        told += bool(found(on, course(rng), rng))
    assert told <= 1


def test_states_that_never_change_follow_nothing() -> None:
    rng = np.random.default_rng(7)
    assert found(np.zeros(RECORDS, bool), course(rng), rng) == []


def test_what_was_before_a_stretch_is_not_held_against_thresholds() -> None:
    """A valve that was open when the recording began stays so between its thresholds: no record of it is wrong."""
    rng = np.random.default_rng(11)
    x = course(rng)
    inside = slice(STRETCH, STRETCH + 8)
    x[inside] = 0.5 * (LOWER + UPPER)
    on = states_of(x, SwitchingDirection.ABOVE)
    on[inside] = True
    (first,) = found(on, x, rng, unsure=0.0)
    assert first.wrong == 0 and first.sure <= RECORDS - 8
