"""The acceptance report of a recording: as rows, one for each thing that is known of it, and as a page of lines.

What `check` shows of an engine file: its design table, and a heating value that does not fit the fuel, as rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.overview import design_table, heating_value_doubts
from enginediag_cli.report.outputs.files import CHECK
from enginediag_cli.report.sentences import count, rounded, with_unit
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.intake.accepted import Accepted
    from enginediag_cli.intake.wanted import Wanted
    from enginediag_cli.recordings.acceptance import Stretches


NOTE, WARNING, PROBLEM = "note", "warning", "problem"
"""What is so; what the user should look at; what keeps the recording from being judged."""

ACCEPTANCE_COLUMNS = CHECK.names
ACCEPTANCE_SUMMARY = ("file", "level", "line", "problem", "found", "hint")


@dataclass(frozen=True)
class Remark:
    """One thing that is known of a recording. about: sensors, inputs, units, frozen, time, repeated, switch, read,
    masked, gate, envelope; name: the column that it concerns; count: records, readings or columns."""

    level: str
    about: str
    text: str
    hint: str = ""
    name: str = ""
    lines: tuple[int, int] | None = None
    count: int | None = None

    @property
    def told(self) -> str:
        """In words, with how to mend it."""
        return self.text + (f" ({self.hint})" if self.hint else "")

    @property
    def line(self) -> str:
        """As a line of the page."""
        return ("warning: " if self.level == WARNING else "") + self.told


def headline(report: Accepted) -> str:
    """What a file holds, in one line."""
    place = report.file if report.file != "-" else "<stdin>"
    place += f", engine {report.engine}" if report.engine else ""
    return f"{place}: {'ok' if report.usable else 'not fit to be judged'}, {_found(report)}"


def acceptance_rows(report: Accepted) -> Iterator[dict[str, Any]]:
    """A row for the file, then one for each remark; `ok` is false where the remark keeps it from being judged."""
    file = report.file if report.file != "-" else "<stdin>"
    start = {"file": file, "engine": report.engine or None}
    yield {
        **start,
        "ok": report.usable,
        "level": NOTE if report.usable else PROBLEM,
        "about": "recording",
        "count": report.acceptance.records,
        "found": _found(report),
    }
    for remark in remarks(report):
        lines = remark.lines or (None, None)
        yield {
            **start,
            "ok": remark.level != PROBLEM,
            "level": remark.level,
            "about": remark.about,
            "line": lines[0],
            "last_line": lines[1],
            "name": remark.name or None,
            "count": remark.count,
            "found" if remark.level == NOTE else "problem": remark.text,
            "hint": remark.hint or None,
        }


def _found(report: Accepted) -> str:
    acceptance = report.acceptance
    numbers = acceptance.numeric + int(acceptance.timed)
    found = f"{count(acceptance.records, 'record')}, {count(numbers, 'column')} of numbers"
    return found + (f", {report.text} of text" if report.text else "")


def remarks(report: Accepted) -> Iterator[Remark]:
    """All that is known of a recording, in the order in which it would be mended."""
    yield from _columns(report)
    yield from _units(report)
    yield from _records(report)
    yield from _masks(report)
    yield from _coverage(report)


def _columns(report: Accepted) -> Iterator[Remark]:
    acceptance, wanted = report.acceptance, report.wanted
    if report.goes_on:
        what = f"the first {acceptance.records:,} records were looked over; the file goes on"
        yield Remark(NOTE, "recording", what, count=acceptance.records)
    if not acceptance.records:
        yield Remark(PROBLEM, "recording", "there is no record", count=0)
    if not acceptance.numeric:
        hint = "are the decimal mark, the delimiter and the units in the header as they should be?"
        yield Remark(PROBLEM, "recording", "no column of numbers", hint, count=0)
    if wanted is None:
        return
    yield from _sensors(report, wanted)
    for absent in acceptance.absent:
        near = f"did you mean {absent.near!r}?" if absent.near else ""
        if absent.column in wanted.inputs:
            what = f"no column {absent.column}, which {wanted.engine} needs"
            yield Remark(PROBLEM, "inputs", what, near, absent.column)
        elif absent.column in wanted.optional:
            yield Remark(WARNING, "inputs", f"no column {absent.column}: taken as not recorded", near, absent.column)
    for column in acceptance.empty if acceptance.records else ():
        needed = column in wanted.inputs
        level, about = (PROBLEM if needed else WARNING), ("inputs" if column in wanted.given else "sensors")
        yield Remark(level, about, f"{column} has no reading", name=column, count=0)


def _sensors(report: Accepted, wanted: Wanted) -> Iterator[Remark]:
    """How many there are, and which are not."""
    from enginediag_cli.detection.verdict import LEAST_SENSORS

    acceptance = report.acceptance
    there = [c for c in wanted.sensors if c in acceptance.found]
    some = f"sensors: {len(there)} of {len(wanted.sensors)}"
    if there:
        yield Remark(NOTE, "sensors", f"{some}: {', '.join(there)}", count=len(there))
    else:
        yield Remark(PROBLEM, "sensors", f"none of the sensors {', '.join(wanted.sensors)}", count=0)
    for absent in acceptance.absent:
        if absent.column in wanted.sensors and (there or absent.near):
            near = f"did you mean {absent.near!r}?" if absent.near else ""
            what = f"no column {absent.column}: judged without, and its errors are no suspects"
            yield Remark(WARNING, "sensors", what, near, absent.column)
    if there and report.sensorless and acceptance.records:
        yield Remark(PROBLEM, "sensors", "no sensor has a reading", count=0)
    elif there and acceptance.records and len(set(there) - set(acceptance.empty)) < LEAST_SENSORS:
        yield Remark(WARNING, "sensors", f"too few sensors for a verdict: {LEAST_SENSORS} are the least")


def _units(report: Accepted) -> Iterator[Remark]:
    for doubt in report.units:
        usual = f"{rounded(doubt.low)} to {rounded(doubt.high)}"
        told = f"{doubt.column}: the median is {rounded(doubt.median)}, and {usual} is what can be"
        yield _unit_remark(doubt.column, told, doubt.plausible)
    for one in report.wrong:
        name = one.trial.mistake.column if one.trial is not None else ""
        since = f"{one.stretch}: " if one.stretch else ""
        yield Remark(PROBLEM, "units", f"{since}{one.what}", one.hint, name, one.lines if one.stretch else None)


def _unit_remark(column: str, told: str, plausible: Sequence[str]) -> Remark:
    if not plausible:
        return Remark(WARNING, "units", told, "no unit makes that right", column)
    units = " or ".join(plausible[:3])
    hint = f"is it in {units}? Let the column's name say so, and a recorder convert it"
    return Remark(PROBLEM, "units", told, hint, column)


def _records(report: Accepted) -> Iterator[Remark]:
    acceptance, timing = report.acceptance, report.acceptance.timing
    for stretch in acceptance.frozen:
        n = int(stretch.amount)
        told = f"lines {stretch.first_line} to {stretch.last_line}: {count(n, 'record')} in which nothing moves"
        lines = (stretch.first_line, stretch.last_line)
        yield Remark(WARNING, "frozen", told, "the recorder stood still; they are not judged", lines=lines, count=n)
    if timing.missing:
        yield Remark(WARNING, "time", f"{count(timing.missing, 'record')} without a time", count=timing.missing)
    yield from _steps("gap", timing.gaps, timing.gap_count, timing.step_s)
    yield from _steps("back", timing.backward, timing.backward_count, timing.step_s)
    if timing.repeated:
        told = f"{count(timing.repeated, 'record')} that repeat an earlier one to the last digit"
        yield Remark(WARNING, "repeated", told, "they are used once", count=timing.repeated)
    for fault in acceptance.switches:
        shown = ", ".join(f"{v!r} in line {k}" for v, k in zip(fault.values, fault.lines, strict=True))
        told = (
            f"{fault.column} is a switch, 0 or 1, and holds something else in {count(fault.count, 'record')}: {shown}"
        )
        lines = (fault.lines[0], fault.lines[-1])
        yield Remark(WARNING, "switch", told, "those records are not computed", fault.column, lines, fault.count)


def _steps(kind: str, stretches: Stretches, number: int, usual: float) -> Iterator[Remark]:
    for stretch in stretches:
        place = f"lines {stretch.first_line} to {stretch.last_line}"
        by = f"{rounded(stretch.amount)} s"
        told = (
            f"a gap of {by}, where the usual step is {rounded(usual)} s" if kind == "gap" else f"time goes back by {by}"
        )
        yield Remark(WARNING, "time", f"{place}: {told}", lines=(stretch.first_line, stretch.last_line))
    if number > len(stretches):
        more = f"{number - len(stretches)} more {'gaps' if kind == 'gap' else 'steps back'} in time"
        yield Remark(WARNING, "time", more, count=number)


def _masks(report: Accepted) -> Iterator[Remark]:
    left = report.left
    for line in left.reading.report_lines():
        yield Remark(NOTE, "read", line)
    for column, reasons in left.columns.items():
        lost, why = sum(reasons.values()), ", ".join(f"{reason} {n}" for reason, n in reasons.items())
        told = f"{column}: {lost} of {left.readings[column]} readings masked ({why})"
        yield Remark(NOTE, "masked", told, name=column, count=lost)
    if report.refused:
        yield Remark(PROBLEM, "gate", report.refused, count=0)
    elif left.gate is not None:
        why = ", ".join(f"{reason} {n}" for reason, n in left.gate.reasons.items() if n)
        told = f"kept {left.gate.kept} of {left.gate.total} {left.gate.unit}" + (f" (left out: {why})" if why else "")
        yield Remark(NOTE, "gate", told, count=left.gate.kept)


def _coverage(report: Accepted) -> Iterator[Remark]:
    coverage = report.coverage
    if coverage is None or report.refused:
        return
    if coverage.records and not coverage.complete:
        yield Remark(PROBLEM, "records", "no record has all inputs and a reading", count=0)
    if not coverage.complete:
        return
    lost = coverage.records - coverage.complete - (0 if report.left.gate else report.left.frozen)
    if lost > 0:
        yield Remark(WARNING, "records", f"{count(lost, 'record')} without an input or any reading", count=lost)
    share = 100.0 * coverage.inside / coverage.complete
    told = f"inside the operating points identified: {coverage.inside} of {coverage.complete} records ({share:.3g} %)"
    if coverage.known:
        yield Remark(NOTE if coverage.inside else PROBLEM, "envelope", told, count=coverage.inside)
    for b in coverage.beyond:
        side = "above" if b.farthest > b.limit else "below"
        what = f"{b.column} {side} {rounded(b.limit)} (as far as {rounded(b.farthest)}), from line {b.line} on"
        n = count(b.records, "record")
        yield Remark(
            WARNING, "envelope", f"{n} outside: {what}", name=b.column, lines=(b.line, b.line), count=b.records
        )
    if coverage.combination:
        n = count(coverage.combination, "record")
        told = f"{n} outside: no input beyond its range, but in a combination that was not seen"
        yield Remark(WARNING, "envelope", told, count=coverage.combination)


SHOWN = {"N": (1e-3, "kN"), "W": (1e-3, "kW"), "Pa": (1e-3, "kPa")}
"""SI units that are large for an engine, with the factor and the unit that engineers read."""
PER_KWH = 3.6e6
"""J in a kilowatt hour."""
SFC = 1e6
"""mg per kg: specific fuel consumption in mg/(N s), which is g/(kN s)."""


def overview_rows(engine: Engine) -> Iterator[dict[str, Any]]:
    """One row per operating point of the design table, and one per heating value that does not fit."""
    table = design_table(engine)
    for point, values, reason in zip(table.points, table.values, table.reasons, strict=True):
        known = dict(zip(table.columns, values.tolist(), strict=True))
        shown = [_shown(c, v) for c, v in known.items() if np.isfinite(v)]
        if "Fn_N" not in known and known.get("power_W", 0.0) > 0.0 and "Wf_kg_s" in known:
            shown.insert(2, f"SFC {with_unit(known['Wf_kg_s'] / known['power_W'] * PER_KWH, 'kg/(kW h)')}")
        found = ", ".join(shown) if not reason else f"no operating point: {reason}"
        yield {"level": "note", "about": "design", "name": point, "found": found}
    for doubt in heating_value_doubts(engine):
        hint = f"the lower one is meant: {doubt.lower:.3g} J/kg, or another fuel_hydrogen_carbon_ratio"
        yield {
            "level": "warning",
            "about": "fuel",
            "name": f"{doubt.burner}.lower_heating_value_J_kg",
            "problem": str(doubt),
            "hint": hint,
        }


def _shown(column: str, value: float) -> str:
    if column == "SFC_kg_Ns":
        return f"SFC {with_unit(value * SFC, 'mg/(N s)')}"
    quantity, unit = split_column(column)
    factor, words = SHOWN.get(unit, (1.0, unit.replace("_", "/")))
    return f"{quantity} {with_unit(value * factor, words)}"
