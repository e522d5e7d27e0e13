"""What a share of long recordings has shown, judged on all of their records.

The search on a share (`fit/share.py`) says what is worth a fit to all records: nothing, or an explanation with the
rivals that the share does not tell from it surely.

- An explanation and its rivals are fitted to all records from where the share's fits ended. With the right one little
  is left to bend the rest, and two or three steps settle it; without it the optimum of more records is far off, since
  priors weigh less against what is missing, along combinations that first derivatives do not hold for. The fit
  without any is therefore only brought nearer, for what the explanation gains; nothing is judged at it.
- What is named must leave nothing over the gates on all records: scores are sums over them. Where it does, sets with
  one more member are tried.
- Where the share shows nothing, what is missing is looked for on all records: what few do not show, many may.
- Flights in which something switches that no column shows are found by what the fit to all records leaves of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    HIDDEN_STATE,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    UNEXPLAINED,
    Answer,
)
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.in_part import left_by
from enginediag_cli.mismatch.explain.pairs import EXTENDED, forward
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search, refit_noise_without_switches
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nearer
from enginediag_cli.mismatch.fit.options import (
    Option,
    combine_options,
    option_scores,
    with_best_onset,
)
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.share import on_share
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.elsewhere import flights_that_switch
from enginediag_cli.progress import each

SURELY_BEHIND = 22.0
"""Units of χ² on the share from which a rival is not fitted to all records: the right one of two is behind by so much
one time in a hundred."""
FAINT = 100.0
"""Fall of χ² on the share below which what is named bends the fit without it so little that everything is weighed anew
on all records: a share may show one of two rivals, and not the other. Judgement."""
MOST = 6
"""Sets that are fitted to all records, best first on the share."""
HELD_BYTES = 400_000_000
"""Rows of all records, by record, beyond which something that switches is told by the share alone. Some copies of them
are made."""


@dataclass(frozen=True)
class Searched:
    """How many `records` of how many in all, `of`, were searched; `judged`: whether what is told was judged on all."""

    records: int
    of: int
    judged: bool


@dataclass(frozen=True)
class Judged:
    """An answer with the `search` that it rests on, and that of the `share`, whose records can be held one by one;
    `fit`: what was fitted to all records, with what is named, None where none was."""

    search: Search
    share: Search
    answer: Answer
    searched: Searched
    fit: HypothesisFit | None = None


def searched_on_share(whole: Dataset, effects: Sequence[Effect] | None) -> tuple[Judged, Answer]:
    """The answer of a search of a share of long recordings, judged on all of them; and the share's own.

    Where the fit to all records leaves flights in which something switches, the share is searched again with these
    whole; where the share has something that switches, all records are, while they can be held."""
    also: Sequence[int] = ()
    for _ in range(2):
        evidence = refit_noise_without_switches(on_share(whole, also))
        share = Search(evidence, effects, hidden_search(evidence))
        first = share.run()
        judged = judged_on_all(share, first, whole)
        if also or judged.fit is None:
            break
        also = flights_that_switch(judged.fit.projection, share.hidden_gate)
        if not also:
            break
    if first.status == HIDDEN_STATE and _bytes(share, whole) <= HELD_BYTES:
        evidence = _all_of(share, whole)
        search = Search(evidence, effects, hidden_search(evidence))
        first = search.run()
        judged = Judged(search, search, first, Searched(whole.records, whole.records, True))
    return judged, first


def judged_on_all(share: Search, answer: Answer, whole: Dataset) -> Judged:
    """The answer of a search of a share, judged on the whole evidence; as it is where it names no recorded driver: an
    amplitude of its own in every record, or none of what is listed."""
    searched = Searched(share.evidence.records, whole.records, False)
    if answer.in_part:  # what leaves a misfit on a share leaves more on all records
        return Judged(share, share, answer, searched)
    faint = answer.status == IDENTIFIED and not answer.hidden and answer.explanations[0].gain < FAINT
    if answer.status in (IDENTIFIED, FORMULA) and not faint:
        told, fit = _named(share, answer, _all_of(share, whole))
        return Judged(share, share, told, replace(searched, judged=True), fit)
    if answer.status == NO_DISCREPANCY or faint:
        search = Search(_all_of(share, whole), share.effects)
        told = _anything(search, share)
        fit = search.base if search.base.converged else None
        return Judged(search, share, told, replace(searched, judged=True), fit)
    return Judged(share, share, answer, searched)


def _bytes(share: Search, whole: Dataset) -> int:
    """What the rows of a search of all records by record would take, with the offsets of every flight."""
    found = share.base.projection.found
    wide = len(share.base.projection.R) + len(whole.flights) * found.fit.z.shape[1]
    return 8 * whole.records * len(found.problem.sensors) * wide


def _all_of(share: Search, whole: Dataset) -> Dataset:
    """All records with the noise and the errors that the share's search has found."""
    own = share.evidence
    return replace(whole, noise=own.noise, settings=own.settings, owed=None)


