"""What a model lacks, in sentences: effects, faults in time, unlisted physics, hidden switches, controls, and doubts.

Also the residual of an explanation, why something that was fitted is no explanation, and what was not searched for
because a recorder excludes the records that would show it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.controlled.fitted import BLOCKS
from enginediag_cli.mismatch.explain.answer import FORMULA, HIDDEN_STATE, IDENTIFIED, NO_DISCREPANCY, NOT_CONVERGED
from enginediag_cli.mismatch.explain.curves import best_places
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION as LAW_OPTION
from enginediag_cli.physics.registry import separate_effects
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.sentences import change, count, format_quantity, listed, probability, rounded, spelled
from enginediag_cli.report.tables.answers import explanation_flips
from enginediag_cli.report.tables.formulas import (
    advice_sentences,
    equations,
    hidden_sentences,
    is_long,
    law_sentences,
    law_statement,
    nearest_law,
    residual_sentence,
)
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.term import Coefficient as Declared
    from enginediag_cli.engine.term import Effect
    from enginediag_cli.mismatch.controlled.find import ControlSearchResult, FittedControlLaw
    from enginediag_cli.mismatch.controlled.law import ControlLaw
    from enginediag_cli.mismatch.explain.answer import Answer, Coefficient, Explanation
    from enginediag_cli.mismatch.explain.curves import Curve
    from enginediag_cli.mismatch.explain.gated import UnsteadyRecords
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.fit.options import Option


KEYS = ("set_point", "low", "high")


def control_headline(law: ControlLaw) -> str:
    """ "compressor guide vanes hold T5 at 823.1 K until they are open, or closed to 33 deg"."""
    quantity, unit = split_column(law.hold)
    a = law.actuator
    stops = [f"{rounded(v)} {a.unit}" for v in (law.low, law.high)]
    return f"{a.words}: {quantity} is fixed at {format_quantity(law.set_point, unit, digits=5)} between {listed(stops)}"


def control_sentences(f: ControlSearchResult) -> Iterator[str]:
    """What is held by what, when, how surely, and what else was tried."""
    law, unit = f.best.law, split_column(f.best.law.hold)[1]
    still = f.still
    yield f"Missing: a control. {_start(control_headline(law))}."
    yield (
        f"  {law.hold} stays within {format_quantity(still.scatter, unit)} there, whereas the model without it "
        f"predicts {format_quantity(still.predicted, unit)}; it holds in {_share(f.held)} of the records"
        + "".join(f", is at its {q} stop in {_share(v)}" for q, v in f.at_limit.items() if v > 0.0)
        + (f", and does not act in {_share(f.released)}" if f.released > 0.0 else "")
        + "."
    )
    if law.enabled is not None:
        e = law.enabled
        side = "at most" if e.side == "at_most" else "at least"
        yield (
            f"  It acts while {e.column} is {side} {rounded(e.value, digits=5)}, which is right for all but "
            f"{_share(e.wrong)} of the records; else the {law.actuator.words} are at {rounded(law.actuator.neutral)} "
            f"{law.actuator.unit}."
        )
    for key, error in f.standard_errors.items():
        of = unit if key == "set_point" else law.actuator.unit
        told = key.replace("_", " ") if key == "set_point" else f"{key} stop"
        yield f"  {told}: {format_quantity(getattr(law, key), of, error)}"
    if law.assumed:
        yield f"  Positions rest on {law.assumed}, which is assumed: readings only know what they give together."
    yield (
        f"  Identified with it, errors on records that the fit had not seen are {rounded(_times(f.best))} times "
        f"smaller (mean over the sensors), in {_share(f.best.blocks)} of {BLOCKS} runs of records."
    )
    if f.rivals:
        others = listed([control_headline(t.law) for t in f.rivals], "or")
        yield f"In these flights it is indistinguishable from {others}."
    for t in f.worse:
        yield f"Tried and worse: {control_headline(t.law)} ({rounded(_times(t))} times smaller)."


def control_rows(f: ControlSearchResult) -> Iterator[dict[str, Any]]:
    """One row per number of every law that was not surely worse."""
    for rank, t in enumerate((f.best, *f.rivals), start=1):
        law = t.law
        errors = law.errors(t.fit.standard_errors)
        for key in KEYS:
            error = errors.get(key)
            value = getattr(law, key)
            yield {
                "rank": rank,
                "kind": "control",
                "name": law.label,
                "component": law.component,
                "driver": law.enabled.column if law.enabled else None,
                "coefficient": f"{law.name}.{key}",
                "value": value,
                "standard_error": error,
                "low": None if error is None else value - NORMAL_95 * error,
                "high": None if error is None else value + NORMAL_95 * error,
                "unit": split_column(law.hold)[1] if key == "set_point" else law.actuator.unit,
                "gain": t.gain,
                "statement": control_headline(law),
            }


def control_document(f: ControlSearchResult) -> dict[str, Any]:
    """Everything as one object."""
    law = f.best.law
    return {
        "name": law.label,
        "in_words": control_headline(law),
        "actuator": law.actuator.name,
        "hold": law.hold,
        **{k: getattr(law, k) for k in KEYS},
        "standard_errors": dict(f.standard_errors),
        "acts_while": None if law.enabled is None else vars(law.enabled),
        "holds_share": f.held,
        "at_stop_share": dict(f.at_limit),
        "released_share": f.released,
        "errors_smaller_by": _times(f.best),
        "runs_gained": f.best.blocks,
        "rivals": [_alternative(t) for t in f.rivals],
        "worse": [_alternative(t) for t in f.worse],
    }


def _alternative(t: FittedControlLaw) -> dict[str, Any]:
    return {
        "name": t.law.label,
        "in_words": control_headline(t.law),
        "errors_smaller_by": _times(t),
        "runs_gained": t.blocks,
    }


def _times(t: FittedControlLaw) -> float:
    return math.exp(t.gain)


def _share(x: float) -> str:
    return f"{rounded(100.0 * x, digits=2)} %"


def _start(text: str) -> str:
    return text[:1].upper() + text[1:]


def gated_sentences(g: UnsteadyRecords | None) -> Iterator[str]:
    """None where nothing was excluded."""
    if g is not None:
        yield (
            f"Not looked for: {count(len(g.effects), 'effect')} with memory ({', '.join(g.effects)}), which would show "
            f"in the {g.records:,} of {g.of:,} {g.unit} that the recorder excluded as not steady. A recorder file "
            "without `steady:` and `average_s:` lets them be looked for."
        )


LEAST_SHARE = 0.005
"""A share that is written as zero."""
LIKELIER = 0.5
"""Probability of all explanations listed from which it is likelier than not."""
PLACES = 3
"""Places that are listed one by one."""


def residual_share_words(a: Answer) -> str:
    """How much of the excess χ² stays with what is named; empty where there is none to explain."""
    if a.unexplained is None or a.in_part:
        return ""
    if a.unexplained < LEAST_SHARE:
        return "; nothing of its excess stays unexplained"
    return f"; {100 * a.unexplained:.0f} % of its excess stays unexplained"


def doubt_sentence(a: Answer) -> Iterator[str]:
    """Where the explanations named are together less likely than those fitted and not named."""
    told = sum(x.probability for x in a.explanations)
    if told < LIKELIER and not a.in_part:
        yield (
            f"It is more likely something else (probability {probability(1.0 - told)}): sets that leave a misfit, or "
            "hold physics that is not listed, are together likelier than all that explains everything."
        )


def rest_sentences(a: Answer) -> Iterator[str]:
    """Of an explanation in part: how much stays, and where."""
    if not a.in_part or a.unexplained is None:
        return
    cells = best_places(a.rest)
    places = listed(list(dict.fromkeys(c.location.words for c in cells))[:PLACES], "or")
    more = len({c.location.words for c in cells}) - PLACES
    further = f" (or {more} further places)" if more > 0 else ""
    drivers = dict.fromkeys(c.driver.driver.words for c in cells if c.driver.driver != CONSTANT)
    along = f", varying with {listed(list(drivers)[:PLACES], 'or')}" if drivers else ""
    yield (
        f"  This is part of the mismatch: {100 * a.unexplained:.0f} % of it (of the excess χ²) stays unexplained, at "
        f"{places}{further}{along}: unlisted physics, or something listed that these flights do not show surely."
    )


def rejection_words(r: Rejected) -> str:
    """Why something that was fitted is no explanation."""
    return {
        Reason.NOT_CONVERGED: lambda: f"did not converge: {r.what}",
        Reason.WORSE: lambda: f"χ² is {r.figure:.1f} worse{f' {r.what}' if r.what else ''}",
        Reason.AT_BOUND: lambda: f"needs {r.what} beyond its physical bound",
        Reason.LEAVES_MISFIT: lambda: f"leaves a misfit behind (−ln p = {r.figure:.1f})",
        Reason.FEW_FLIGHTS: lambda: (
            f"predicts only {100 * r.figure:.0f} % of the flights better: not separable from map error"
        ),
        Reason.NOT_NEEDED: lambda: f"does not need {r.what}",
        Reason.ONE_UNLISTED: lambda: "one unlisted effect explains as much",
    }[r.reason]()


SHOWN = 5
"""Rejected explanations that are listed one by one; the rest are counted."""


def sentences(story: ExplanationResult) -> Iterator[str]:
    """The story, a paragraph at a time."""
    a = story.answer
    if story.control is not None:
        yield from control_sentences(story.control)
        yield "The rest is of the engine with that control:"
    if a.status == NOT_CONVERGED:
        yield f"no verdict: {a.reason}"
        return
    if a.status == NO_DISCREPANCY:
        yield (
            f"Nothing is missing that these flights can show: {a.reason} (the largest effect: −ln p "
            f"{rounded(a.surprise)}; chance alone reaches {rounded(a.gates[0])})."
        )
    elif a.status == IDENTIFIED:
        yield from _named(story)
    elif a.status == FORMULA:
        yield from _law(story)
    elif a.status == HIDDEN_STATE:
        for finding, effects in zip(story.hidden[:1], story.hidden_effects, strict=False):
            yield from hidden_sentences(story, finding, effects)
    else:
        yield from _none(story)
    yield from _rejected(story)
    yield from _floor(story)
    yield from explanation_flips(story)
    yield from advice_sentences(story.advice, all_kinds=story.planned)
    yield from _not_identifiable(story)
    yield from gated_sentences(story.gated)
    yield from _searched(story)


def _searched(story: ExplanationResult) -> Iterator[str]:
    """Of long recordings, which records were searched and what the others have a say in."""
    s = story.searched
    if s is None or s.records == s.of:
        return
    of = f"{count(s.records, 'record')} of {s.of:,}, whole stretches spread over the flights"
    if story.answer.status == NO_DISCREPANCY:
        yield (
            f"Listed effects and changes in time were looked for in all {s.of:,} records; the noise, and effects whose "
            f"driver is not recorded, only in {of}: what such an effect does at other times, or too little for so few "
            "records, is not seen."
        )
    elif s.judged:
        yield (
            f"Searched in {of}; what is named, and alternatives not surely worse there, were fitted to all records and "
            "judged on all. Sizes from which effects show, and effects whose driver is not recorded, are of the share."
        )
    else:
        yield f"Only {of} were used; the other records were ignored."


def _not_identifiable(story: ExplanationResult) -> Iterator[str]:
    """What identification takes up, by the kind of effect that was looked for; what of it would be seen to switch."""
    switched = {e.label for effects in story.hidden_effects[:1] for e in effects if story.answer.status == HIDDEN_STATE}
    told = [u for u in story.unseen if u.label not in switched]
    for words in dict.fromkeys(u.driver.words for u in told):
        own = [u.label for u in told if u.driver.words == words]
        kind = "if it is there in every record" if any(u.driver == CONSTANT for u in told if u.label in own) else ""
        yield (
            f"Cannot be seen in these flights, whatever its size, {kind or f'as an effect that varies with {words}'} "
            f"(identification takes it up): {', '.join(own)}."
        )
    seen = [f"{u.label} from {_size(u.switching, u.unit)}" for u in told if math.isfinite(u.switching)]
    if seen:
        yield f"  Of these, switched on and off within a flight, {listed(seen, 'and')} would be seen."


def headline(x: Explanation) -> str:
    """One explanation in a phrase: what acts where, or what changed and since when."""
    return listed([_phrase(o, x) for o in x.options], "together with")


def _phrase(o: Option, x: Explanation) -> str:
    if o.hypothesis.effects:
        e = o.hypothesis.effects[0]
        places = listed([spelled(own.site.name) for own in separate_effects(e)], "and")
        return f"{e.term.TITLE} at {places} ({o.label})"
    d = o.hypothesis.discrepancies[0]
    c = next(c for c in x.coefficients if c.name == d.name)
    assert o.target is not None
    return f"a fault, {change(o.target, c.value, NORMAL_95 * c.standard_error)} {d.curve}"


def _named(story: ExplanationResult) -> Iterator[str]:
    a = story.answer
    x = a.explanations[0]
    fault = any(o.hypothesis.discrepancies for o in x.options)
    effect = any(o.hypothesis.effects for o in x.options)
    kind = "Missing"
    if fault:
        kind = "Missing, with a fault" if effect else "Not missing physics but a change in time"
    if a.in_part:
        kind = "Missing in part" if effect else "In part a change in time"
    yield f"{kind}: {headline(x)} (probability {probability(x.probability)})."
    for o in x.options:
        for e in o.hypothesis.effects:
            if o.kind == LAW_OPTION:
                yield from law_statement(e, a.law)
            else:
                yield f"  {e.term.STATEMENT} It varies with {o.driver.words}."
            yield from _coefficients(x, e)
        if o.hypothesis.discrepancies:
            yield "  It begins at that time and holds over all operating conditions, which no effect does."
    if a.law is not None:
        yield from law_sentences(a.law)
    yield _gained(story, residual_share_words(a))
    yield from rest_sentences(a)
    yield from doubt_sentence(a)
    if len(a.explanations) > 1:
        others = [f"{headline(other)} ({probability(other.probability)})" for other in a.explanations[1:]]
        yield f"In these flights it is indistinguishable from {listed(others, 'or')}."


def _gained(story: ExplanationResult, left: str = "") -> str:
    """What the first explanation gains, on the flights together and in cross-validation, and the unexplained part
    `left`."""
    x = story.answer.explanations[0]
    asked = x.flights == x.flights
    share = "every flight is" if x.flights >= 1.0 else f"{100 * x.flights:.0f} % of the flights are"
    told = f"; {share} predicted better from the others" if asked else ""
    return (
        f"  With it χ² falls from {_whole(x.objective + x.gain)} to {_whole(x.objective)} for "
        f"{_whole(story.answer.readings)} readings{told}{left}."
    )


def _law(story: ExplanationResult) -> Iterator[str]:
    """An empirical correction, with what is settled of it and its residual."""
    a, x = story.answer, story.answer.explanations[0]
    assert a.law is not None
    effects = [e for o in x.options for e in o.hypothesis.effects]
    yield f"No listed effect explains it; {'a law does' if len(effects) == 1 else 'two laws together do'}:"
    for e in effects:
        yield from law_statement(e, a.law)
        yield from _coefficients(x, e)
    yield from law_sentences(a.law)
    yield residual_sentence(a.law)
    yield _gained(story)
    if len(a.explanations) > 1:
        others = [f"{equations(other.options)} ({probability(other.probability)})" for other in a.explanations[1:]]
        yield f"In these flights it is indistinguishable from {listed(others, 'or')}."


def _coefficients(x: Explanation, effect: Effect) -> Iterator[str]:
    """Those of an effect, each in a line; of a formula with many its curve is written instead."""
    if not is_long(effect.term):
        for c in x.coefficients:
            if c.name in effect.amplitudes:
                yield f"  {coefficient(c, effect)}"


def coefficient(c: Coefficient, effect: Effect) -> str:
    """A coefficient with its interval and unit, and whether its bounds were judged or read."""
    declared = next((k for k in effect.term.COEFFICIENTS if effect.parameter_name(k.name) == c.name), None)
    unit = "" if c.unit == "1" else c.unit
    what = declared.description if declared else c.name
    size = f"{rounded(c.value, c.standard_error)}{f' {unit}' if unit else ''}"
    interval = f"{rounded(c.low, c.standard_error)} to {rounded(c.high, c.standard_error)}"
    if declared and effect.trial_names and c.value == declared.absent:
        most = (
            f"; up to {rounded(c.high)}{f' {unit}' if unit else ''} it would not show"
            if c.high < declared.upper
            else ""
        )
        return f"{declared.name} = {declared.absent:g}: not seen to be anything else{most} ({what})."
    told = rate_words(effect, declared, (c.value, c.low, c.high)) if declared else ""
    return f"{declared.name if declared else c.name} = {size}, 95 % interval {interval}: {what}{told}."


def rate_words(effect: Effect, declared: Declared, times: tuple[float, float, float]) -> str:
    """A time for a full scale, with its bounds, as the rate that it stands for; empty where it is none."""
    rates = [effect.site.rate(declared, max(t, 0.0)) for t in times]
    if rates[0] is None:
        return ""
    (rate, unit), slowest, fastest = rates[0], rates[2], rates[1]
    error = (rate - slowest[0]) / NORMAL_95 if slowest else None
    top = rounded(fastest[0], error) if fastest else "any"
    return f"; a rate of {rounded(rate, error)} {unit} ({rounded(slowest[0], error) if slowest else '0'} to {top})"


def _whole(value: float) -> str:
    return f"{value:,.0f}" if math.isfinite(value) else rounded(value)


def _none(story: ExplanationResult) -> Iterator[str]:
    good = [c for c in story.curves if c.converged]
    yield f"None of these: {story.answer.reason}."
    if not good:
        yield "  No free-form curve could be fitted either."
        return
    places = listed(list(dict.fromkeys(place(c) for c in good)), "or")
    words = [
        f"varying with {w}" for w in dict.fromkeys(c.driver.driver.words for c in good if c.driver.driver != CONSTANT)
    ]
    if len(words) < len({c.driver.name for c in good}):
        words.append("the same in every record")
    yield f"  Unlisted physics at {places}, {listed(words, 'or')}."
    yield f"  {curve_in_words(good[0])}"
    if story.answer.law is not None:
        yield nearest_law(story.answer.law)


def place(c: Curve) -> str:
    """Where a curve acts, in words."""
    return c.location.words


def curve_in_words(c: Curve) -> str:
    """The ends of a curve, or its one level."""
    percent = c.unit in ("", "1")
    factor, unit = (100.0, "%") if percent else (1.0, c.unit)
    fall = f"χ² falls by {rounded(c.gain)} with {count(c.dof, 'coefficient')}"
    if c.driver.driver == CONSTANT:
        size = format_quantity(factor * c.change[0], unit, factor * NORMAL_95 * c.standard_error[0])
        return f"{place(c)} is off by {size} in every record ({fall})."
    ends = []
    for k in (0, -1):
        size = format_quantity(factor * c.change[k], unit, factor * NORMAL_95 * c.standard_error[k])
        ends.append(f"{size} at {c.driver.short} {_driver_value(c, k)}")
    return f"{place(c)} goes from {ends[0]} to {ends[1]}, about its mean ({fall})."


def _driver_value(c: Curve, k: int) -> str:
    value, driver = float(c.values[k]), c.driver.driver
    if driver.quantity_unit:
        return rounded(math.exp(value))
    return rounded(value) if driver.unit == "1" else format_quantity(value, driver.unit)


def _rejected(story: ExplanationResult) -> Iterator[str]:
    rejected = story.answer.rejected
    if rejected:
        told = [f"{label} ({rejection_words(r)})" for label, r in list(rejected.items())[:SHOWN]]
        more = f", and {len(rejected) - SHOWN} more" if len(rejected) > SHOWN else ""
        yield f"Fitted and rejected: {'; '.join(told)}{more}."


def _floor(story: ExplanationResult) -> Iterator[str]:
    accuracy = story.evidence.settings.map_accuracy
    if accuracy <= 0.0:
        yield (
            "The maps were taken as exact (--model-error 0): an error of theirs of a few tenths of a per cent looks "
            "like missing physics."
        )
        return
    named = {o.label for x in story.answer.explanations for o in x.options}
    for c in story.floor:
        if c.label in named:
            yield (
                f"Tolerance of the maps {100 * accuracy:g} %: {c.label} would lower χ² by "
                f"{rounded(c.score_without)} were the maps exact, and by {rounded(c.score)} as they are; these "
                f"flights show it from a size of {_size(c.visible_without, c.unit)} and "
                f"{_size(c.visible, c.unit)}."
            )
    if story.only_exact:
        told = [
            f"{c.label} (χ² falls by {rounded(c.score_without)} with exact maps, {rounded(c.score)} with these)"
            for c in sorted(story.only_exact, key=lambda c: -c.score_without)[:SHOWN]
        ]
        more = len(story.only_exact) - SHOWN
        yield (
            f"Not separable from errors of the maps of {100 * accuracy:g} %: {'; '.join(told)}"
            f"{f', and {more} more' if more > 0 else ''}."
        )


def _size(value: float, unit: str) -> str:
    return "no size" if value == float("inf") else format_quantity(value, "" if unit == "1" else unit, digits=2)
