"""How an unknown file is written, judged by its first lines: a guess for the user to confirm."""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.dialect import DELIMITERS, OWN, Dialect
from enginediag_cli.recordings.formats.base import Asked
from enginediag_cli.recordings.formats.cells import MISSING
from enginediag_cli.recordings.formats.parquet_in import ParquetTable, is_parquet
from enginediag_cli.recordings.source import refuse_devices
from enginediag_cli.units import UnitError, find_unit

LOOKED_AT = 1 << 18
"""Bytes of the file that are looked at, 256 KiB: some thousand records."""
PARQUET_RECORDS = 2000
"""Records of a Parquet file that are looked at, as many as fit into those bytes of a CSV file."""
MOST_TITLE_LINES = 60
"""Lines among which the header is looked for."""
NUMBERS = 0.6
"""Share of a column's cells that must be numbers, or missing, for it to be one of numbers."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Sniffed:
    """dialect: with its header line always stated where lines stand before it; header: the names; units: cells of the
    unit row, else empty texts; cells: column → texts of the records looked at; guessed_encoding: it is not UTF-8."""

    source: str
    dialect: Dialect
    header: tuple[str, ...]
    units: tuple[str, ...]
    cells: dict[str, list[str]]
    guessed_encoding: bool

    def values(self, column: str) -> np.ndarray | None:
        """The column's numbers (N,), NaN where missing, or None when it holds text."""
        result, good = [], 0
        for cell in self.cells[column]:
            bare = cell.strip()
            if self.dialect.decimal == ",":
                bare = bare.replace(",", ".")
            number = _NUMBER.fullmatch(bare) is not None
            good += number or bare.lower() in MISSING
            result.append(float(bare) if number else np.nan)
        values = np.array(result)
        return values if good >= NUMBERS * max(len(values), 1) and np.isfinite(values).any() else None


def sniff(path: str) -> Sniffed:
    """Look at the head of a file (`-`: standard input). Raises DataError when no table is found in it."""
    if path != "-" and is_parquet(path):
        return _first_records(path)
    raw = _head(path)
    text, encoding = _decoded(raw, path)
    lines = text.splitlines()
    if len(raw) == LOOKED_AT:
        lines = lines[:-1]  # the last one may be cut
    try:
        delimiter, header = _table(lines, path)
        rows = [row for row in csv.reader(lines[header:], delimiter=delimiter) if any(c.strip() for c in row)]
    except csv.Error as error:
        raise DataError(f"{path}: no table: {error}") from error
    names = tuple(cell.strip().lstrip("\ufeff") for cell in rows[0])
    units = tuple(cell.strip() for cell in rows[1]) if len(rows) > 1 and _is_unit_row(rows[1], len(names)) else ()
    body = [row for row in rows[2 if units else 1 :] if len(row) == len(names)]
    cells = {name: [row[k] for row in body] for k, name in enumerate(names)}
    plain = all(not line.strip() or line.startswith("#") for line in lines[:header])
    dialect = Dialect(delimiter, _decimal(body, delimiter), encoding, 0 if plain else header + 1, bool(units))
    return Sniffed(path, dialect, names, units or ("",) * len(names), cells, encoding not in ("utf-8", "utf-16"))


def _first_records(path: str) -> Sniffed:
    """The first records of a Parquet file, which says itself what its columns are."""
    with closing(ParquetTable(path)) as table:
        first = next(table.records(Asked((), by_suffix=False), PARQUET_RECORDS))
    cells = {name: list(first.text[name]) for name in table.columns}
    return Sniffed(path, OWN, table.columns, ("",) * len(table.columns), cells, False)


def _head(path: str) -> bytes:
    if path == "-":
        return sys.stdin.buffer.read(LOOKED_AT)
    refuse_devices(path)
    try:
        with gzip.open(path, "rb") if path.endswith(".gz") else open(path, "rb") as stream:
            return bytes(stream.read(LOOKED_AT))
    except (OSError, EOFError) as error:
        raise DataError(f"{path}: {getattr(error, 'strerror', None) or error}") from error


def _decoded(raw: bytes, path: str) -> tuple[str, str]:
    """The text and the encoding; what is no Unicode is taken for Western European Windows text."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16", errors="ignore"), "utf-16"
    if b"\0" in raw:
        raise DataError(f"{path}: no text but binary data; export it as CSV or Parquet first")
    try:
        return codecs.getincrementaldecoder("utf-8-sig")().decode(raw), "utf-8"
    except UnicodeDecodeError:
        try:
            return raw.decode("cp1252"), "cp1252"
        except UnicodeDecodeError:
            return raw.decode("latin-1"), "latin-1"


def _table(lines: Sequence[str], path: str) -> tuple[str, int]:
    """Delimiter, and index of the header: the first line that is as wide as most, before the first with numbers."""
    best: tuple[float, str, int] | None = None
    shown = [line for line in lines if line.strip() and not line.startswith("#")]
    for delimiter in DELIMITERS.values():
        widths = [len(row) for row in csv.reader(shown, delimiter=delimiter)]
        common, count = Counter(widths[len(widths) // 3 :]).most_common(1)[0] if widths else (1, 0)
        if common < 2:
            continue
        score = count / len(shown) * common
        header = next(
            (
                k
                for k, line in enumerate(lines[:MOST_TITLE_LINES])
                if not line.startswith("#") and _is_header(next(csv.reader([line], delimiter=delimiter), []), common)
            ),
            -1,
        )
        if header >= 0 and (best is None or score > best[0]):
            best = (score, delimiter, header)
    if best is None:
        raise DataError(f"{path}: no table with a header was found (commas, semicolons, tabs and | were tried)")
    return best[1], best[2]


def _is_header(row: Sequence[str], width: int) -> bool:
    named = [cell.strip() for cell in row]
    return (
        len(row) == width and all(named) and sum(not _NUMBER.fullmatch(c.replace(",", ".")) for c in named) > width / 2
    )


def _is_unit_row(row: Sequence[str], width: int) -> bool:
    cells = [cell.strip(" []()") for cell in row]
    filled = [cell for cell in cells if cell and cell != "-"]
    return len(row) == width and bool(filled) and sum(known_unit(c) for c in filled) >= len(filled) / 2


def known_unit(text: str) -> bool:
    """Whether a text is a unit or an alias of one."""
    try:
        find_unit(text)
    except UnitError:
        return False
    return not _NUMBER.fullmatch(text)


def _decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    if delimiter == ",":
        return "."
    cells = [cell.strip() for row in rows for cell in row]
    commas = sum(bool(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell)) for cell in cells)
    points = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", cell)) for cell in cells)
    return "," if commas > points else "."
