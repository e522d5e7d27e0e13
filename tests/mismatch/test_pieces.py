"""A stretch of records does not confirm its own state through what is identified with it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from enginediag_cli.mismatch.unrecorded import states
from enginediag_cli.mismatch.unrecorded.pieces import EVEN, Account, judged
from enginediag_cli.mismatch.unrecorded.states import Bounds, States, two_states
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction

FLIGHT, HIGH = 40, 6
SIZE = 3.0


def linear(e, nuisance, gap):
    """Basis and direction of one sensor whose readings the amplitude moves by 1: e (N,), nuisance (N, q) of prior 1."""
    N, q = nuisance.shape
    Q = np.linalg.qr(np.vstack([nuisance, np.eye(q)]))[0]
    whole = np.concatenate([e, np.zeros(q)])
    pull = Q.T @ whole
    left = e - Q[:N] @ pull
    of = Basis(SimpleNamespace(), Q[:N, None], e[:, None], left[:, None], 0.0, pull, Q[N:], gap)
    one, none = np.ones((N, 1)), np.zeros((N, 1))
    return of, Direction(one, none, np.ones(N), np.zeros(N - 1), of.rows)


def gaps():
    gap = np.ones(2 * FLIGHT)
    gap[[0, FLIGHT]] = 0.0
    return gap


def said(on):
    return States(on, np.zeros_like(on), SIZE, 0.0, 50.0, True)


def high_power():
    """A curve of the maps that only the first records of either flight show."""
    rows = np.arange(2 * FLIGHT) % FLIGHT < HIGH
    return 20.0 * rows[:, None].astype(float)


def test_a_stretch_that_the_nuisance_was_bent_to_is_turned_back():
    truth = np.zeros(2 * FLIGHT)
    truth[FLIGHT : FLIGHT + 20] = 1.0
    e = SIZE * truth + np.random.default_rng(0).standard_normal(2 * FLIGHT)
    of, along = linear(e, high_power(), gaps())
    wrong = truth.copy()
    wrong[:HIGH] = 1.0
    found = judged(of, along, Bounds(0.0, 50.0, 10.0), said(wrong))
    assert np.array_equal(found.on > 0.5, truth > 0.5)
    assert np.all(np.abs(found.on - truth) < 0.01)


def test_what_the_readings_cannot_say_is_told_with_fewer_changes_and_as_a_doubt():
    truth = np.zeros(2 * FLIGHT)
    truth[FLIGHT + 20 :] = 1.0
    e = SIZE * truth + np.random.default_rng(1).standard_normal(2 * FLIGHT)
    first = 100.0 * (np.arange(2 * FLIGHT) < HIGH)[:, None].astype(float)  # shows in no other record
    of, along = linear(e, first, gaps())
    start = truth.copy()
    start[:HIGH] = 1.0
    found = judged(of, along, Bounds(0.0, 50.0, 10.0), said(start))
    assert np.array_equal(found.on > 0.5, truth > 0.5)
    assert np.all((found.on[:HIGH] > 0.001) & (found.on[:HIGH] <= EVEN))
    assert np.all(np.abs(found.on - truth)[HIGH:] < 0.05)


def test_clear_states_stay_as_they_are():
    rng = np.random.default_rng(2)
    truth = np.zeros(2 * FLIGHT)
    truth[10:25], truth[FLIGHT + 5 : FLIGHT + 12] = 1.0, 1.0
    of, along = linear(2 * SIZE * truth + rng.standard_normal(2 * FLIGHT), high_power(), gaps())
    found = judged(of, along, Bounds(0.0, 50.0, 10.0), said(truth))
    assert np.all(np.abs(found.on - truth) < 1e-3)


def test_the_states_do_not_depend_on_how_many_chains_are_run_at_once(monkeypatch):
    truth = np.zeros(2 * FLIGHT)
    truth[FLIGHT + 9 : FLIGHT + 30] = 1.0
    e = SIZE * truth + np.random.default_rng(4).standard_normal(2 * FLIGHT)
    of, along = linear(e, high_power(), gaps())
    starts = np.stack([e > 1.5, e < 1.5, e > 0.0]).astype(float)
    bounds = Bounds(-50.0, 50.0, 10.0)
    whole = two_states(of, along, bounds, starts)
    monkeypatch.setattr(states, "AT_ONCE", 4 * len(e))
    parts = two_states(of, along, bounds, starts)
    assert whole.settled and parts.settled
    assert np.allclose(whole.on, parts.on, atol=1e-12) and np.mean((whole.on > 0.5) == (truth > 0.5)) > 0.9
    assert np.isclose(whole.evidence, parts.evidence) and np.isclose(whole.amplitude, parts.amplitude)


def test_all_exchanges_together_gain_what_each_gains_by_itself():
    rng = np.random.default_rng(3)
    N = 2 * FLIGHT
    of, _ = linear(rng.standard_normal(N), rng.standard_normal((N, 2)), gaps())
    own, before = rng.standard_normal((N, 1)), rng.standard_normal((N, 1))
    before[gaps() == 0.0] = 0.0
    diagonal, beside = own[:, 0] ** 2, before[1:, 0] * own[1:, 0]
    diagonal[:-1] += before[1:, 0] ** 2
    along = Direction(own, before, diagonal, beside, of.rows)
    account = Account(of, along, Bounds(-50.0, 50.0, 10.0), along.B, along.gathered(of.left))
    on = (rng.random(N) < 0.3).astype(float)
    pieces = [slice(0, 1), slice(0, N), slice(3, 9), slice(FLIGHT - 2, FLIGHT + 5), slice(N - 4, N)]
    alone = []
    for piece in pieces:
        other = on.copy()
        other[piece] = 1.0 - other[piece]
        alone.append(account(other))
    assert np.allclose(account.exchanged(on, pieces), alone, rtol=1e-12)
    one = np.zeros(N)
    one[5] = 1.0
    assert account.exchanged(one, [slice(5, 6)])[0] == account(np.zeros(N)) == -np.inf
