"""Rows and sentences of `trend` about what restoring would bring and what maintenance did bring."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.detection.trend_of_files import Series
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.work_scope_rows import (
    maintenance_cell,
    maintenance_sentence,
    work_scope_cell,
    work_scope_sentences,
)
from enginediag_cli.work_scope.maintenance import Maintenance
from enginediag_cli.work_scope.scope import Scoping, WorkScope

MAINTENANCE = "maintenance"
"""`kind` of the rows of what maintenance did bring."""


def tell_scope(messages: Messages, engine: str, scope: WorkScope | None) -> None:
    """What restoring the components of the events would bring, in words."""
    name = f"engine {engine}: " if engine else ""
    for sentence in work_scope_sentences(scope) if scope is not None else ():
        messages.note(f"{name}{sentence}")


def with_scope(rows: Iterable[Mapping[str, Any]], scope: WorkScope | None, form: str) -> Iterator[dict[str, Any]]:
    """Rows with what restoring would bring; form: "" without, "cell" as text, "nested" in full."""
    told = work_scope_cell(scope) if form == "nested" else None if scope is None else list(work_scope_sentences(scope))
    for row in rows:
        yield {**row, "work_scope": told} if form else {**row}


def tell_maintenance(messages: Messages, engine: str, found: Maintenance, series: Series, scoping: Scoping) -> None:
    """What maintenance did bring, in words."""
    name = f"engine {engine}: " if engine else ""
    label = series.stretches[engine][found.flight - 1].window.flight or str(found.flight)
    told = maintenance_sentence(found, series.known, scoping.reference({}))
    messages.note(f"{name}maintenance before flight {label}: {told}")


def maintenance_row(
    engine: str, found: Maintenance, series: Series, scoping: Scoping, form: str, others: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """One row with the columns of the `others`, as far as they apply; form: as of `with_scope`."""
    window = series.stretches[engine][found.flight - 1].window
    reference = scoping.reference({})
    told = maintenance_sentence(found, series.known, reference)
    described = [series.known[n].component for n in found.names]
    own = {
        "engine": engine,
        "flights": len(series.stretches[engine]),
        "verdict": "changed" if found.names else "steady",
        "kind": MAINTENANCE,
        "components": list(dict.fromkeys(described)),
        "component": list(dict.fromkeys(described)),
        "parameter": list(found.names),
        "probability": found.probability,
        "onset": found.flight,
        "onset_flight": window.flight,
        "onset_source": window.source,
        "onset_line": window.first_line,
        "change": list(found.change),
        "work_scope": maintenance_cell(found, reference) if form == "nested" else [told],
    }
    columns = dict.fromkeys([*(others[0] if others else own), "work_scope"])
    return {column: own.get(column) for column in columns}
