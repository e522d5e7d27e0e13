"""A file of results, whole: what it is, where it comes from, its rows or its document."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from enginediag_cli.errors import DataError
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.results.kinds import Kind
from enginediag_cli.recordings.provenance import sha256_of
from enginediag_cli.safe_text import shortened

KNOWN = (
    "a report reads what detect, isolate, trend, identify, residual, locate, explain, refine --report and fleet write "
    "with all columns, as CSV or JSON"
)
NOMINAL_HEAD = "kind: nominal"
"""The first line of a nominal file that is no comment."""
PARTS = ("rows", "windows")
"""Keys under which a document may hold the rows of a table."""


@dataclass(frozen=True)
class Result:
    """One file. `name`: as the report calls it; `rows` of a table, `document` of JSON; `lines`: of a file of
    statistics, which its own reader checks; `sha256` of its bytes."""

    kind: Kind
    name: str
    provenance: Sequence[str] = ()
    rows: Sequence[Row] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
    lines: Sequence[str] = ()
    sha256: str = ""
    path: str = ""


def read_result(path: str, name: str, *, recordings: bool = False) -> Result:
    """What a file holds; recordings: what is no result is one. Raises DataError where nothing that a report reads is
    recognised, or it is damaged."""
    from enginediag_cli.recordings.read import table_file

    with table_file(path) as table:
        if recordings and _is_recording(table.columns):
            return Result(kinds.RECORDING, name, sha256="" if path == "-" else sha256_of(path), path=path)
        lines = [line if line.endswith("\n") else line + "\n" for line in _decoded(table.lines, name)]
    digest = "" if path == "-" else sha256_of(path)
    provenance = [line[1:].removeprefix(" ").rstrip() for line in _head(lines)]
    body = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    if not body:
        raise DataError(f"{name}: the file is empty; {KNOWN}")
    if body.lstrip()[0] in "[{":
        return _of_json("".join(lines), name, path, digest)
    if body.strip() == NOMINAL_HEAD:
        return Result(kinds.NOMINAL, name, (), sha256=digest, path=path)
    return _of_csv(lines, name, path, digest, provenance)


def _is_recording(columns: Sequence[str]) -> bool:
    """Whether it is a table, and none that a command of this program has written as its answer."""
    first = columns[0].lstrip() if columns else ""
    return bool(first) and first[0] not in "[{" and first != NOMINAL_HEAD and kinds.of_table(columns) is None


def _decoded(lines: Iterable[str], name: str) -> Iterator[str]:
    try:
        yield from lines
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: not UTF-8 text ({error.reason}); {KNOWN}") from None


def _head(lines: Sequence[str]) -> Iterator[str]:
    for line in lines:
        if not line.startswith("#"):
            return
        yield line


def _of_csv(lines: Sequence[str], name: str, path: str, digest: str, provenance: Sequence[str]) -> Result:
    head = len(provenance)
    reader = csv.reader(iter(lines[head:]), strict=True)
    rows: list[Row] = []
    try:
        header = next(reader, [])
        kind = kinds.of_table(header)
        if kind is None:
            raise DataError(_unknown(name, header))
        if kind is kinds.STATISTICS:
            return Result(kind, name, provenance, lines=lines, sha256=digest, path=path)
        before = reader.line_num
        for cells in reader:
            line, before = head + before + 1, reader.line_num
            if not any(cells):
                continue
            if len(cells) != len(header):
                raise DataError(f"{name}:{line}: {len(cells)} fields where the header has {len(header)}")
            rows.append(Row(dict(zip(header, cells, strict=True)), Origin(name, str(line))))
    except csv.Error as error:
        raise DataError(f"{name}:{head + reader.line_num}: {error}") from None
    return Result(kind, name, provenance, rows, sha256=digest, path=path)


def _of_json(text: str, name: str, path: str, digest: str) -> Result:
    document = _parsed(text, name)
    provenance = _provenance(document)
    if isinstance(document, Mapping):
        kind = kinds.of_document(document)
        if kind is not None:
            return Result(kind, name, provenance, document=document, sha256=digest, path=path)
        part = next((p for p in PARTS if isinstance(document.get(p), list)), "")
        if not part:
            raise DataError(_unknown(name, list(document)))
        items, place = document[part], f"{part}[{{}}]"
    else:
        items, place = document, "[{}]"
    if not all(isinstance(item, Mapping) for item in items):
        raise DataError(f"{name}: not a list of rows; {KNOWN}")
    columns = list(items[0]) if items else []
    kind = kinds.of_table(columns)
    if kind is None:
        raise DataError(_unknown(name, columns))
    if kind is kinds.STATISTICS:
        raise DataError(
            f"{name}: statistics are read as CSV, which keeps their checksums: `enginediag residual -o x.csv`"
        )
    rows = [Row(item, Origin(name, place.format(k))) for k, item in enumerate(items)]
    return Result(kind, name, provenance, rows, sha256=digest, path=path)


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
