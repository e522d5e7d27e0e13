"""Texts of a column of numbers as numbers: how they are written, and what stands for a missing one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.dialect import Dialect
from enginediag_cli.safe_text import shortened

EMPTY = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Cells that stand for a missing value and need no word about it, in any case."""

MISSING = EMPTY | frozenset(
    word
    for line in (
        "- -- --- — – ? nil n.a. #n/a #na #value! #ref! #div/0! #num! #name? #null! 1.#qnan -1.#qnan 1.#ind -1.#ind",
        "bad|bad data|bad input|bad quality|bad total|no data|nodata|no good data|no value|no result|no sample|missing",
        "i/o timeout|io timeout|i/o time-out|timeout|scan timeout|scan off|comm fail|comm failure|comm error",
        "communication failure|not connected|disconnected|offline|off-line|out of service|out of serv|shutdown",
        "shut down|intf shut|interface shut|pt created|point created|configure|over range|under range|overrange",
        "underrange|inp fail|input fail|input failure|sensor fail|sensor failure|calc failed|calc fail|calc off",
        "calc crash|bad_quality|not available|not avail|unavailable|invalid|invalid data|invalid float|undefined|undef",
        "error|err|failed|fail|fault|unknown|stale|arc off-line|arc offline|access denied|no access|no lab data",
    )
    for word in (line.split("|") if "|" in line else line.split())
)
"""Those, and the words of plant historians, spreadsheets and C libraries (PI digital states, Excel errors, printf)."""

_CODED = re.compile(r"\*+|\[-\d+\].*")
"""Asterisks that fill a field whose number is too wide (Fortran), and a historian's error number with its text."""

_SPACES = re.compile("[\u00a0\u2007\u2009\u202f]")
"""Spaces that do not break, between groups of digits."""


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a missing value in any recording."""
    bare = cell.strip().lower()
    return bare in MISSING or _CODED.fullmatch(bare) is not None


@dataclass(frozen=True)
class NumberForm:
    """How numbers are written. decimal: "." or ","; thousands: the mark between groups of three digits, or "";
    missing: further words for a missing value, in any case, or numbers that stand for one."""

    decimal: str = "."
    thousands: str = ""
    missing: tuple[str, ...] = ()

    @staticmethod
    def from_dialect(dialect: Dialect) -> NumberForm:
        return NumberForm(dialect.decimal, dialect.thousands, dialect.missing)

    @cached_property
    def words(self) -> frozenset[str]:
        return frozenset(word.strip().lower() for word in self.missing)

    @cached_property
    def codes(self) -> np.ndarray:
        """(K,) numbers that stand for a missing value, as -9999 does."""
        return np.array([value for word in self.missing if (value := _number(word)) is not None])

    @cached_property
    def _grouped(self) -> re.Pattern[str]:
        mark, point = re.escape(self.thousands), re.escape(self.decimal)
        return re.compile(rf"\s*[-+]?\d{{1,3}}(?:{mark}\d{{3}})+(?:{point}\d*)?\s*")

    def values(self, cells: Sequence[str]) -> tuple[np.ndarray, list[int], Counter[str]]:
        """(N,) float64 of a column's cells, NaN where missing; indices of cells that are no number; and how often each
        word, or number, stood for a missing value, those of EMPTY left out. Slow only where a cell is no number."""
        bad: list[int] = []
        counts: Counter[str] = Counter()
        plain = self._plain(cells)
        try:
            values = np.fromiter(map(float, plain), dtype=float, count=len(cells))
        except ValueError:
            values = np.empty(len(cells))
            for k, cell in enumerate(plain):
                number = _number(cell)
                if number is not None:
                    values[k] = number
                    continue
                values[k] = np.nan
                bare = cells[k].strip().lower()
                if bare in EMPTY:
                    continue
                if bare in self.words or bare in MISSING or _CODED.fullmatch(bare):
                    counts[shortened(cells[k].strip())] += 1
                else:
                    bad.append(k)
        if "_" in "".join(cells):  # float() reads 1_000 as a thousand; a recorder that writes it has lost a digit
            bad = sorted({*bad, *(k for k, cell in enumerate(cells) if "_" in cell and _number(cell) is not None)})
        if self.codes.size:
            coded = np.isin(values, self.codes)
            counts.update(f"{value:g}" for value in values[coded])
            values[coded] = np.nan
        return values, bad, counts

    def _plain(self, cells: Sequence[str]) -> Sequence[str]:
        """The cells with decimal points and without marks of thousands; what has such a mark in a wrong place, or a
        point where decimals have commas, stays no number."""
        if self.thousands:
            cells = [self._ungrouped(cell) for cell in cells]
        if self.decimal == ",":
            return [cell.replace(".", "\u00b7").replace(",", ".") for cell in cells]
        return cells

    def _ungrouped(self, cell: str) -> str:
        if self.thousands == " ":
            cell = _SPACES.sub(" ", cell)
        elif self.thousands == "'":
            cell = cell.replace("\u2019", "'")
        if self.thousands not in cell.strip():
            return cell
        return cell.replace(self.thousands, "") if self._grouped.fullmatch(cell) else cell + "\u00b7"


def no_number(cell: str, place: str) -> DataError:
    """The error for a cell that is no number, with the key of a recorder that may make it one."""
    bare = _SPACES.sub(" ", cell.strip())
    hint = ""
    if re.fullmatch(r"[-+]?\d+,\d+", bare) and not re.fullmatch(r"[-+]?\d{1,3},\d{3}", bare):
        hint = "decimal: comma"
    elif found := re.fullmatch(r"[-+]?\d{1,3}(?:([, '])\d{3})(?:\1\d{3})*(?:\.\d*)?", bare):
        hint = "thousands: " + {",": "comma", " ": "space", "'": "apostrophe"}[found[1]]
    elif re.fullmatch(r"[A-Za-z#*?!/ .-]{1,30}", bare):
        hint = f'missing: ["{bare}"]'
    told = f"; if it stands for one, or for a missing one, a recorder says how: `file: {{{hint}}}`" if hint else ""
    return DataError(f"{place}: not a number: {shortened(cell)!r}{told}")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        pass
    try:
        return float(cell.replace("\u2212", "-")) if "\u2212" in cell else None
    except ValueError:
        return None
