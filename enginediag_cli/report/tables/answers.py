"""Additions to an answer: what to record next, the sensitivity of the conclusion, and the work scope.

As sentences, as objects for JSON, and as texts for a table, where they have to be asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite, log10
from typing import TYPE_CHECKING, Any

from enginediag_cli.detection.series import Series
from enginediag_cli.fleets.maintenance import MaintenanceEffect
from enginediag_cli.fleets.work_scope import POWER, Gain, PowerReference, Quantity, WorkScope, WorkScopeEstimator
from enginediag_cli.isolation.sensitivity_analysis import (
    ACCURACY,
    INPUT,
    MAP,
    PRIOR,
    SPREAD,
    STATED,
    ConclusionChange,
    SensitivityAnalysis,
)
from enginediag_cli.isolation.windows import NextRecording
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import (
    change,
    count,
    format_quantity,
    further_records,
    listed,
    parameter_words,
    probability,
    rounded,
    spelled,
)
from enginediag_cli.report.tables import column, part
from enginediag_cli.report.tables.formulas import suggestion
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.story import ExplanationResult

FLIP = (
    column("what", "text", "the map, instrument, input or prior that would have to be wrong"),
    column("kind", "text", "map, sensor, input or prior"),
    column("size", "number", "smallest error that changes the name, as added to what was recorded"),
    column("unit", "text", "its unit"),
    column("stated", "number?", "what is allowed for it already, one standard deviation"),
    column("stated_as", "text?", "where that comes from"),
    column("times", "number?", "size over stated"),
    column("becomes", "text?", "what the answer would be"),
    column("words", "text", "the same as a sentence"),
)
FLIPS = (
    part("flips", "errors that would change the name, the nearest first", FLIP, many=True, empty=True),
    column("flips_told", "text?", "the nearest of them in one sentence"),
)
WORK_SCOPE = part("work_scope", "turbine temperature and fuel at equal power if a module were restored", empty=True)


WHOLE_FLIGHTS = 2
"""Whole flights that are listed: the best, and one of another kind to choose instead."""


def next_recording(found: NextRecording | None) -> list[str]:
    """The alternative hypotheses, then the best operating conditions, sensors and whole flights (between all leading
    sets), with the records that each takes; empty where the answer has no alternative."""
    if found is None:
        return []
    words = [listed(parameter_words(found.meaning, names)) or "no change" for names in found.alternatives]
    lines = [f"to separate {words[0]} from {words[1]}:"]
    for one in found.conditions:
        where = ", ".join(f"{column} {value:.4g}" for column, value in one.values.items())
        unseen = "" if one.inside_envelope else " (beyond the operating points identified)"
        lines.append(f"{further_records(f'at {where}', one.records, one.odds, one.noncentrality)}{unseen}")
    for one in found.sensors or ():
        where = f"with {one.label}" if one.values else "like these"
        lines.append(further_records(where, one.records, one.odds, one.noncentrality))
    useful = [one for one in found.flights if isfinite(one.records)]
    lines += [f"a whole flight: {suggestion(one)}" for one in useful[:WHOLE_FLIGHTS]]
    if found.flights and not useful:
        lines.append("no whole flight of those tried would separate all of them")
    return lines


MOST_CONDITIONS = 3
"""Conditions in a sentence, the nearest first; rows have all."""
LARGE = 0.2
"""Share of a reading from which it is not written: of a temperature's or a height's deviation it means nothing."""
MANY = 1e6
"""Odds from which only their order of magnitude is written."""

Words = Callable[[Sequence[str]], Sequence[str]]
"""How the names of an answer are said."""


def flip_cells(flips: SensitivityAnalysis | None, words: Words) -> dict[str, Any]:
    """`flips`: one mapping each, the nearest first, with its sentence; `flips_told`: all in one sentence."""
    if flips is None:
        return {"flips": None, "flips_told": None}
    return {
        "flips": [_cells(flip, flips.conclusion, words) for flip in flips.changes],
        "flips_told": flips_sentence(flips, words),
    }


def flip_column(flips: SensitivityAnalysis | None, words: Words) -> dict[str, Any]:
    """The nearest changes of the conclusion as one column of a table."""
    return {"flips": None if flips is None else [_short(flip) for flip in flips.changes[:MOST_CONDITIONS]]}


def _cells(flip: ConclusionChange, first: Sequence[str], words: Words) -> dict[str, Any]:
    origin = flip.error.origin if flip.error else "openness of the prior"
    return {
        "what": flip.name,
        "kind": flip.kind,
        "size": flip.size,
        "unit": flip.unit,
        "stated": flip.stated,
        "stated_as": origin,
        "times": flip.times,
        "becomes": " & ".join(flip.conclusion) or "nothing",
        "words": f"the answer would {_outcome(flip, first, words)}",
    }


def _short(flip: ConclusionChange) -> str:
    size = f"{rounded(flip.size, digits=2)} {flip.unit}"
    return f"{flip.name} {size} ({rounded(flip.times, digits=2)} stated): {' & '.join(flip.conclusion) or 'nothing'}"


def _condition(flip: ConclusionChange, words: Words) -> str:
    """For instance "T45 read 1.2 K higher (0.14 % of it; 2.3 times its spread between recordings)"."""
    if flip.kind == PRIOR or flip.error is None:
        size = rounded(flip.size, digits=2) if flip.size < MANY else f"10^{log10(flip.size):.0f}"
        return f"that were {size} times as probable before the data"
    error = flip.error
    times = f"{rounded(flip.times, digits=2)} times"
    size = format_quantity(abs(flip.size), flip.unit, digits=2)
    if flip.kind == MAP:
        (name,) = words([error.name])
        by = {ACCURACY: "what training leaves open", STATED: "its stated accuracy"}.get(
            error.origin, f"a {error.origin}"
        )
        where = " where this was flown" if error.origin != STATED else ""
        return f"the map of {name} were wrong by {size}{where} ({times} {by})"
    (name,) = words([error.name])
    channel = split_column(error.column)[0] if error.column else name
    of_it = ""
    share = abs(flip.size / error.reading) if error.reading else float("nan")
    if flip.unit != "%" and isfinite(share) and share < LARGE:
        of_it = f"{rounded(100 * share, digits=2)} % of it; "
    way = "higher" if flip.size > 0 else "lower"
    whose = "its" if error.origin == SPREAD else "a"
    what = f"the input {channel}" if flip.kind == INPUT else channel
    return f"{what} read {size} {way} ({of_it}{times} {whose} {error.origin})"


def flips_sentence(flips: SensitivityAnalysis, words: Words) -> str:
    """Sensitivity of the conclusion in one sentence."""
    errors = [flip for flip in flips.changes if flip.error is not None]
    prior = [flip for flip in flips.changes if flip.error is None]
    if errors:
        outcomes = [_outcome(flip, flips.conclusion, words) for flip in flips.changes[:MOST_CONDITIONS]]
        return f"the answer would {'; or '.join(outcomes)}"
    rest = f"; it would {_outcome(prior[0], flips.conclusion, words)}" if prior else ""
    return (
        f"no single error of a map, a sensor or an input would change the name within {flips.most:g} times what is "
        f"stated of it ({flips.tried} tried){rest}"
    )


def _outcome(flip: ConclusionChange, first: Sequence[str], words: Words) -> str:
    """For instance "hold fan flow capacity as well if T45 read 1.2 K higher"."""
    more, less = [n for n in flip.conclusion if n not in first], [n for n in first if n not in flip.conclusion]
    if not flip.conclusion:
        told = "be no change"
    elif (less and more) or not first:
        told = f"be {listed(list(words(flip.conclusion)))}"
    else:
        told = f"hold {listed(list(words(more)))} as well" if more else f"not hold {listed(list(words(less)))}"
    return f"{told} if {_condition(flip, words)}"


def flip_words(story: ExplanationResult) -> Words:
    """How names of explanations, and of parameters that may be wrong beside them, are said."""
    known = story.evidence.engine.parameters
    return lambda names: [known[n].words if n in known else n for n in names]


def explanation_flips(story: ExplanationResult) -> Iterator[str]:
    """What would change the first explanation of `explain`; nothing where none is named."""
    if story.flips is not None:
        told = flips_sentence(story.flips, flip_words(story))
        yield f"{told[:1].upper()}{told[1:]}."


PERCENT = 100.0
"""Per cent in one."""


def work_scope_cell(scope: WorkScope | None) -> dict[str, Any] | None:
    """The whole scope as a mapping: where, what is held, and the gain of each module; positive gains are falls of
    temperature and fuel at equal power, with 95 % intervals."""
    if scope is None:
        return None
    modules = [_gain_cells(g, scope.reference) for g in scope.gains if scope.reference is not None]
    return {
        **reference_cells(scope.reference),
        "modules": modules,
        "reason": scope.reason,
        "told": list(work_scope_sentences(scope)),
    }


def reference_cells(reference: PowerReference | None) -> dict[str, Any]:
    """Operating point of a gain."""
    if reference is None:
        return {"reference": None, "inputs": None, "held": None, "temperature": None, "fuel": None}
    return {
        "reference": reference.words,
        "inputs": dict(reference.inputs),
        "held": reference.fixed_column,
        "temperature": reference.temperature,
        "fuel": reference.fuel,
    }


def _gain_cells(gain: Gain, reference: PowerReference) -> dict[str, Any]:
    return {"module": gain.module, "parameters": list(gain.names), **gain_cells(gain, reference)}


def gain_cells(gain: Gain, reference: PowerReference) -> dict[str, Any]:
    """The fall of temperature, in its unit, and of fuel, in per cent of the present flow, with 95 % intervals."""
    t, f = gain.temperature, gain.fuel
    return {
        "temperature_gain": t.value,
        "temperature_low": t.value - NORMAL_95 * t.deviation,
        "temperature_high": t.value + NORMAL_95 * t.deviation,
        "temperature_unit": split_column(reference.temperature)[1],
        "fuel_gain_percent": PERCENT * f.share,
        "fuel_low_percent": PERCENT * (f.share - NORMAL_95 * f.share_deviation),
        "fuel_high_percent": PERCENT * (f.share + NORMAL_95 * f.share_deviation),
    }


def work_scope_sentences(scope: WorkScope) -> Iterator[str]:
    """For instance "restoring the HPC would lower T45 by 6.1 K ± 0.6 K and fuel flow by 0.40 % ± 0.04 % at equal
    thrust (design point)"."""
    if scope.reason:
        yield f"the gain of restoring is unknown: {scope.reason}"
    for gain in scope.gains:
        if scope.reference is not None:
            yield _restoring(gain, scope.reference)


