"""Rows of results as CSV or JSON, one row in memory at a time, and as the cells that both share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO


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
    if columns:
        writer.writerow(columns)
    count = 0
    for count, row in enumerate(rows, start=1):  # noqa: B007
        writer.writerow([cell(row.get(column)) for column in columns])
        if live:
            stream.flush()
    return count


def write_json(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO, *, live: bool = False) -> int:
    """One JSON array of objects, written row by row; NaN and infinity, which JSON lacks, become null."""
    import json

    count = 0
    for count, row in enumerate(rows, start=1):
        record = {column: finite(plain(row.get(column))) for column in columns}
        stream.write("[\n" if count == 1 else ",\n")
        stream.write(json.dumps(record, ensure_ascii=False, allow_nan=False))
        if live:
            stream.flush()
    stream.write("\n]\n" if count else "[]\n")
    return count


def finite(value: Any) -> Any:
    """`value` with every NaN and infinity replaced by None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return value
