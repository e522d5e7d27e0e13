"""The answer of `isolate`: one row per window and isolated parameter, and the same in words.

The answer of `isolate --by component`: one row per window, and the same in words.

What to record next to tell an answer from its leading rival, in sentences.

What would flip an answer, as cells and in words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.isolation.results import Adequacy
from enginediag_cli.isolation.sensitivity_analysis import ACCURACY, INPUT, MAP, PRIOR, SPREAD, STATED, Flip, Flips
from enginediag_cli.isolation.windows import NextRecording
from enginediag_cli.report.laws import suggestion
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.outputs.judgements import COMPONENTS, ISOLATE
from enginediag_cli.report.sentences import further_records, listed, rounded, told, with_unit
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.fleets.work_scope import WorkScope
    from enginediag_cli.isolation.catalogue import NamedIsolation
    from enginediag_cli.isolation.diagnosis import ComponentIsolation, Diagnosis
    from enginediag_cli.isolation.results import Class, IsolationResult
    from enginediag_cli.isolation.windows import IsolatedWindow
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.parameters import Parameter


FORM_WORDS = {"bias": "a bias", "scale": "a scale error", "drift": "a drift", "soak": "heat soak"}
"""Forms of an instrument's error, by the quantity of the parameter."""
CANNOT_TELL = "cannot tell"
"""The verdict where the leading answer does not stand."""


def told_verdict(verdict: Verdict, adequacy: Adequacy | None) -> str:
    """The verdict of the test, or that the answer to what it found does not stand; an instrument that is stuck or
    scatters is a fault whatever the test says of the rest."""
    if adequacy is not None and not adequacy.stands:
        return CANNOT_TELL
    return verdict.with_instruments


def instrument_rows(verdict: Verdict) -> Iterator[dict[str, Any]]:
    """Cells of the instruments of a window that are stuck or scatter, one mapping for each."""
    from enginediag_cli.units import split_column

    for fault in verdict.window.instruments:
        yield {
            "parameter": fault.name,
            "inclusion": fault.probability,
            "change": fault.size,
            "unit": split_column(fault.column)[1] or "1",
        }


def reservation(adequacy: Adequacy, known: Mapping[str, Parameter]) -> str:
    """Why the answer does not stand; empty where it does."""
    from enginediag_cli.report.sentences import not_listed, outside_physics, wrong_file

    if adequacy.stands:
        return ""
    if adequacy.disagreement is not None and adequacy.disagreement.doubtful:
        return wrong_file(adequacy.disagreement)
    if adequacy.beyond is not None:
        name, change = adequacy.beyond
        return outside_physics(known[name], change, adequacy.unlisted)
    return not_listed(adequacy.fit, adequacy.unlisted)


def isolation_rows(
    verdict: Verdict,
    diagnosis: Diagnosis | None,
    known: Mapping[str, Parameter],
    catalogue: bool = False,
    advice: Sequence[str] | None = None,
) -> Iterator[dict[str, Any]]:
    """Rows of one window: one per isolated parameter, or a single one when there is none.

    catalogue: with columns for named faults; advice: sentences, a column where they were asked for.
    """
    from enginediag_cli.report.sentences import instrument_fault
    from enginediag_cli.residuals.flat import window_row

    row = window_row(verdict.window)
    row.update(
        verdict=told_verdict(verdict, diagnosis.adequacy if diagnosis else None),
        p_value=verdict.test.p_value if verdict.test else None,
        **fit_cells(diagnosis.adequacy if diagnosis else None),
        note=verdict.reason,
    )
    if catalogue:
        row.update(named=None, named_probability=None, severity=None, named_rivals=None)
        if diagnosis is not None and diagnosis.named is not None:
            row.update(_named_cells(diagnosis.named))
    if advice is not None:
        row["advice"] = list(advice)
    instruments = verdict.window.instruments
    row["instruments"] = [instrument_fault(fault) for fault in instruments]
    if diagnosis is None:
        row["isolated"] = [fault.name for fault in instruments] or None
        for cells in instrument_rows(verdict):
            yield ISOLATE.row(row | cells)
        if not instruments:
            yield ISOLATE.row(row)
        return
    result = diagnosis.result
    chance = float(np.prod([fault.probability for fault in instruments]))
    row.update(
        isolated=[*result.isolated, *(fault.name for fault in instruments)],
        probability=result.probability * chance,
        **class_cells(result.one_of),
        rivals=[f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in result.rivals],
        rivals_left_out=result.rivals_left_out,
        note="; ".join(filter(None, [reservation(diagnosis.adequacy, known), *_forms(result, known), result.note])),
    )
    if not result.sizes and not instruments:
        yield ISOLATE.row(row)
    for size in result.sizes:
        of_this = {
            "parameter": size.parameter,
            "inclusion": result.inclusion.get(size.parameter),
            "change": size.change,
            "lower": size.lower,
            "upper": size.upper,
            "unit": known[size.parameter].unit,
            "percent": size.percent,
        }
        yield ISOLATE.row(row | of_this)
    for cells in instrument_rows(verdict):
        yield ISOLATE.row(row | cells)


