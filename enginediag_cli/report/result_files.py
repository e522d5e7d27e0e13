"""The kinds of results that a report reads, each recognised by its content and never by the name of its file.

`ResultFile` is a whole file: its kind, its origin, its rows or its document. `Row` gives the cells of a row as texts,
numbers and lists, with its place in the file. `ResidualRecords` are the residuals of records as columns, as
`residual --what records` writes them. The meaning of parameters comes from nominal files.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import dropwhile, islice, pairwise, takewhile
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.isolation.results import restricted_change
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.recordings.source import file_sha256
from enginediag_cli.report.plotting import Axis, RowOrigin, date_words
from enginediag_cli.residuals.flat import is_flat
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.safe_text import shortened, unguarded
from enginediag_cli.units import is_date

NOT_KNOWN = float("nan")


@dataclass(frozen=True)
class Row:
    """`cells` as CSV (texts) or JSON (typed) has them."""

    cells: Mapping[str, Any]
    origin: RowOrigin

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def text(self, name: str) -> str:
        """The text of a cell; empty where there is none."""
        value = self.cells.get(name)
        return "" if value is None else unguarded(value) if isinstance(value, str) else str(value)

    def number(self, name: str) -> float:
        """The number of a cell, NaN where there is none. Raises DataError for words."""
        value = self.cells.get(name)
        if value is None or value == "":
            return NOT_KNOWN
        if isinstance(value, bool):
            return float(value)
        try:
            return float(value)
        except (TypeError, ValueError):
            raise DataError(f"{self.origin.file}:{self.origin.row}:{name}: not a number: {value!r}") from None

    def count(self, name: str) -> int:
        """A whole number, 0 where there is none."""
        value = self.number(name)
        return 0 if math.isnan(value) else round(value)

    def flag(self, name: str) -> bool:
        return str(self.cells.get(name)).lower() in ("true", "1", "1.0")

    def list(self, name: str) -> tuple[str, ...]:
        """The entries of a list: "a; b" in CSV."""
        value = self.cells.get(name)
        if value is None or value == "":
            return ()
        if isinstance(value, (list, tuple)):
            return tuple(str(item) for item in value)
        return tuple(part.strip() for part in unguarded(str(value)).split(";") if part.strip())

    @property
    def window(self) -> str:
        """Which flight or window it is of, as `isolate` says it."""
        if flight := self.text("flight"):
            return f"flight {flight}"
        first, last = self.text("first_line"), self.text("last_line")
        return f"lines {first} to {last}" if first else self.text("source")


def parse_alternative(text: str) -> tuple[tuple[str, ...], float]:
    """An alternative as `isolate` and `trend` write it, "a & b (0.022)": the parameters and their probability."""
    names, _, chance = text.rpartition(" (")
    try:
        value = float(chance.rstrip(")"))
    except ValueError:
        names, value = text, NOT_KNOWN
    return tuple(name.strip() for name in names.split("&") if name.strip() not in ("", "nothing")), value


@dataclass(frozen=True)
class ResidualRecords:
    """Of one engine, in order: `sigmas` and `residual` (n,) by sensor column, in standard deviations of its noise and
    in its unit; `inputs` (n,) by column; `time_s` (n,), NaN where not known; the flight, file and line of each.

    `altitude` and `power`: the inputs that say how high and how hard the engine runs, "" where not known.
    """

    files: Sequence[str]
    lines: Sequence[int]
    flights: Sequence[str]
    time_s: np.ndarray
    sigmas: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray] = field(default_factory=dict)
    altitude: str = ""
    power: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def from_flight(self, file: str, flight: str) -> ResidualRecords:
        """From the first record of a flight on; all of them where it is not among these."""
        places = list(zip(self.files, self.flights, strict=True))
        first = places.index((file, flight)) if (file, flight) in places else 0
        return replace(
            self,
            files=self.files[first:],
            lines=self.lines[first:],
            flights=self.flights[first:],
            time_s=self.time_s[first:],
            sigmas={name: values[first:] for name, values in self.sigmas.items()},
            residual={name: values[first:] for name, values in self.residual.items()},
            inputs={name: values[first:] for name, values in self.inputs.items()},
        )

    def origin(self, k: int) -> RowOrigin:
        return RowOrigin(self.files[k], str(self.lines[k]))

    def stretches(self) -> list[tuple[str, np.ndarray]]:
        """Flights, or files where flights are not named, with the places of their records."""
        names = [f"flight {flight}" if flight else file for flight, file in zip(self.flights, self.files, strict=True)]
        keys = list(zip(self.files, names, strict=True))
        return [(key[1], np.array([k for k, other in enumerate(keys) if other == key])) for key in dict.fromkeys(keys)]

    def farthest(self, most: int) -> list[str]:
        """Sensors whose residuals lie farthest from nominal in the last stretch, farthest first."""
        _, last = self.stretches()[-1]
        means = {name: abs(finite_mean(values[last])) for name, values in self.sigmas.items()}
        return sorted(means, key=lambda name: -means[name])[:most]


def finite_mean(values: np.ndarray) -> float:
    """Of those that are there; 0 of none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else 0.0


