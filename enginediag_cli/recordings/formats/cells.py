"""Texts of a column of numbers as numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from enginediag_cli.errors import DataError

MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Cells of a declared column that stand for a missing value, in any case."""


def points(cells: Collection[str], decimal: str) -> Collection[str]:
    """The cells with decimal points; a point in a file with decimal commas is left for `floats` to refuse."""
    if decimal == ".":
        return cells
    return [cell.replace(".", "\u00b7").replace(",", ".") for cell in cells]


def floats(cells: Collection[str], place: Callable[[int], str]) -> np.ndarray:
    """(N,) float64 of one column's cells; the slow way only where a cell is missing or wrong. place: where the k-th
    cell stands, for the DataError about one that is no number."""
    try:
        values = np.fromiter(map(float, cells), dtype=float, count=len(cells))
    except ValueError:
        values = np.empty(len(cells))
        for k, cell in enumerate(cells):
            try:
                values[k] = np.nan if cell.strip().lower() in MISSING else float(cell)
            except ValueError:
                raise DataError(f"{place(k)}: not a number: {cell!r}") from None
    if "_" in "".join(cells):  # float() reads 1_000 as a thousand; a recorder that writes it has lost a digit
        bad = next(k for k, cell in enumerate(cells) if "_" in cell)
        raise DataError(f"{place(bad)}: not a number: {list(cells)[bad]!r}")
    return values
