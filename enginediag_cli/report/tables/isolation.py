"""`isolate`: its tables and its words.

One row per window and isolated parameter or instrument, or with --by component one per window.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from enginediag_cli.isolation.prior import SEPARATED
from enginediag_cli.isolation.results import Adequacy
from enginediag_cli.parameters import spelled
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import (
    ambiguity_words,
    change,
    instrument_fault,
    listed,
    named_fault,
    no_verdict,
    not_listed,
    outside_physics,
    parameter_words,
    probability,
    sensor_or_component,
    unexplained,
    wrong_file,
)
from enginediag_cli.report.tables import Columns, Table, object_column
from enginediag_cli.report.tables.answers import (
    FLIPS,
    WORK_SCOPE,
    flip_cells,
    flip_column,
    flips_sentence,
    next_recording,
    work_scope_cells,
    work_scope_sentences,
)
from enginediag_cli.report.tables.detection import INSTRUMENTS, WINDOW
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.fleets.work_scope import WorkScope
    from enginediag_cli.history.engines import FlightAgreement
    from enginediag_cli.isolation.catalogue import NamedIsolation
    from enginediag_cli.isolation.diagnosis import ComponentIsolation, Diagnosis
    from enginediag_cli.isolation.results import AmbiguityGroup, SetIsolation
    from enginediag_cli.isolation.windows import IsolatedWindow
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.residuals.windows import WindowStatistics

FORM_WORDS = {"bias": "a bias", "scale": "a scale error", "drift": "a drift", "soak": "heat soak"}
"""Forms of an instrument's error, by the quantity of the parameter."""
CANNOT_TELL = "cannot tell"
"""The verdict where the leading answer does not stand."""
LEAST_INCLUSION = 0.01
"""Probability below which a component is not listed as one that may have changed."""


class IsolatedPart(NamedTuple):
    """A parameter, or an instrument that is stuck or scatters, with its change."""

    parameter: str
    inclusion: float | None
    change: float
    unit: str
    lower: float | None = None
    upper: float | None = None
    percent: float | None = None


class IsolationRow(NamedTuple):
    """A window and one of the parts that are isolated in it; flips and work_scope: the cells of these columns."""

    isolated_window: IsolatedWindow
    part: IsolatedPart | None = None
    flips: Mapping[str, Any] = {}
    work_scope: Any = None

    @property
    def window(self) -> WindowStatistics:
        return self.isolated_window.verdict.window

    @property
    def diagnosis(self) -> Diagnosis | None:
        return self.isolated_window.diagnosis

    @property
    def result(self) -> SetIsolation | None:
        return self.diagnosis.result if self.diagnosis else None

    @property
    def components(self) -> ComponentIsolation | None:
        return self.isolated_window.components

    @property
    def adequacy(self) -> Adequacy | None:
        answer = self.components if self.isolated_window.to_components else self.diagnosis
        return answer.adequacy if answer else None

    @property
    def verdict(self) -> str:
        """That of the test, or that the answer to what it found does not stand; an instrument that is stuck or
        scatters is a fault whatever the test says of the rest."""
        stands = self.adequacy is None or self.adequacy.is_listed
        return self.isolated_window.verdict.including_instruments if stands else CANNOT_TELL

    @property
    def isolated(self) -> list[str] | None:
        instruments = [fault.name for fault in self.window.instruments]
        return [*self.result.isolated, *instruments] if self.result else instruments or None

    @property
    def probability(self) -> float | None:
        if self.result is None:
            return None
        return self.result.probability * float(np.prod([fault.probability for fault in self.window.instruments]))

    @property
    def note(self) -> str:
        """Why there is no verdict, or what a bad fit did to the answer."""
        known = self.isolated_window.meaning
        if self.components is not None:
            larger = "" if self.components.complete else "larger sets of parameters were not considered"
            return "; ".join(filter(None, [reservation(self.components.adequacy, known), larger]))
        if self.diagnosis is None or self.result is None:
            return self.isolated_window.verdict.reason
        caution = reservation(self.diagnosis.adequacy, known)
        return "; ".join(filter(None, [caution, *_forms(self.result, known), self.result.note]))


row_column: Columns[IsolationRow] = Columns()
class_column: Columns[AmbiguityGroup] = Columns()
named_column: Columns[NamedIsolation] = Columns()
result_column: Columns[SetIsolation] = Columns()
components_column: Columns[ComponentIsolation] = Columns()
part_column: Columns[Any] = Columns()