def isolated_rows(found: IsolatedWindow, catalogue: bool, *, advice: bool) -> Iterator[dict[str, Any]]:
    """Rows of one window, by parameter or by component as it was isolated; columns as in `isolation_rows`."""

    if found.by_component:
        yield component_row(found.verdict, found.components, found.known)
        return
    told = next_recording(found.advice) if advice and found.diagnosis is not None else None
    yield from isolation_rows(found.verdict, found.diagnosis, found.known, catalogue, told)


def beside_cells(found: IsolatedWindow, scope: WorkScope | None, forms: Mapping[str, str]) -> dict[str, Any]:
    """What would flip the answer and what restoring brings; forms: how each is written, "" not at all, "cell" as text,
    "nested" in full."""
    from enginediag_cli.report.work_scope_rows import work_scope_cell, work_scope_sentences

    cells: dict[str, Any] = {}
    if forms["flips"]:
        cells.update((flip_cells if forms["flips"] == "nested" else flip_column)(found.flips, words_of(found)))
    if forms["work_scope"] == "nested":
        cells["work_scope"] = work_scope_cell(scope)
    elif forms["work_scope"]:
        cells["work_scope"] = None if scope is None else list(work_scope_sentences(scope))
    return cells


def words_of(found: IsolatedWindow) -> Callable[[Sequence[str]], list[str]]:
    """How the names of an answer are said: of parameters, else of components."""
    from enginediag_cli.report.sentences import spelled
    from enginediag_cli.report.sentences import told as in_words

    def words(names: Sequence[str]) -> list[str]:
        return [in_words(found.known, [n])[0] if n in found.known else spelled(n) for n in names]

    return words


def tell_isolated(messages: Messages, found: IsolatedWindow, scope: WorkScope | None = None) -> None:
    """The answer for one window in words."""
    from enginediag_cli.report.work_scope_rows import work_scope_sentences

    of = about(found.verdict)
    tell_instruments(messages, found.verdict)
    if found.components is not None:
        messages.note(f"{where(found.verdict)}: {component_sentence(found.components, found.known)}", **of)
    elif not found.by_component:
        tell(messages, found.verdict, found.diagnosis, found.known, next_recording(found.advice))
    if found.flips is not None and found.named:
        messages.note(f"{where(found.verdict)}: {flips_sentence(found.flips, words_of(found))}")
    for sentence in work_scope_sentences(scope) if scope is not None else ():
        messages.note(f"{where(found.verdict)}: {sentence}")


def tell_instruments(messages: Messages, verdict: Verdict) -> None:
    """Instruments of a window that are stuck or scatter, in words."""
    if not verdict.window.instruments:
        return
    from enginediag_cli.report.sentences import instrument_fault

    for fault in verdict.window.instruments:
        messages.note(f"{where(verdict)}: {instrument_fault(fault)}", **about(verdict))


def _forms(result: IsolationResult, known: Mapping[str, Parameter]) -> list[str]:
    """Of which instruments these records do not separate the forms of the error, and which are possible."""
    from enginediag_cli.isolation.prior import SEPARATED
    from enginediag_cli.report.sentences import listed

    found = []
    for name, shares in result.forms.items():
        if shares[name] < SEPARATED:
            likely = sorted(shares, key=lambda form: -shares[form])
            forms = [FORM_WORDS[known[form].quantity] for form in likely if shares[form] > 1 - SEPARATED]
            found.append(f"{known[name].part}: {listed(forms, 'or')}, these records do not separate them")
    return found


def class_cells(found: Class | None) -> dict[str, Any]:
    """The class of which the answer is the likeliest member: its probability, its members, each with what all of them
    share, and the sensors that would tell them apart."""
    if found is None:
        return {"class": None, "members": None, "would_tell": None}
    members = [" & ".join((*found.shared, *member)) for member in found.members]
    return {"class": found.probability, "members": members, "would_tell": list(found.would_tell)}


