"""Component maps of compressors and turbines: tables, parametric maps, guide vanes and the surge line.

A table (`TableMap`) is a CSV file with two coordinates and several quantities on a rectangular grid. Inside the grid a
quantity is a polynomial in local cell coordinates, made once; looking up all quantities of all points is one gather of
coefficient rows and a Horner sum. Interpolation rules:

- `linear`: bilinear in the cell.
- `quadratic`: in each direction the parabola through the bracketing pair and the next grid value up, or
  the last three values at the upper end; the rule of the T-MATS and NPSS "lagrange2" maps.

Beyond the grid, in the coordinate that left it, the value continues on the straight line through the last two grid
values, whatever the rule inside, and the point is marked:

    f(x) = f_n + (f_n − f_{n−1}) / (x_n − x_{n−1}) · (x − x_n)

That is how NPSS continues a map. The tangent of the last parabola instead is off by up to 1.8 % at idle points below a
fan's lowest speed line. At the edge of a parabola the slope therefore jumps, as it does at every grid line inside.

The parametric compressor map (`work_and_loss`) is one of work and flow: smooth, monotone, from windmilling to full
power.

With n = N/√θ and w = W√θ/δ, both relative to design, and flow coefficient x = w / n^e,

    work  ψ = n^q [1 + (s/c)(1 − x^c)]                         Δh/θ relative to design
    loss  L = n^q (1 − η_d) [1 + a (x − 1)² + b (n − 1)² + g (n − 1)]

and the isentropic work is ψ − L, so the isentropic efficiency is 1 − L/ψ: η_d at design. The
enthalpy rise falls with flow for every x > 0 (s, c > 0), the speed lines steepen towards choke as c grows,
and no auxiliary map coordinate is needed. Form: work–flow similarity of turbomachines (J. H. Horlock,
Axial Flow Compressors, 1958, ch. 3); coefficients are for identification, their defaults assumed.

Guide vanes and variable stators change a compressor's map when they close further than the map assumes. With a closing
Δφ in degrees beyond the schedule of the map (negative: opened),

    W_c = W_c,map exp(−a Δφ),    η = η_map/(1 + b Δφ²)

to first order −a Δφ and −b Δφ², and sensible for any angle. Form: the variable-geometry inputs of NLR GSP and GasTurb,
a flow change per degree and a loss per square degree; magnitudes assumed.

The surge margin (`SurgeLine`) is that of pressure ratio at constant corrected flow, SM = PR_surge(W_c)/PR − 1. Others
are in use and are other numbers for the same point: at constant corrected speed (PR_surge/PR)(W_c/W_c,surge) − 1, for
which one must know where the speed line ends, and (PR_surge − PR)/(PR_surge − 1), which counts from a ratio of one.
Below zero the point lies beyond the line.

The parametric turbine map gives flow capacity and isentropic efficiency, smooth and monotone in pressure ratio.

    capacity    W√T/P relative to design = √(1 − PR^−k) / √(1 − PR_d^−k) · [1 − c (N/√T − 1)]
    efficiency  η/η_d = 1 − a (ν/ν_d − 1)²,   ν = N / √(ideal enthalpy drop)  (blade-speed ratio)

The capacity is Stodola's ellipse law with exponent k: k = 2 for a many-stage turbine, larger the fewer
stages there are to choke (A. Stodola, Steam and Gas Turbines, 1927; J. H. Horlock, Axial Flow Turbines, 1966).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Array, Dual, Value, chain, exp, log, power, sqrt, value
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
    bad = next((k for k, row in lines[1:] if not _are_numbers(row, at)), None)
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


def _are_numbers(row: list[str], at: list[int]) -> bool:
    try:
        return all(np.isfinite(float(row[k])) for k in at)
    except (ValueError, IndexError):
        return False


COMPRESSOR_FIELDS = (
    Field("work_slope", "number", "s: fall of work with flow coefficient at design", 1.2, minimum=0.05, maximum=8.0),
    Field(
        "choking_exponent", "number", "c: how much the speed lines steepen with flow", 3.0, minimum=0.5, maximum=15.0
    ),
    Field("flow_speed_exponent", "number", "e: flow at constant work coefficient ∝ n^e", 1.1, minimum=0.1, maximum=8.0),
    Field("work_speed_exponent", "number", "q: work at constant flow coefficient ∝ n^q", 2.0, minimum=0.5, maximum=4.5),
    Field(
        "loss_incidence", "number", "a: growth of loss off the best flow coefficient", 4.0, minimum=0.0, maximum=60.0
    ),
    Field("loss_speed", "number", "b: growth of loss off design speed", 0.5, minimum=-2.0, maximum=20.0),
    Field("loss_speed_slope", "number", "g: tilt of loss with speed", 0.0, minimum=-2.0, maximum=2.0),
)
COMPRESSOR_COEFFICIENTS = tuple(f.name for f in COMPRESSOR_FIELDS)


def work_and_loss(n: Value, w: Value, design_loss: float, coefficient: dict[str, Value]) -> tuple[Value, Value]:
    """Relative work ψ and loss L of shape (N,) at relative corrected speed n and flow w."""
    c = coefficient
    log_n = log(n)
    x = w * exp(-(c["flow_speed_exponent"] * log_n))
    q = c["work_speed_exponent"]
    level = n * n if isinstance(q, float) and q == 2.0 else exp(q * log_n)
    work = level * (1.0 + (c["work_slope"] / c["choking_exponent"]) * (1.0 - power(x, c["choking_exponent"])))
    off_flow, off_speed = x - 1.0, n - 1.0
    loss = level * (
        design_loss
        * (
            1.0
            + c["loss_incidence"] * (off_flow * off_flow)
            + off_speed * (c["loss_speed"] * off_speed + c["loss_speed_slope"])
        )
    )
    return work, loss


VANES = Section(
    "vanes",
    "guide vanes and variable stators, moved by the actuator <compressor>.vane_closing_deg",
    (
        Field(
            "flow_per_deg",
            "number",
            "a: fall of corrected flow per degree of closing",
            0.01,
            unit="1/deg",
            minimum=0.0,
            maximum=0.05,
        ),
        Field(
            "loss_per_deg2",
            "number",
            "b: fall of efficiency per square degree",
            3e-4,
            unit="1/deg2",
            minimum=0.0,
            maximum=5e-3,
        ),
        Field("open_stop_deg", "number", "closing at the open stop; 0 is where the map holds", 0.0, unit="deg"),
        Field("closed_stop_deg", "number", "closing at the closed stop", 40.0, unit="deg"),
    ),
)


def closed_flow(flow: Value, flow_per_deg: Value, closing_deg: Value) -> Value:
    """Corrected flow, or a factor on it, (N,) with the vanes closed by `closing_deg` (N,)."""
    return flow * exp(-1.0 * (flow_per_deg * closing_deg))


def closed_efficiency(efficiency: Value, loss_per_deg2: Value, closing_deg: Value) -> Value:
    """Isentropic efficiency, or a factor on it, (N,) with the vanes closed by `closing_deg` (N,)."""
    return efficiency / (1.0 + loss_per_deg2 * (closing_deg * closing_deg))


SURGE_LINE = Section(
    "surge_line",
    "points at which the compressor surges; beyond the first and last one the straight line goes on",
    (
        Field(
            "corrected_flow",
            "numbers",
            "corrected flow of each point, rising: in the units of the table, or in kg/s where there is none",
        ),
        Field("pressure_ratio", "numbers", "pressure ratio of each point: that of the table, or as it is"),
    ),
)


class SurgeLine:
    """Straight lines between the points. Raises ValueError where they are no line."""

    def __init__(self, values: Mapping[str, Any]):
        self.flow = np.asarray(values["corrected_flow"], dtype=float)
        self.ratio = np.asarray(values["pressure_ratio"], dtype=float)
        if self.flow.size != self.ratio.size or self.flow.size < 2 or (np.diff(self.flow) <= 0.0).any():
            raise ValueError("corrected_flow of its surge_line must rise, with one pressure_ratio each, at least two")

    def pressure_ratio(self, flow: Value) -> Value:
        """Pressure ratio of surge (N,) at a corrected flow (N,)."""
        slope = np.diff(self.ratio) / np.diff(self.flow)
        w = np.asarray(value(flow))
        k = np.clip(np.searchsorted(self.flow, w, side="right") - 1, 0, slope.size - 1)
        return chain(self.ratio[k] + slope[k] * (w - self.flow[k]), (slope[k], flow))


TURBINE_FIELDS = (
    Field("choking_exponent", "number", "k: how early the flow capacity saturates", 3.0, minimum=0.5, maximum=12.0),
    Field("capacity_speed_slope", "number", "c: fall of flow capacity with speed", 0.0, minimum=-0.5, maximum=0.5),
    Field("efficiency_loading", "number", "a: loss off the design blade-speed ratio", 0.5, minimum=0.0, maximum=5.0),
)
TURBINE_COEFFICIENTS = tuple(f.name for f in TURBINE_FIELDS)


def saturation(log_pressure_ratio: Value, choking_exponent: Value) -> Value:
    """√(1 − PR^−k), shape (N,)."""
    return sqrt(1.0 - exp(-(choking_exponent * log_pressure_ratio)))


def relative_capacity(
    log_pressure_ratio: Value, speed: Value, design_log_ratio: float, coefficient: dict[str, Value]
) -> Value:
    """W√T/P relative to design at ln PR and relative N/√T, shape (N,)."""
    k = coefficient["choking_exponent"]
    shape = saturation(log_pressure_ratio, k) / saturation(design_log_ratio, k)
    slope = coefficient["capacity_speed_slope"]
    return shape if isinstance(slope, float) and slope == 0.0 else shape * (1.0 - slope * (speed - 1.0))


def relative_efficiency(blade_speed_ratio: Value, coefficient: dict[str, Value]) -> Value:
    """η/η_d at ν/ν_d, shape (N,)."""
    off = blade_speed_ratio - 1.0
    return 1.0 - coefficient["efficiency_loading"] * (off * off)
