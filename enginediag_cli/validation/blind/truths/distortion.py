"""A smooth error of a component map that no polynomial of low order describes.

Over a map's coordinates u (speed) and v (position on the speed line), both 0 to 1 where the engine flies, or over a
wider range where it hardly moves,

    error = Σ_k a_k sin(2π f_k (u cos ψ_k + v sin ψ_k) + φ_k) + b |u − u₀| + c_j sin(πv)

with waves k of random length and direction, a kink where the flow regime of the blades changes, and a waviness c_j that
each measured speed line j has for itself, linear between lines: maps of rigs are measured line by line. What the design
point has is taken away, since an engine is built to its design point, and the rest scaled so that its root mean square
about its mean, over that range, is the size asked for: the map's *shape* is wrong by that much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WAVES = 3
"""Enough that no two components are wrong in the same way."""
FREQUENCY = (0.3, 1.2)
"""Waves over the range that is flown, from and to: from a bend to a full swing."""
KINK, WAVINESS = 1.0, 0.35
"""Standard deviations of b and of c_j, where those of the a_k are 1. Judgement: a kink as large as a wave, and speed
lines that scatter by a third of it."""
LINES = 9
"""Speed lines that have a waviness of their own: as many as a rig measures between idle and full speed."""


LEAST_WIDTH = 0.3
"""Of either range, over the design value: an error does not swing within a few per cent of speed."""
GRID = 21
"""Values of u and of v at which the size of an error is measured."""


@dataclass(frozen=True)
class Range:
    """Where an engine flies in a map: `speed` and `position` of the points flown (N,), and of the design point."""

    speed: np.ndarray
    position: np.ndarray
    design: tuple[float, float]

    def scaled(self, speed: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """u and v of the equation above, of the shape of both together."""
        found = []
        for x, own, design in zip((speed, position), (self.speed, self.position), self.design, strict=True):
            width = max(float(np.ptp(own)), LEAST_WIDTH * design)
            found.append((np.asarray(x, float) - 0.5 * (own.min() + own.max())) / width + 0.5)
        u, v = np.broadcast_arrays(*found)
        return u, v


@dataclass(frozen=True)
class Distortion:
    """A drawn error: `at` gives it as a share. Amplitudes are those before scaling, `factor` and `shift` scale."""

    where: Range
    waves: np.ndarray
    middle: float
    kink: float
    lines: np.ndarray
    factor: float = 1.0
    shift: float = 0.0

    def at(self, speed: np.ndarray, position: np.ndarray) -> np.ndarray:
        """The error at points of the map, of the shape of both coordinates together."""
        return self.of(*self.where.scaled(speed, position))

    def of(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The same at scaled coordinates."""
        a, f, psi, phi = self.waves
        along = u[..., None] * np.cos(psi) + v[..., None] * np.sin(psi)
        raw = np.sum(a * np.sin(2.0 * np.pi * f * along + phi), axis=-1)
        raw = raw + self.kink * np.abs(u - self.middle)
        raw = raw + np.interp(u, np.linspace(0.0, 1.0, LINES), self.lines) * np.sin(np.pi * np.clip(v, 0.0, 1.0))
        return np.asarray(self.factor * raw - self.shift)


def draw_distortion(where: Range, size: float, rng: np.random.Generator) -> Distortion:
    """An error whose shape has the root mean square `size`, as a share, over the range that is flown."""
    waves = np.stack(
        [
            rng.standard_normal(WAVES),
            rng.uniform(*FREQUENCY, WAVES),
            rng.uniform(0.0, 2.0 * np.pi, WAVES),
            rng.uniform(0.0, 2.0 * np.pi, WAVES),
        ]
    )
    plain = Distortion(
        where,
        waves,
        float(rng.uniform(0.2, 0.8)),
        float(KINK * rng.standard_normal()),
        WAVINESS * rng.standard_normal(LINES),
    )
    spread = float(np.std(plain.of(*np.meshgrid(*[np.linspace(0.0, 1.0, GRID)] * 2))))
    factor = size / max(spread, 1e-9)
    at_design = float(plain.at(np.array(where.design[0]), np.array(where.design[1])))
    return Distortion(where, waves, plain.middle, plain.kink, plain.lines, factor, factor * at_design)
