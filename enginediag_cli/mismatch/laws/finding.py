"""Laws that were found: a posterior over places, drivers and forms, and what it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.laws.band import Band
from enginediag_cli.mismatch.laws.scan import Formula
from enginediag_cli.physics.law import Variable

Group = tuple[Variable, ...]
"""Variables that the records cannot tell apart, the one that the law has first."""


TOGETHER = 0.95
"""Probability from which what is told holds the truth, alone or together with its rivals."""


@dataclass(frozen=True)
class FittedLaw:
    """A law fitted inside the simulator. `evidence`: ln of the marginal likelihood against the model as it is, with the
    prior of place, driver and form; `probability`: among all laws."""

    option: Option
    location: Location
    formula: Formula
    evidence: float
    probability: float


@dataclass(frozen=True)
class Share:
    """A law's part in an average: the words of its forms, its formula with numbers in the places of coefficients, its
    probability and variables, and whether it is `written` as one of the few that stand for all."""

    words: tuple[str, ...]
    text: str
    probability: float
    of: tuple[Variable, ...]
    written: bool


@dataclass(frozen=True)
class LawFinding:
    """`laws`: fitted, likeliest first; `places` and `drivers` with their probabilities, each driver as the groups of
    one or two variables; `excess`: χ² of the model as it is beyond its noise, `explained`: the share of it that the
    first law explains, None where the recordings alone say how large the noise is; `moves`: by how much the first law
    changes its place in the records, about the mean, least and most, in `unit`; `band`: its curve, where it varies
    with one variable; `alike`: places that these recordings cannot tell from the first; `forms`: what the first law is
    an average of, likeliest first, nothing where its form is settled."""

    laws: tuple[FittedLaw, ...]
    places: tuple[tuple[Location, float], ...]
    drivers: tuple[tuple[tuple[Group, ...], float], ...]
    excess: float
    explained: float | None
    moves: tuple[float, float]
    unit: str
    band: Band | None
    alike: tuple[Location, ...] = ()
    forms: tuple[Share, ...] = ()

    @property
    def together(self) -> float:
        """Probability of the first place and of those that cannot be told from it."""
        known = {self.places[0][0].name, *(p.name for p in self.alike)}
        return min(sum(q for p, q in self.places if p.name in known), 1.0)

    @property
    def along(self) -> tuple[tuple[Group, ...], ...]:
        """What it varies with: the first where that is settled, else as many, likeliest first, as hold the truth
        together."""
        total = np.cumsum([q for _, q in self.drivers])
        return tuple(groups for groups, _ in self.drivers[: 1 + int(np.searchsorted(total, TOGETHER))])