def fit_cells(adequacy: Adequacy | None) -> dict[str, float | None]:
    """χ² per degree of freedom before and after the answer, and the share of the excess that it explains, None where
    nothing is left to test it by, or where there is no excess; probability that it is something that is not listed."""
    from math import isfinite

    found = adequacy or Adequacy()
    cells = {"fit_before": found.before, "fit": found.fit, "explained": found.explained}
    shown = {name: value if isfinite(value) else None for name, value in cells.items()}
    return shown | {"unlisted": None if adequacy is None else found.unlisted}


def _named_cells(named: NamedIsolation) -> dict[str, Any]:
    return {
        "named": list(named.faults) or (["unlisted"] if named.free else []),
        "named_probability": named.probability,
        "severity": [f"{s.value:.3g} ({s.lower:.3g} to {s.upper:.3g})" for s in named.severities],
        "named_rivals": [f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in named.rivals],
    }


def where(verdict: Verdict) -> str:
    """Which window it is: its flight and engine, or else file and lines."""
    window = verdict.window
    names = (window.flight and f"flight {window.flight}", window.engine and f"engine {window.engine}")
    return " ".join(filter(None, names)) or f"{window.source}:{window.first_line}-{window.last_line}"


def about(verdict: Verdict) -> dict[str, Any]:
    """Which window it is, for a log."""
    window = verdict.window
    return {
        "file": window.source,
        "flight": window.flight,
        "engine": window.engine,
        "lines": [window.first_line, window.last_line],
    }


def tell(
    messages: Messages,
    verdict: Verdict,
    diagnosis: Diagnosis | None,
    known: Mapping[str, Parameter],
    advice: Sequence[str] = (),
) -> None:
    """The answer for one window in words."""
    from enginediag_cli.report.sentences import (
        change,
        no_verdict,
        one_of,
        probability,
        sensor_or_component,
        unexplained,
    )
    from enginediag_cli.report.sentences import told as in_words

    here, of = where(verdict), about(verdict)
    if diagnosis is None:
        messages.note(no_verdict(verdict.reason, where=here), **of)
        return
    result = diagnosis.result
    told = [
        change(
            known[size.parameter],
            size.change,
            size.reach,
            chance=result.inclusion.get(size.parameter),
        )
        for size in result.sizes
    ]
    alone = f": probability {probability(result.probability)}" if result.inclusion else ""
    caution = reservation(diagnosis.adequacy, known)
    if caution:
        messages.note(f"{here}: {caution}", **of)
    if verdict.window.doubtful:  # what would explain a right file says nothing of this one
        return
    leading = "" if diagnosis.adequacy.stands else "leading, but not to be relied on: "
    left = unexplained(diagnosis.adequacy.before, diagnosis.adequacy.fit, diagnosis.adequacy.explained)
    nothing = "no further change that matters" if verdict.window.instruments else "no change that matters"
    what = "; ".join([*told, "nothing else that matters"] if told and alone else told) or nothing
    messages.note(f"{here}: {leading}{what}{alone}{left and f'; {left}'}", **of)
    for sentence in _forms(result, known):
        messages.note(f"{here}: {sentence}", **of)
    if result.one_of is not None:
        messages.note(f"{here}: {one_of(result.one_of, lambda names: in_words(known, names))}", **of)
    if diagnosis.nonlinear:
        messages.note(f"{here}: a large change, judged with the full model", **of)
    if diagnosis.rivalry is not None and result.one_of is None:  # else it is told among the members
        r = diagnosis.rivalry
        sensors, components, shared = (in_words(known, each) for each in (r.sensors, r.components, r.shared))
        told_rivalry = sensor_or_component(sensors, components, r.of_sensors, r.of_components, shared)
        messages.note(f"{here}: {told_rivalry}", **of)
    if result.rivals:
        rivals = [" & ".join(r.parameters) or "no change" for r in result.rivals[:3]]
        more = len(result.rivals) - len(rivals) + result.rivals_left_out
        behind = f" and {more} more" if more else ""
        share = f" (with the answer, {100 * result.coverage:.3g} % in all)" if result.inclusion else ""
        messages.note(f"{here}: not excluded either: {'; '.join(rivals)}{behind}{share}", **of)
    if diagnosis.named is not None:
        messages.note(f"{here}: {_named_sentence(diagnosis.named, known)}", **of)
    for sentence in advice:
        messages.note(f"{here}: {sentence}", **of)


