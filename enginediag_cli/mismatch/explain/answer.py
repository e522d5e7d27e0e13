"""What `explain` answers: a status, and explanations with their coefficients, rivals and doubts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.explain.rejected import Rejected
from enginediag_cli.mismatch.fit.freeform import Cell, Place
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.laws.finding import LawFinding

NO_DISCREPANCY, IDENTIFIED, FORMULA, UNEXPLAINED, HIDDEN_STATE, NOT_CONVERGED = (
    "nothing",
    "named",
    "law",
    "none of these",
    "hidden",
    "did not converge",
)
STATUSES = (NO_DISCREPANCY, IDENTIFIED, FORMULA, UNEXPLAINED, HIDDEN_STATE, NOT_CONVERGED)


@dataclass(frozen=True)
class Coefficient:
    """Estimate with its 95 % interval, in `unit`."""

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float


@dataclass(frozen=True)
class Explanation:
    """One set of options that explains the mismatch. `gain`: fall of χ² against the model as it is; `probability`:
    among all that was fitted; `left`: −ln p of the most surprising thing that it leaves unexplained;
    `flights`: share of flights that it predicts better from the other flights, NaN where not asked."""

    options: tuple[Option, ...]
    coefficients: tuple[Coefficient, ...]
    objective: float
    gain: float
    probability: float
    left: float
    flights: float
    at_bound: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        return " + ".join(o.label for o in self.options)


@dataclass(frozen=True)
class Answer:
    """`explanations`: the alias set, best first (empty unless something is named); `cells`: where the mismatch is, by
    free form, most surprising first, and `places` by component; `unseen`: effects that these flights cannot show;
    `hidden`: findings of an unrecorded driver; `gates`: −ln p thresholds on listed effects, of detection and of
    adequacy; `surprise`: the largest −ln p of a listed effect at the model as it is; `rejected`: label → why, for
    what was fitted and not named; `law`: what no listed effect explains, as a law (status LAW, `explanations` are
    the laws; status NAMED, it is in the first explanation beside what is listed; else none is enough);
    `unexplained`: share (0 to 1) of the excess χ² that stays with the first explanation, None where there is none
    to explain; `rest`: where that is, of an explanation in part, most surprising first."""

    status: str
    reason: str
    explanations: tuple[Explanation, ...]
    cells: tuple[Cell, ...]
    places: tuple[Place, ...]
    unseen: tuple[str, ...]
    hidden: tuple[object, ...]
    gates: tuple[float, float]
    surprise: float
    objective: float
    readings: int
    rejected: Mapping[str, Rejected]
    theta: Mapping[str, float]
    number: np.ndarray
    law: LawFinding | None = None
    unexplained: float | None = None
    rest: tuple[Cell, ...] = ()

    @property
    def in_part(self) -> bool:
        """Whether what is named explains only a part of the mismatch."""
        return bool(self.rest)

    @property
    def kind(self) -> str:
        """ "effect", "fault", "sensor fault", "effect + fault", … of the first explanation; "" without one."""
        return " + ".join(sorted({o.kind for o in self.explanations[0].options})) if self.explanations else ""
