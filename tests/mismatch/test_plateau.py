"""Intervals of coefficients of which the records tell one end only."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.mismatch.fit import plateau
from enginediag_cli.mismatch.fit.plateau import interval_at


def interval(monkeypatch, chi2, at, error, bounds=(0.0, 1.0)):
    monkeypatch.setattr(plateau, "_objective", lambda found, j, value: chi2(value))
    problem = SimpleNamespace(names=("h",), lower=np.array(bounds[:1]), upper=np.array(bounds[1:]))
    return interval_at(SimpleNamespace(problem=problem, theta={"h": at}), "h", error)


def test_where_chi2_is_a_parabola_it_is_as_ever(monkeypatch):
    found = interval(monkeypatch, lambda h: 100.0 + ((h - 0.5) / 0.1) ** 2, 0.5, 0.1)
    assert found == pytest.approx((0.5 - 0.196, 0.5 + 0.196), abs=1e-3)


def test_of_what_is_at_least_so_large_the_upper_end_is_where_chi2_rises_or_the_bound(monkeypatch):
    def edge(h):
        return 100.0 + 50.0 * max(0.2 - h, 0.0) / 0.01

    low, high = interval(monkeypatch, edge, 0.2, 0.01)
    assert low == pytest.approx(0.2 - 0.0196, abs=1e-4) and high == 1.0

    def both(h):
        return edge(h) + 100.0 * (h > 0.6)

    assert 0.6 < interval(monkeypatch, both, 0.2, 0.01)[1] < 1.0


def test_an_interval_ends_at_the_bounds(monkeypatch):
    assert interval(monkeypatch, lambda h: 100.0, 0.3, 5.0) == (0.0, 1.0)
