"""What a model misses at operating points that are flown again and again: one number for each reading and point.

Records of a fleet at a few conditions say where the model's error lies there, to the scatter of one reading over the
root of their number. What no error of the maps can be is then

    y_s = Φ_s(u, θ) + d_s,c(u),     d_sc ~ N(0, s_s²),

with c(u) the operating point at which a record is. It is the same when a window is judged, and cancels there, as far as
it is known; counted as noise it would hide what changes, and what engines differ by. Records at none of the points have
one such error in common, of which training knows nothing but its size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.wrapped import Question, WrappedModel
from enginediag_cli.parameters import Parameter

POINT_FAMILY = "point_error"
"""Family of what the model misses at operating points."""


@dataclass(frozen=True)
class OperatingPoints:
    """Boxes of the inputs: `low` and `high` (k, d) of k operating points, column by column of `inputs`."""

    inputs: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray

    def __len__(self) -> int:
        return len(self.low)

    def of(self, inputs: Mapping[str, Any]) -> np.ndarray:
        """Number of the point at which each record is, (N,) int, k where it is at none."""
        u = np.column_stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(inputs[c], float)) for c in self.inputs)))
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        distance = np.max(np.abs(u[:, None, :] - middle) / half, axis=2)
        return np.where(np.nanmin(distance, axis=1, initial=np.inf) <= 1.0, distance.argmin(axis=1), len(self))


class PointErrorModel(WrappedModel):
    """`model` with what it misses at operating points among its parameters; `sizes`: column → standard deviation."""

    def __init__(self, model: Any, points: OperatingPoints, sizes: Mapping[str, float]):
        self.points, self.sizes = points, dict(sizes)
        self.groups = {s: tuple(f"{POINT_FAMILY}.{s}.{c + 1}" for c in range(len(points) + 1)) for s in sizes}
        self._place = {name: (s, c) for s, names in self.groups.items() for c, name in enumerate(names)}
        super().__init__(model, {name: self._parameter(name, s, c) for name, (s, c) in self._place.items()})

    def _parameter(self, name: str, sensor: str, c: int) -> Parameter:
        where = f"at operating point {c + 1}" if c < len(self.points) else "elsewhere"
        words = f"what the model misses of {sensor} {where}"
        return Parameter(
            name, POINT_FAMILY, 0.0, -np.inf, np.inf, self.sizes[sensor], "", words, sensor, "error", words, where
        )

    def _answer(self, asked: Question) -> Any:
        """Each reading moved by what the model misses of it at the record's operating point."""
        amounts, wrt = {name: float(value) for name, value in asked.own.items()}, asked.wrt
        along = tuple(n for n in wrt if n not in self._place)
        p = self._ask(asked, wrt=along)
        if len(along) == len(wrt) and not any(amounts.values()):
            return p
        at, y = self.points.of(asked.inputs), p.y.copy()
        at = np.broadcast_to(at, len(y))
        table = np.zeros((len(self.points) + 1, y.shape[1]))
        J = np.zeros((*y.shape, len(wrt)))
        column = {s: j for j, s in enumerate(p.columns)}
        for name, value in amounts.items():
            s, c = self._place[name]
            if s in column:
                table[c, column[s]] = value
        J[:, :, [i for i, n in enumerate(wrt) if n not in self._place]] = p.jacobian
        for i, name in enumerate(wrt):
            s, c = self._place.get(name, ("", 0))
            if s in column:
                J[:, column[s], i] = at == c
        return replace(p, y=y + table[at], jacobian=J, wrt=wrt)


def sized(model: PointErrorModel, sizes: Mapping[str, float]) -> PointErrorModel:
    """The same with other sizes."""
    return PointErrorModel(model.model, model.points, sizes)
