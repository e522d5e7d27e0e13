"""What was there from the first flight on, or came at once, is no growth: the margin is less, and lasts as long."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from enginediag_cli.detection.forecast import fit_laws, forecast, unknown_population
from enginediag_cli.fleets.margin import _margin_course
from enginediag_cli.history.hypotheses import FROM_START, STEP


def found(kind: str, onset: int) -> Any:
    """A history of 20 flights with one event of a component."""
    event = SimpleNamespace(instrument=False, onset=onset)
    return SimpleNamespace(flights=20, events=(event,), family=lambda _: kind, flight_number=lambda epoch: epoch + 1)


@pytest.mark.parametrize("kind, onset", [(FROM_START, 0), (STEP, 10)])
def test_a_constant_loss_of_margin_is_not_extrapolated(kind, onset) -> None:
    used = np.where(np.arange(10) * 2 >= onset, 15.0, 0.0)
    health = SimpleNamespace(
        knots=tuple(range(0, 20, 2)), steps=(), project_stretches=lambda slope: (used, 0.25 * np.eye(10))
    )
    course = _margin_course(found(kind, onset), health, np.zeros(0), 1)
    assert course is not None
    left = forecast(fit_laws(course, 30.0), unknown_population(), 30.0)
    assert left.rate == pytest.approx(0.0, abs=0.1)
    assert left.quantile(0.5) > 100