def _figure(get: Callable[[Adequacy], float]) -> Callable[[IsolationRow], float | None]:
    """A figure of how well an answer fits; None where nothing is left to test it by."""

    def figure(row: IsolationRow) -> float | None:
        value = get(row.adequacy or Adequacy())
        return value if isfinite(value) else None

    return figure


def format_sets(sets: Sequence[Any]) -> list[str]:
    """Sets of parameters with their probabilities, as cells have them: "hpc.efficiency & T3.bias (0.02)"."""
    return [f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in sets]


_TESTED = (
    row_column(
        "verdict", "text", "healthy, fault, no verdict, or cannot tell where the leading answer is not reliable"
    ),
    row_column(
        "p_value",
        "number?",
        "probability of such a statistic where nothing changed",
        lambda row: row.isolated_window.verdict.test.p_value if row.isolated_window.verdict.test else None,
    ),
    row_column("fit_before", "number?", "reduced χ² without any answer", _figure(lambda a: a.fit_before)),
    row_column("fit", "number?", "reduced χ² with the answer", _figure(lambda a: a.fit)),
    row_column(
        "explained", "number?", "share of the excess χ² that the answer takes away", _figure(lambda a: a.explained)
    ),
    row_column(
        "unlisted",
        "number?",
        "probability that it is something that is not among the suspects",
        lambda row: row.adequacy.unlisted if row.adequacy else None,
    ),
    *row_column.part(lambda row: row.window, (INSTRUMENTS,)),
)
_CLASS = (
    class_column("class", "number?", "probability that one of `members` is it", lambda c: c.probability),
    class_column(
        "members",
        "texts?",
        "answers that the data do not separate",
        lambda c: [" & ".join((*c.shared, *member)) for member in c.members],
    ),
    class_column(
        "would_tell", "texts?", "sensors that would separate the members", lambda c: list(c.separating_sensors)
    ),
)
_NOTE = row_column("note", "text", "why there is no verdict, or what a bad fit did to the answer")
_BESIDE = (
    object_column(FLIPS[0], lambda row: row.flips["flips"], "--flips, or json"),
    object_column(FLIPS[1], lambda row: row.flips["flips_told"], "json"),
    object_column(WORK_SCOPE, lambda row: row.work_scope, "--work-scope, or json"),
)

ISOLATE: Table[IsolationRow] = Table(
    "isolate",
    1,
    "one row per window and isolated parameter, a single one where none is isolated",
    (
        *row_column.part(lambda row: row.window, WINDOW),
        *_TESTED,
        row_column("isolated", "texts?", "the set of parameters that changed, with the instruments that are wrong"),
        row_column(
            "probability",
            "number?",
            "probability that these changed and nothing else that matters; with those of all others and `unlisted`, 1",
        ),
        *row_column.part(lambda row: row.result and row.result.ambiguity, _CLASS),
        *row_column.part(
            lambda row: row.part,
            (
                part_column("parameter", "text?", "the parameter that this row is about"),
                part_column("inclusion", "number?", "probability that this parameter changed, in any set"),
                part_column("change", "number?", "its change from nominal", unit="of the parameter"),
                part_column(
                    "lower", "number?", "lower end of the change's interval (--confidence)", unit="of the parameter"
                ),
                part_column(
                    "upper", "number?", "upper end of the change's interval (--confidence)", unit="of the parameter"
                ),
                part_column("unit", "text?", "unit of the change; 1 is a share of nominal"),
                part_column("percent", "number?", "the change in per cent of nominal", unit="%"),
            ),
        ),
        *row_column.part(
            lambda row: row.result,
            (
                result_column(
                    "rivals",
                    "texts?",
                    "other sets that cannot be excluded, with their probabilities",
                    lambda result: format_sets(result.alternatives),
                ),
                result_column(
                    "rivals_left_out", "integer?", "alternatives that are not listed", lambda r: r.alternatives_omitted
                ),
            ),
        ),
        _NOTE,
        *row_column.part(
            lambda row: row.diagnosis and row.diagnosis.catalogue,
            (
                named_column(
                    "named",
                    "texts?",
                    "faults of the catalogue that it is",
                    lambda named: list(named.faults) or (["unlisted"] if named.free else []),
                    only_with="--catalogue",
                ),
                named_column(
                    "named_probability",
                    "number?",
                    "probability of exactly these faults",
                    lambda named: named.probability,
                    only_with="--catalogue",
                ),
                named_column(
                    "severity",
                    "texts?",
                    "size of each named fault with its interval, 1 as the catalogue has it",
                    lambda named: [f"{s.value:.3g} ({s.lower:.3g} to {s.upper:.3g})" for s in named.severities],
                    only_with="--catalogue",
                ),
                named_column(
                    "named_rivals",
                    "texts?",
                    "other faults that cannot be excluded",
                    lambda named: format_sets(named.alternatives),
                    only_with="--catalogue",
                ),
            ),
        ),
        row_column(
            "advice",
            "texts",
            "what to record next, in sentences",
            lambda row: next_recording(row.isolated_window.advice) if row.diagnosis else [],
            only_with="--advise",
        ),
        *_BESIDE,
    ),
    (
        "flight",
        "engine",
        "verdict",
        "parameter",
        "change",
        "lower",
        "upper",
        "unit",
        "probability",
        "start_s",
        "fit",
        "note",
        "rivals",
    ),
)
CATALOGUE = ("named", "named_probability", "severity", "named_rivals")
"""Columns that are there with --catalogue."""

