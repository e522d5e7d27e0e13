"""Sensitivity test: how well a change of the parameters a alone explains the residual, eqs. (12) and (13).

    t̃_a = rᵀΣ⁻¹M_a (M_aᵀΣ⁻¹M_a)⁻¹ M_aᵀΣ⁻¹ r = b_aᵀ I_aa⁺ b_a ~ χ²(|a|)   if nothing else changed

It is biased when parameters outside a changed too; for that there is the min-max test.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.residuals.excitation import RANK_TOLERANCE, range_space
from enginediag_cli.residuals.score import Score


def quadratic_form(b: np.ndarray, information: np.ndarray, floor: float = 0.0) -> tuple[float, int]:
    """bᵀ I⁺ b and rank of I for scaled b (q,), I (q, q); eigenvalues up to `floor` count as zero."""
    space = range_space(information, np.ones(len(b)))
    kept = space.eigenvalues > floor
    v = b @ space.basis[:, kept]
    return float(np.sum(v**2 / space.eigenvalues[kept])), int(kept.sum())


def sensitivity_test(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """t̃_a of the parameters `names` and its degrees of freedom."""
    a = score.indices(names)
    b, information = score.scaled()
    floor = RANK_TOLERANCE * float(np.max(np.diag(information), initial=0.0))
    return quadratic_form(b[a], information[np.ix_(a, a)], floor)


def single_sensitivities(score: Score) -> np.ndarray:
    """t̃ of each parameter alone (p,): b_i²/I_ii, zero where the parameter is not excited."""
    b, information = score.scaled()
    diagonal = np.diag(information)
    seen = diagonal > RANK_TOLERANCE * np.max(diagonal, initial=0.0)
    return np.where(seen, b**2 / np.where(seen, diagonal, 1.0), 0.0)
