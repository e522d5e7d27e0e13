"""Forward–backward over all records at once says what the sum over every path of states says."""

from __future__ import annotations

from itertools import product

import numpy as np

from enginediag_cli.mismatch.unrecorded import chain
from enginediag_cli.mismatch.unrecorded.chain import forward_backward, transitions

GAP = np.array([0, 1, 1, 3, 0, 1, 1])


def test_posteriors_and_evidence_are_those_of_all_paths():
    rng = np.random.default_rng(0)
    steps = transitions(GAP, np.array([0.1, 0.3])) + rng.normal(0, 2, (2, len(GAP), 2, 2)) * (GAP > 0)[:, None, None]
    steps[:, GAP == 0] += rng.normal(0, 2, (2, 2, 1, 2))  # nothing is known of the record before
    found = forward_backward(steps)
    for s in range(2):
        paths = np.array(list(product([0, 1], repeat=len(GAP))))
        before = np.column_stack([np.zeros(len(paths), int), paths[:, :-1]])
        log_p = steps[s, np.arange(len(GAP)), before, paths].sum(axis=1)
        p = np.exp(log_p)
        assert np.isclose(found.log_evidence[s], np.log(p.sum()), atol=1e-10)
        w = p / p.sum()
        assert np.allclose(found.on[s], w @ paths, atol=1e-10)
        assert np.allclose(found.both[s, 1:], w @ (paths[:, 1:] * paths[:, :-1]), atol=1e-10)
        assert np.allclose(found.changed[s, 1:], w @ (paths[:, 1:] != paths[:, :-1]), atol=1e-10)


def test_a_gap_counts_as_so_many_chances_to_change():
    one = np.exp(transitions(np.array([0, 1]), np.array([0.07])))[0, 1]
    five = np.exp(transitions(np.array([0, 5]), np.array([0.07])))[0, 1]
    assert np.allclose(np.linalg.matrix_power(one, 5), five)


def test_certain_readings_over_hours_do_not_overflow():
    rng = np.random.default_rng(1)
    N = 5000
    truth = np.cumsum(rng.uniform(size=N) < 0.05) % 2
    steps = transitions(np.r_[0, np.ones(N - 1)], np.array([0.05]))
    steps = steps + np.where(truth[:, None] == np.array([0, 1]), 0.0, -1e4)[None, :, None, :]
    found = forward_backward(steps)
    assert np.array_equal(found.on[0] > 0.5, truth == 1)
    assert np.isfinite(found.log_evidence).all()


def test_probabilities_and_their_logarithms_give_the_same_posterior(monkeypatch):
    rng = np.random.default_rng(2)
    N = 700
    gap = np.r_[0, rng.integers(0, 3, N - 1)]
    steps = transitions(gap, np.array([0.2, 0.01])) + rng.normal(0, 40, (2, N, 1, 2))
    plain = forward_backward(steps)
    monkeypatch.setattr(chain, "FAR_APART", 0.0)
    logs = forward_backward(steps)
    for name in ("log_evidence", "on", "both", "changed"):
        assert np.allclose(getattr(plain, name), getattr(logs, name), rtol=1e-9, atol=1e-9)