COMPONENTS: Table[IsolationRow] = Table(
    "isolate/components",
    1,
    "isolate --by component: one row per window",
    (
        *row_column.part(lambda row: row.window, WINDOW),
        *_TESTED,
        *row_column.part(
            lambda row: row.components,
            (
                components_column("components", "texts?", "the components that changed", lambda c: list(c.components)),
                components_column("probability", "number?", "probability of exactly these"),
            ),
        ),
        *row_column.part(lambda row: row.components and row.components.ambiguity, _CLASS),
        *row_column.part(
            lambda row: row.components,
            (
                components_column(
                    "inclusion",
                    "texts?",
                    "each component with the probability that it changed, likeliest first",
                    lambda c: [
                        f"{name} ({chance:.2g})"
                        for name, chance in sorted(c.inclusion.items(), key=lambda item: -item[1])
                        if chance >= LEAST_INCLUSION
                    ],
                ),
                components_column(
                    "rivals",
                    "texts?",
                    "other sets of components, with their probabilities",
                    lambda c: format_sets(c.alternatives),
                ),
            ),
        ),
        _NOTE,
        *_BESIDE,
    ),
    ("flight", "engine", "verdict", "components", "probability", "start_s", "fit", "rivals", "note"),
)


def isolated_rows(
    found: IsolatedWindow,
    catalogue: bool = False,
    *,
    advice: bool = False,
    scope: WorkScope | None = None,
    forms: Mapping[str, str] | None = None,
) -> Iterator[dict[str, Any]]:
    """Rows of one window, by parameter or by component as it was isolated.

    forms: how `flips` and `work_scope` are written, "" not at all, "cell" as text, "nested" in full.
    """
    forms = forms or {}
    flips = forms.get("flips")
    cells = (
        (flip_cells if flips == "nested" else flip_column)(found.sensitivity, name_formatter(found)) if flips else {}
    )
    restored, asked = work_scope_cells(scope, forms.get("work_scope", ""))
    optional = [*cells, *asked]
    if found.to_components:
        yield COMPONENTS.row(IsolationRow(found, None, cells, restored), optional)
        return
    optional += [*(CATALOGUE if catalogue else ()), *(["advice"] if advice and found.diagnosis is not None else [])]
    parts: list[IsolatedPart | None] = [*_parts(found)]
    for part in parts or [None]:
        yield ISOLATE.row(IsolationRow(found, part, cells, restored), optional)


def _parts(found: IsolatedWindow) -> Iterator[IsolatedPart]:
    """Parameters that are isolated in a window, then its instruments that are stuck or scatter."""
    if found.diagnosis is not None:
        inclusion = found.diagnosis.result.inclusion
        for s in found.diagnosis.result.sizes:
            unit = found.meaning[s.parameter].unit
            yield IsolatedPart(s.parameter, inclusion.get(s.parameter), s.change, unit, s.lower, s.upper, s.percent)
    for fault in found.instruments:
        yield IsolatedPart(fault.name, fault.probability, fault.size, split_column(fault.column)[1] or "1")