ALONE = (
    "Dots: each flight by itself, with 95 % intervals, if nothing but the parameters shown has changed. Line, with its "
    "95 % band: all flights together."
)
"""What a chart of such sizes says of itself."""


def conditional_rows(windows: Iterable[tuple[WindowStatistics, RowOrigin]], changed: Sequence[str]) -> list[Row]:
    """Rows as those of `trend --what flights`, of every window with statistics of these parameters."""
    rows: list[Row] = []
    for number, (window, origin) in enumerate(windows, start=1):
        statistics = window.statistics
        if statistics is None or not changed or not set(changed) <= set(statistics.parameters):
            continue
        for name, change, error in zip(changed, *restricted_change(statistics, changed), strict=True):
            half = NORMAL_95 * error
            cells = {"flight": window.flight, "number": number, "parameter": name, "change": change}
            cells["time_s"] = window.start_s
            rows.append(Row({**cells, "low": change - half, "high": change + half}, origin))
    return rows


def first_alarm_of_last_run(rows: Sequence[Row]) -> Row | None:
    """The window from which on every judged window alarms; None where the last does not."""
    first = None
    for row in reversed([r for r in rows if r.text("verdict") != "no verdict"]):
        if row.text("verdict") != "fault":
            break
        first = row
    return first


@dataclass(frozen=True)
class Order:
    """`x` of each of `names`, which may be flights or windows: a number, or a date in seconds since 1970."""

    names: Sequence[str]
    x: Sequence[float]
    axis: Axis

    def label(self, k: int) -> str:
        """What the one at position k is called on an axis."""
        return date_words(self.x[k]) if self.axis.dates else self.names[k] or f"{self.x[k]:g}"

    def number_position(self, number: float) -> float | None:
        """Where the so manieth stands, counted from 1."""
        k = round(number) - 1 if number == number else -1
        return self.x[k] if 0 <= k < len(self.x) else None


def order_windows(rows: Sequence[Row]) -> Order:
    """The order of rows, one for each window: by date where the recordings have dates."""
    flights = [row.text("flight") for row in rows]
    times = [row.number("time_s" if "time_s" in row else "start_s") for row in rows]
    if times and all(map(is_date, times)) and all(a < b for a, b in pairwise(times)):
        return Order(flights, times, Axis("date", dates=True))
    numbers = [_number(flight) for flight in flights]
    rising = all(b is not None and a is not None and a < b for a, b in pairwise(numbers))
    if numbers and all(n is not None for n in numbers) and rising:
        return Order(flights, [n for n in numbers if n is not None], Axis("flight"))
    named = bool(flights) and all(flights) and len(set(flights)) == len(flights)
    label = "flight, in the order given" if named else "window, in the order given"
    return Order(flights, [float(k) for k in range(1, len(rows) + 1)], Axis(label))