def _restoring(gain: Gain, reference: PowerReference) -> str:
    module = spelled(gain.module)
    if gain.temperature.value < 0 and gain.fuel.value < 0:
        return f"the {module} has become better, which {_gain_sentence(_reversed(gain), reference, past=True)}"
    return f"restoring the {module} would {_gain_sentence(gain, reference)}"


def _reversed(gain: Gain) -> Gain:
    t, f = (Quantity(-q.value, q.deviation, -q.share, q.share_deviation) for q in (gain.temperature, gain.fuel))
    return Gain(gain.module, gain.names, t, f)


def gain_words(gain: Gain, reference: PowerReference) -> str:
    """What maintenance did: "lowered T45 by 6.1 K ± 0.6 K and lowered fuel flow by 0.40 % ± 0.04 % at equal thrust
    (design point)"."""
    return _gain_sentence(gain, reference, past=True)


def _gain_sentence(gain: Gain, reference: PowerReference, past: bool = False) -> str:
    quantity, unit = split_column(reference.temperature)
    name = quantity if reference.recorded else f"{quantity} (of the model)"
    held = "power" if reference.fixed_column == POWER else "thrust"
    first = _change_words(name, gain.temperature, unit, past)
    share = Quantity(PERCENT * gain.fuel.share, PERCENT * gain.fuel.share_deviation, 0.0, 0.0)
    return f"{first} and {_change_words('fuel flow', share, '%', past)} at equal {held} ({reference.words})"


