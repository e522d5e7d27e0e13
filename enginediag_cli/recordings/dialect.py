"""How a text file is written: what parts cells, the marks in numbers, the encoding, and what its columns are called."""

from __future__ import annotations

import codecs
from dataclasses import dataclass

from enginediag_cli.errors import DataError

DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|"}
"""Names of the delimiters that `auto` looks for, and the characters."""

WHITESPACE, FIXED = "whitespace", "fixed"
LAYOUTS = (WHITESPACE, FIXED)
"""Columns without a delimiter: parted by any number of blanks, or each so many characters wide."""

THOUSANDS = {"comma": ",", "point": ".", "space": " ", "apostrophe": "'"}
"""Names of the marks between groups of three digits; a space is any kind of space, an apostrophe also a typographic
one."""


@dataclass(frozen=True)
class Dialect:
    """delimiter: one character, "auto": the one of DELIMITERS that the header has most of, outside quotes, or one of
    LAYOUTS; decimal: "." or ","; header_line: the physical line of the header, 0: the first that is neither blank nor
    begins with #; unit_row: whether a row that is no record follows the header; names: the columns of a file without
    a header, "" for one that is not read; widths: characters of each column where they are fixed; thousands: a mark of
    THOUSANDS, or ""; missing: words for a missing value beyond those of `formats.cells`; sheet: of a workbook."""

    delimiter: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    header_line: int = 0
    unit_row: bool = False
    names: tuple[str, ...] = ()
    widths: tuple[int, ...] = ()
    thousands: str = ""
    missing: tuple[str, ...] = ()
    sheet: str = ""

    @property
    def codec(self) -> str:
        """The encoding to open a file with; a byte order mark is no part of UTF-8 text."""
        return "utf-8-sig" if codecs.lookup(self.encoding).name == "utf-8" else self.encoding

    def separator(self, header: str, place: str) -> str:
        """The character between cells, judged by this first line of the table where it is not stated; or one of
        LAYOUTS. Raises DataError when decimal mark and delimiter are one."""
        found = separator_of(header) if self.delimiter == "auto" else self.delimiter
        if found == self.decimal:
            raise DataError(f"{place}: the decimal mark and the delimiter are both '{found}'; state another delimiter")
        return found


OWN = Dialect()
"""Files of this program: commas, decimal points, UTF-8, the header first."""


def separator_of(header: str) -> str:
    """The delimiter that a header line has most of, outside quotes; a comma where it has none."""
    bare = "".join(header.split('"')[::2])
    return max(DELIMITERS.values(), key=bare.count) if any(map(bare.count, DELIMITERS.values())) else ","


def known_encoding(name: str) -> bool:
    """Whether Python has a text codec of this name."""
    try:
        return bool(codecs.lookup(name)._is_text_encoding)
    except LookupError:
        return False
