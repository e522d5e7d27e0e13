"""Min-max test: has a changed, whatever the others (b) did? Eq. (14) and below.

    b_a* = b_a − I_ab I_bb⁺ b_b      I_a* = I_aa − I_ab I_bb⁺ I_ba      t_a* = b_a*ᵀ (I_a*)⁺ b_a* ~ χ²(rank)

The GLR test splits exactly into two parts: t = t_a* + t̃_b.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.isolation.sensitivity import quadratic_form, sensitivity_test
from enginediag_cli.residuals.excitation import RANK_TOLERANCE, range_space
from enginediag_cli.residuals.score import Score


def minmax_test(score: Score, names: Sequence[str]) -> tuple[float, int]:
    """t_a* of the parameters `names` and its degrees of freedom (0: the others can imitate any change)."""
    a = score.indices(names)
    rest = [name for name in score.parameters if name not in names]
    if not rest:
        return score.glr, score.rank
    b, information = score.scaled()
    others = score.indices(rest)
    space = range_space(information[np.ix_(others, others)], np.ones(len(others)))
    regression = information[np.ix_(a, others)] @ (space.basis / space.eigenvalues) @ space.basis.T
    reduced_b = b[a] - regression @ b[others]
    reduced = information[np.ix_(a, a)] - regression @ information[np.ix_(others, a)]
    # what is left of a column after projection is known only to the rank tolerance of the whole column
    floor = RANK_TOLERANCE * float(np.max(np.diag(information), initial=0.0))
    return quadratic_form(reduced_b, reduced, floor)


def single_minmax(score: Score) -> tuple[np.ndarray, np.ndarray]:
    """t* of each parameter alone (p,) and whether it has a degree of freedom left (p,)."""
    results = [minmax_test(score, [name]) for name in score.parameters]
    return np.array([t for t, _ in results]), np.array([dof > 0 for _, dof in results])


def rejection_test(score: Score, isolated: Sequence[str]) -> tuple[float, int]:
    """Is something outside `isolated` needed? t_b* = t − t̃_a with rank − |a| degrees of freedom (step 2)."""
    explained, dof = sensitivity_test(score, isolated) if isolated else (0.0, 0)
    return max(score.glr - explained, 0.0), score.rank - dof
