"""Rows of results as CSV or JSON, one row in memory at a time, and as the cells that both share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TextIO

from enginediag_cli.safe_text import guarded, json_escaped, visible


def plain(value: Any) -> Any:
    """`value` in Python's own types: numpy scalars and arrays become numbers and lists."""
    if hasattr(value, "tolist"):  # numpy, without importing it
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    return value


def cell(value: Any) -> str:
    """Text of one CSV cell: floats that read back to the same value, empty for None and NaN."""
    value = plain(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict):
        return "; ".join(f"{key}={cell(item)}" for key, item in value.items())
    if isinstance(value, list):
        return "; ".join(cell(item) for item in value)
    return str(value)


def bare_cells(row: Mapping[str, Any], columns: Sequence[str]) -> list[Any]:
    """Cells of a row as numbers and texts; what is neither is the text that a CSV cell has of it."""
    values = [plain(row.get(column)) for column in columns]
    return [cell(value) if isinstance(value, (dict, list)) else value for value in values]


def write_csv(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    stream: TextIO,
    *,
    provenance: Sequence[str] = (),
    live: bool = False,
) -> int:
    """Provenance lines behind `# `, the header, then the rows; a column that a row lacks is left empty."""
    import csv

    for line in provenance:
        stream.write(line.rstrip("\n") + "\n" if line.startswith("#") else f"# {line}\n")
    writer = csv.writer(stream, lineterminator="\n")
    shown = stream.isatty()

    def safe(value: Any) -> str:
        """A cell that neither a spreadsheet nor a terminal obeys; numbers stay as they are."""
        text = cell(value)
        if isinstance(value, (float, int)):
            return text
        text = guarded(text) if _begins_with_text(value) else text
        return visible(text) if shown else text

    if columns:
        writer.writerow([safe(column) for column in columns])
    count = 0
    for count, row in enumerate(rows, start=1):  # noqa: B007
        writer.writerow([safe(row.get(column)) for column in columns])
        if live:
            stream.flush()
    return count


def write_json(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO, *, live: bool = False) -> int:
    """One JSON array of objects, written row by row; NaN and infinity, which JSON lacks, become null."""
    count = 0
    for count, row in enumerate(rows, start=1):
        record = {column: finite(plain(row.get(column))) for column in columns}
        stream.write("[\n" if count == 1 else ",\n")
        stream.write(json_text(record))
        if live:
            stream.flush()
    stream.write("\n]\n" if count else "[]\n")
    return count


def write_object(document: Mapping[str, Any], stream: TextIO) -> None:
    """One JSON object, indented, NaN and infinity as null; values that are iterators are written item by item."""
    between = "{"
    for key, value in document.items():
        stream.write(f"{between}\n {json_text(str(key))}: ")
        between = ","
        if not isinstance(value, Iterator):
            stream.write(_indented(value, 1))
            continue
        count = 0
        for count, item in enumerate(value, start=1):
            stream.write(("[" if count == 1 else ",") + "\n  " + _indented(item, 2))
        stream.write("\n ]" if count else "[]")
    stream.write("\n}\n" if document else "{}\n")


def _indented(value: Any, depth: int) -> str:
    """As part of an object, so many levels deep."""
    return json_text(finite(plain(value)), indent=1).replace("\n", "\n" + " " * depth)


def write_ndjson(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO) -> int:
    """One JSON object a line, each handed on at once; NaN and infinity become null."""
    count = 0
    for row in rows:
        count += 1
        stream.write(json_text({column: finite(plain(row.get(column))) for column in columns}) + "\n")
        stream.flush()
    return count


def json_text(value: Any, indent: int | None = None) -> str:
    """JSON of plain, finite values; letters as they are, control characters as escapes, those beyond ASCII too."""
    import json

    text = json.dumps(value, ensure_ascii=False, allow_nan=False, indent=indent)
    return json_escaped(text)


def _begins_with_text(value: Any) -> bool:
    """Whether a cell begins with a text and not with a number: "=1" and ["-x", 2], but not -3.5 and [-1, 2]."""
    value = plain(value)
    while isinstance(value, list) and value:
        value = value[0]
    return isinstance(value, (str, dict))


def finite(value: Any) -> Any:
    """`value` with every NaN and infinity replaced by None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return value