def _number(text: str) -> float | None:
    try:
        return float(int(text))
    except ValueError:
        return None


@dataclass(frozen=True)
class ResultKind:
    """`name`: what an error and a list of files call it; `columns`: those of a table that make it this kind; `keys`:
    of a JSON document; `also`: a further condition on its columns."""

    name: str
    command: str
    columns: frozenset[str] = frozenset()
    keys: frozenset[str] = frozenset()
    condition: Callable[[Collection[str]], bool] | None = None

    def is_table(self, columns: Collection[str]) -> bool:
        return (
            bool(self.columns) and self.columns <= set(columns) and (self.condition is None or self.condition(columns))
        )

    def is_document(self, document: Mapping[str, Any]) -> bool:
        return bool(self.keys) and self.keys <= set(document)


def _kind(name: str, command: str, columns: str, also: Callable[[Collection[str]], bool] | None = None) -> ResultKind:
    return ResultKind(name, command, frozenset(columns.split()), condition=also)


def _has_residuals(columns: Collection[str]) -> bool:
    return any(column.endswith(SIGMAS) for column in columns)


SIGMAS, RESIDUAL = ":sigmas", ":residual"
"""What `residual --what records` puts behind a sensor's column."""

STATISTICS = _kind("statistics", "residual", "source n chi2 dof", is_flat)
RECORDS = _kind("residuals of records", "residual --what records", "source line state", _has_residuals)
ISOLATED = _kind("isolated parameters", "isolate", "verdict isolated parameter inclusion change lower upper")
COMPONENTS = _kind("isolated components", "isolate --by component", "verdict components inclusion fit_before records")
TREND = _kind("trend", "trend", "parameter kind onset change change_low change_high verdict")
EVENTS = _kind("trend by component", "trend --by component", "components kind onset onset_flight flights")
FLIGHTS = _kind("health of each flight", "trend --what flights", "parameter number change low high unit")
MARGIN = _kind("margin", "trend --what margin", "row limit_K used_K margin_K remaining_flights recovered_K")
DELTAS = _kind("deltas", "trend --what deltas", "column name delta smoothed level since unit")
FOLLOWED = _kind("evidence as records came", "detect --follow", "log10_e block alarm")
DETECTED = _kind("verdicts", "detect", "verdict statistic threshold p_value alarm")
LOCATED = _kind("places of a mismatch", "locate", "driver location statistic share stability")
EXPLAINED = ResultKind("explanation", "explain", keys=frozenset({"explanations", "rejected", "places", "sentences"}))
REFINED = ResultKind(
    "refinement", "refine --report", keys=frozenset({"verdict", "criteria", "chi2_per_reading", "effects"})
)
FLEET = ResultKind("fleet", "fleet", keys=frozenset({"engines", "discoveries", "left_out"}))
NOMINAL = ResultKind("nominal engine", "identify")
RECORDING = ResultKind("recording", "simulate")

TABLES = (
    STATISTICS,
    RECORDS,
    ISOLATED,
    COMPONENTS,
    TREND,
    EVENTS,
    FLIGHTS,
    MARGIN,
    DELTAS,
    FOLLOWED,
    DETECTED,
    LOCATED,
)
DOCUMENTS = (FLEET, EXPLAINED, REFINED)


def table_kind(columns: Collection[str]) -> ResultKind | None:
    """The kind of a table with these columns; None for none that is known."""
    return next((kind for kind in TABLES if kind.is_table(columns)), None)


def document_kind(document: Mapping[str, Any]) -> ResultKind | None:
    return next((kind for kind in DOCUMENTS if kind.is_document(document)), None)


KNOWN = (
    "a report reads what detect, isolate, trend, identify, residual, locate, explain, refine --report and fleet write "
    "with all columns, as CSV or JSON"
)
NOMINAL_HEAD = "kind: nominal"
"""The first line of a nominal file that is no comment."""
PARTS = ("rows", "windows")
"""Keys under which a document may hold the rows of a table."""