def _change_words(name: str, gain: Quantity, unit: str, past: bool) -> str:
    verb = ("lowered", "raised") if past else ("lower", "raise")
    half = NORMAL_95 * gain.deviation
    return f"{verb[gain.value < 0]} {name} by {format_quantity(abs(gain.value), unit, half)}"


def maintenance_sentence(
    found: MaintenanceEffect, known: Mapping[str, Parameter], reference: PowerReference | None
) -> str:
    """What maintenance restored, and at which operating point."""
    sides = f"{count(found.flights_before, 'flight')} before against {found.flights_after} after"
    if not found.names:
        return f"nothing changed with it for certain ({sides})"
    parts = [
        change(known[n], d, NORMAL_95 * s) for n, d, s in zip(found.names, found.change, found.deviation, strict=True)
    ]
    what = f"{listed(parts)} (probability {probability(found.probability)}; {sides})"
    if found.gain is None or reference is None:
        return f"{what}; the gain is unknown: {found.reason}"
    return f"it {_gain_sentence(found.gain, reference, past=True)}: {what}"


def maintenance_cell(found: MaintenanceEffect, reference: PowerReference | None) -> dict[str, Any]:
    """What maintenance did bring, as a mapping; positive gains are falls."""
    gain = {} if found.gain is None or reference is None else gain_cells(found.gain, reference)
    return {
        **reference_cells(reference),
        "flights_before": found.flights_before,
        "flights_after": found.flights_after,
        "changed": list(found.names),
        "probability": found.probability,
        "change": list(found.change),
        "deviation": list(found.deviation),
        **gain,
        "reason": found.reason,
    }


