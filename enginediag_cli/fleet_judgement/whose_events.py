"""Which engine each event of a file of maintenance is of."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from enginediag_cli.config.hints import near
from enginediag_cli.errors import DataError
from enginediag_cli.fleet_judgement.history import Event


def events_by_engine(
    events: Sequence[Event], engines: Collection[str], path: str
) -> tuple[dict[str, tuple[Event, ...]], tuple[str, ...]]:
    """Events of a file by the `engines` that are recorded, and the names in it of which nothing is. One engine needs no
    name, in recordings or in events. Raises DataError where it is not known whose events are, or nobody's are here."""
    names = tuple(dict.fromkeys(e.engine for e in events if e.engine))
    told = ", ".join(names)
    if len(names) > 1 and "" in engines:
        raise DataError(f"{path}: events of several engines ({told}), and the recordings name none: keep those of one")
    if len(engines) > 1 and any(not e.engine for e in events):
        raise DataError(f"{path}: an event names no engine, and the recordings are of {len(engines)}")
    if set(engines) == {""}:
        return {"": tuple(events)}, ()
    unknown = tuple(name for name in names if name not in engines)
    if unknown and len(unknown) == len(names) and all(e.engine for e in events):
        raise DataError(f"{path}: no recording is of engine {told}; {near(unknown[0], engines)}")
    mine = {engine: tuple(e for e in events if e.engine in ("", engine)) for engine in engines}
    return mine, unknown
