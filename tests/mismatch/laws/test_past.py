"""What followers in a formula are over the records of a fit."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.engine.dual import Dual
from enginediag_cli.engine.filters import Backlash, FilterClock, Lag
from enginediag_cli.engine.recall import MOMENT, NO_MOMENT
from enginediag_cli.mismatch.laws.past import clock_of, past_along
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.law import Expression

N = 60
TURBOJET = Path(__file__).parents[3] / "configs" / "turbojet.yaml"


@pytest.fixture
def course() -> tuple[FilterClock, np.ndarray]:
    """Two stretches of half a minute between records, and a variable that goes up and down."""
    first = np.isin(np.arange(N), [0, 25])
    time = 30.0 * np.arange(N) + np.where(np.arange(N) < 25, 0.0, 5000.0)
    return FilterClock(time, first), 0.8 + 0.2 * np.sin(np.arange(N) / 5.0)


def test_a_follower_is_its_signal_and_what_the_filter_makes_of_it(course) -> None:
    clock, x = course
    text = Expression.parse("2 * lagged(x, t) + backlash(x, h)")
    none = np.zeros((0, N))
    lagged = x + Lag()(clock, x, none, (90.0,)).value
    dragged = x + Backlash()(clock, x, none, (0.1,)).value
    assert np.allclose(text.evaluate({"x": x, "t": 90.0, "h": 0.1}, past_along(clock)), 2.0 * lagged + dragged)
    assert np.allclose(text.evaluate({"x": x, "t": 90.0, "h": 0.1}), 3.0 * x)  # nothing is known of a past


def test_many_tries_at_once_are_each_of_them(course) -> None:
    clock, x = course
    text, tries = Expression.parse("limited(x, s, s)"), np.array([[10.0], [600.0], [3000.0]])
    found = text.evaluate({"x": x, "s": tries}, past_along(clock))
    for row, s in zip(np.asarray(found), tries[:, 0], strict=True):
        assert np.array_equal(row, text.evaluate({"x": x, "s": float(s)}, past_along(clock)))


@pytest.mark.parametrize("text", ["lagged(x, p)", "limited(x, p, p)"])
def test_derivatives_by_its_coefficients_are_those_of_differences(course, text: str) -> None:
    clock, x = course
    expression, at, h = Expression.parse(text), 220.0, 1e-3
    found = expression.evaluate(
        {"x": x, "p": Dual(np.full(N, at), np.vstack([np.zeros(N), np.ones(N)]))}, past_along(clock)
    )
    assert isinstance(found, Dual)
    high, low = (np.asarray(expression.evaluate({"x": x, "p": at + d}, past_along(clock))) for d in (h, -h))
    assert np.allclose(found.d[1], (high - low) / (2.0 * h), atol=1e-6 * np.abs(found.d[1]).max())


def fit_of(*times: np.ndarray) -> SimpleNamespace:
    """As much of a fit as its clock asks of it, of recordings at these times."""
    engine = load_engine(TURBOJET)
    moments = [engine.tapes.add({"time_s": t, "Wf_kg_s": np.ones(len(t))}) for t in times]
    problem = SimpleNamespace(inputs={MOMENT: np.concatenate(moments)})
    return SimpleNamespace(problem=problem, evidence=SimpleNamespace(engine=engine))


def test_recordings_along_time_have_a_clock_with_a_stretch_each() -> None:
    clock = clock_of(fit_of(np.arange(0.0, 900.0, 30.0), np.arange(0.0, 600.0, 20.0)))
    assert clock is not None and np.flatnonzero(clock.first).tolist() == [0, 30]


def test_records_that_stand_alone_are_no_course() -> None:
    assert clock_of(fit_of(np.arange(0.0, 360000.0, 3600.0))) is None


def test_where_a_past_is_not_known_there_is_none() -> None:
    found = fit_of(np.arange(0.0, 900.0, 30.0))
    found.problem.inputs[MOMENT][3] = NO_MOMENT
    assert clock_of(found) is None and clock_of(SimpleNamespace(problem=SimpleNamespace(inputs={}))) is None