def _named(share: Search, answer: Answer, evidence: Dataset) -> tuple[Answer, HypothesisFit | None]:
    """The answer, and the best fit to all records of what it names."""
    whole = Search(evidence, share.effects)
    found = nearer(evidence, NULL_HYPOTHESIS, whole.along, share.base.found)
    whole.look_from(HypothesisFit((), found, Projection(found)))
    whole.detect, whole.adequate = share.detect, share.adequate
    trials = [_fitted(whole, t) for t in each(_worth_it(share, answer), "fitting to all records")]
    named = whole.named(_best_first(whole, trials))
    if not named:
        wider = [(t, options) for t in _best_first(whole, trials)[:EXTENDED] for options in forward(whole.library, [t])]
        more = [_attempt(whole, options, t) for t, options in each(wider, "fitting to all records", len(wider))]
        named = whole.named([t for t in _best_first(whole, more) if whole.counts(t, None)])
        trials += more
    rejected = {k: v for k, v in share.rejected.items() if v.reason is not Reason.WORSE or k not in whole.rejected}
    told = {x.label for x in named}
    on_share = {k: replace(v, what=v.what or "on a share of the records") for k, v in rejected.items()}
    judged = replace(
        answer,
        status=answer.status if named else UNEXPLAINED,
        reason="" if named else "what explains a share of the records leaves a misfit behind on all of them",
        explanations=tuple(named),
        objective=whole.base.objective,
        readings=whole.base.projection.dof,
        rejected={k: v for k, v in {**on_share, **whole.rejected}.items() if k not in told},
        unexplained=left_by(named[0].objective, whole.base) if named else 1.0,
    )
    return judged, next((t for t in trials if named and t.label == named[0].label), None)


def _anything(whole: Search, share: Search) -> Answer:
    """What all records show where a share shows nothing; of an unrecorded driver, what the share did."""
    found = identify_with(whole.evidence, NULL_HYPOTHESIS, whole.along, share.base.found)
    whole.look_from(HypothesisFit((), found, Projection(found)))
    whole.detect, whole.adequate = share.detect, share.adequate
    rest = remainder(whole.base, whole.library, whole.along_drivers)
    if not found.converged:
        return whole.answer(NOT_CONVERGED, f"the model could not be fitted to all records: {found.reason}", rest)
    rest = whole.weighed(rest)
    if not rest.over(whole.detect):
        return whole.answer(NO_DISCREPANCY, "no significant difference beyond noise and identified parameters", rest)
    return whole.decide(rest)


def _worth_it(share: Search, answer: Answer) -> Sequence[HypothesisFit]:
    """Trials on the share that are named, and those not surely behind, best first."""
    named = {x.label for x in answer.explanations}
    best = min(t.objective for t in share.fitted.values() if t.label in named)

    def near(t: HypothesisFit) -> bool:
        why = share.rejected.get(t.label)
        return t.label in named or bool(
            t.converged and why and why.reason is Reason.WORSE and t.objective - best < SURELY_BEHIND
        )

    return sorted((t for t in share.fitted.values() if near(t)), key=lambda t: t.objective)[:MOST]


def _fitted(whole: Search, trial: HypothesisFit) -> HypothesisFit:
    """A trial on a share, fitted to all records from where it ended."""
    share = trial.found.evidence
    engines = ["" if o.driver != TIME else _engine_of(o, share) for o in trial.options]
    return _attempt(whole, [_carried(o, whole, e) for o, e in zip(trial.options, engines, strict=True)], trial)


def _attempt(whole: Search, options: Sequence[Option], start: HypothesisFit) -> HypothesisFit:
    found = identify_with(whole.evidence, combine_options(*options), whole.along, start.found)
    return HypothesisFit(tuple(options), found, Projection(found))


def _carried(option: Option, whole: Search, engine: str) -> Option:
    """An option of a share's records as one of all of them: a change in time of an `engine` begins with the record, of
    all, that suits best."""
    if option.driver != TIME:
        return option
    (d,), base = option.hypothesis.discrepancies, whole.base
    same = [o for o in whole.library if _target(o) == d.target and _engine_of(o, whole.evidence) == engine]
    scores = option_scores(base.found, base.projection, same)
    best = max(scores, key=lambda s: s.score.statistic).option
    return with_best_onset(base.found, base.projection, best)


def _target(option: Option) -> str:
    """The parameter that a change in time changes; "" of anything else."""
    return option.hypothesis.discrepancies[0].target if option.driver == TIME else ""


def _engine_of(option: Option, evidence: Dataset) -> str:
    """Whose a change in time is."""
    onset = int(np.flatnonzero(option.hypothesis.curves[option.hypothesis.discrepancies[0].curve])[0])
    return evidence.flights[int(np.searchsorted(np.cumsum([len(f) for f in evidence.flights]), onset, "right"))].engine


def _best_first(whole: Search, trials: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    for t in trials:
        if not t.converged:
            whole.rejected[t.label] = Rejected(Reason.NOT_CONVERGED, what=t.found.reason)
    return sorted((t for t in trials if t.converged), key=lambda t: t.weighed)
