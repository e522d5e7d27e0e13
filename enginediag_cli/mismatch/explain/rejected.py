"""Why something that was fitted is no explanation: a reason and its figure, told in words by presentation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Reason(Enum):
    """What speaks against it. `figure` and `what` of `Rejected` are named beside each."""

    NOT_CONVERGED = "did not converge"  # what: where the fit ended
    WORSE = "fits worse"  # figure: by how much χ² is behind the best; what: on which records, if not all
    AT_BOUND = "needs a coefficient beyond its bound"  # what: the coefficients
    LEAVES_MISFIT = "leaves a misfit behind"  # figure: −ln p of what stands out most
    FEW_FLIGHTS = "predicts too few flights better"  # figure: their share
    NOT_NEEDED = "holds a member that is not needed"  # what: the member
    ONE_UNLISTED = "is no better than one unlisted effect"


@dataclass(frozen=True)
class Rejected:
    """`reason`, with the figure or the name that belongs to it."""

    reason: Reason
    figure: float = float("nan")
    what: str = ""
