"""How far each reading is from nominal, and what a set of changes would do to it, from local statistics alone.

Where every sensor's bias b_x is among the parameters, ∂y_x/∂b_x = 1, so that s_x = Σ r_x e_x and F_xq = Σ r_x ∂y_x/∂θ_q
with the weights r_x of sensor x, what is uncertain about nominal taken out. The weighted mean of the deviation of a
reading, and that which a change Δ foretells, are

    d_x = s_x / F_xx ,   var d_x = V_xx / F_xx² ,   f_x(Δ) = Σ_q F_xq Δ_q / F_xx

and the change of a set A of parameters that is likeliest, with its prior Δ_q ~ N(0, σ_q²), is
Δ_A = (F_Aᵀ V⁻¹ F_A + diag σ⁻²)⁻¹ F_Aᵀ V⁻¹ s with F_A the columns of A.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class Fingerprint:
    """Of m readings, named by the parameter that is their bias: deviation (m,) and standard error (m,) in the reading's
    unit, and what each of n sets of changes foretells (n, m)."""

    biases: tuple[str, ...]
    deviation: np.ndarray
    error: np.ndarray
    foretold: np.ndarray


def fingerprint(statistics: LocalStatistics, sets: Sequence[Sequence[str]] = ()) -> Fingerprint | None:
    """None where no sensor's bias is among the parameters, or one of `sets` holds a parameter that is not."""
    names, meaning = statistics.parameters, statistics.meaning
    rows = [
        i
        for i, name in enumerate(names)
        if name in meaning and meaning[name].of_sensor and meaning[name].quantity == BIAS
    ]
    rows = [i for i in rows if statistics.F[i, i] > 0]
    if not rows or any(name not in names for one in sets for name in one):
        return None
    weight = np.diag(statistics.F)[rows]
    foretold = [statistics.F[np.ix_(rows, _places(names, one))] @ likeliest(statistics, one) / weight for one in sets]
    return Fingerprint(
        tuple(names[i] for i in rows),
        statistics.s[rows] / weight,
        np.sqrt(np.diag(statistics.V)[rows]) / weight,
        np.array(foretold).reshape(len(sets), len(rows)),
    )


BIAS = "bias"
"""The error of a sensor that acts on its reading one to one."""


def likeliest(statistics: LocalStatistics, changed: Sequence[str]) -> np.ndarray:
    """The likeliest change (q,) of the parameters `changed`, in their units."""
    return given(statistics, changed)[0]


def given(statistics: LocalStatistics, changed: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest change (q,) of the parameters `changed`, and its standard error (q,), if these alone may have
    changed; in their units. The error is the root of the diagonal of (F_Aᵀ V⁻¹ F_A + diag σ⁻²)⁻¹."""
    places = _places(statistics.parameters, changed)
    if not places:
        return np.zeros(0), np.zeros(0)
    scale = statistics.prior_sigma
    V = statistics.V * scale * scale[:, None]
    F = (statistics.F * scale * scale[:, None])[:, places]
    weighted = np.linalg.pinv(V, hermitian=True) @ F
    covariance = np.linalg.inv(F.T @ weighted + np.eye(len(places)))
    change = covariance @ weighted.T @ (statistics.s * scale)
    return change * scale[places], np.sqrt(np.diag(covariance)) * scale[places]


def _places(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    return [names.index(name) for name in wanted]
