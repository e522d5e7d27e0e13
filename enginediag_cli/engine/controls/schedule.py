"""A value that follows something: a table read along straight lines, or a polynomial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.dual import Array, Value, chain, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter, spelled

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

PRIOR_SHARE = 0.05
"""How far a value of a schedule plausibly lies from what is stated, as a share of its largest. Judgement."""
REACH = 10.0
"""Bounds of a value, in such standard deviations."""


@dataclass(frozen=True)
class Schedule:
    """v(x): straight lines through (`points`, values), the end values beyond them, or Σ c_i x^i.

    `part`: the control that it belongs to. x is `column`, in its unit: an input (`is_input`) or a model column. Values
    or coefficients, with their parameters `<owner>.value_1`, … are in `unit`.
    """

    part: str
    owner: str
    column: str
    is_input: bool
    points: tuple[float, ...]
    values: tuple[float, ...]
    unit: str

    @staticmethod
    def declared(of: tuple[str, ...], values: Mapping[str, Any], unit: str, inputs: Mapping[str, Any]) -> Schedule:
        """From the file; `of`: the control, and what of it follows the schedule; `inputs`: of the engine without
        controls. ValueError says what is wrong."""
        points, table, law = (tuple(float(v) for v in values[k]) for k in ("points", "values", "polynomial"))
        if bool(values["against"]) == bool(values["input"]):
            raise ValueError("a schedule names what it follows, either `against` a model column or an `input`")
        if bool(table) == bool(law):
            raise ValueError("a schedule has either `points` and `values` or a `polynomial`")
        if table and (len(points) != len(table) or len(points) < 2 or (np.diff(points) <= 0.0).any()):
            raise ValueError("`points` must rise, with one of `values` for each, at least two")
        column = values["against"] or values["input"]
        return Schedule(
            of[0], ".".join(of), column, bool(values["input"]) or column in inputs, points, table or law, unit
        )

    def names(self) -> tuple[str, ...]:
        return tuple(f"{self.owner}.value_{k + 1}" for k in range(len(self.values)))

    def parameters(self) -> tuple[Parameter, ...]:
        found = []
        size = max(abs(v) for v in self.values) or 1.0
        for k, (name, v) in enumerate(zip(self.names(), self.values, strict=True)):
            sigma = PRIOR_SHARE * (size if self.points else abs(v) or size)
            told = f"at {self.points[k]:g}" if self.points else f"coefficient of power {k}"
            found.append(
                Parameter(
                    name,
                    "design",
                    v,
                    v - REACH * sigma,
                    v + REACH * sigma,
                    sigma,
                    self.unit,
                    f"value of the schedule {told}",
                    self.part,
                    f"value_{k + 1}",
                    f"{spelled(self.owner)} {told}",
                    spelled(self.part),
                )
            )
        return tuple(found)

    def at(self, e: Evaluation, network: Network) -> Value:
        """The value in this evaluation (N,)."""
        return self.of(e, e[self.column] if self.is_input else network.read(e, self.column))

    def of(self, e: Evaluation, x: Value) -> Value:
        """The value at x, both (N,)."""
        v = [e[name] for name in self.names()]
        if not self.points:
            total: Value = v[-1]
            for c in reversed(v[:-1]):
                total = total * x + c
            return total
        plain = np.asarray(value(x), dtype=float)
        hats, slopes = self._hats(plain)
        total = 0.0
        for hat, c in zip(hats, v, strict=True):
            total = total + hat * c
        along = sum(s * np.asarray(value(c)) for s, c in zip(slopes, v, strict=True))
        return total + chain(np.zeros_like(plain), (np.asarray(along), x))

    def inverse(self, wanted: float) -> float:
        """An x at which the value is `wanted`, as stated in the file; the nearest point's where there is none."""
        xs = np.asarray(self.points or np.linspace(0.0, 1.0, 101))
        ys = np.asarray(self.values) if self.points else np.polynomial.polynomial.polyval(xs, self.values)
        for k in range(len(xs) - 1):
            low, high = sorted((ys[k], ys[k + 1]))
            if low <= wanted <= high and low < high:
                return float(xs[k] + (wanted - ys[k]) / (ys[k + 1] - ys[k]) * (xs[k + 1] - xs[k]))
        return float(xs[np.argmin(np.abs(ys - wanted))])

    def _hats(self, x: Array) -> tuple[Array, Array]:
        """Weight of each value and its slope along x, (points, N) each."""
        grid = np.asarray(self.points)
        cell = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, len(grid) - 2)
        width = grid[cell + 1] - grid[cell]
        share = np.clip((x - grid[cell]) / width, 0.0, 1.0)
        slope = np.where((x >= grid[0]) & (x <= grid[-1]), 1.0 / width, 0.0)
        k = np.arange(len(grid)).reshape(-1, *([1] * np.ndim(x)))
        lower, upper = k == cell, k == cell + 1
        return lower * (1.0 - share) + upper * share, (upper * 1.0 - lower * 1.0) * slope
