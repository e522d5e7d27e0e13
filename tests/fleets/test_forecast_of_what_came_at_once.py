"""What was there from the first flight on, or came at once, is no growth: the margin is less, and lasts as long."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from turbofan_fleet import engine_history, geometry, judged, lost, scale

from enginediag_cli.detection.forecast import fit_laws, forecast, unknown_population
from enginediag_cli.fleets.findings import FleetSettings
from enginediag_cli.fleets.margin import PASSED, _margin_course, add_forecasts
from enginediag_cli.history.hypotheses import FROM_START, STEP
from enginediag_cli.report.tables.fleet import margin_words


def found(kind: str, onset: int) -> Any:
    """A history of 20 flights with one event of a component."""
    event = SimpleNamespace(instrument=False, onset=onset, kind=kind, end=-1)
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


@pytest.mark.parametrize("seed", [21, 22])
def test_fouling_that_has_levelled_out_short_of_the_limit_gives_no_number_of_flights(seed) -> None:
    """Of two thirds of the margin, with a time constant of five flights: as it is now it will be."""
    flights = 60
    course = -np.expm1(-np.maximum(np.arange(flights) - 24, 0) / 5.0)
    sizes = {"hpc.efficiency": -1.0, "hpc.flow_capacity": -1.2}
    unit = dict(zip(geometry().monitor.monitored, geometry().monitor.prior_sigma, strict=True))
    used_K = sum(scale().slope[name] * size * unit[name] for name, size in sizes.items())
    settings = FleetSettings(limits_K={"T45_K": scale().nominal_K + 1.5 * used_K})
    history = engine_history(np.random.default_rng(seed), "A", flights, lost(flights, sizes, course))
    (finding,) = add_forecasts([judged(history, settings)], settings)
    left = finding.margin.remaining_flights
    assert finding.margin.consumed_K.low < used_K < finding.margin.consumed_K.high
    assert left.low > 10 and left.high == np.inf
    assert "no growth shown at present; not before" in margin_words(finding.margin)


def test_a_limit_that_is_below_what_a_healthy_engine_reads_is_no_missing_limit() -> None:
    settings = FleetSettings(limits_K={"T45_K": scale().nominal_K - 40.0})
    (finding,) = add_forecasts([judged(engine_history(np.random.default_rng(3), "B", 40), settings)], settings)
    assert finding.margin.reason == PASSED
