"""What restoring modules would bring, and what maintenance did bring: as cells and in words.

Rows and sentences of `trend` about what restoring would bring and what maintenance did bring.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.detection.series import Series
from enginediag_cli.fleets.maintenance import Maintenance
from enginediag_cli.fleets.work_scope import POWER, Gain, Quantity, Reference, Scoping, WorkScope
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.parameters import Parameter
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import change, count, listed, probability, spelled, with_unit
from enginediag_cli.units import split_column

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


def reference_cells(reference: Reference | None) -> dict[str, Any]:
    """Where a gain is told."""
    if reference is None:
        return {"reference": None, "inputs": None, "held": None, "temperature": None, "fuel": None}
    return {
        "reference": reference.words,
        "inputs": dict(reference.inputs),
        "held": reference.held,
        "temperature": reference.temperature,
        "fuel": reference.fuel,
    }


def _gain_cells(gain: Gain, reference: Reference) -> dict[str, Any]:
    return {"module": gain.module, "parameters": list(gain.names), **gain_cells(gain, reference)}


def gain_cells(gain: Gain, reference: Reference) -> dict[str, Any]:
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
        yield f"what restoring would bring cannot be told: {scope.reason}"
    for gain in scope.gains:
        if scope.reference is not None:
            yield _restoring(gain, scope.reference)


def _restoring(gain: Gain, reference: Reference) -> str:
    module = spelled(gain.module)
    if gain.temperature.value < 0 and gain.fuel.value < 0:
        return f"the {module} has become better, which {_told(_reversed(gain), reference, past=True)}"
    return f"restoring the {module} would {_told(gain, reference)}"


def _reversed(gain: Gain) -> Gain:
    t, f = (Quantity(-q.value, q.deviation, -q.share, q.share_deviation) for q in (gain.temperature, gain.fuel))
    return Gain(gain.module, gain.names, t, f)


def gain_words(gain: Gain, reference: Reference) -> str:
    """What maintenance did: "lowered T45 by 6.1 K ± 0.6 K and lowered fuel flow by 0.40 % ± 0.04 % at equal thrust
    (design point)"."""
    return _told(gain, reference, past=True)


def _told(gain: Gain, reference: Reference, past: bool = False) -> str:
    quantity, unit = split_column(reference.temperature)
    name = quantity if reference.recorded else f"{quantity} (of the model)"
    held = "power" if reference.held == POWER else "thrust"
    first = _moved(name, gain.temperature, unit, past)
    share = Quantity(PERCENT * gain.fuel.share, PERCENT * gain.fuel.share_deviation, 0.0, 0.0)
    return f"{first} and {_moved('fuel flow', share, '%', past)} at equal {held} ({reference.words})"


def _moved(name: str, gain: Quantity, unit: str, past: bool) -> str:
    verb = ("lowered", "raised") if past else ("lower", "raise")
    half = NORMAL_95 * gain.deviation
    return f"{verb[gain.value < 0]} {name} by {with_unit(abs(gain.value), unit, half)}"


def maintenance_sentence(found: Maintenance, known: Mapping[str, Parameter], reference: Reference | None) -> str:
    """What maintenance did bring, and of what it is told."""
    sides = f"{count(found.before, 'flight')} before against {found.after} after"
    if not found.names:
        return f"nothing changed with it for certain ({sides}; probability {probability(found.probability)})"
    parts = [
        change(known[n], d, NORMAL_95 * s) for n, d, s in zip(found.names, found.change, found.deviation, strict=True)
    ]
    what = f"{listed(parts)} (probability {probability(found.probability)}; {sides})"
    if found.gain is None or reference is None:
        return f"{what}; what that brought cannot be told: {found.reason}"
    return f"it {_told(found.gain, reference, past=True)}: {what}"


def maintenance_cell(found: Maintenance, reference: Reference | None) -> dict[str, Any]:
    """What maintenance did bring, as a mapping; positive gains are falls."""
    gain = {} if found.gain is None or reference is None else gain_cells(found.gain, reference)
    return {
        **reference_cells(reference),
        "flights_before": found.before,
        "flights_after": found.after,
        "changed": list(found.names),
        "probability": found.probability,
        "change": list(found.change),
        "deviation": list(found.deviation),
        **gain,
        "reason": found.reason,
    }


MAINTENANCE = "maintenance"
"""`kind` of the rows of what maintenance did bring."""


def tell_scope(messages: Messages, engine: str, scope: WorkScope | None) -> None:
    """What restoring the components of the events would bring, in words."""
    name = f"engine {engine}: " if engine else ""
    for sentence in work_scope_sentences(scope) if scope is not None else ():
        messages.note(f"{name}{sentence}")


def with_scope(rows: Iterable[Mapping[str, Any]], scope: WorkScope | None, form: str) -> Iterator[dict[str, Any]]:
    """Rows with what restoring would bring; form: "" without, "cell" as text, "nested" in full."""
    told = work_scope_cell(scope) if form == "nested" else None if scope is None else list(work_scope_sentences(scope))
    for row in rows:
        yield {**row, "work_scope": told} if form else {**row}


def tell_maintenance(messages: Messages, engine: str, found: Maintenance, series: Series, scoping: Scoping) -> None:
    """What maintenance did bring, in words."""
    name = f"engine {engine}: " if engine else ""
    label = series.stretches[engine][found.flight - 1].window.flight or str(found.flight)
    told = maintenance_sentence(found, series.known, scoping.reference({}))
    messages.note(f"{name}maintenance before flight {label}: {told}")


def maintenance_row(
    engine: str, found: Maintenance, series: Series, scoping: Scoping, form: str, others: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """One row with the columns of the `others`, as far as they apply; form: as of `with_scope`."""
    window = series.stretches[engine][found.flight - 1].window
    reference = scoping.reference({})
    told = maintenance_sentence(found, series.known, reference)
    described = [series.known[n].component for n in found.names]
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