def reservation(adequacy: Adequacy, known: Mapping[str, Parameter]) -> str:
    """Why the answer does not stand; empty where it does."""

    if adequacy.is_listed:
        return ""
    if adequacy.disagreement is not None and adequacy.disagreement.is_likely_wrong:
        return wrong_file(adequacy.disagreement)
    if adequacy.impossible_change is not None:
        name, change = adequacy.impossible_change
        return outside_physics(known[name], change, adequacy.unlisted)
    return not_listed(adequacy.fit, adequacy.unlisted)


def name_formatter(found: IsolatedWindow) -> Callable[[Sequence[str]], list[str]]:
    """How the names of an answer are said: of parameters, else of components."""

    def words(names: Sequence[str]) -> list[str]:
        return [parameter_words(found.meaning, [n])[0] if n in found.meaning else spelled(n) for n in names]

    return words


def report_pooled(messages: Messages, found: IsolatedWindow, agreement: Mapping[str, FlightAgreement]) -> None:
    """Which flights of an engine were judged as one, and whether they agree."""
    engine = found.verdict.window.engine
    pooled = agreement.get(engine)
    if pooled is None:
        return
    name = f"engine {engine}: " if engine else ""
    offsets = "" if pooled.learnt or pooled.flights == 1 else "; instruments' offsets per flight as identified"
    messages.note(
        f"{name}{pooled.flights} of {pooled.of} flights judged as one ({found.verdict.window.flight}){offsets}",
        engine=engine,
    )
    if not pooled.agree:
        messages.warning(
            f"{name}these flights differ from each other by {pooled.ratio:.2g} times what they should: something "
            "changed among them; run trend, or pool fewer flights",
            engine=engine,
        )


def report_isolation(messages: Messages, found: IsolatedWindow, scope: WorkScope | None = None) -> None:
    """The answer for one window in words."""

    of = window_fields(found.verdict)
    report_instruments(messages, found.verdict)
    if found.components is not None:
        messages.note(f"{window_words(found.verdict)}: {component_sentence(found.components, found.meaning)}", **of)
    elif not found.to_components:
        report_diagnosis(messages, found.verdict, found.diagnosis, found.meaning, next_recording(found.advice))
    if found.sensitivity is not None and found.named:
        messages.note(f"{window_words(found.verdict)}: {flips_sentence(found.sensitivity, name_formatter(found))}")
    for sentence in work_scope_sentences(scope) if scope is not None else ():
        messages.note(f"{window_words(found.verdict)}: {sentence}")


def report_instruments(messages: Messages, verdict: Verdict) -> None:
    """Instruments of a window that are stuck or scatter, in words."""
    for fault in verdict.window.instruments:
        messages.note(f"{window_words(verdict)}: {instrument_fault(fault)}", **window_fields(verdict))


def _forms(result: SetIsolation, known: Mapping[str, Parameter]) -> list[str]:
    """Of which instruments these records do not separate the forms of the error, and which are possible."""

    found = []
    for name, shares in result.forms.items():
        if shares[name] < SEPARATED:
            likely = sorted(shares, key=lambda form: -shares[form])
            forms = [FORM_WORDS[known[form].quantity] for form in likely if shares[form] > 1 - SEPARATED]
            found.append(f"{known[name].part}: {listed(forms, 'or')}, these records do not separate them")
    return found


def window_words(verdict: Verdict) -> str:
    """Which window it is: its flight and engine, or else file and lines."""
    window = verdict.window
    names = (window.flight and f"flight {window.flight}", window.engine and f"engine {window.engine}")
    return " ".join(filter(None, names)) or f"{window.source}:{window.first_line}-{window.last_line}"


def window_fields(verdict: Verdict) -> dict[str, Any]:
    """Which window it is, for a log."""
    window = verdict.window
    return {
        "file": window.source,
        "flight": window.flight,
        "engine": window.engine,
        "lines": [window.first_line, window.last_line],
    }


