"""Tabulated component maps: CSV file with two coordinates and several quantities on a rectangular grid.

Inside the grid a quantity is a polynomial in local cell coordinates, made once; looking up all quantities
of all points is one gather of coefficient rows and a Horner sum. Interpolation rules:

- `linear`: bilinear in the cell.
- `quadratic`: in each direction the parabola through the bracketing pair and the next grid value up, or
  the last three values at the upper end; the rule of the T-MATS and NPSS "lagrange2" maps.

Beyond the grid, in the coordinate that left it, the value continues on the straight line through the last two grid
values, whatever the rule inside, and the point is marked:

    f(x) = f_n + (f_n − f_{n−1}) / (x_n − x_{n−1}) · (x − x_n)

That is how NPSS continues a map. The tangent of the last parabola instead is off by up to 1.8 % at idle points below a
fan's lowest speed line. At the edge of a parabola the slope therefore jumps, as it does at every grid line inside.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, chain, value
from enginediag_cli.errors import ConfigError, Mark, Problem

RULES = ("linear", "quadratic")


@dataclass(frozen=True)
class TableMap:
    """Cell polynomials of q quantities: `cells` (nx+1, ny+1, q, a, b) with a, b the powers in x and y.

    Cells 0 and nx, ny are the continuations outside the grid. `x`, `y` are the grid coordinates.
    """

    x: Array
    y: Array
    cells: Array

    def lookup(self, x: Value, y: Value) -> tuple[list[Value], Array]:
        """The quantities at (x, y), each (N,), and which points lie outside the grid (N,)."""
        xv, yv = value(x), value(y)
        i = np.searchsorted(self.x, xv, side="right")
        j = np.searchsorted(self.y, yv, side="right")
        outside = (i == 0) | (j == 0) | (xv > self.x[-1]) | (yv > self.y[-1])
        _, _, q, a, b = self.cells.shape
        C = self._columns.take(i * (len(self.y) + 1) + j, axis=1).reshape(q, a, b, -1)
        u = xv - self.x[np.maximum(i - 1, 0)]
        v = yv - self.y[np.maximum(j - 1, 0)]
        # Horner in v for each power of u, then in u
        s = C[:, :, b - 1]
        for k in range(b - 2, -1, -1):
            s = s * v + C[:, :, k]
        t = s[:, a - 1]
        for k in range(a - 2, -1, -1):
            t = t * u + s[:, k]
        slopes: list[list[tuple[Array, Value]]] = [[] for _ in range(q)]
        if isinstance(x, Dual):
            tu = np.zeros_like(t)
            for k in range(a - 1, 0, -1):
                tu = tu * u + k * s[:, k]
            for m in range(q):
                slopes[m].append((tu[m], x))
        if isinstance(y, Dual):
            sv = np.zeros_like(s)
            for k in range(b - 1, 0, -1):
                sv = sv * v + k * C[:, :, k]
            tv = sv[:, a - 1]
            for k in range(a - 2, -1, -1):
                tv = tv * u + sv[:, k]
            for m in range(q):
                slopes[m].append((tv[m], y))
        return [chain(t[m], *slopes[m]) for m in range(q)], outside

    @cached_property
    def _columns(self) -> Array:
        """Coefficients (q·a·b, cells), a row for each, to be taken for all points at once."""
        return np.ascontiguousarray(self.cells.reshape(self.cells.shape[0] * self.cells.shape[1], -1).T)


def make_table(x: Array, y: Array, tables: Array, rule_x: str, rule_y: str) -> TableMap:
    """A map from grids x (nx,), y (ny,) and tables (q, nx, ny)."""
    Bx, By = _cell_basis(x, rule_x), _cell_basis(y, rule_y)  # (nx+1, a, nx), (ny+1, b, ny)
    return TableMap(x, y, np.ascontiguousarray(np.einsum("iak,qkl,jbl->ijqab", Bx, tables, By)))


def _cell_basis(grid: Array, rule: str) -> Array:
    """Local polynomial of each cell as a linear map of grid values: (n+1 cells, powers, n).

    Cell 0 is below the grid, cell i lies above grid value i−1, cell n above the last one; the local
    coordinate counts from the cell's lower grid value (from the first one below the grid). The two outer cells hold
    the straight line through the last two grid values.
    """
    n = len(grid)
    order = 2 if rule == "quadratic" and n >= 3 else 1
    basis = np.zeros((n + 1, order + 1, n))
    for i in range(n - 1):
        if order == 1:
            h = grid[i + 1] - grid[i]
            basis[i + 1, 0, i] = 1.0
            basis[i + 1, 1, i], basis[i + 1, 1, i + 1] = -1.0 / h, 1.0 / h
        else:
            nodes = np.arange(i, i + 3) if i + 2 < n else np.arange(n - 3, n)
            local = grid[nodes] - grid[i]
            basis[i + 1][:, nodes] = np.linalg.inv(np.vander(local, 3, increasing=True))
    for cell, edge, lower in ((0, 0, 0), (n, n - 1, n - 2)):
        h = grid[lower + 1] - grid[lower]
        basis[cell, 0, edge] = 1.0
        basis[cell, 1, lower], basis[cell, 1, lower + 1] = -1.0 / h, 1.0 / h
    return basis


def read_table(
    path: Path, x_column: str, y_column: str, quantities: tuple[str, ...], text: str | None = None
) -> tuple[Array, Array, Array]:
    """Grids and tables (q, nx, ny) of a map CSV with one row per grid point; ConfigError names the fault. `text`: what
    the file holds, for one that travels in another file and is not read."""

    def fail(message: str, line: int = 0, hint: str = "") -> ConfigError:
        return ConfigError([Problem(Mark(str(path), line), message, hint)])

    try:
        with path.open(newline="", encoding="utf-8") if text is None else io.StringIO(text, newline="") as file:
            lines = [(k, row) for k, row in enumerate(csv.reader(file), 1) if row and not row[0].startswith("#")]
    except OSError as error:
        raise fail(f"cannot read the component map: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise fail("the component map is not UTF-8 text", 0, "save it as CSV in UTF-8") from error
    except csv.Error as error:
        raise fail(f"the component map is not CSV: {error}") from error
    header = lines[0][1] if lines else []
    missing = [c for c in (x_column, y_column, *quantities) if c not in header]
    if missing:
        # of a file that is no map, nothing is repeated
        found = [c for c in header if c in (x_column, y_column, *quantities)]
        raise fail(
            f"map columns missing: {', '.join(missing)}", 1, f"found {', '.join(found) or 'none of its columns'}"
        )
    if len(lines) == 1:
        raise fail("the component map has no rows", lines[0][0])
    at = [header.index(c) for c in (x_column, y_column, *quantities)]
    bad = next((k for k, row in lines[1:] if not _all_numbers(row, at)), None)
    if bad is not None:
        raise fail("a map entry is not a number", bad)
    data = np.array([[float(row[k]) for k in at] for _, row in lines[1:]])
    x, y = np.unique(data[:, 0]), np.unique(data[:, 1])
    if len(data) != len(x) * len(y):
        raise fail(
            f"the map grid has {len(data)} rows, {len(x)} × {len(y)} were expected",
            0,
            f"every {x_column} needs every {y_column} once",
        )
    if min(len(x), len(y)) < 2:
        raise fail(f"the map grid is {len(x)} × {len(y)}", 0, f"give at least two values of {x_column} and {y_column}")
    tables = np.full((len(quantities), len(x), len(y)), np.nan)
    tables[:, np.searchsorted(x, data[:, 0]), np.searchsorted(y, data[:, 1])] = data[:, 2:].T
    if not np.isfinite(tables).all():
        raise fail("a grid point of the map is given twice and another not at all")
    return x, y, tables


def _all_numbers(row: list[str], at: list[int]) -> bool:
    try:
        return all(np.isfinite(float(row[k])) for k in at)
    except (ValueError, IndexError):
        return False
