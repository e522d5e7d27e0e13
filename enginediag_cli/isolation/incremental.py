"""Incremental diagnosis, the paper's algorithm for an unknown number of faults (section 5.1.2).

Step 1: best set of i parameters by the sensitivity test. Step 2: rejection test of all other parameters.
Step 3: if it rejects, i grows by one and step 1 is taken again; otherwise the set is the answer.
"""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.detection.glr import threshold
from enginediag_cli.isolation.minmax import rejection_test
from enginediag_cli.isolation.subsets import ENUMERATED, best_subsets
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class IncrementalStep:
    """One turn: the best set, its sensitivity statistic and the rejection test of the rest."""

    parameters: tuple[str, ...]
    statistic: float
    rejection: float
    rejection_dof: int
    rejection_threshold: float


@dataclass(frozen=True)
class IncrementalDiagnosis:
    """`isolated` parameters; `steps` on the way; `accepted`: the last rejection test let the set stand;
    `exact`: every set on the way is proved to be the best of its size."""

    isolated: tuple[str, ...]
    steps: tuple[IncrementalStep, ...]
    accepted: bool
    exact: bool


def incremental_diagnosis(
    score: Score, *, false_alarm: float = 0.01, faults: int | None = None, largest: int | None = None
) -> IncrementalDiagnosis:
    """Isolate by the paper's algorithm; with `faults` = q, the best set of exactly q parameters.

    `false_alarm` is the level of the rejection test, which the paper does not state.
    """
    if faults is None and (score.rank == 0 or score.glr <= threshold(score.rank, false_alarm)):
        return IncrementalDiagnosis((), (), score.rank > 0, True)
    most = faults or min(largest or score.rank, score.rank)
    steps: list[IncrementalStep] = []
    accepted, exact = False, True
    best = best_subsets(score, most) if len(score.parameters) <= ENUMERATED else None
    for size in [most] if faults else range(1, most + 1):
        # a search is cheapest for small sets, and the algorithm seldom gets to large ones
        found = best or best_subsets(score, size)
        if len(found.sets) < size:
            break
        exact = exact and found.exact
        names = tuple(score.parameters[i] for i in found.sets[size - 1])
        rejection, dof = rejection_test(score, names)
        limit = threshold(dof, false_alarm)
        steps.append(IncrementalStep(names, float(found.values[size - 1]), rejection, dof, limit))
        accepted = dof <= 0 or rejection <= limit
        if accepted:
            break
    return IncrementalDiagnosis(steps[-1].parameters if steps else (), tuple(steps), accepted, exact)
