"""A good start for the iteration: the unknowns as a polynomial of corrected operating coordinates.

In corrected terms an engine's unknowns depend on corrected power setting and flight Mach number, and only weakly on
temperature (real gas) and pressure. A Chebyshev product basis that spends its degree accordingly predicts them to about
1e-3. It is fitted to a few hundred anchor points that represent the whole envelope (`anchor_points`), or to points of
the batch where the envelope is not known.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from enginediag_cli.engine.dual import Array, value
from enginediag_cli.engine.evaluation import P_ISA, T_ISA, standard_atmosphere
from enginediag_cli.engine.gas import COLUMNS
from enginediag_cli.units import split_column

DEGREE = 9.0
"""Weighted degree of the fitted start. Judgement between a start near enough and the number of terms."""
WEIGHTS = {"power": 1.0, "mach": 1.3, "theta": 3.0, "delta": 5.0, "other": 3.0, "fixed": 1e9}
"""What a power of each coordinate costs of the degree: the engine bends most with power and Mach, hardly with what is
left of θ and δ after correction, not at all with what does not vary. Judgement."""
POWER_EXPONENTS = {
    "kg_s": (1, 1),
    "rpm": (0, 1),
    "K": (0, 2),
    "N": (1, 0),
    "W": (1, 1),
    "N_m": (1, 0),
    "": (0, 0),
}
"""Of (δ, √θ) in the corrected power setting, by the unit of its column: any flow of fuel, speed, temperature, thrust,
power and torque (power over speed); a pressure ratio is corrected as it stands."""
UNCORRECTED = (0, 0)
"""Of a set point, which asks for the same power whatever the air is."""


def correction(column: str, theta: Array, delta: Array) -> Array:
    """What a power setting is divided by to correct it to ISA sea level."""
    a, b = POWER_EXPONENTS.get(split_column(column)[1], UNCORRECTED)
    return delta**a * theta ** (0.5 * b)


@np.errstate(all="ignore")  # wild inputs are flagged where they are used
def total_ratios(inputs: Mapping[str, Any]) -> tuple[Array, Array]:
    """θ₂ and δ₂ with constant γ = 1.4: close enough for a start and for corrected power settings."""
    if "altitude_m" in inputs:
        T, P = (np.asarray(value(x)) for x in standard_atmosphere(np.asarray(inputs["altitude_m"], dtype=float)))
        ram = 1.0 + 0.2 * np.asarray(inputs["mach"], dtype=float) ** 2
        return (T + inputs["dT_isa_K"]) / T_ISA * ram, P / P_ISA * ram**3.5
    theta = np.asarray(inputs["ambient_temperature_K"], dtype=float) / T_ISA
    return theta, np.asarray(inputs["ambient_pressure_Pa"], dtype=float) / P_ISA


@np.errstate(all="ignore")  # wild inputs are flagged where they are used
def coordinates(power_setting: str, inputs: Mapping[str, Any], size: int) -> tuple[tuple[str, ...], Array]:
    """Names and values (k, N) of the corrected coordinates; inputs of their own keep their column's name."""
    theta, delta = total_ratios(inputs)
    kinds, rows = (
        ["power"],
        [np.log(np.maximum(inputs[power_setting] / correction(power_setting, theta, delta), 1e-12))],
    )
    if "mach" in inputs:
        kinds.append("mach")
        rows.append(np.asarray(inputs["mach"], dtype=float))
    kinds += ["theta", "delta"]
    rows += [np.log(theta), np.log(delta)]
    for column, x in inputs.items():
        if column not in (
            power_setting,
            "altitude_m",
            "mach",
            "dT_isa_K",
            "ambient_temperature_K",
            "ambient_pressure_Pa",
        ):
            kinds.append(column)
            rows.append(x / np.sqrt(theta) if split_column(column)[1] == "rpm" else np.asarray(x, dtype=float))
    return tuple(kinds), np.stack([np.broadcast_to(r, (size,)) for r in rows])


