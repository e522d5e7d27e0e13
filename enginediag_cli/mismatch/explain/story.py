"""The whole answer of `explain`: what is named, and all that a reader asks next.

What the tolerance of the maps cost, the curve of what no listed effect explains, and which recording would separate
explanations that these flights cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from enginediag_cli.engine.term import Effect
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.isolation.sensitivity_analysis import SensitivityAnalysis
from enginediag_cli.mismatch.controlled.find import ControlSearchResult
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    UNEXPLAINED,
    Answer,
)
from enginediag_cli.mismatch.explain.change_times import with_times
from enginediag_cli.mismatch.explain.curves import Curve, best_places, fitted_curves
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.flips import flips_of_answer
from enginediag_cli.mismatch.explain.floor_cost import FloorCost, tolerance_cost
from enginediag_cli.mismatch.explain.follows import HysteresisFit, followed
from enginediag_cli.mismatch.explain.gated import UnsteadyRecords, gated_out
from enginediag_cli.mismatch.explain.on_all import Searched, searched_on_share
from enginediag_cli.mismatch.explain.plan import Advice, advise_flights_for_explanations
from enginediag_cli.mismatch.explain.reach import near_alternatives
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search, refit_noise_without_switches
from enginediag_cli.mismatch.explain.unseen import Unseen, unseen_effects
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.options import EFFECT
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION as OF_A_LAW
from enginediag_cli.mismatch.fit.share import is_long
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import known_variables
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, effects_at
from enginediag_cli.mismatch.unrecorded.switched import effects_that_switch


@dataclass(frozen=True)
class ExplanationResult:
    """`answer`, and around it; `evidence` with the noise that the answer rests on. `only_exact`: effects that would
    stand out if the maps were exact."""

    evidence: Dataset
    answer: Answer
    hidden: tuple[HiddenFinding, ...]
    hidden_effects: tuple[tuple[Effect, ...], ...]  # listed effects that may be each of `hidden`
    curves: tuple[Curve, ...]
    floor: tuple[FloorCost, ...]
    only_exact: tuple[FloorCost, ...]
    advice: Advice | None  # what would tell the explanations apart
    unseen: tuple[Unseen, ...] = ()  # of `answer.unseen`, by the kind of effect that was looked for
    switched: tuple[
        HypothesisFit, ...
    ] = ()  # effects that may be the first of `hidden`, refitted at its states, best first
    searched: Searched | None = None  # None: all records
    control: ControlSearchResult | None = None  # that the engine file lacks and the engine that was searched has
    gated: UnsteadyRecords | None = None  # what was left out of the search with the records that are not steady
    flips: SensitivityAnalysis | None = None  # what would change the first name, None where nothing is named
    follows: tuple[HysteresisFit, ...] = ()  # what the first of `hidden` follows after all, best first
    planned: bool = False  # whether the best recording of every kind is asked for

    @property
    def found_nothing(self) -> bool:
        return self.control is None and self.answer.status == NO_DISCREPANCY


def explain_mismatch(
    evidence: Dataset,
    effects: Sequence[Effect] | None = None,
    *,
    advise: bool = True,
    intake: RecordingLoader | None = None,
    every_record: bool = False,
) -> ExplanationResult:
    """Search and everything around it. `effects`: the library, default all that the model does not carry; `intake`: by
    which records that were left out as unsteady are read, where something has switched between them. Of long recordings
    a share is searched, unless `every_record` is to be."""
    searched: Searched | None = None
    if is_long(evidence.flights) and not every_record:
        judged, first = searched_on_share(evidence, effects)
        search, share, answer, searched = judged.search, judged.share, judged.answer, judged.searched
        first = _still_named(first, answer) if first.status in (IDENTIFIED, FORMULA) else answer
    else:
        evidence = refit_noise_without_switches(evidence)
        search = share = Search(evidence, effects, hidden_search(evidence))
        answer = first = search.run()
    # of a strong effect nearly every place is significant; those that can be told from the first are its shadows
    found = [f for f in answer.hidden if isinstance(f, HiddenFinding)]
    hidden = tuple(f for f in found if f is found[0] or f.location in found[0].rivals)
    engine = search.evidence.engine
    at = tuple(tuple(e for e in effects_at(f.location, engine) if _listed(e, search.effects)) for f in hidden)
    if answer.status == NOT_CONVERGED:
        return ExplanationResult(search.evidence, answer, hidden, at, (), (), (), None, searched=searched)
    trials: list[HypothesisFit] = []
    refitted = effects_that_switch(found, search.effects, search.base, search.along)
    if refitted is not None:
        lead, trials = refitted
        listed = {t.label for t in trials}
        told = [f for f in hidden if f.location.name not in listed]
        # places that fit as well, but where nothing that is listed can switch, stay among the rivals
        hidden = (replace(lead, rivals=tuple(f.location for f in told)), *told)
        best = tuple(replace(e, switch="") for t in trials for e in t.hypothesis.effects)
        at = (best, *(tuple(e for e in effects_at(f.location, engine) if _listed(e, search.effects)) for f in told))
    base, gated = search.base, gated_out(evidence, search.effects, intake)
    if hidden and intake is not None:
        hidden = (with_times(hidden[0], trials, base.found, search.along, intake), *hidden[1:])
    curves = (
        fitted_curves(base.found, base.objective, best_places(answer.cells), search.along)
        if answer.status == UNEXPLAINED
        else []
    )
    floor = tolerance_cost(base, search.library)
    only_exact = _only_exact(answer, floor)
    rivals = near_alternatives(first, share.fitted) if advise and answer.status in (IDENTIFIED, FORMULA) else ()
    return ExplanationResult(
        search.evidence,
        answer,
        hidden,
        at,
        tuple(curves),
        tuple(floor),
        tuple(only_exact),
        advise_flights_for_explanations(share.base.found, rivals),
        # what a gate has left out is not taken up by identification
        tuple(unseen_effects(share.base, share.library, [n for n in answer.unseen if n not in _labels(gated)])),
        tuple(trials),
        searched,
        gated=gated,
        flips=flips_of_answer(answer, search),
        follows=followed(hidden[0], base.found, known_variables(base.found)) if hidden else (),
    )


def _labels(gated: UnsteadyRecords | None) -> tuple[str, ...]:
    return gated.effects if gated is not None else ()


def _still_named(share: Answer, answer: Answer) -> Answer:
    """The answer of a share, as fitted to it, with what all records still name."""
    named = {x.label for x in answer.explanations}
    return replace(share, explanations=tuple(x for x in share.explanations if x.label in named))


def _only_exact(answer: Answer, floor: Sequence[FloorCost]) -> list[FloorCost]:
    """Effects over the gate of detection without the floor alone; where something was found, scores of others are its
    shadows."""
    if answer.status != NO_DISCREPANCY:
        return []
    gate = float(special.chdtri(1.0, np.exp(-answer.gates[0])))
    return [c for c in floor if c.score <= gate < c.score_without]


def named_effects(story: ExplanationResult) -> tuple[Effect, ...]:
    """Effects of the first explanation; empty when it is none or holds a change in time."""
    if not story.answer.explanations:
        return ()
    options = story.answer.explanations[0].options
    if any(o.kind not in (EFFECT, OF_A_LAW) for o in options):
        return ()
    return tuple(e for o in options for e in o.hypothesis.effects)


def _listed(effect: Effect, library: Sequence[Effect]) -> bool:
    return any(e.label == effect.label for e in library)
