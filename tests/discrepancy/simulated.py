"""A small linear problem with known truth: two sensors, three places, readings that nobody's code has fitted."""

from __future__ import annotations

import numpy as np

from enginediag_cli.discrepancy.linearised import CandidatePlace, LinearProblem
from enginediag_cli.engine.term import Driver, DriverValues

RECORDS = 80


def place(name: str, scale: float = 1.0, sign: int = 0) -> CandidatePlace:
    return CandidatePlace(name, name, name, {name: 1.0}, scale, scale, sign)


def problem(seed: int = 0, records: int = RECORDS, amplitude: np.ndarray | None = None) -> LinearProblem:
    """White noise of the stated size and a little drift; `amplitude` (N,) acts at place "a"."""
    rng = np.random.default_rng(seed)
    N, m = records, 2
    t = 20.0 * np.arange(N)
    speed = np.sin(np.arange(N) / 7.0) + 0.1 * rng.standard_normal(N)
    mach = np.cos(np.arange(N) / 11.0)
    points = np.column_stack([speed, mach])
    G = np.zeros((N, m, 3))
    G[:, 0, 0], G[:, 1, 0] = 1.0, 0.5 + 0.1 * mach
    G[:, 0, 1], G[:, 1, 1] = 1.0, -0.6
    G[:, 0, 2], G[:, 1, 2] = 0.2, 1.0 + 0.3 * speed
    X = np.zeros((N, m, 3))
    X[:, 0, 0] = X[:, 1, 1] = 3.0
    # the map of machine b, wrong along speed
    X[:, :, 2] = 0.3 * G[:, :, 1] * speed[:, None]
    y = 0.8 * rng.standard_normal((N, m)) + X @ np.array([0.4, -0.6, 0.5])
    if amplitude is not None:
        y = y + G[:, :, 0] * amplitude[:, None]
    drivers = tuple(DriverValues(Driver(n, n), n, v, n) for n, v in (("speed", speed), ("Mach number", mach)))
    return LinearProblem(
        ("T_K", "W_kg_s"),
        y,
        np.ones((N, m), bool),
        X,
        G,
        (place("a", sign=1), place("b"), place("c")),
        np.array([0, 0, 1]),
        ("b",),
        np.ones(N),
        t,
        np.zeros(N, int),
        np.zeros(N, int),
        np.zeros(N, int),
        points,
        drivers,
        np.ones(m),
    )
