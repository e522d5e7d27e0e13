"""Contiguous-block cross-validation: refit without a block of consecutive records, then predict it.

Consecutive records share their model error, so leaving single records out would flatter the fit; whole blocks
do not (P. Burman, E. Chow and D. Nolan, Biometrika 81 (1994) 351–358).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.warm import apart
from enginediag_cli.identification.gauss_newton import Fit, solve
from enginediag_cli.identification.map_error import with_range_of
from enginediag_cli.identification.normal_equations import NormalEquations, normal_equations
from enginediag_cli.identification.problem import Problem
from enginediag_cli.identification.steps import ways
from enginediag_cli.progress import each
from enginediag_cli.side_by_side import in_turn

FOLDS = 8
"""Each fold is one more fit; with eight a fit has seen seven eighths of the records and is nearly the one that is
judged."""
MAX_ITERATIONS = 40
"""A fold begins at the full fit and needs a few; one that needs so many has failed."""
TOLERANCE = 0.2
"""Standard errors; a fold starts at the full fit and need not be found more exactly than it is known."""


@dataclass(frozen=True)
class CrossValidation:
    """Prediction of every record by a fit that had not seen its block."""

    predicted: np.ndarray  # (N, m), NaN where the model gave none or the fold did not converge
    folds: int
    failed_folds: int


def block_folds(recording: np.ndarray, block: int) -> np.ndarray:
    """Fold of each record, (N,) int.

    Blocks of `block` consecutive records of one recording are dealt in turn to at most FOLDS folds;
    `block` = 0 cuts all records into FOLDS runs of equal length.
    """
    N = len(recording)
    if block <= 0:
        return np.arange(N) * FOLDS // max(N, 1)
    starts = np.r_[True, np.diff(recording) != 0]
    position = np.arange(N) - np.maximum.accumulate(np.where(starts, np.arange(N), 0))
    number = np.cumsum(starts | (position % block == 0)) - 1
    return number % min(FOLDS, int(number[-1]) + 1)


def cross_validate(problem: Problem, fit: Fit, block: int, max_iterations: int = MAX_ITERATIONS) -> CrossValidation:
    """Refit without each fold, starting from the full fit, and predict the fold.

    Offsets of a recording come from its remaining records, or stay at zero when none remain. Errors of the maps begin
    anew where the remaining records end, as in the fit of a user who has no others: curves that know where the fold
    lies would be bent there by what lies elsewhere.
    """
    fold_of = block_folds(problem.recording, block)
    predicted = np.full(problem.measured.shape, np.nan)
    folds = np.unique(fold_of)
    failed = 0
    if len(folds) < 2:
        return CrossValidation(predicted, 0, 0)

    def left_out(k: int) -> np.ndarray | None:
        """What is predicted (n, m) of the records of a fold, None where the fit to the others did not converge."""
        out = fold_of == folds[k]
        # left out are the readings, not the records: their derivatives are those of the full fit, where these were kept
        rest = with_range_of(problem, ~out & fit.equations.ok)
        without = replace(rest, measured=np.where(out[:, None], np.nan, problem.measured))
        with apart(problem.model):  # folds know nothing of each other, whoever fits them
            part = solve(
                without,
                (fit.x, fit.z),
                max_iterations=max_iterations,
                tolerance=TOLERANCE,
                derivatives=ways(problem)[0],
                begin=_without(rest, fit, out),
            )
        return part.equations.predicted[out] if part.converged else None

    refits = in_turn(left_out, len(folds))
    for fold, found in each(zip(folds, refits, strict=True), "cross-validation, refits", len(folds)):
        if found is None:
            failed += 1
        else:
            predicted[fold_of == fold] = found
    return CrossValidation(predicted, len(folds), failed)


def _without(problem: Problem, fit: Fit, out: np.ndarray) -> NormalEquations | None:
    """Equations at the fit of all records but those `out` (N,), where the fit has kept its derivatives. `problem`: with
    the readings of these, too, and with the errors of maps that a fit without them has."""
    whole = fit.equations
    if whole.at is None:
        return None
    at = whole.at.with_curves(problem, fit.x)
    if at is not whole.at:  # of other curves all sums are others
        whole = normal_equations(problem, fit.x, fit.z, at)
    part = normal_equations(problem.select(out), fit.x, fit.z, at.select(out))
    sums = {f: getattr(whole, f) - getattr(part, f) for f in ("H_xx", "H_xz", "H_zz", "g_x", "g_z")}
    return replace(
        whole,
        residual=np.where(out[:, None], np.nan, whole.residual),
        record_cost=np.where(out, 0.0, whole.record_cost),
        **sums,
    )