def report_diagnosis(
    messages: Messages,
    verdict: Verdict,
    diagnosis: Diagnosis | None,
    known: Mapping[str, Parameter],
    advice: Sequence[str] = (),
) -> None:
    """The answer for one window in words."""

    here, of = window_words(verdict), window_fields(verdict)
    if diagnosis is None:
        messages.note(no_verdict(verdict.reason, where=here), **of)
        return
    result = diagnosis.result
    changes = [
        change(known[size.parameter], size.change, size.reach, chance=result.inclusion.get(size.parameter))
        for size in result.sizes
    ]
    alone = f": probability {probability(result.probability)}" if result.inclusion else ""
    caution = reservation(diagnosis.adequacy, known)
    if caution:
        messages.note(f"{here}: {caution}", **of)
    if verdict.window.is_doubtful:  # what would explain a right file says nothing of this one
        return
    leading = "" if diagnosis.adequacy.is_listed else "leading, but not to be relied on: "
    left = unexplained(diagnosis.adequacy.fit_before, diagnosis.adequacy.fit, diagnosis.adequacy.explained)
    nothing = "no further change that matters" if verdict.window.instruments else "no change that matters"
    what = "; ".join([*changes, "nothing else that matters"] if changes and alone else changes) or nothing
    messages.note(f"{here}: {leading}{what}{alone}{left and f'; {left}'}", **of)
    for sentence in _forms(result, known):
        messages.note(f"{here}: {sentence}", **of)
    if result.ambiguity is not None:
        messages.note(f"{here}: {ambiguity_words(result.ambiguity, lambda names: parameter_words(known, names))}", **of)
    if diagnosis.nonlinear:
        messages.note(f"{here}: a large change, judged with the full model", **of)
    if diagnosis.sensor_ambiguity is not None and result.ambiguity is None:  # else it is told among the members
        r = diagnosis.sensor_ambiguity
        sensors, components, shared = (parameter_words(known, each) for each in (r.sensors, r.components, r.shared))
        rivalry = sensor_or_component(sensors, components, r.p_sensors, r.p_components, shared)
        messages.note(f"{here}: {rivalry}", **of)
    if result.alternatives:
        rivals = [" & ".join(r.parameters) or "no change" for r in result.alternatives[:3]]
        more = len(result.alternatives) - len(rivals) + result.alternatives_omitted
        behind = f" and {more} more" if more else ""
        share = f" (with the answer, {100 * result.coverage:.3g} % in all)" if result.inclusion else ""
        messages.note(f"{here}: not excluded either: {'; '.join(rivals)}{behind}{share}", **of)
    if diagnosis.catalogue is not None:
        messages.note(f"{here}: {_named_sentence(diagnosis.catalogue, known)}", **of)
    for sentence in advice:
        messages.note(f"{here}: {sentence}", **of)


def _named_sentence(named: NamedIsolation, known: Mapping[str, Parameter]) -> str:
    """The named answer and its leading alternative."""

    if named.faults:
        sentence = named_fault([(s.fault, s.value, s.upper - s.value) for s in named.severities], named.probability)
    elif named.free:
        sentence = f"none of the catalogue's faults (probability {probability(named.unlisted)})"
    else:
        sentence = f"no fault of the catalogue (probability {probability(named.probability)})"
    if named.alternatives:
        rival = named.alternatives[0]
        name = listed([known[n].words if n in known else spelled(n) for n in rival.parameters]) or "no fault"
        sentence += f"; next: {name} ({probability(rival.probability)})"
    return sentence


def component_sentence(found: ComponentIsolation, known: Mapping[str, Parameter]) -> str:
    """The answer for one window in words."""

    def words(components: tuple[str, ...]) -> str:
        return listed([spelled(c) for c in components]) or "no component"

    sentence = f"{words(found.components)} changed (probability {probability(found.probability)})"
    if found.possible:
        besides = [f"{spelled(c)} ({probability(found.inclusion[c])})" for c in found.possible]
        sentence = f"{words(found.components)} changed (probability {probability(found.p_all)})"
        sentence += f", perhaps {listed(besides)} as well; exactly this: probability {probability(found.probability)}"
    if found.alternatives:
        sentence += (
            f"; next: {words(found.alternatives[0].parameters)} ({probability(found.alternatives[0].probability)})"
        )
    if found.ambiguity is not None:
        sentence += f"; {ambiguity_words(found.ambiguity, lambda names: [spelled(c) for c in names])}"
    left = unexplained(found.adequacy.fit_before, found.adequacy.fit, found.adequacy.explained)
    sentence += left and f"; {left}"
    caution = reservation(found.adequacy, known)
    leading = "" if found.adequacy.is_listed else "leading, but not to be relied on: "
    return f"{caution}; {leading}{sentence}" if caution else sentence
