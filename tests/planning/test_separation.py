"""How soon records set rivals apart: closed forms of linear rivals, and what cannot be told at all."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from enginediag_cli.isolation.planned_flights import ODDS, SURE, Adaptation, Outlook, Separation, fewest

RNG = np.random.default_rng(3)


def outlook(p, d, columns):
    """Two rivals whose readings differ by ±d (k, m), each free to adapt by its own columns."""
    first, second = (Adaptation.from_columns(c) for c in columns)
    return Outlook(np.array(p), [[None, second.separation(d)], [first.separation(-d), None]])


def test_without_anything_to_adapt_the_separation_is_the_squared_difference_times_the_records():
    d = RNG.standard_normal((5, 3))
    s = Adaptation.from_columns(np.zeros((5, 3, 2))).separation(d)
    assert s(7) == pytest.approx(7 * np.sum(d**2) / 5)


def test_one_column_of_known_spread_takes_its_share_in_closed_form():
    d, a = np.array([[1.0, 0.0]]), np.array([[[1.0], [1.0]]])
    s = Adaptation.from_columns(0.5 * a).separation(d)
    # min over y of n[(1 − y/2)² + (y/2)²] + y², y = n/2 / (1 + n/2)
    for n in (1.0, 10.0, 1e6):
        assert s(n) == pytest.approx(n - (n / 2) ** 2 / (1 + n / 2))


def test_it_is_what_the_information_of_both_recordings_says_beyond_that_of_the_first():
    """λ_sep(I + nG) − λ_sep(I), for a rival that was fitted to what the truth showed so far."""
    X, Z = RNG.standard_normal((40, 3)), RNG.standard_normal((6, 3))  # z and t of the truth; column 2 is the rival's
    t, y = [1], [0, 2]
    size, n = np.array([0.7]), 9.0

    def left(I):
        return float(
            size @ (I[np.ix_(t, t)] - I[np.ix_(t, y)] @ np.linalg.solve(I[np.ix_(y, y)], I[np.ix_(y, t)])) @ size
        )

    prior = np.diag([1.0, 0.0, 1.0])
    I = X.T @ X + prior
    G = Z.T @ Z / 6
    adapted = np.linalg.solve(I[np.ix_(y, y)], I[np.ix_(y, t)] @ size)
    root = np.linalg.cholesky(np.linalg.inv(I[np.ix_(y, y)]))
    d = Z[:, t] @ size - Z[:, y] @ adapted
    s = Adaptation.from_columns((Z[:, y] @ root)[:, None, :]).separation(d[:, None])
    assert s(n) == pytest.approx(left(I + n * G) - left(I))


def test_a_flight_along_which_the_rivals_columns_are_parallel_tells_nothing():
    a = RNG.standard_normal((4, 2))
    s = Adaptation.from_columns(1e4 * a[:, :, None]).separation(0.3 * a)
    assert s(1000.0) < 1e-6
    found = outlook([0.5, 0.5], 0.3 * a, [1e4 * a[:, :, None]] * 2)
    assert found.records == np.inf and found.chance(1000.0) == pytest.approx(0.0, abs=1e-12)


def test_the_chance_of_two_rivals_is_that_of_the_log_odds():
    d, none = np.full((1, 1), 2.0), np.zeros((1, 1, 0))
    found = outlook([0.7, 0.3], d, [none, none])
    lam, lead = 4.0 * 2, np.log(0.7 / 0.3)
    alone = [stats.norm.sf(np.log(ODDS), 0.5 * lam + s * lead, np.sqrt(lam)) for s in (1, -1)]
    assert found.chance(2.0) == pytest.approx(0.7 * alone[0] + 0.3 * alone[1])
    n = found.records
    assert found.chance(n) >= SURE > found.chance(n - 1)


def test_the_order_of_the_rivals_does_not_matter():
    readings, columns = RNG.standard_normal((3, 6, 2)), RNG.standard_normal((3, 6, 2, 4))
    p = np.array([0.5, 0.3, 0.2])

    def told(order):
        a = [Adaptation.from_columns(columns[k]) for k in order]
        table = [
            [None if g == h else a[j].separation(readings[h] - readings[g]) for j, g in enumerate(order)] for h in order
        ]
        return Outlook(p[list(order)], table)

    one, other = told((0, 1, 2)), told((2, 0, 1))
    assert one.chance(30.0) == pytest.approx(other.chance(30.0)) and one.records == other.records


def test_more_that_may_be_adapted_never_separates_more():
    d, Y = RNG.standard_normal((8, 3)), RNG.standard_normal((8, 3, 5))
    found = [Adaptation.from_columns(Y[:, :, :q]).separation(d)(50.0) for q in range(6)]
    assert all(a >= b - 1e-9 for a, b in pairwise(found))


def test_a_gram_matrix_gives_what_its_rows_give():
    d, Y = RNG.standard_normal((5, 3)), RNG.standard_normal((5, 3, 4))
    rows = np.concatenate([d[:, :, None], Y], axis=2).reshape(-1, 5)
    assert Separation.from_gram(rows.T @ rows / 5)(20.0) == pytest.approx(
        Adaptation.from_columns(Y).separation(d)(20.0)
    )


def test_what_never_is_enough_takes_infinitely_many_records():
    assert fewest(lambda n: n >= 37) == 37.0
    assert fewest(lambda n: False) == np.inf


def test_records_that_may_yet_bring_a_rival_back_are_not_enough():
    """Odds of 24 to one stand out now, but a hundred records that hardly separate upset them one time in four."""
    found = outlook([0.96, 0.04], np.full((1, 1), 0.2), [np.zeros((1, 1, 0))] * 2)
    assert found.chance(1e-9) > SURE > found.chance(50.0)
    assert found.records > 100.0 and found.chance(found.records) >= SURE > found.chance(found.records - 1)
