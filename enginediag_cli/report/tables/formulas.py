"""Empirical corrections and hidden effects of `explain`, in sentences and as parts of its document.

A correction: its formula, what is settled of it, and its residual. An effect whose driver no column records: where it
acts, when it switches, and what that follows. What to record next.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence, Set
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from enginediag_cli.isolation.planned_flights import (
    DURATION_S,
    MANOEUVRE,
    RECORDS,
    SAME,
    SENSOR,
    SWITCH,
    best_of_each_kind,
)
from enginediag_cli.mismatch.laws.finding import TOGETHER
from enginediag_cli.mismatch.unrecorded.finding import Limit
from enginediag_cli.mismatch.unrecorded.latched import SwitchingDirection
from enginediag_cli.physics.engine_file import law_entry
from enginediag_cli.physics.law import Law
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.sentences import count, format_quantity, listed, probability, rounded

if TYPE_CHECKING:
    from enginediag_cli.engine.term import Effect, Term
    from enginediag_cli.isolation.planned_flights import Suggestion
    from enginediag_cli.mismatch.explain.follows import HysteresisFit
    from enginediag_cli.mismatch.explain.plan import Advice
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.fit.options import Option
    from enginediag_cli.mismatch.laws.band import Band
    from enginediag_cli.mismatch.laws.finding import Group, LawFinding, Share
    from enginediag_cli.mismatch.unrecorded.finding import Switch
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding


POSSIBLE = 0.02
"""Probability below which an alternative is not listed."""
MOST = 3
"""Alternatives in a sentence."""
MANY, LONG = 5, 300
"""Coefficients of a law, and letters of its formula, that a reader follows; of one with more its curve is written
instead."""
ALONG = 5
"""Points of such a curve that are written."""


def is_long(term: Term) -> TypeGuard[Law]:
    """Whether a law has more coefficients, or a longer formula, than a reader follows."""
    return isinstance(term, Law) and (len(term.COEFFICIENTS) > MANY or len(term.expression.text) > LONG)


def equation(term: Term) -> str:
    """What an effect says, as a line has it."""
    if is_long(term):
        of = f"formula of {len(term.COEFFICIENTS)} coefficients" if len(term.COEFFICIENTS) > MANY else "long formula"
        return f"{term.changed}, f a {of} that varies with {term.driver_words()}: JSON and `refine` write it whole"
    return term.EQUATION.replace(",  ", ", ")


def equations(options: Sequence[Option]) -> str:
    """Laws of one explanation."""
    return " with ".join(equation(o.hypothesis.effects[0].term) for o in options)


def law_statement(e: Effect, found: LawFinding | None) -> Iterator[str]:
    """What a law says, as the likeliest where what it varies with is not settled."""
    settled = found is None or len(found.along) == 1
    yield f"  {'' if settled else 'The likeliest of those that these flights do not separate: '}{e.term.STATEMENT}"
    yield f"  {equation(e.term)}." if is_long(e.term) else f"  {e.term.EQUATION}"


def law_sentences(found: LawFinding) -> Iterator[str]:
    """What is known of a law, beside its coefficients."""
    first = found.laws[0]
    yield f"  {_location_sentence(found)}"
    yield f"  {_certainty_sentence('What it varies with', [(_groups(g), q) for g, q in found.drivers])}"
    yield from _averaged(found)
    alike = [v.words for group in found.drivers[0][0] for v in group[1:]]
    if alike:
        more = [f"{len(alike) - MOST} more"] if len(alike) > MOST else []
        yield f"  In these flights it is indistinguishable from {listed([*alike[:MOST], *more], 'or')}."
    least, most = (_size(x, found.unit) for x in found.moves)
    what = first.location.words or first.location.name
    yield f"  Over the records it changes {what} by {least} to {most} about the mean."
    if found.band is not None:
        yield from _curve_sentences(found.band, ALONG if is_long(first.option.hypothesis.effects[0].term) else 2)


def residual_sentence(found: LawFinding) -> str:
    """How much of the mismatch it explains, and what remains; nothing where the recordings alone say what noise is."""
    if found.explained is None:
        return "  The residual is indistinguishable from noise, whose size these recordings alone give."
    return (
        f"  It explains {_percent(found.explained)} of what is beyond the noise (χ² {rounded(found.excess)}); "
        f"{_percent(1.0 - found.explained)} remains."
    )


def nearest_law(found: LawFinding) -> str:
    """Where no law is enough: how far the likeliest goes."""
    first = found.laws[0]
    share = "" if found.explained is None else f" explains {_percent(found.explained)} of what is beyond the noise and"
    return f"  The nearest law, {equation(first.option.hypothesis.effects[0].term)},{share} leaves a misfit behind."


def law_document(found: LawFinding) -> dict[str, Any]:
    """The same as one object; `entry` is what an engine file takes."""
    return {
        "laws": [
            {
                "name": law.option.label,
                "location": law.location.name,
                "probability": law.probability,
                "evidence": law.evidence,
                "entry": law_entry(law.option.hypothesis.effects[0]),
            }
            for law in found.laws
        ],
        "places": [
            {"location": p.name, "component": p.component, "probability": q} for p, q in found.places if q > POSSIBLE
        ],
        "alike": [p.name for p in found.alike],
        "forms": [
            {
                "words": list(x.words),
                "variables": [v.name for v in x.of],
                "expression": x.text,
                "probability": x.probability,
                "written": x.written,
            }
            for x in found.forms
        ],
        "drivers": [
            {"variables": [[v.name for v in g] for g in groups], "probability": q}
            for groups, q in found.drivers
            if q > POSSIBLE
        ],
        "along": [[[v.name for v in g] for g in groups] for groups in found.along],
        "excess": found.excess,
        "explained": found.explained,
        "moves": list(found.moves),
        "unit": found.unit,
        "band": None if found.band is None else _band(found.band),
    }


def _band(b: Band) -> dict[str, Any]:
    return {
        "variable": b.of.variable.name,
        "values": b.at,
        "change": b.change,
        "standard_error": b.standard_error,
        "unit": b.unit,
        "parts_below": b.parts[0],
        "parts_above": b.parts[1],
    }


def _certainty_sentence(what: str, of: Sequence[tuple[str, float]]) -> str:
    likely = [(words, q) for words, q in of if q > POSSIBLE][:MOST]
    if likely[0][1] >= TOGETHER:
        return f"{what} is settled: {likely[0][0]} (probability {probability(likely[0][1])})."
    return f"{what} is not settled: {listed([f'{words} ({probability(q)})' for words, q in likely], 'or')}."


def _location_sentence(found: LawFinding) -> str:
    alike = {p.name for p in found.alike}
    likely = [(p, q) for p, q in found.places[1:] if p.name in alike and q > POSSIBLE][:MOST]
    if not likely or found.together < TOGETHER:
        return _certainty_sentence("Where", [(p.words or p.name, q) for p, q in found.places])
    words = [f"{p.words or p.name} ({probability(q)})" for p, q in (found.places[0], *likely)]
    return (
        f"Where is settled but for places that these flights do not separate: {listed(words, 'or')}, together "
        f"{probability(found.together)}."
    )


def _groups(groups: Sequence[Group]) -> str:
    return listed([g[0].words for g in groups], "and")


def _curve_sentences(b: Band, points: int) -> Iterator[str]:
    """The curve at so many points, the ends among them."""
    ends = [
        f"{_size(float(b.change[k]), b.unit, float(NORMAL_95 * b.standard_error[k]))} at {rounded(float(b.at[k]))}"
        for k in np.linspace(0, len(b.at) - 1, points).round().astype(int)
    ]
    name = b.of.variable.words
    over = "" if b.of.variable.recorded else ", in design values"
    over_middle = f" over {', '.join(ends[1:-1])}" if ends[1:-1] else ""
    yield f"  Along {name}{over} it goes from {ends[0]}{over_middle} to {ends[-1]}, whatever the form."
    below, above = b.parts
    told = [f"below {rounded(below)}"] if below is not None else []
    told += [f"above {rounded(above)}"] if above is not None else []
    if told:
        yield f"  Forms that fit as well part {listed(told, 'and')}: there it is not known."


def _averaged(found: LawFinding) -> Iterator[str]:
    """What a law is an average of, where its form is not settled."""
    if not found.forms:
        return
    first = frozenset(g[0].name for g in found.drivers[0][0])
    likely = [x for x in found.forms if x.probability > POSSIBLE][:MOST]
    words = [_form(x, first) for x in likely]
    told = listed([f"{w} ({probability(x.probability)})" for w, x in zip(words, likely, strict=True)], "or")
    written = sum(x.written for x in found.forms)
    few = f", of which {written} {'stand' if written > 1 else 'stands'} for all" if written < len(found.forms) else ""
    several = (
        f"the average of {len(found.forms)}: {told}{few}" if len(found.forms) > 1 else "the average of smooth curves"
    )
    yield f"  Its form is not settled, and it is {several}."
    alone = next((x.text for x in likely if len(x.text) <= LONG), None)
    if alone is not None:
        yield f"  The likeliest {'' if alone == likely[0].text else 'formula '}alone: f = {alone}."


def _form(x: Share, first: Set[str]) -> str:
    """Its forms in words; its variables by name where they are not those named `first`."""
    it = "it" if len(x.of) == 1 else "both"
    if {v.name for v in x.of} != first:
        it = listed([v.words for v in x.of], "and")
    return " and ".join(f"{w} {it}" for w in dict.fromkeys(x.words))


def _size(x: float, unit: str, half: float | None = None) -> str:
    factor, words = (100.0, "%") if unit in ("", "1") else (1.0, unit)
    return format_quantity(factor * x, words, None if half is None else factor * half)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


MOST_SWITCHES, MOST_OTHERS = 12, 3
"""Switching times, and other variables, in a sentence that can still be read."""

_LIMITS: dict[Limit, Callable[[str], str]] = {
    Limit.BASE_FIT: lambda what: f"The fit without this effect did not converge: {what}.",
    Limit.REFIT: lambda what: f"The fit of this effect as two states did not converge: {what}.",
    Limit.AT_BOUND: lambda _: "The size of this effect is at its physical bound, so that its interval says little.",
    Limit.UNBELIEVED: lambda _: "Nothing there changes by so much within seconds and back: this is not believed.",
    Limit.UNSETTLED: lambda _: (
        "Which records are on still changed when the fit of this effect ended: its switching times are approximate."
    ),
}


def hidden_sentences(story: ExplanationResult, f: HiddenFinding, effects: tuple[Effect, ...]) -> Iterator[str]:
    """A finding, and of the first what it follows; `effects`: listed ones that may be it."""
    where = f.location.words
    rivals = f" (or {listed([r.words for r in f.rivals], 'or')})" if f.rivals else ""
    likelier = f"log likelihood +{rounded(f.lr)}; chance alone reaches +{rounded(f.threshold)}"
    unit = "" if f.unit == "1" else f.unit
    if f.is_switch:
        half = 0.5 * (f.interval[1] - f.interval[0])
        yield (
            f"An effect at {where}{rivals} switches between two states that no column records: "
            f"{count(len(f.switches), 'change')} within flights, of size {format_quantity(f.coefficient, unit, half)} "
            f"({likelier})."
        )
        yield from _switched(f.switches)
        if f.doubtful:
            told = [
                f"{count(d.records, 'record')} of {d.flight}"
                + (f" ({d.first_s:.10g} to {d.last_s:.10g} s)" if math.isfinite(d.first_s + d.last_s) else "")
                for d in f.doubtful
            ]
            yield f"  These readings do not say in which state the engine was in {listed(told, 'and')}."
        if f is story.hidden[0]:
            yield from follows_sentences(story.follows)
        yield (
            "  Which state is on follows from the sign that physics gives."
            if f.sign
            else "  The readings do not say which of the two states is on."
        )
    else:
        yield (
            f"An effect at {where}{rivals} varies with something that no column records ({likelier}); two "
            "states do not describe it better than a drifting amplitude."
        )
    if story.switched:
        best = story.switched[0].objective
        told = [
            f"{t.label} ({', '.join(format_quantity(v, '', NORMAL_95 * e) for v, e in t.coefficients.values())}"
            + (f", χ² {rounded(t.objective - best)} worse)" if t is not story.switched[0] else ")")
            for t in story.switched
        ]
        yield f"  Listed effects that act there, refitted with these states, best first: {listed(told, 'or')}."
    elif effects:
        yield f"  Listed effects that act there: {listed([e.label for e in effects], 'or')}."
    if f.remark:
        yield f"  {_LIMITS[f.remark.limit](f.remark.what)}"


def follows_sentences(follows: Sequence[HysteresisFit]) -> Iterator[str]:
    """What a switch that no column records follows, and what else would give its states back as well."""
    if not follows:
        return
    first, latch = follows[0].of.variable, follows[0].latch
    changes, records = count(follows[0].changes, "change"), count(latch.sure, "record")
    low, high = rounded(latch.lower), rounded(latch.upper)
    when = {
        SwitchingDirection.ABOVE: f"on above {high}, off below {low}",
        SwitchingDirection.BELOW: f"on below {low}, off above {high}",
        SwitchingDirection.FALLING: f"on between {low} and {high} after coming from above",
        SwitchingDirection.RISING: f"on between {low} and {high} after coming from below",
    }[latch.way]
    over = "" if first.recorded else " (in design values)"
    yield (
        f"  But its states are those of hysteresis in {first.words}{over}: {when}, which gives back "
        f"{latch.turns} of {changes} and all but {latch.wrong} of {records}."
    )
    others = [f.of.variable.words for f in follows[1 : 1 + MOST_OTHERS]]
    if others:
        yield f"  Thresholds of {listed(others, 'or')} do it nearly as well."


def _switched(switches: Sequence[Switch]) -> Iterator[str]:
    """When, flight by flight."""
    shown = switches[:MOST_SWITCHES]
    more = f"; and {len(switches) - MOST_SWITCHES} more" if len(switches) > MOST_SWITCHES else ""
    for flight in dict.fromkeys(s.flight for s in shown):
        told = ", ".join(f"{'on' if s.on else 'off'} {moment(s)}" for s in shown if s.flight == flight)
        last = more if flight == shown[-1].flight else ""
        yield f"  In {flight} switched {told}{last}."
    timed = sum(s.narrowed for s in shown)
    if timed:
        rest = "" if timed == len(shown) else "; where no time is given, they narrow it no further than steady ones"
        yield f"  Times of 95 % come from unsteady records between steady ones, to which nothing was fitted{rest}."


def moment(s: Switch) -> str:
    """When a state changed: by the unsteady records, or between those that are judged, whose times are the middles of
    what was averaged."""
    if s.narrowed:
        low, high = math.floor(10.0 * s.earliest_s) / 10.0, math.ceil(10.0 * s.latest_s) / 10.0
        return f"between {low:.10g} and {high:.10g} s (95 %)"
    if not (math.isfinite(s.before_s) and math.isfinite(s.time_s)):
        return f"at record {s.record + 1}"
    return f"between {s.before_s:.10g} and {s.time_s:.10g} s"


def follows_document(follows: HysteresisFit) -> dict[str, Any]:
    """The same as an object."""
    latch = follows.latch
    return {
        "variable": follows.of.variable.name,
        "way": latch.way.value,
        "lower": latch.lower,
        "upper": latch.upper,
        "turns": latch.turns,
        "changes": follows.changes,
        "wrong": latch.wrong,
        "records": latch.sure,
        "gain": latch.gain,
    }


MOST_SUGGESTIONS = 2
"""Suggestions that are always listed: the best, and one to choose instead."""


def advice_sentences(advice: Advice | None, *, all_kinds: bool = False) -> Iterator[str]:
    """The alternatives, and what would separate them: the best two, or the best of every kind."""
    if advice is None:
        return
    rivals = [f"{label} ({probability(p)})" for label, p in advice.rivals]
    yield f"To separate {rivals[0]} from {listed(rivals[1:], 'or')}:"
    kinds = best_of_each_kind(advice.suggestions)
    useful = [s for s in kinds if math.isfinite(s.records)]
    if not useful:
        yield "  no recording that was tried would do so surely."
    for s in kinds if all_kinds else useful[:MOST_SUGGESTIONS]:
        yield f"  {suggestion(s)}"


def suggestion(s: Suggestion) -> str:
    """One recording that would help, how soon, and what RECORDS records of it promise."""
    what = {
        SAME: "more records like these",
        SWITCH: f"records like these with {s.subject} switched off and on by turns",
        SENSOR: f"records like these with {s.subject} recorded",
    }.get(s.kind, s.subject)
    beyond = "" if s.is_flown else " (beyond the conditions flown)"
    settled = f"after {RECORDS} the right one is found with probability {probability(s.chance)}"
    if not math.isfinite(s.records):
        return f"{what}{beyond}: {settled}"
    if s.kind == MANOEUVRE:
        return f"{what}, recorded once a second: {count(math.ceil(s.records / DURATION_S), 'time')}"
    return f"{what}{beyond}: {count(int(s.records), 'record')} ({settled})"


def advice_document(advice: Advice | None) -> dict[str, Any] | None:
    """For JSON: alternatives, and every suggestion with its words."""
    if advice is None:
        return None
    return {
        "rivals": [{"label": label, "probability": p} for label, p in advice.rivals],
        "separates": advice.separates,
        "suggestions": [
            {
                "kind": s.kind,
                "what": s.subject,
                "records": s.records,
                "chance": s.chance,
                "known": s.is_flown,
                "in_words": suggestion(s),
            }
            for s in advice.suggestions
        ],
    }
