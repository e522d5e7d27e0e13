"""Results sorted by engine: all that is known of each, whichever files it came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter, unspecified
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.results.kinds import Kind
from enginediag_cli.presentation.report.results.read import Result
from enginediag_cli.presentation.report.results.records import records_of
from enginediag_cli.residuals.window import WindowStatistics


@dataclass
class EngineEvidence:
    """Rows of one engine, by kind and in the order of the files, its windows of statistics with their places, its
    residuals, and how many readings of each sensor were masked."""

    engine: str
    rows: dict[Kind, list[Row]] = field(default_factory=dict)
    windows: list[tuple[WindowStatistics, Origin]] = field(default_factory=list)
    records: Records | None = None
    masked: dict[str, int] = field(default_factory=dict)

    def of(self, kind: Kind) -> list[Row]:
        return self.rows.get(kind, [])

    @property
    def isolated(self) -> list[list[Row]]:
        """Rows of `isolate`, window by window."""
        return windows_of(self.of(kinds.ISOLATED))


@dataclass
class Evidence:
    """All of it; `known`: what parameters mean, as far as any file says."""

    results: Sequence[Result]
    engines: dict[str, EngineEvidence]
    known: dict[str, Parameter]

    _told: dict[tuple[str, ...], str] = field(default_factory=dict, repr=False)

    def add(self, kind: Kind, row: Row, by: str) -> None:
        """Take a row over; by: the file, or what else, that tells it. Raises DataError where another one tells the
        same window or parameter, which would count twice."""
        engine = row.text("engine")
        place = (kind.name, engine, *(row.text(name) for name in PLACE))
        before = self._told.setdefault(place, by)
        if before != by:
            of = f"engine {engine}" if engine else "an engine without a name"
            raise DataError(f"{before} and {by} both tell {kind.name} of the same part of {of}: give one of them")
        self.engines.setdefault(engine, EngineEvidence(engine)).rows.setdefault(kind, []).append(row)

    def documents(self, kind: Kind) -> list[Result]:
        return [result for result in self.results if result.kind is kind]


PLACE = ("source", "flight", "first_line", "last_line", "parameter", "components", "block")
"""Cells that say of which window or parameter a row is, as far as it has them."""


def evidence_of(results: Sequence[Result], known: Mapping[str, Parameter] | None = None) -> Evidence:
    """Raises DataError for damaged statistics."""
    from enginediag_cli.residuals.additive import marginalised
    from enginediag_cli.residuals.statistics_file import Ledger, read_statistics

    found = Evidence(results, {}, dict(known or {}))
    ledger = Ledger()
    for result in results:
        if result.kind is kinds.RECORDS:
            _records(found, result)
            continue
        for row in result.rows if result.kind is not kinds.LOCATED else ():
            found.add(result.kind, row, result.name)
        if result.kind is kinds.STATISTICS:
            first = next(k for k, line in enumerate(result.lines) if not line.startswith("#")) + 2
            for number, (window, meaning) in enumerate(read_statistics(result.lines, result.name, ledger)):
                for name, parameter in meaning.items():
                    found.known.setdefault(name, parameter)
                mine = found.engines.setdefault(window.engine, EngineEvidence(window.engine))
                if window.statistics is not None:
                    window = replace(window, statistics=marginalised(window.statistics))
                mine.windows.append((window, Origin(result.name, str(first + number))))
    for name, unit in _named(found):
        found.known.setdefault(name, unspecified(name, unit))
    return found


def _records(found: Evidence, result: Result) -> None:
    by_engine: dict[str, list[Row]] = {}
    for row in result.rows:
        by_engine.setdefault(row.text("engine"), []).append(row)
    for engine, rows in by_engine.items():
        mine = found.engines.setdefault(engine, EngineEvidence(engine))
        if mine.records is not None:
            raise DataError(f"{result.name}: residuals of these records come from another file, too: give one of them")
        mine.records = records_of(rows)


def _named(found: Evidence) -> Iterator[tuple[str, str]]:
    """Parameters that rows name, with their units."""
    for engine in found.engines.values():
        for kind in (kinds.ISOLATED, kinds.TREND, kinds.FLIGHTS):
            for row in engine.of(kind):
                if name := row.text("parameter"):
                    yield name, row.text("unit")
                for isolated in row.list("isolated"):
                    yield isolated, ""


def windows_of(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows that are of one window together."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        place = tuple(row.text(name) for name in ("source", "flight", "engine", "first_line", "last_line"))
        found.setdefault((row.origin.file, *place), []).append(row)
    return list(found.values())
