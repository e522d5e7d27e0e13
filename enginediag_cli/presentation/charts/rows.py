"""A row of results, of a file or just made: its cells as texts, numbers and lists, and its place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from enginediag_cli.errors import DataError
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.safe_text import unguarded

NOT_KNOWN = float("nan")


@dataclass(frozen=True)
class Row:
    """`cells` as CSV (texts) or JSON (typed) has them."""

    cells: Mapping[str, Any]
    origin: Origin

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


def rival(text: str) -> tuple[tuple[str, ...], float]:
    """A rival as `isolate` and `trend` write it, "a & b (0.022)": the parameters and their probability."""
    names, _, chance = text.rpartition(" (")
    try:
        value = float(chance.rstrip(")"))
    except ValueError:
        names, value = text, NOT_KNOWN
    return tuple(name.strip() for name in names.split("&") if name.strip() not in ("", "nothing")), value
