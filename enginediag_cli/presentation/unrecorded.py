"""Effects whose driver no column records, in plain sentences: where, when they switch, what that follows after all."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.mismatch.unrecorded.finding import Limit
from enginediag_cli.mismatch.unrecorded.latched import Way
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import rounded, with_unit
from enginediag_cli.presentation.sentences import count

if TYPE_CHECKING:
    from enginediag_cli.engine.term import Effect
    from enginediag_cli.mismatch.explain.follows import Follows
    from enginediag_cli.mismatch.explain.story import Story
    from enginediag_cli.mismatch.unrecorded.finding import Switch
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding

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


def hidden_sentences(story: Story, f: HiddenFinding, effects: tuple[Effect, ...]) -> Iterator[str]:
    """A finding, and of the first what it follows; `effects`: listed ones that may be it."""
    where = f.location.words
    rivals = f" (or {listed([r.words for r in f.rivals], 'or')})" if f.rivals else ""
    likelier = f"log likelihood +{rounded(f.lr)}; chance alone reaches +{rounded(f.threshold)}"
    unit = "" if f.unit == "1" else f.unit
    if f.is_switch:
        half = 0.5 * (f.interval[1] - f.interval[0])
        yield (
            f"An effect at {where}{rivals} switches between two states that no column records: "
            f"{count(len(f.switches), 'change')} within flights, of size {with_unit(f.coefficient, unit, half)} "
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
            f"{t.label} ({', '.join(with_unit(v, '', NORMAL_95 * e) for v, e in t.coefficients.values())}"
            + (f", χ² {rounded(t.objective - best)} worse)" if t is not story.switched[0] else ")")
            for t in story.switched
        ]
        yield f"  Listed effects that act there, refitted with these states, best first: {listed(told, 'or')}."
    elif effects:
        yield f"  Listed effects that act there: {listed([e.label for e in effects], 'or')}."
    if f.remark:
        yield f"  {_LIMITS[f.remark.limit](f.remark.what)}"


def follows_sentences(follows: Sequence[Follows]) -> Iterator[str]:
    """What a switch that no column records follows, and what else would give its states back as well."""
    if not follows:
        return
    first, latch = follows[0].of.variable, follows[0].latch
    changes, records = count(follows[0].changes, "change"), count(latch.sure, "record")
    low, high = rounded(latch.lower), rounded(latch.upper)
    when = {
        Way.ABOVE: f"on above {high}, off below {low}",
        Way.BELOW: f"on below {low}, off above {high}",
        Way.FALLING: f"on between {low} and {high} after coming from above",
        Way.RISING: f"on between {low} and {high} after coming from below",
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
        rest = "" if timed == len(shown) else "; where that is not said, they do not tell it closer than steady ones"
        yield f"  Times of 95 % are told by unsteady records between steady ones, to which nothing was fitted{rest}."


def moment(s: Switch) -> str:
    """When a state changed: by the unsteady records, or between those that are judged, whose times are the middles of
    what was averaged."""
    if s.narrowed:
        low, high = math.floor(10.0 * s.earliest_s) / 10.0, math.ceil(10.0 * s.latest_s) / 10.0
        return f"between {low:.10g} and {high:.10g} s (95 %)"
    if not (math.isfinite(s.before_s) and math.isfinite(s.time_s)):
        return f"at record {s.record + 1}"
    return f"between {s.before_s:.10g} and {s.time_s:.10g} s"


def follows_document(follows: Follows) -> dict[str, Any]:
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
