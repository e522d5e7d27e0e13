"""The answer of `isolate`: one row per window and isolated parameter, and the same in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.isolation.adequacy import Adequacy
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.outputs.isolate import ISOLATE

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.isolation.classes import Class
    from enginediag_cli.isolation.diagnosis import Diagnosis
    from enginediag_cli.isolation.named_faults import NamedIsolation
    from enginediag_cli.isolation.of_windows import IsolatedWindow
    from enginediag_cli.isolation.result import IsolationResult
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.work_scope.scope import WorkScope


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
    from enginediag_cli.presentation.sentences import not_listed, outside_physics, wrong_file

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
    from enginediag_cli.presentation.sentences import instrument_fault
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
    from enginediag_cli.presentation.component_rows import component_row
    from enginediag_cli.presentation.next_recording import next_recording

    if found.by_component:
        yield component_row(found.verdict, found.components, found.known)
        return
    told = next_recording(found.advice) if advice and found.diagnosis is not None else None
    yield from isolation_rows(found.verdict, found.diagnosis, found.known, catalogue, told)


def beside_cells(found: IsolatedWindow, scope: WorkScope | None, forms: Mapping[str, str]) -> dict[str, Any]:
    """What would flip the answer and what restoring brings; forms: how each is written, "" not at all, "cell" as text,
    "nested" in full."""
    from enginediag_cli.presentation.flip_rows import flip_cells, flip_column
    from enginediag_cli.presentation.work_scope_rows import work_scope_cell, work_scope_sentences

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
    from enginediag_cli.presentation.names import spelled
    from enginediag_cli.presentation.names import told as in_words

    def words(names: Sequence[str]) -> list[str]:
        return [in_words(found.known, [n])[0] if n in found.known else spelled(n) for n in names]

    return words


def tell_isolated(messages: Messages, found: IsolatedWindow, scope: WorkScope | None = None) -> None:
    """The answer for one window in words."""
    from enginediag_cli.presentation.component_rows import component_sentence
    from enginediag_cli.presentation.flip_rows import flips_sentence
    from enginediag_cli.presentation.next_recording import next_recording
    from enginediag_cli.presentation.work_scope_rows import work_scope_sentences

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
    from enginediag_cli.presentation.sentences import instrument_fault

    for fault in verdict.window.instruments:
        messages.note(f"{where(verdict)}: {instrument_fault(fault)}", **about(verdict))


def _forms(result: IsolationResult, known: Mapping[str, Parameter]) -> list[str]:
    """Of which instruments these records do not separate the forms of the error, and which are possible."""
    from enginediag_cli.isolation.prior import SEPARATED
    from enginediag_cli.presentation.names import listed

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
    from enginediag_cli.presentation.names import told as in_words
    from enginediag_cli.presentation.numbers import probability
    from enginediag_cli.presentation.sentences import change, no_verdict, one_of, sensor_or_component, unexplained

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
    from enginediag_cli.presentation.names import listed, spelled
    from enginediag_cli.presentation.numbers import probability
    from enginediag_cli.presentation.sentences import named_fault

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