@dataclass(frozen=True)
class ResultFile:
    """One file of results.

    Attributes
    ----------
    kind : ResultKind
        What it holds.
    name, path : str
        Its name in the report, and where it is.
    provenance : sequence of str
        Lines of its head.
    rows : sequence of Row
        Of a table.
    document : mapping
        Of a JSON object.
    lines : sequence of str
        Of a file of statistics, which has its own reader.
    sha256 : str
        Of its bytes.
    """

    kind: ResultKind
    name: str
    provenance: Sequence[str] = ()
    rows: Sequence[Row] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
    lines: Sequence[str] = ()
    sha256: str = ""
    path: str = ""

    @property
    def row_count(self) -> int | None:
        """Rows of a table; None of what is none, and of recordings, whose records are counted where they are judged."""
        if self.lines:
            return sum(not line.startswith("#") and bool(line.strip()) for line in self.lines) - 1
        return None if self.document or self.kind in (RECORDING, NOMINAL) else len(self.rows)


def read_result(path: str, name: str, *, recordings: bool = False) -> ResultFile:
    """Read a file of results.

    Parameters
    ----------
    path, name : str
        Where it is, and its name in the report.
    recordings : bool
        Whether a file that is no result counts as a recording.

    Returns
    -------
    ResultFile

    Raises
    ------
    DataError
        For a file that is damaged, or that holds nothing that a report reads.
    """
    from enginediag_cli.recordings.read import open_table

    with open_table(path) as table:
        if recordings and _is_recording(table.columns):
            made = _provenance_lines(_head(_decoded(table.lines, name)))
            return ResultFile(RECORDING, name, made, sha256="" if path == "-" else file_sha256(path), path=path)
        lines = [line if line.endswith("\n") else line + "\n" for line in _decoded(table.lines, name)]
    digest = "" if path == "-" else file_sha256(path)
    provenance = _provenance_lines(_head(lines))
    body = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    if not body:
        raise DataError(f"{name}: the file is empty; {KNOWN}")
    if body.lstrip()[0] in "[{":
        return _read_json("".join(lines), name, path, digest)
    if body.strip() == NOMINAL_HEAD:
        return ResultFile(NOMINAL, name, _nominal_provenance(lines), sha256=digest, path=path)
    return _read_csv(lines, name, path, digest, provenance)


def _is_recording(columns: Sequence[str]) -> bool:
    """Whether it is a table, and none that a command of this program has written as its answer."""
    first = columns[0].lstrip() if columns else ""
    return bool(first) and first[0] not in "[{" and first != NOMINAL_HEAD and table_kind(columns) is None


def _decoded(lines: Iterable[str], name: str) -> Iterator[str]:
    try:
        yield from lines
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: not UTF-8 text ({error.reason}); {KNOWN}") from None


def _provenance_lines(head: Iterable[str]) -> list[str]:
    """Lines of a head without their marks."""
    return [line[1:].removeprefix(" ").rstrip() for line in head]


def _nominal_provenance(lines: Sequence[str]) -> list[str]:
    """What a nominal file says of its making: the lines below its key `provenance`."""
    below = dropwhile(lambda line: line.rstrip() != "provenance:", lines)
    return [line.strip() for line in takewhile(lambda line: line.startswith(" "), islice(below, 1, None))]


def _head(lines: Iterable[str]) -> Iterator[str]:
    for line in lines:
        if not line.startswith("#"):
            return
        yield line


def _read_csv(lines: Sequence[str], name: str, path: str, digest: str, provenance: Sequence[str]) -> ResultFile:
    head = len(provenance)
    reader = csv.reader(iter(lines[head:]), strict=True)
    rows: list[Row] = []
    try:
        header = next(reader, [])
        kind = table_kind(header)
        if kind is None:
            raise DataError(_unknown(name, header))
        if kind is STATISTICS:
            return ResultFile(kind, name, provenance, lines=lines, sha256=digest, path=path)
        before = reader.line_num
        for cells in reader:
            line, before = head + before + 1, reader.line_num
            if not any(cells):
                continue
            if len(cells) != len(header):
                raise DataError(f"{name}:{line}: {len(cells)} fields where the header has {len(header)}")
            rows.append(Row(dict(zip(header, cells, strict=True)), RowOrigin(name, str(line))))
    except csv.Error as error:
        raise DataError(f"{name}:{head + reader.line_num}: {error}") from None
    return ResultFile(kind, name, provenance, rows, sha256=digest, path=path)