@lru_cache(maxsize=32)
def basis(kinds: tuple[str, ...], degree: float) -> tuple[tuple[int, ...], ...]:
    """Exponents of every Chebyshev product of weighted degree ≤ degree."""
    weights = [WEIGHTS.get(k, WEIGHTS["other"]) for k in kinds]
    ranges = [range(int(degree / w) + 1) for w in weights]
    return tuple(t for t in itertools.product(*ranges) if sum(e * w for e, w in zip(t, weights, strict=True)) <= degree)


@dataclass(frozen=True)
class StartFit:
    """ln x (nx, N) = coefficients (nx, terms) · Chebyshev products of scaled coordinates."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    low: Array
    high: Array
    degree: float
    coefficients: Array

    @staticmethod
    def fit(kinds: tuple[str, ...], z: Array, x: Array, degree: float = DEGREE) -> StartFit | None:
        """Least squares on anchors z (k, n), x (nx, n); None when there are too few for a useful polynomial."""
        low, high = z.min(axis=1), z.max(axis=1)
        moving = tuple(
            "fixed" if h - l < 1e-9 * max(1.0, abs(h)) else k for k, l, h in zip(kinds, low, high, strict=True)
        )
        while len(basis(moving, degree)) * 1.6 > z.shape[1]:
            degree -= 1.0
            if degree < 1.0:
                return None
        A = _features(moving, degree, low, high, z)
        coefficients = np.linalg.lstsq(A.T, np.log(x).T, rcond=1e-10)[0].T
        return StartFit(kinds, moving, low, high, degree, np.ascontiguousarray(coefficients))

    def covers(self, names: tuple[str, ...], z: Array) -> Array:
        """Which points (N,) have these coordinates and lie within the anchors' range, with a margin of 2 %."""
        if names != self.names:
            return np.zeros(z.shape[1], dtype=bool)
        margin = 0.02 * (self.high - self.low) + 1e-9
        return ((z >= (self.low - margin)[:, None]) & (z <= (self.high + margin)[:, None])).all(axis=0)

    @np.errstate(all="ignore")
    def predict(self, z: Array) -> Array:
        """Starting unknowns (nx, N)."""
        n = z.shape[1]
        z = np.pad(z, ((0, 0), (0, -n % COLUMNS)), mode="edge")
        features = _features(self.kinds, self.degree, self.low, self.high, z)
        # a library's product of so many terms sums them in an order that depends on the column
        return np.exp(np.einsum("ij,jn->in", self.coefficients, features)[:, :n])


def _features(kinds: tuple[str, ...], degree: float, low: Array, high: Array, z: Array) -> Array:
    """Chebyshev products (terms, N) of coordinates scaled to [−1, 1]."""
    scaled = np.clip((2.0 * z - (low + high)[:, None]) / np.maximum(high - low, 1e-12)[:, None], -1.02, 1.02)
    terms = basis(kinds, degree)
    tables = []
    for k, row in enumerate(scaled):
        top = max(t[k] for t in terms)
        T = [np.ones_like(row), row]
        for _ in range(top - 1):
            T.append(2.0 * row * T[-1] - T[-2])
        tables.append(T)
    out = np.empty((len(terms), z.shape[1]))
    for m, exponents in enumerate(terms):
        product = None
        for k, power in enumerate(exponents):
            if power:
                product = tables[k][power] if product is None else product * tables[k][power]
        out[m] = 1.0 if product is None else product
    return out


ANCHORS = 150
"""Points that are solved first for a fitted start to be learnt from: twice its terms."""


def anchor_points(ranges: Mapping[str, tuple[float, float]], columns: Sequence[str]) -> dict[str, Array]:
    """ANCHORS values of every column within its range, evenly spread together, denser towards the ends, as a polynomial
    needs them. The same ones always.

    Additive recurrence on the powers of the root φ of φ^(d+1) = φ + 1 (M. Roberts, 2018, after H. Weyl).
    """
    d = len(columns)
    phi = 2.0
    for _ in range(60):
        phi = (1.0 + phi) ** (1.0 / (d + 1))
    share = (0.5 + np.arange(1, ANCHORS + 1) * phi ** -np.arange(1.0, d + 1)[:, None]) % 1.0
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    return {c: ranges[c][0] + (ranges[c][1] - ranges[c][0]) * u for c, u in zip(columns, share, strict=True)}
