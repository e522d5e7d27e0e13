"""A fit of an engine that carries a law already, from which others at its place are weighed: a model without a large
law answers it with other derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.band import summed
from enginediag_cli.mismatch.laws.scan import KnownVariable, seen_at


@dataclass(frozen=True)
class Carried:
    """A fit whose engine carries a law at a place, which is f (N,) over the records; `gain`: half of the χ² that the
    fit without it had more; `known`: variables as this fit has them."""

    found: IdentifiedHypothesis
    projection: Projection
    place: Location
    f: np.ndarray
    gain: float
    known: tuple[KnownVariable, ...]


def carried(
    base: HypothesisFit, trial: HypothesisFit, laws: Sequence[Effect], place: Location, known: Sequence[KnownVariable]
) -> Carried:
    """The fit of an engine that carries the laws of a trial, all at one place, as this has fitted them, beside what the
    base has. What identification absorbs is that of the base: a floor's curves along what a law moves would be curves
    of the law."""
    evidence = base.found.evidence
    fixed = tuple(e.replace_values(trial.values) for e in laws)
    engine = evidence.engine.replace_effects((*evidence.engine.effects, *fixed))
    found = identify_with(replace(evidence, engine=engine), base.hypothesis, nuisance(evidence), base.found)
    projection = Projection(found)
    seen = seen_at(found, known)
    f = summed(laws, seen, trial.values)
    return Carried(found, projection, place, f, 0.5 * (base.objective - projection.objective), seen)