def _read_json(text: str, name: str, path: str, digest: str) -> ResultFile:
    document = _parsed(text, name)
    provenance = _provenance(document)
    if isinstance(document, Mapping):
        kind = document_kind(document)
        if kind is not None:
            return ResultFile(kind, name, provenance, document=document, sha256=digest, path=path)
        part = next((p for p in PARTS if isinstance(document.get(p), list)), "")
        if not part:
            raise DataError(_unknown(name, list(document)))
        items, place = document[part], f"{part}[{{}}]"
    else:
        items, place = document, "[{}]"
    if not all(isinstance(item, Mapping) for item in items):
        raise DataError(f"{name}: not a list of rows; {KNOWN}")
    columns = list(items[0]) if items else []
    kind = table_kind(columns)
    if kind is None:
        raise DataError(_unknown(name, columns))
    if kind is STATISTICS:
        raise DataError(
            f"{name}: statistics are read as CSV, which keeps their checksums: `enginediag residual -o x.csv`"
        )
    rows = [Row(item, RowOrigin(name, place.format(k))) for k, item in enumerate(items)]
    return ResultFile(kind, name, provenance, rows, sha256=digest, path=path)


def _parsed(text: str, name: str) -> Any:
    """JSON, or one object a line."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        first = error
    try:
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    except json.JSONDecodeError:
        raise DataError(f"{name}:{first.lineno}:{first.colno}: not JSON: {first.msg}") from None


def _provenance(document: Any) -> list[str]:
    found = document.get("provenance") if isinstance(document, Mapping) else None
    if isinstance(found, Mapping):
        return [f"{key}: {value}" for key, value in found.items()]
    return [str(line) for line in found] if isinstance(found, list) else []


def _unknown(name: str, columns: Sequence[str]) -> str:
    from enginediag_cli.units import is_numeric_column

    if any(is_numeric_column(column) for column in columns):
        return f"{name}: this is a recording, not a result: give -n NOMINAL, and all of them are judged, or {KNOWN}"
    has = ", ".join(shortened(column, 30) for column in columns[:8]) or "nothing"
    return f"{name}: not recognised (it has {has}{' …' if len(columns) > 8 else ''}); {KNOWN}"


def known_parameters(results: Sequence[ResultFile]) -> dict[str, Parameter]:
    """By name, of every nominal file among the results. Raises ConfigError for a damaged one."""
    from enginediag_cli.intake.selection import open_baseline
    from enginediag_cli.residuals.monitor import build_monitor

    known: dict[str, Parameter] = {}
    for result in results:
        if result.kind is NOMINAL:
            known.update(build_monitor(open_baseline(result.path), sensors=True).meaning)
    return known


def nominal_result(path: str) -> ResultFile:
    """The nominal file with which recordings were judged, as one of the files of a report."""
    import os

    return read_result(path, os.path.basename(path))


def residual_records(rows: Sequence[Row]) -> ResidualRecords:
    """Raises DataError for a cell that is no number. At least one row."""
    sensors = [name.removesuffix(SIGMAS) for name in rows[0].cells if name.endswith(SIGMAS)]

    def column(name: str) -> np.ndarray:
        return np.array([row.number(name) for row in rows])

    return ResidualRecords(
        [row.origin.file for row in rows],
        [int(row.origin.row) if row.origin.row.isdigit() else k for k, row in enumerate(rows)],
        [row.text("flight") for row in rows],
        column("time_s"),
        {sensor: column(sensor + SIGMAS) for sensor in sensors},
        {sensor: column(sensor + RESIDUAL) for sensor in sensors},
    )