def _named_sentence(named: NamedIsolation, known: Mapping[str, Parameter]) -> str:
    """The named answer and its leading rival."""
    from enginediag_cli.report.sentences import listed, named_fault, probability, spelled

    if named.faults:
        told = named_fault([(s.fault, s.value, s.upper - s.value) for s in named.severities], named.probability)
    elif named.free:
        told = f"none of the catalogue's faults (probability {probability(named.unlisted)})"
    else:
        told = f"no fault of the catalogue (probability {probability(named.probability)})"
    if named.rivals:
        rival = named.rivals[0]
        name = listed([known[n].words if n in known else spelled(n) for n in rival.parameters]) or "no fault"
        told += f"; next: {name} ({probability(rival.probability)})"
    return told


def component_row(verdict: Verdict, found: ComponentIsolation | None, known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Row of one window; `inclusion` lists the components likeliest first, down to one in a hundred."""
    from enginediag_cli.report.sentences import instrument_fault
    from enginediag_cli.residuals.flat import window_row

    adequacy = found.adequacy if found else None
    row = window_row(verdict.window)
    row.update(
        verdict=told_verdict(verdict, adequacy),
        p_value=verdict.test.p_value if verdict.test else None,
        **fit_cells(adequacy),
        note=verdict.reason,
        instruments=[instrument_fault(fault) for fault in verdict.window.instruments],
    )
    if found is not None:
        shown = sorted(found.inclusion.items(), key=lambda item: -item[1])
        row.update(
            components=list(found.components),
            probability=found.probability,
            **class_cells(found.one_of),
            inclusion=[f"{name} ({chance:.2g})" for name, chance in shown if chance >= 0.01],
            rivals=[f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in found.rivals],
            note="; ".join(
                filter(
                    None,
                    [
                        reservation(found.adequacy, known),
                        "" if found.complete else "larger sets of parameters were not considered",
                    ],
                )
            ),
        )
    return COMPONENTS.row(row)


def component_sentence(found: ComponentIsolation, known: Mapping[str, Parameter]) -> str:
    """The answer for one window in words."""
    from enginediag_cli.report.sentences import listed, one_of, probability, spelled, unexplained

    def words(components: tuple[str, ...]) -> str:
        return listed([spelled(c) for c in components]) or "no component"

    told = f"{words(found.components)} changed (probability {probability(found.probability)})"
    if found.perhaps:
        besides = [f"{spelled(c)} ({probability(found.inclusion[c])})" for c in found.perhaps]
        told = f"{words(found.components)} changed (probability {probability(found.all_of_them)})"
        told += f", perhaps {listed(besides)} as well; exactly this: probability {probability(found.probability)}"
    if found.rivals:
        told += f"; next: {words(found.rivals[0].parameters)} ({probability(found.rivals[0].probability)})"
    if found.one_of is not None:
        told += f"; {one_of(found.one_of, lambda names: [spelled(c) for c in names])}"
    left = unexplained(found.adequacy.before, found.adequacy.fit, found.adequacy.explained)
    told += left and f"; {left}"
    caution = reservation(found.adequacy, known)
    leading = "" if found.adequacy.stands else "leading, but not to be relied on: "
    return f"{caution}; {leading}{told}" if caution else told


FLIGHTS = 2
"""Whole flights that are told: the best, and one of another kind to choose instead."""


def next_recording(found: NextRecording | None) -> list[str]:
    """The rivals, then the best operating conditions, sensors and whole flights (between all leading sets), with the
    records that each takes; empty where the answer has no rival."""
    if found is None:
        return []
    words = [listed(told(found.known, names)) or "no change" for names in found.rivals]
    lines = [f"to tell {words[0]} from {words[1]}:"]
    for one in found.conditions:
        where = ", ".join(f"{column} {value:.4g}" for column, value in one.values.items())
        unseen = "" if one.known else " (beyond the operating points identified)"
        lines.append(f"{further_records(f'at {where}', one.records, one.odds, one.noncentrality)}{unseen}")
    for one in found.sensors or ():
        where = f"with {one.label}" if one.values else "like these"
        lines.append(further_records(where, one.records, one.odds, one.noncentrality))
    useful = [one for one in found.flights if isfinite(one.records)]
    lines += [f"a whole flight: {suggestion(one)}" for one in useful[:FLIGHTS]]
    if found.flights and not useful:
        lines.append("no whole flight of those tried would tell all of them apart")
    return lines


TOLD = 3
"""Flips told in a sentence, the nearest first; rows have all."""
LARGE = 0.2
"""Share of a reading that is not told any more: of a temperature's or a height's deviation it means nothing."""
MANY = 1e6
"""Odds from which only their order of magnitude is told."""

Words = Callable[[Sequence[str]], Sequence[str]]
"""How the names of an answer are said."""


def flip_cells(flips: Flips | None, words: Words) -> dict[str, Any]:
    """`flips`: one mapping each, the nearest first, with its sentence; `flips_told`: all in one sentence."""
    if flips is None:
        return {"flips": None, "flips_told": None}
    return {
        "flips": [_cells(flip, flips.first, words) for flip in flips.found],
        "flips_told": flips_sentence(flips, words),
    }


def flip_column(flips: Flips | None, words: Words) -> dict[str, Any]:
    """The nearest flips as one column for a table."""
    return {"flips": None if flips is None else [_short(flip) for flip in flips.found[:TOLD]]}


def _cells(flip: Flip, first: Sequence[str], words: Words) -> dict[str, Any]:
    origin = flip.error.origin if flip.error else "openness of the prior"
    return {
        "what": flip.what,
        "kind": flip.kind,
        "size": flip.size,
        "unit": flip.unit,
        "stated": flip.stated,
        "stated_as": origin,
        "times": flip.times,
        "becomes": " & ".join(flip.becomes) or "nothing",
        "words": f"the answer would {_to(flip, first, words)}",
    }


def _short(flip: Flip) -> str:
    size = f"{rounded(flip.size, digits=2)} {flip.unit}"
    return f"{flip.what} {size} ({rounded(flip.times, digits=2)} stated): {' & '.join(flip.becomes) or 'nothing'}"


def _condition(flip: Flip, words: Words) -> str:
    """For instance "T45 read 1.2 K higher (0.14 % of it; 2.3 times its spread between recordings)"."""
    if flip.kind == PRIOR or flip.error is None:
        size = rounded(flip.size, digits=2) if flip.size < MANY else f"10^{log10(flip.size):.0f}"
        return f"that were {size} times as probable before the data"
    error = flip.error
    times = f"{rounded(flip.times, digits=2)} times"
    size = with_unit(abs(flip.size), flip.unit, digits=2)
    if flip.kind == MAP:
        (name,) = words([error.what])
        by = {ACCURACY: "what training leaves open", STATED: "its stated accuracy"}.get(
            error.origin, f"a {error.origin}"
        )
        where = " where this was flown" if error.origin != STATED else ""
        return f"the map of {name} were wrong by {size}{where} ({times} {by})"
    (name,) = words([error.what])
    channel = split_column(error.column)[0] if error.column else name
    of_it = ""
    share = abs(flip.size / error.reading) if error.reading else float("nan")
    if flip.unit != "%" and isfinite(share) and share < LARGE:
        of_it = f"{rounded(100 * share, digits=2)} % of it; "
    way = "higher" if flip.size > 0 else "lower"
    whose = "its" if error.origin == SPREAD else "a"
    what = f"the input {channel}" if flip.kind == INPUT else channel
    return f"{what} read {size} {way} ({of_it}{times} {whose} {error.origin})"


def flips_sentence(flips: Flips, words: Words) -> str:
    """The nearest flips in one sentence, or that there are none."""
    errors = [flip for flip in flips.found if flip.error is not None]
    prior = [flip for flip in flips.found if flip.error is None]
    if errors:
        return f"the answer would {'; or '.join(_to(flip, flips.first, words) for flip in flips.found[:TOLD])}"
    rest = f"; it would {_to(prior[0], flips.first, words)}" if prior else ""
    return (
        f"no single error of a map, a sensor or an input would change the name within {flips.most:g} times what is "
        f"stated of it ({flips.tried} tried){rest}"
    )


def _to(flip: Flip, first: Sequence[str], words: Words) -> str:
    """For instance "hold fan flow capacity as well if T45 read 1.2 K higher"."""
    more, less = [n for n in flip.becomes if n not in first], [n for n in first if n not in flip.becomes]
    if not flip.becomes:
        told = "be no change"
    elif (less and more) or not first:
        told = f"be {listed(list(words(flip.becomes)))}"
    else:
        told = f"hold {listed(list(words(more)))} as well" if more else f"not hold {listed(list(words(less)))}"
    return f"{told} if {_condition(flip, words)}"


def flip_words(story: ExplanationResult) -> Words:
    """How names of explanations, and of parameters that may be wrong beside them, are said."""
    known = story.evidence.engine.parameters
    return lambda names: [known[n].words if n in known else n for n in names]


def explanation_flips(story: ExplanationResult) -> Iterator[str]:
    """What would flip the first name of `explain`; nothing where none is named."""
    if story.flips is not None:
        told = flips_sentence(story.flips, flip_words(story))
        yield f"{told[:1].upper()}{told[1:]}."
