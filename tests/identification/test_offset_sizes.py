"""Sizes of offsets between recordings by marginal likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.instruments import ArrowData, likeliest_offsets, log_likelihood


def drawn(rng, recordings, size, information=400.0, parameters=1):
    """One offset of true standard deviation `size` (in present ones), seen beside parameters of all records."""
    z = size * rng.standard_normal((recordings, 1))
    H_zz = np.full((recordings, 1, 1), information)
    H_xz = np.full((recordings, parameters, 1), information)
    b_z = information * z + np.sqrt(information) * rng.standard_normal((recordings, 1))
    H_xx = recordings * information * np.ones((parameters, parameters))
    return ArrowData(H_xx, H_xz, H_zz, np.full(parameters, b_z.sum()), b_z)


def by_hand(data, t):
    """ln L with the joint matrix of parameters and offsets written out."""
    R, p, q = data.H_xz.shape
    n = p + R * q
    H, b, T = np.zeros((n, n)), np.concatenate([data.b_x, data.b_z.ravel()]), np.ones(n)
    H[:p, :p] = data.H_xx
    for r in range(R):
        own = slice(p + r * q, p + (r + 1) * q)
        H[:p, own], H[own, :p], H[own, own], T[own] = data.H_xz[r], data.H_xz[r].T, data.H_zz[r], t
    inner = np.eye(n) + T[:, None] * H * T
    return 0.5 * (T * b) @ np.linalg.solve(inner, T * b) - 0.5 * np.linalg.slogdet(inner)[1]


def test_the_likelihood_and_its_slopes_are_those_of_the_joint_matrix():
    rng = np.random.default_rng(1)
    R, p, q = 4, 3, 2
    rows = [(rng.standard_normal((9, p)), rng.standard_normal((9, q))) for _ in range(R)]
    e = rng.standard_normal((R, 9))
    data = ArrowData(
        sum(X.T @ X for X, _ in rows),
        np.stack([X.T @ Z for X, Z in rows]),
        np.stack([Z.T @ Z for _, Z in rows]),
        sum(X.T @ k for (X, _), k in zip(rows, e, strict=True)),
        np.stack([Z.T @ k for (_, Z), k in zip(rows, e, strict=True)]),
    )
    t = np.array([0.7, 1.6])
    value, slopes = log_likelihood(data, t)
    assert value == pytest.approx(by_hand(data, t))
    step = 1e-6
    for j in range(q):
        up, down = (by_hand(data, t * np.exp(np.where(np.arange(q) == j, d, 0.0))) for d in (step, -step))
        assert slopes[j] == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("size", [0.3, 1.0, 4.0])
def test_a_known_scatter_is_found_within_its_sampling_error(size):
    found = [
        likeliest_offsets(drawn(np.random.default_rng(k), 40, size), np.ones(1), np.ones(1), np.ones(1, bool))[0]
        for k in range(20)
    ]
    # each is known to 1/√(2·39), and what is usual holds it by little
    assert np.log(np.array(found) / size) == pytest.approx(np.zeros(20), abs=3.5 / np.sqrt(78))
    assert np.mean(np.log(np.array(found) / size)) == pytest.approx(0.0, abs=0.06)


def test_where_there_is_no_scatter_the_size_falls_below_what_the_records_could_show():
    data = drawn(np.random.default_rng(2), 40, 0.0)
    found = likeliest_offsets(data, np.ones(1), np.ones(1), np.ones(1, bool))[0]
    assert found < 1.0 / np.sqrt(400.0)  # the standard error of one recording's offset


def test_the_answer_does_not_depend_on_the_unit_of_the_present_sizes():
    data = drawn(np.random.default_rng(3), 6, 1.0)
    one = likeliest_offsets(data, np.ones(1), np.ones(1), np.ones(1, bool))
    scaled = ArrowData(data.H_xx, 5 * data.H_xz, 25 * data.H_zz, data.b_x, 5 * data.b_z)
    other = 5 * likeliest_offsets(scaled, np.full(1, 5.0), np.ones(1), np.ones(1, bool))
    assert other == pytest.approx(one, rel=1e-3)


def test_stated_sizes_stay():
    data = drawn(np.random.default_rng(4), 6, 3.0)
    assert likeliest_offsets(data, np.ones(1), np.ones(1), np.zeros(1, bool)) == pytest.approx([1.0])
