"""What places say of laws, each at a fit that carries the best law there: several places side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from enginediag_cli.engine.wrapped import preserve_memory
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.carried import carried
from enginediag_cli.mismatch.laws.fitted import Fitted, Where
from enginediag_cli.mismatch.laws.grammar import FORMS, LATCHES
from enginediag_cli.mismatch.laws.refined import refined
from enginediag_cli.mismatch.laws.said import Said, Says
from enginediag_cli.mismatch.laws.scan import (
    Candidate,
    Formula,
    KnownVariable,
    Scan,
    formulas_of,
    formulas_over,
    prior_of_a_place,
)
from enginediag_cli.mismatch.laws.smooth import Smooth, smooth_evidence
from enginediag_cli.mismatch.laws.steps import Bends, bends_of
from enginediag_cli.parallel import ProcessCodec, parallel_map

SETS = 10
"""Sets of variables at a place of which all forms are shaped, likeliest first."""

TRIED, HARDLY = 4, 3.0
"""Choices of variables of the same groups of which curves, or sums of them, are weighed, and by how much of ln evidence
one may be behind the best of surfaces."""


@dataclass(frozen=True)
class AtPlace:
    """What a place says at a fit that carries a law there: of smooth curves and surfaces of all variables, of every
    form with the shape that suits it, of how finely curves of the likeliest bend and sums of them, and of any curve."""

    place: str
    smooth: list[Smooth]
    refined: list[Candidate]
    bends: dict[Where, Bends]
    says: Says


def said_at_places(base: HypothesisFit, scan: Scan, laws: Sequence[Fitted]) -> list[AtPlace]:
    """At the places of these laws, where a fit that carries them converges."""
    tries, prior = scan.formulas, prior_of_a_place(base.found)

    def at_place(k: int) -> AtPlace | None:
        # each place begins where the base has ended, whichever was asked before
        with preserve_memory(base.found.model):
            said = said_at(base, laws[k], scan)
            return None if said is None else all_said(said, formulas_over(said.at.known, scan.known, tries), prior)

    handing = ProcessCodec(shared=[*in_both(scan.known), *(f.laws[0].candidate.location for f in laws)])
    return [here for here in parallel_map(at_place, len(laws), handing) if here is not None]


def in_both(known: Sequence[KnownVariable]) -> list[object]:
    """What a process and its copies both have of formulas: variables, forms, and shapes, of which those that were tried
    are kept with a variable that has moved."""
    forms = dict.fromkeys((*FORMS, *LATCHES))
    return [*known, *(k.variable for k in known), *forms, *(s for f in forms for s in f.shapes)]


def said_at(base: HypothesisFit, law: Fitted, scan: Scan) -> Said | None:
    """At the place of a law, where a fit that carries it converges."""
    at = carried(base, law.trial, law.effects, law.laws[0].candidate.location, scan.known)
    return Said(at) if at.found.converged else None


def all_said(said: Said, tries: Sequence[Formula], prior: float) -> AtPlace:
    """Of these formulas, and of more tries of the likeliest variables; `prior`: ln, of the place."""
    known = said.at.known
    smooth = smooth_evidence(said, known, prior)
    likely = sorted({s.groups: s for s in reversed(smooth)}.values(), key=lambda s: -s.evidence)[:SETS]
    finer = [f for s in likely for f in formulas_of(s.of, known, finer=True)]
    shaped = refined(said, [*tries, *finer], known, prior)
    says = said.kept
    return AtPlace(said.at.place.name, smooth, shaped, {s.where: _bends(says, s, smooth) for s in likely}, says)


def _bends(says: Says, best: Smooth, smooth: Sequence[Smooth]) -> Bends:
    """Of the likeliest of a set's variables: which of those that the records hardly tell apart it is."""
    alike = (s for s in smooth if s.groups == best.groups and s.evidence > best.evidence - HARDLY)
    return max((bends_of(says, s.of) for s in islice(alike, TRIED)), key=lambda b: b.evidence)
