"""Options fitted to an evidence, with everything else anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from enginediag_cli.engine.term import Effect
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.mismatch.fit.identified import (
    ANY_REACH,
    FitBudget,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
)
from enginediag_cli.mismatch.fit.options import (
    FORMULA_OPTION,
    Option,
    combine_options,
    effect_option,
    effect_options,
    option_scores,
)
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit, remembered

LEFT_BEHIND = 0.2
"""Of two limits one that is found this much below the other may be where it is because nothing showed it. Judgement."""


def attempt(
    options: Sequence[Option],
    start: IdentifiedHypothesis,
    along: Nuisance,
    of_few: Fit | None = None,
    reach: FitBudget = ANY_REACH,
    onward: bool = False,
) -> HypothesisFit:
    """Fit nuisance and options together to the evidence of another fit. It begins at the prior means, the nominal
    state: the other fit, without the options, is bent by what they explain; or where a fit `of_few` records ended.
    `reach`: how far it is worth its time. `onward`: it begins at the other fit and ends roughly, which is enough to
    compare sets by.

    Of effects that remember and act at one place, one works on what the other makes: a limit behind a lag is not a lag
    behind a limit. Both orders are fitted, and the better one is the trial."""
    trial = _attempt(options, start, along, of_few, reach, onward)
    if not _one_behind_the_other(options):
        return trial
    turned = _attempt(options[::-1], start, along, None, reach)
    better = turned.converged and (not trial.converged or turned.objective < trial.objective)
    return turned if better else trial


def _one_behind_the_other(options: Sequence[Option]) -> bool:
    """Whether two of the options remember and act on the same thing; a law follows what both leave."""
    effects = [e for o in options if o.kind != FORMULA_OPTION for e in o.hypothesis.effects if remembered(e)]
    acts_on = [n for e in effects for n in e.site.targets]
    return len(acts_on) > len(set(acts_on))


def _attempt(
    options: Sequence[Option],
    start: IdentifiedHypothesis,
    along: Nuisance,
    of_few: Fit | None,
    reach: FitBudget,
    onward: bool = False,
) -> HypothesisFit:
    """The options in this order."""
    begun = start if onward else None
    found = identify_with(start.evidence, combine_options(*options), along, begun, of_few, reach, onward)
    trial = HypothesisFit(tuple(options), found, Projection(found))
    evened = [_evened(o, found.theta) for o in options]
    if all(o is None for o in evened):
        return trial
    # where nothing met one of two limits, no derivative shows it: it is tried at the size of the other
    other = [e or o for e, o in zip(evened, options, strict=True)]
    again = identify_with(start.evidence, combine_options(*other), along, reach=reach)
    second = HypothesisFit(tuple(other), again, Projection(again))
    return second if second.converged and second.objective < trial.objective else trial


def _evened(option: Option, theta: Mapping[str, float]) -> Option | None:
    """The option begun with all sizes alike, where one of them ended far below another; None elsewhere."""
    for e in option.hypothesis.effects:
        found = [theta[n] for n in e.sizes]
        if e.trial_names and len(found) > 1 and min(found) < LEFT_BEHIND * max(found):
            alike = {c.name: max(found) for c in e.term.amplitudes() if not c.free}
            return replace(option, hypothesis=Hypothesis((replace(e, values={**e.values, **alike}),)))
    return None


def begun(effects: Sequence[Effect], found: IdentifiedHypothesis) -> list[Option]:
    """Options of these effects, those that are tried at some size at the one that says most about what a fit without
    them leaves."""
    projection = Projection(found)
    best = []
    for effect in effects:
        scores = option_scores(found, projection, effect_options([effect])) if effect.trial_names else []
        told = max(scores, key=lambda s: s.score.statistic if s.feasible else -1.0, default=None)
        best.append(told.option if told is not None else effect_option(effect))
    return best
