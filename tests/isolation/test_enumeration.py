"""All sets at once: quadratic forms and determinants are those of each set alone, by elimination and in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.isolation.subsets import count_sets, enumerate_sets, enumeration_masks


def problem(p, slabs=2):
    rng = np.random.default_rng(p)
    root = rng.standard_normal((slabs, p, p + 3))
    return rng.standard_normal((slabs, p)), np.eye(p) + root @ root.transpose(0, 2, 1)


@pytest.mark.parametrize("most", [0, 1, 2, 3])
@pytest.mark.parametrize("limit", [1, 2, 4, 7])
@pytest.mark.parametrize("few", [[], [0, 2, 5], [3, 4, 5, 6], list(range(7)), [1]])
def test_every_set_has_the_form_and_determinant_of_its_own(few, limit, most):
    beta, A = problem(7)
    rare = np.isin(np.arange(7), few)
    masks, quadratic, log_det = enumerate_sets(beta, A, limit, rare, most)
    wanted = {
        tuple(bits)
        for bits in np.ndindex(*[2] * 7)
        if sum(bits) <= limit and sum(b for b, r in zip(bits, rare, strict=True) if r) <= most
    }
    found = [tuple(map(int, mask)) for mask in masks]
    assert set(found) == wanted and len(found) == len(wanted) == count_sets(7, limit, len(few), most)
    for k, mask in enumerate(masks):
        s = np.flatnonzero(mask)
        for w in range(2):
            inner = A[w][np.ix_(s, s)]
            assert quadratic[w, k] == pytest.approx(beta[w, s] @ np.linalg.solve(inner, beta[w, s]) if s.size else 0)
            assert log_det[w, k] == pytest.approx(np.linalg.slogdet(inner)[1] if s.size else 0, abs=1e-12)
    assert np.array_equal(enumeration_masks(7, limit, tuple(rare.tolist()), most), masks)
