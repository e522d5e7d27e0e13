"""Maintenance of a fleet, out of a CSV file: which engine, what was done, before which flight or when."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite, nan
from pathlib import Path

from enginediag_cli.config.hints import near
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.fleet_judgement.history import KINDS, Event
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.table import Recording

COLUMNS = ("engine", "kind", "flight", "time_s", "component")


def read_events(path: Path, *, named: bool = True) -> tuple[Event, ...]:
    """Events in the order of the file; named: each says its engine, as it must where there are several. Raises
    ConfigError with every row that is wrong."""
    try:
        table = read_all(str(path), declared=("time_s",), by_suffix=False)
    except DataError as error:
        raise ConfigError([Problem(Mark(str(path)), str(error))]) from None
    head = Mark(str(path), int(table.line[0]) - 1 if len(table) else 0)
    known = {*table.text, *table.columns}
    problems = [
        Problem(head, f"unknown column {column!r}", near(column, COLUMNS))
        for column in table.order
        if column not in COLUMNS
    ]
    needed = COLUMNS[:2] if named else COLUMNS[1:2]
    problems += [Problem(head, f"no column {c!r}", "columns: " + ", ".join(COLUMNS)) for c in needed if c not in known]
    if not known & {"flight", "time_s"}:
        problems.append(Problem(head, "no column 'flight' and none 'time_s'", "one of them says when an event was"))
    if problems:
        raise ConfigError(problems)
    events = []
    for k in range(len(table)):
        event = _event(table, k)
        place = Mark(str(path), int(table.line[k]))
        wrong = list(_wrong(event, place, named))
        problems += wrong
        if not wrong:
            events.append(event)
    if problems:
        raise ConfigError(problems)
    return tuple(events)


def _event(table: Recording, k: int) -> Event:
    def text(column: str) -> str:
        return table.text[column][k].strip() if column in table.text else ""

    time = float(table.columns["time_s"][k]) if "time_s" in table.columns else nan
    return Event(text("engine"), text("kind"), text("flight"), time, text("component"))


def _wrong(event: Event, place: Mark, named: bool) -> Iterator[Problem]:
    if named and not event.engine:
        yield Problem(place, "the event names no engine", "its serial number belongs in the column 'engine'")
    if event.kind not in KINDS:
        yield Problem(place, f"unknown kind of event {event.kind!r}", near(event.kind, KINDS))
    if bool(event.flight) == isfinite(event.time_s):
        what = "both a flight and a time" if event.flight else "neither a flight nor a time"
        yield Problem(place, f"the event has {what}", "the first flight after it, or time_s")
