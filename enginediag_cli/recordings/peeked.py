"""A text file whose head has been read, to see what it holds before it is read as that."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import chain

MOST_BLANK_LINES = 2_000_000
"""Blank lines in a row after which a file is refused: packed, gigabytes of them take no room. A sheet has 1,048,576
rows, which may all be there."""


class Peeked:
    """An open text file whose head has been read: `provenance`, the `#` lines before the header; `columns`, the cells
    of the header; iterating gives all lines from the first."""

    def __init__(self, stream: Iterable[str], name: str):
        self.name = name
        self.provenance: list[str] = []
        self.columns: tuple[str, ...] = ()
        self._stream = iter(stream)
        self._head: list[str] = []
        rest = self._stream
        try:
            self._peek()
        except (
            UnicodeDecodeError,
            OSError,
            EOFError,
            zlib.error,
        ) as error:  # whoever reads on meets it, and says what it means
            rest = _broken(error)
        self._lines = chain(self._head, rest)

    def _peek(self) -> None:
        for text in self._stream:
            self._head.append(text)
            bare = text.lstrip("\ufeff").strip()
            if bare.startswith("#"):
                self.provenance.append(bare[1:].strip())
            elif bare:
                with suppress(csv.Error):
                    self.columns = tuple(cell.strip() for cell in next(csv.reader([bare]), []))
                return
            if len(self._head) > MOST_BLANK_LINES + 1:  # whoever reads on refuses it
                return

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def __next__(self) -> str:
        return next(self._lines)


def _broken(error: Exception) -> Iterator[str]:
    """Lines that cannot be read."""
    raise error
    yield ""