MAINTENANCE = "maintenance"
"""`kind` of the rows of what maintenance did bring."""


def report_work_scope(messages: Messages, engine: str, scope: WorkScope | None) -> None:
    """What restoring the components of the events would bring, in words."""
    name = f"engine {engine}: " if engine else ""
    for sentence in work_scope_sentences(scope) if scope is not None else ():
        messages.note(f"{name}{sentence}")


def work_scope_cells(scope: WorkScope | None, form: str) -> tuple[Any, tuple[str, ...]]:
    """The cell of `work_scope`, and the columns that it fills; form: "" none, "cell" as text, "nested" in full."""
    if form == "nested":
        return work_scope_cell(scope), ("work_scope",)
    return None if scope is None else list(work_scope_sentences(scope)), ("work_scope",) if form else ()


def report_maintenance(
    messages: Messages, engine: str, found: MaintenanceEffect, series: Series, scoping: WorkScopeEstimator
) -> None:
    """What maintenance did bring, in words."""
    name = f"engine {engine}: " if engine else ""
    label = series.stretches[engine][found.flight - 1].window.flight or str(found.flight)
    told = maintenance_sentence(found, series.parameters, scoping.reference({}))
    messages.note(f"{name}maintenance before flight {label}: {told}")


def maintenance_row(
    engine: str,
    found: MaintenanceEffect,
    series: Series,
    scoping: WorkScopeEstimator,
    form: str,
    others: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """One row with the columns of the `others`, as far as they apply; form: as of `work_scope_cells`."""
    window = series.stretches[engine][found.flight - 1].window
    reference = scoping.reference({})
    told = maintenance_sentence(found, series.parameters, reference)
    described = [series.parameters[n].component for n in found.names]
    own = {
        "engine": engine,
        "flights": len(series.stretches[engine]),
        "verdict": "changed" if found.names else "steady",
        "kind": MAINTENANCE,
        "components": list(dict.fromkeys(described)),
        "component": list(dict.fromkeys(described)),
        "parameter": list(found.names),
        "probability": found.probability,
        "onset": found.flight,
        "onset_flight": window.flight,
        "onset_source": window.source,
        "onset_line": window.first_line,
        "change": list(found.change),
        "work_scope": maintenance_cell(found, reference) if form == "nested" else [told],
    }
    columns = dict.fromkeys([*(others[0] if others else own), "work_scope"])
    return {column: own.get(column) for column in columns}
