"""What a report says first of an engine: one answer out of all files, the most that any of them shows.

What to do next, from what was found: only what follows from the answer, no maintenance manual.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from enginediag_cli.detection.glr import size_with_unit
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.report.charts.health_trend import margin_found
from enginediag_cli.report.charts.rows import Row, rival
from enginediag_cli.report.isolation_rows import CANNOT_TELL
from enginediag_cli.report.page import results as kinds
from enginediag_cli.report.page.evidence import EngineEvidence, Evidence
from enginediag_cli.report.page.page import Lead, State
from enginediag_cli.report.sentences import change, count, listed, probability, rounded
from enginediag_cli.report.trend_rows import margin_words
from enginediag_cli.report.work_scope_rows import MAINTENANCE
from enginediag_cli.units import split_column


def next_step(state: State, changed: Sequence[Parameter], telling: Sequence[str], advice: Sequence[str]) -> str:
    """changed: parameters of the answer, or its suspects; telling: sensors that would tell them apart; advice: what
    `isolate --advise` said."""
    return " ".join([_own(state, changed, telling), *advice])


def _own(state: State, changed: Sequence[Parameter], telling: Sequence[str]) -> str:
    instruments = _parts(p for p in changed if p.of_instrument)
    components = _parts(p for p in changed if not p.of_instrument)
    if state is State.NO_VERDICT:
        return "Mend what stood in the way, or record under conditions that identification covered, and judge again."
    if state is State.NOTHING_FOUND:
        return "Nothing; keep recording. `detect --detectable` shows the smallest change that each window would show."
    if state is State.CANNOT_TELL:
        if telling:
            sensors = [split_column(column)[0] for column in telling]
            return f"Record {listed(sensors, 'or')}, which would tell; until then do no work on either suspicion."
        if instruments:
            return f"Check {listed(instruments)} first: cheaper than opening the engine, and it decides between them."
        return "Record more flights, and ask `isolate --advise` which operating point or sensor would tell most."
    if instruments and not components:
        return f"Check {listed(instruments)}, wiring and recorder channel; the engine itself shows no change."
    if instruments:
        return f"Check {listed(instruments)} first, then inspect the {listed(components)}."
    if components:
        return f"Inspect the {listed(components)}; compare the trend with the log of events since it began."
    return "Ask `isolate` or `trend` what changed."


def _parts(parameters: Iterable[Parameter]) -> list[str]:
    return list(dict.fromkeys(("the " if p.of_instrument else "") + (p.part or p.component) for p in parameters))


LIKELY, SETTLED = 0.5, 0.9
"""Probability from which a parameter is told as one that changed, and which the likeliest must have for the answer to
stand in the headline without a doubt."""
MISFIT = 2.0
"""χ² per degree of freedom of a window, after its answer, from which no answer explains what was read. Judgement."""


def lead_of(engine: EngineEvidence, evidence: Evidence, key: str) -> Lead:
    """The first screen of an engine."""
    found = _by_trend(engine, evidence) or _by_isolation(engine, evidence) or _by_detection(engine, evidence)
    state, sentence, names = _in_doubt(engine, found)
    return Lead(
        state,
        sentence,
        engine.engine,
        surely=_surely(engine),
        since=_since(engine, state),
        margin=_margin(engine),
        next=next_step(
            state, [evidence.known[n] for n in names if n in evidence.known], _telling(engine), _advice(engine)
        ),
        flips=_flips(engine),
        rivals=_rivals(engine, evidence),
        key=key,
    )


_Found = tuple[State, str, Sequence[str]]


def _in_doubt(engine: EngineEvidence, found: _Found) -> _Found:
    """The answer, told as the likeliest account of something that the model does not explain where that is so."""
    state, sentence, names = found
    fit = engine.isolated[-1][0].number("fit") if engine.isolated else math.nan
    if state not in (State.CHANGED, State.CANNOT_TELL) or not fit > MISFIT:
        return found
    told = f"The readings depart from nominal, and no change explains them (χ² per degree of freedom {rounded(fit)}): "
    return State.CANNOT_TELL, f"{told}ask explain what the model lacks. Nearest to it: {sentence}", names


DETECTABLE = "detectable:"
"""Begin of the columns of `detect` that hold the smallest changes that would have shown."""
UNCHANGED = ("", "steady", "cannot tell", MAINTENANCE)
"""Kinds of rows of `trend` that tell of no change by itself."""


def changed_in_trend(engine: EngineEvidence) -> list[Row]:
    """Rows of `trend` of parameters that have probably changed."""
    rows = [row for row in engine.of(kinds.TREND) if row.text("kind") not in UNCHANGED]
    return [row for row in rows if row.number("probability") >= LIKELY]


def _by_trend(engine: EngineEvidence, evidence: Evidence) -> _Found | None:
    rows = engine.of(kinds.TREND)
    changed = changed_in_trend(engine)
    if changed:
        told, names = listed([_of_trend(row, evidence) for row in changed]), [row.text("parameter") for row in changed]
        most = max(row.number("probability") for row in changed)
        if most < SETTLED:
            doubt = f"Something changed, and what is not settled; the likeliest ({probability(most)}): {told}."
            return State.CANNOT_TELL, doubt, names
        return State.CHANGED, f"{told}.", names
    suspects = [row for row in rows if row.text("kind") not in UNCHANGED]
    if suspects and rows[0].text("verdict") == "changed":
        parts = {row.text("component"): row for row in suspects}
        each = [f"{_part(row, evidence)} ({probability(row.number('probability'))})" for row in parts.values()]
        return (
            State.CANNOT_TELL,
            f"Something changed; it cannot be told whether it is {listed(each, 'or')}.",
            [row.text("parameter") for row in suspects],
        )
    if rows and rows[0].text("verdict") == CANNOT_TELL:
        alone = _by_isolation(engine, evidence)
        scatter = "Whether anything changed over these flights cannot be told from their scatter."
        if alone is None or alone[0] is not State.CHANGED:
            return State.CANNOT_TELL, scatter, []
        return State.CANNOT_TELL, f"{scatter} The last window by itself: {alone[1]}", alone[2]
    return None


def _of_trend(row: Row, evidence: Evidence) -> str:
    half = (row.number("change_high") - row.number("change_low")) / 2
    return change(evidence.known[row.text("parameter")], row.number("change"), half)


def _part(row: Row, evidence: Evidence) -> str:
    known = evidence.known[row.text("parameter")]
    return known.part or row.text("component")


def _by_isolation(engine: EngineEvidence, evidence: Evidence) -> _Found | None:
    windows = [rows for rows in engine.isolated if rows[0].text("verdict") != "no verdict"]
    if not windows:
        return None
    last, head = windows[-1], windows[-1][0]
    names = head.list("isolated")
    if head.text("verdict") == CANNOT_TELL:
        return State.CANNOT_TELL, f"{_capital(head.window)}: {head.text('note') or 'cannot tell what changed'}.", names
    if members := head.list("members"):
        words = [listed([p.words for p in meanings(evidence.known, rival(m)[0] or (m,)).values()]) for m in members]
        return (
            State.CANNOT_TELL,
            f"{_capital(head.window)}: it cannot be told which of these changed: {listed(words, 'or')} "
            f"(together {probability(head.number('class'))}).",
            names,
        )
    if names:
        told = [size_in_words(row, evidence) for row in last if row.text("parameter")]
        return State.CHANGED, f"{listed(told) or listed(list(names))}.", names
    if head.text("verdict") == "fault":
        return State.CANNOT_TELL, f"{_capital(head.window)} departs from nominal, and no parameter stands out.", ()
    return _quiet(engine, evidence)


def size_in_words(row: Row, evidence: Evidence) -> str:
    """The change of one isolated parameter with half its interval."""
    half = (row.number("upper") - row.number("lower")) / 2
    return change(evidence.known[row.text("parameter")], row.number("change"), half)


def _by_detection(engine: EngineEvidence, evidence: Evidence) -> _Found:
    rows = [row for row in engine.of(kinds.DETECTED) if row.text("verdict") != "no verdict"]
    if rows and rows[-1].text("verdict") == "fault":
        told = f"The engine departs from nominal in {rows[-1].window}; what changed has not been asked."
        return State.CHANGED, told, ()
    return _quiet(engine, evidence)


def _quiet(engine: EngineEvidence, evidence: Evidence) -> _Found:
    """Nothing in the last window, or nothing at all: never more than the tests say, and with their power."""
    judged = [r for r in _verdicts(engine) if r.text("verdict") != "no verdict"]
    if not judged:
        reasons = sorted({r.text("reason") or r.text("note") for r in _verdicts(engine)} - {""})
        why = f": {reasons[0]}" if reasons else ""
        return State.NO_VERDICT, f"Nothing could be judged{why}.", ()
    alarms = [row for row in judged if row.text("verdict") == "fault"]
    if alarms and judged[-1].text("verdict") != "fault":
        told = f"The last window agrees with nominal; {count(len(alarms), 'earlier window')} of {len(judged)} did not."
        return State.CANNOT_TELL, told, ()
    power = _power(judged[-1], evidence)
    return State.NOTHING_FOUND, f"All {count(len(judged), 'window')} judged agree with the nominal engine.{power}", ()


def _power(window: Row, evidence: Evidence) -> str:
    """What the window would have shown: of each component the smallest change of a parameter, where `detect` says."""
    smallest: dict[str, tuple[float, Parameter]] = {}
    for name in window.cells:
        parameter = evidence.known.get(name.removeprefix(DETECTABLE)) if name.startswith(DETECTABLE) else None
        if parameter is None or parameter.of_instrument or not math.isfinite(window.number(name)):
            continue
        known = smallest.get(parameter.component)
        if known is None or window.number(name) < known[0]:
            smallest[parameter.component] = (window.number(name), parameter)
    if not smallest:
        return ""
    told = [f"{p.words or p.name} by {size_with_unit(p, size)}" for size, p in smallest.values()]
    return f" The last would have shown a change of {listed(told, 'or')}."


def _verdicts(engine: EngineEvidence) -> list[Row]:
    """One row for each window that was judged or should have been."""
    return engine.of(kinds.DETECTED) or [rows[0] for rows in engine.isolated] or engine.of(kinds.COMPONENTS)


def _surely(engine: EngineEvidence) -> str:
    told = []
    changed = changed_in_trend(engine)
    if changed:
        row = max(changed, key=lambda r: r.number("probability"))
        flights = count(row.count("flights"), "flight" if row.text("onset_flight") else "window")
        told.append(f"probability {probability(row.number('probability'))} by the trend over {flights}")
    elif engine.of(kinds.TREND) and engine.of(kinds.TREND)[0].text("verdict") == "steady":
        told.append(f"the trend over {count(engine.of(kinds.TREND)[0].count('flights'), 'flight')} shows no change")
    windows = [rows[0] for rows in engine.isolated if not math.isnan(rows[0].number("probability"))]
    if windows:
        head = windows[-1]
        fit = head.number("fit")
        fits = f", χ² per degree of freedom {rounded(fit)} after it" if math.isfinite(fit) else ""
        exact = "this and nothing else that matters" if head.list("isolated") else "nothing that matters"
        told.append(f"{head.window} alone: {exact} with probability {probability(head.number('probability'))}{fits}")
    detected = engine.of(kinds.DETECTED)
    if detected:
        alarms = sum(row.text("verdict") == "fault" for row in detected)
        silent = sum(row.text("verdict") == "no verdict" for row in detected)
        without = f", {silent} without verdict" if silent else ""
        quiet = " but not the last" if changed and detected[-1].text("verdict") == "healthy" else ""
        told.append(f"{alarms} of {count(len(detected), 'window')} alarm{quiet}{without}")
    return "; ".join(told)


def _since(engine: EngineEvidence, state: State) -> str:
    if state is State.NOTHING_FOUND or state is State.NO_VERDICT:
        return ""
    changed = changed_in_trend(engine)
    if changed:
        row = min(changed, key=lambda r: r.number("onset"))
        word = "at once" if row.text("kind") == "step" else "growing"
        flight = row.text("onset_flight") or f"stretch {row.count('onset')}"
        low, high = row.count("onset_low"), row.count("onset_high")
        within = "" if low == high else f"; counted from the first, between {low} and {high}"
        named = f"flight {flight}" if row.text("onset_flight") else flight
        return f"{named}, {word}{within}"
    run = first_of_last_run(engine.of(kinds.DETECTED))
    return f"{run.window}, the first of an unbroken run of alarms" if run is not None else ""


def _margin(engine: EngineEvidence) -> str:
    """How far the turbine temperature is from its limit, where a result follows it."""
    found = margin_found(engine.of(kinds.MARGIN))
    return f"{_capital(margin_words(found.margin))}." if found is not None else ""


def first_of_last_run(rows: Sequence[Row]) -> Row | None:
    """The window from which on every judged window alarms; None where the last does not."""
    first = None
    for row in reversed([r for r in rows if r.text("verdict") != "no verdict"]):
        if row.text("verdict") != "fault":
            break
        first = row
    return first


def _telling(engine: EngineEvidence) -> Sequence[str]:
    return engine.isolated[-1][0].list("would_tell") if engine.isolated else ()


def _advice(engine: EngineEvidence) -> Sequence[str]:
    """What `isolate` advised, and what restoring a module would bring."""
    if not engine.isolated:
        return ()
    head = engine.isolated[-1][0]
    scope = head.cells.get("work_scope")
    told = scope.get("told", ()) if isinstance(scope, dict) else head.list("work_scope")
    return (*head.list("advice"), *(f"{_capital(str(sentence))}." for sentence in told))


def _flips(engine: EngineEvidence) -> tuple[str, ...]:
    """What would flip the answer, as `isolate` says it."""
    flips = engine.isolated[-1][0].cells.get("flips") if engine.isolated else None
    if isinstance(flips, list):
        return tuple(str(f.get("words", f)) if isinstance(f, dict) else str(f) for f in flips)
    return engine.isolated[-1][0].list("flips") if flips else ()


def _rivals(engine: EngineEvidence, evidence: Evidence) -> tuple[str, ...]:
    """What else the data do not exclude."""
    if not engine.isolated:
        return ()
    head, told = engine.isolated[-1][0], []
    for names, chance in map(rival, head.list("rivals")[:2]):
        words = listed([p.words for p in meanings(evidence.known, names).values()]) or "no change"
        told.append(f"{words} ({probability(chance)})")
    return tuple(told)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
