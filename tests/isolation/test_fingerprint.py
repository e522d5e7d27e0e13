"""Deviations of readings, and what changes foretell of them, against statistics made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.isolation.results import fingerprint, restricted_change
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.statistics import LocalStatistics

J = np.array([[3.0, -1.0], [0.5, 2.0], [1.0, 1.0]])
"""Three readings, two health parameters."""
SIGMA = np.array([0.5, 1.0, 2.0])
RECORDS = 50


def statistics(change: np.ndarray, *, biases: bool = True) -> LocalStatistics:
    """Without noise: readings deviate by J times the change."""
    columns = np.hstack([J, np.eye(3)]) if biases else J
    names = [f"part.q{k}" for k in range(2)] + [f"sensor.S{k}.bias" for k in range(3)] * biases
    weight = RECORDS / SIGMA**2
    F = columns.T @ (weight[:, None] * columns)
    families = ["health"] * 2 + ["sensor"] * 3
    meaning = {
        n: Parameter(n, f, 0.0, -1.0, 1.0, 1.0, component=n, quantity="bias" if f == "sensor" else "q")
        for n, f in zip(names, families, strict=False)
    }
    p = len(names)
    s = columns.T @ (weight * (J @ change))
    return LocalStatistics(tuple(names), np.zeros(p), np.ones(p) * 1e3, s, F, F, RECORDS, 0.0, 150.0, meaning=meaning)


def test_a_reading_deviates_by_what_it_does_and_the_answer_foretells_it() -> None:
    change = np.array([0.2, -0.4])
    found = fingerprint(statistics(change), [("part.q0", "part.q1"), ("sensor.S1.bias",)])
    assert found is not None
    assert found.deviation == pytest.approx(J @ change)
    assert found.error == pytest.approx(SIGMA / np.sqrt(RECORDS))
    assert found.predicted[0] == pytest.approx(J @ change, rel=1e-4)
    assert found.predicted[1][[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_change_of_the_answer_alone_is_weighted_least_squares() -> None:
    change = np.array([0.2, -0.4])
    size, error = restricted_change(statistics(change), ("part.q0", "part.q1"))
    covariance = np.linalg.inv(J.T @ np.diag(RECORDS / SIGMA**2) @ J)
    assert size == pytest.approx(change, rel=1e-4)
    assert error == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-4)


def test_without_the_sensors_errors_there_is_no_fingerprint() -> None:
    assert fingerprint(statistics(np.array([0.1, 0.0]), biases=False)) is None
    assert fingerprint(statistics(np.array([0.1, 0.0])), [("unknown",)]) is None
