"""The margin of one engine: flight by flight, how long it lasts, and what maintenance brought."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.presentation.charts.margin import maintenance_marks, margin
from enginediag_cli.presentation.charts.margin_found import Brought, maintenance_found, margin_found
from enginediag_cli.presentation.charts.model import Column, Mark, Table, Value
from enginediag_cli.presentation.charts.order import Order
from enginediag_cli.presentation.maintenance_rows import MAINTENANCE
from enginediag_cli.presentation.margin_rows import margin_words
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import with_unit
from enginediag_cli.presentation.report.evidence import EngineEvidence
from enginediag_cli.presentation.report.page import Block, Tabled, Words
from enginediag_cli.presentation.report.results import kinds

NOT_FOLLOWED = (
    "Cannot tell the margin of the turbine temperature, because none of these results follows it: "
    "`trend --what margin --limit COLUMN KELVIN` does."
)


def margin_blocks(engine: EngineEvidence, key: str) -> Iterator[Block]:
    """Nothing where no result is of flights at all."""
    rows = engine.of(kinds.MARGIN)
    found = margin_found(rows)
    if found is None:
        if engine.of(kinds.TREND) or engine.of(kinds.FLIGHTS):
            yield Words(NOT_FOLLOWED, quiet=True)
        return
    told = margin_words(found.margin)
    yield Words(f"{told[0].upper()}{told[1:]}.")
    chart = margin(f"{key}-margin", found, maintenance_marks(found))
    if chart is not None:
        yield chart
    yield from _table(maintenance_found(rows))


def maintenance_in(engine: EngineEvidence, order: Order) -> list[Mark]:
    """Maintenance at its place among the flights of another chart."""
    told = {x.event.number: x.event.words for x in maintenance_found(engine.of(kinds.MARGIN))}
    for row in engine.of(kinds.TREND):
        if row.text("kind") == MAINTENANCE:
            told.setdefault(row.count("onset"), MAINTENANCE)
    places = ((order.at(number), words) for number, words in sorted(told.items()) if number)
    return [Mark(x, words) for x, words in places if x is not None]


COLUMNS = (
    Column("maintenance"),
    Column("before flight"),
    Column("what changed, 95 %"),
    Column("turbine temperature"),
    Column("fuel flow"),
    Column("margin recovered"),
    Column("note"),
)


def _table(events: Sequence[Brought]) -> Iterator[Block]:
    if not events:
        return
    rows: list[tuple[Value, ...]] = []
    for x in events:
        e = x.event
        rows.append(
            (
                e.words,
                x.flight or e.number or "none recorded",
                listed(list(x.gains)),
                _fell(x.temperature_K, "K"),
                _fell(x.fuel_percent, "%"),
                _size(e.recovered_K, "K"),
                e.reason,
            )
        )
    held = next((x.held for x in events if x.held), "")
    title = "What maintenance brought" + (f" ({held})" if held else "")
    yield Tabled(title, Table(COLUMNS, rows, [x.event.origin for x in events]))


def _fell(gain: Estimate, unit: str) -> str:
    """A gain is a fall of temperature or fuel."""
    if not math.isfinite(gain.value):
        return ""
    size = with_unit(abs(gain.value), unit, (gain.high - gain.low) / 2)
    return f"{'fell' if gain.value >= 0 else 'rose'} by {size}"


def _size(x: Estimate, unit: str) -> str:
    if not math.isfinite(x.value):
        return ""
    return with_unit(x.value, unit, (x.high - x.low) / 2).replace("-", "−")
