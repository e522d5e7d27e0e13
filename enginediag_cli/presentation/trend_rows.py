"""The answer of `trend` as rows: one per flight and parameter, or one per parameter with onset and rate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.detection.trend_of_files import EngineTrend, FlightSums


def flight_rows(sums: FlightSums) -> Iterator[dict[str, Any]]:
    """Changes from nominal, in the parameter's unit, with 95 % intervals."""
    from enginediag_cli.detection.trend import flight_change

    counts: Counter[str] = Counter()
    for (engine, source, flight), statistics in sums.flights.items():
        counts[engine] += 1
        found = flight_change(statistics)
        for a, change, error in zip(found.parameters, found.change, found.standard_error, strict=True):
            yield {
                "engine": engine,
                "source": source,
                "flight": flight,
                "number": counts[engine],
                "records": found.records,
                "parameter": a,
                "change": change,
                "low": change - NORMAL_95 * error,
                "high": change + NORMAL_95 * error,
                "unit": sums.known[a].unit,
            }


def trend_rows(trends: Iterable[EngineTrend], sums: FlightSums) -> Iterator[dict[str, Any]]:
    """Changes since the onset, in the parameter's unit, with 95 % intervals."""

    for found in trends:
        for t in found.fit.trends if found.fit is not None else ():
            changed = t.kind != "steady"
            row: dict[str, Any] = {
                "engine": found.engine,
                "flights": found.flights,
                "parameter": t.parameter,
                "kind": t.kind,
                "probability": t.probability,
            }
            values: dict[str, float | None] = {
                "onset": t.onset,
                "onset_low": t.onset_low,
                "onset_high": t.onset_high,
                "change": t.change,
                "change_low": t.change - NORMAL_95 * t.change_error,
                "change_high": t.change + NORMAL_95 * t.change_error,
                "rate_per_flight": t.rate,
                "rate_low": t.rate - NORMAL_95 * t.rate_error,
                "rate_high": t.rate + NORMAL_95 * t.rate_error,
            }
            if t.kind == "step":
                values.update(rate_per_flight=None, rate_low=None, rate_high=None)
            row.update({k: v if changed else None for k, v in values.items()})
            row["unit"] = sums.known[t.parameter].unit
            yield row


def tell_trends(messages: Messages, trends: Iterable[EngineTrend]) -> None:
    """What stood in the way of a trend."""
    for found in trends:
        name = f"engine {found.engine}: " if found.engine else ""
        if found.fit is None:
            messages.warning(f"{name}{found.flights} flights are too few for a trend, which needs three")
        elif not found.fit.converged:
            messages.warning(f"{name}the search for onsets did not settle")
