"""`check`, `simulate` and the intake of recordings: excluded data with reasons, and the acceptance report.

The acceptance report of a recording has rows, one for each finding, and a page of lines; of
an engine file `check` shows its design table, and a heating value that does not fit the fuel. The columns of what
`simulate` records are here, too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.overview import design_table, heating_value_doubts
from enginediag_cli.intake.loader import ExcludedData, GrossCounts
from enginediag_cli.intake.selection import NominalBaseline
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import count, format_quantity, rounded
from enginediag_cli.report.tables import Table, column, object_column, part
from enginediag_cli.residuals.windows import Extrapolation
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.intake.acceptance import CheckedFile, Stretches
    from enginediag_cli.intake.agreement import RecordingMismatch
    from enginediag_cli.intake.loader import Thinning
    from enginediag_cli.intake.selection import RequiredColumns


CHECK: Table[Mapping[str, Any]] = Table(
    "check",
    1,
    "one row per file, then one for each thing that is known of it",
    (
        column("file", "text", "the file"),
        column("engine", "text?", "engine of a recording that holds several"),
        column("ok", "boolean", "false where it keeps the file from being used"),
        column("level", "text?", "note, warning or problem"),
        column("about", "text?", "sensors, inputs, units, frozen, time, repeated, read, masked, envelope …"),
        column("line", "integer?", "line of the file, from 1"),
        column("last_line", "integer?", "last line, where it is several"),
        column("column", "integer?", "character of the line, from 1"),
        column("name", "text?", "column of the recording"),
        column("count", "integer?", "records, readings or columns"),
        column("found", "text?", "what is so"),
        column("problem", "text?", "what is wrong"),
        column("hint", "text?", "how to fix it"),
    ),
    ("file", "level", "line", "problem", "found", "hint"),
)


_ABOUT = "a message that is about it"
_BEGIN, _END = "event: begin", "event: end"

LOG: Table[Mapping[str, Any]] = Table(
    "log",
    1,
    "--log: one JSON object a line; the first of a run has event begin, the last event end",
    (
        column("time", "text", "UTC, ISO 8601 to the millisecond"),
        column("version", "text", "version of the program"),
        column("command", "text", "the command"),
        column("run", "text", "whose line it is, where runs share a log"),
        column("level", "text", "note, warning or error"),
        column("message", "text", "what was said"),
        column("event", "text", "begin or end", only_with="the first and the last line"),
        column("arguments", "texts", "the command line", only_with=_BEGIN),
        column("folder", "text", "where it was given", only_with=_BEGIN),
        column("process", "integer", "its process", only_with=_BEGIN),
        column("exit_code", "integer", "how the run ended", only_with=_END),
        column("seconds", "number", "how long it took", "s", only_with=_END),
        object_column(
            part("outputs", "every file written: file, sha256, bytes", many=True), itemgetter("outputs"), _END
        ),
        column("file", "text", "file that a message is about", only_with=_ABOUT),
        column("flight", "text", "flight that a message is about", only_with=_ABOUT),
        column("engine", "text", "engine that a message is about", only_with=_ABOUT),
        column("lines", "numbers", "its first and last line in the file", only_with=_ABOUT),
        column("flights", "integer", "flights that a message is about", only_with=_ABOUT),
        object_column(part("counts", "what was counted"), itemgetter("counts"), _ABOUT),
        column("line", "integer?", "line of the file", only_with=_ABOUT),
        column("column", "integer?", "character of the line", only_with=_ABOUT),
        column("hint", "text", "how to fix it", only_with=_ABOUT),
        column("verdict", "text", "fault or no verdict, of a window of detect", only_with="detect"),
        column("p_value", "number?", "of that window", only_with="detect"),
        column("lock", "text", "file whose lock the run holds", only_with="--lock"),
        column("traceback", "text", "of an internal error", only_with="exit code 70"),
    ),
)


_FLIGHTS = "flights, or --conditions that have the column"
SIMULATE: Table[Mapping[str, Any]] = Table(
    "simulate",
    1,
    "one row per record: what the engine's sensors record",
    (
        column("flight", "integer", "number of the flight, from 1", only_with=_FLIGHTS),
        column("time_s", "number", "time since the flight began", "s", only_with=_FLIGHTS),
        column("phase", "text", "phase of the flight", only_with=_FLIGHTS),
        column("status", "text", "ok, or what is doubtful about the record"),
    ),
    families=(
        column("<quantity>_<unit>", "number?", "input or reading of the engine", "as its name says"),
        column("mach", "number", "flight Mach number"),
    ),
    terminal=("time_s", "flight", "altitude_m", "mach", "status"),
)


SOME_LINES = 5
"""Lines of the file that a sentence names: enough to look at; JSON holds more."""


def report_excluded(
    messages: Messages,
    left_out: Iterable[ExcludedData],
    records: Mapping[str, int] | None = None,
    elsewhere: Mapping[Extrapolation, int] | None = None,
) -> None:
    """All of it, `records` being counts of records that came in and were not judged, `elsewhere` of those that lie
    where identification has not been."""
    left_out = list(left_out)
    for text in undecided_lines(dict.fromkeys(text for left in left_out for text in left.undecided)):
        messages.warning(text)
    for left in left_out:
        report_absent(messages, left)
        for line in excluded_lines(left):
            messages.note(line, file=left.file, engine=left.engine)
    for line in not_judged_lines(records or {}):
        messages.note(line, counts=dict(records or {}))
    for line in outside_envelope_lines(elsewhere or {}):
        messages.note(line)


def report_thinning(messages: Messages, thinning: Thinning) -> None:
    """How many records were taken where there are more than memory should hold."""
    if thinning.halved:
        from enginediag_cli.intake.loader import RUN

        messages.note(
            f"of {thinning.total:,} records one run of {RUN} in {2**thinning.halved} is fitted, evenly spread: "
            f"{thinning.most:,} are as many as memory is taken for"
        )


def undecided_lines(undecided: Collection[str]) -> Iterator[str]:
    """What the recorder leaves open, which may make every answer wrong."""
    for text in undecided:
        yield f"the recorder leaves open: {text}"


def report_mismatches(messages: Messages, mismatches: Iterable[RecordingMismatch]) -> None:
    """Recordings that cannot be of the engine or in these units, where that was accepted."""
    for one in mismatches:
        messages.warning(f"{one}; accepted", file=one.source, engine=one.engine)


def report_absent(messages: Messages, left: ExcludedData) -> None:
    """Sensors of the engine that a recording has no column of: nothing can be said of them."""
    if not left.absent:
        return
    words = [str(a) for a in left.absent]
    what = "columns" if len(words) > 1 else "column"
    messages.warning(
        f"{_place(left)}: no {what} {', '.join(words)}: judged without", file=left.file, engine=left.engine
    )


def excluded_lines(left: ExcludedData) -> Iterator[str]:
    """One line per column that lost readings, and one per reason for which whole records went."""
    place = _place(left)
    yield from (f"{place}: {line}" for line in left.reading.report_lines())
    for name, reasons in left.columns.items():
        why = ", ".join(f"{reason} {n}" for reason, n in reasons.items())
        yield f"{place}: {name}: {sum(reasons.values())} of {left.readings[name]} readings masked ({why})"
    if left.frozen:
        yield f"{place}: {count(left.frozen, 'record')} in which nothing moves, not judged: the recorder was frozen"
    if left.repeated:
        yield f"{place}: {count(left.repeated, 'record')} that repeat an earlier one, not used again"
    yield from (f"{place}: {line}" for line in gross_lines(left.gross))
    if left.gate is not None:
        yield f"{place}: {left.gate.report_line()}"


def gross_lines(gross: GrossCounts) -> Iterator[str]:
    """What was rejected as gross errors, a line per name; from a few per cent on it is a finding about the sensor."""
    for name, n in sorted(gross.readings.items(), key=lambda item: (-item[1], item[0])):
        share = f"{n} of {gross.judged:,} readings" + (
            f" ({100 * gross.share(name):.2g} %)" if gross.noteworthy(name) else ""
        )
        if name in gross.dead:
            what = "far from anything that the engine can give, not used: the sensor is dead, or its column is another"
        else:
            what = f"{'gross errors (spikes)' if n > 1 else 'a gross error (spike)'}, not used"
            what += ": check the sensor and its wiring" if gross.noteworthy(name) else ""
        yield f"{name}: {share} {'are' if n > 1 else 'is'} {what}{_named_lines(gross.lines.get(name, ()), n)}"
    for name, n in gross.wrong_inputs.items():
        why = f"{name} is wrong there" if name else "most of their readings are wrong there"
        why = "most of its readings are wrong there" if n == 1 and not name else why
        lines = _named_lines(gross.lines.get(name, ()), n)
        yield f"{count(n, 'record')} of {gross.judged:,} not judged: {why}{lines}"
    for name in gross.spoilt:
        yield f"{name}: more than half of the readings are gross errors; all are used, judge without this sensor"
    for name, runs in gross.excursions.items():
        for first, last, n in runs:
            yield (
                f"{name}: short excursion in lines {first} to {last} ({n} records), treated as a disturbance of the "
                "sensor and not used"
            )


def _named_lines(lines: Sequence[int], n: int) -> str:
    """In brackets; nothing where they are not known."""
    named = ", ".join(map(str, lines[:SOME_LINES])) + (", …" if n > len(lines[:SOME_LINES]) else "")
    return f" ({'line' if n == 1 else 'lines'} {named})" if lines else ""


def not_judged_lines(records: Mapping[str, int]) -> Iterator[str]:
    """Of records that came in: how many could not be judged, and why."""
    for key, what in (
        ("incomplete", "without an input or any reading"),
        ("failed", "not computed by the engine"),
        ("repeating", "whose readings are those of the record before, not judged"),
    ):
        if records.get(key):
            yield f"{count(records[key], 'record')} {what}"


def outside_envelope_lines(elsewhere: Mapping[Extrapolation, int]) -> Iterator[str]:
    """Of records outside the operating points identified: which input it is, and what became of them."""
    for judged, what in ((True, "judged with widened limits"), (False, "too far to be judged")):
        by = {w.column: n for w, n in elsewhere.items() if w.judged == judged and n}
        if by:
            most = sorted(by, key=lambda column: (-by[column], column))
            inputs = ", ".join(f"{column or 'a combination of inputs'} in {by[column]:,}" for column in most)
            yield f"{count(sum(by.values()), 'record')} outside the operating points identified, {what}: {inputs}"


def _place(left: ExcludedData) -> str:
    import os

    name = "stdin" if left.file == "-" else os.path.basename(left.file)
    return name + (f", engine {left.engine}" if left.engine else "")


def report_baseline(messages: Messages, baseline: NominalBaseline, engine_instance: str = "") -> None:
    """A changed engine file, a nominal file without its checksum, and recordings of another engine."""
    if baseline.changed_engine:
        messages.warning(
            f"{baseline.engine.path} has changed since its nominal state was identified; what follows is judged with "
            "the engine as it is now"
        )
    if baseline.unused_engine:
        messages.warning(
            f"{baseline.unused_engine} has changed since its nominal state was identified; the engine that was "
            f"identified, which travels in {baseline.path}, is used (--accept-changed-engine: the file as it is now)"
        )
    if not baseline.nominal.sealed:
        messages.warning(f"{baseline.path} has no checksum: nothing shows that it is as identify wrote it")
    other = baseline.other_instance(engine_instance)
    if other is not None:
        messages.warning(
            f"{baseline.path} was identified on engine {other[0]!r}, and these are recordings of {other[1]!r}: what is "
            "found may be the difference between the two"
        )


NOTE, WARNING, PROBLEM = "note", "warning", "problem"
"""What is so; what the user should look at; what keeps the recording from being judged."""


@dataclass(frozen=True)
class Remark:
    """One thing that is known of a recording. about: sensors, inputs, units, frozen, time, repeated, switch, read,
    masked, gate, envelope; name: the column that it concerns; count: records, readings or columns."""

    level: str
    topic: str
    text: str
    hint: str = ""
    name: str = ""
    lines: tuple[int, int] | None = None
    count: int | None = None

    @property
    def text_with_hint(self) -> str:
        """In words, with how to fix it."""
        return self.text + (f" ({self.hint})" if self.hint else "")

    @property
    def line(self) -> str:
        """As a line of the page."""
        return ("warning: " if self.level == WARNING else "") + self.text_with_hint


def headline(report: CheckedFile) -> str:
    """What a file holds, in one line."""
    place = report.file if report.file != "-" else "<stdin>"
    place += f", engine {report.engine}" if report.engine else ""
    return f"{place}: {'ok' if report.usable else 'not fit to be judged'}, {_content_words(report)}"


def acceptance_rows(report: CheckedFile) -> Iterator[dict[str, Any]]:
    """A row for the file, then one for each remark; `ok` is false where the remark keeps it from being judged."""
    file = report.file if report.file != "-" else "<stdin>"
    start = {"file": file, "engine": report.engine or None}
    yield {
        **start,
        "ok": report.usable,
        "level": NOTE if report.usable else PROBLEM,
        "about": "recording",
        "count": report.acceptance.records,
        "found": _content_words(report),
    }
    for remark in remarks(report):
        lines = remark.lines or (None, None)
        yield {
            **start,
            "ok": remark.level != PROBLEM,
            "level": remark.level,
            "about": remark.topic,
            "line": lines[0],
            "last_line": lines[1],
            "name": remark.name or None,
            "count": remark.count,
            "found" if remark.level == NOTE else "problem": remark.text,
            "hint": remark.hint or None,
        }


def _content_words(report: CheckedFile) -> str:
    acceptance = report.acceptance
    numbers = acceptance.numeric + int(acceptance.timed)
    found = f"{count(acceptance.records, 'record')}, {count(numbers, 'column')} of numbers"
    return found + (f", {report.text} of text" if report.text else "")


def remarks(report: CheckedFile) -> Iterator[Remark]:
    """All that is known of a recording, in the order in which it would be fixed."""
    yield from _columns(report)
    yield from _units(report)
    yield from _records(report)
    yield from _masks(report)
    yield from _coverage(report)


def _columns(report: CheckedFile) -> Iterator[Remark]:
    acceptance, wanted = report.acceptance, report.wanted
    if report.is_partial:
        what = f"the first {acceptance.records:,} records were checked; the file continues"
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
    for name in acceptance.empty if acceptance.records else ():
        needed = name in wanted.inputs
        level, about = (PROBLEM if needed else WARNING), ("inputs" if name in wanted.input_columns else "sensors")
        yield Remark(level, about, f"{name} has no reading", name=name, count=0)


def _sensors(report: CheckedFile, wanted: RequiredColumns) -> Iterator[Remark]:
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
    if there and report.lacks_sensors and acceptance.records:
        yield Remark(PROBLEM, "sensors", "no sensor has a reading", count=0)
    elif there and acceptance.records and len(set(there) - set(acceptance.empty)) < LEAST_SENSORS:
        yield Remark(WARNING, "sensors", f"too few sensors for a verdict: {LEAST_SENSORS} are the least")


def _units(report: CheckedFile) -> Iterator[Remark]:
    for doubt in report.units:
        usual = f"{rounded(doubt.low)} to {rounded(doubt.high)}"
        told = f"{doubt.column}: the median is {rounded(doubt.median)}, and {usual} is what can be"
        yield _unit_remark(doubt.column, told, doubt.plausible)
    for one in report.wrong:
        name = one.trial.mistake.column if one.trial is not None else ""
        since = f"{one.stretch}: " if one.stretch else ""
        yield Remark(PROBLEM, "units", f"{since}{one.description}", one.hint, name, one.lines if one.stretch else None)


def _unit_remark(column: str, told: str, plausible: Sequence[str]) -> Remark:
    if not plausible:
        return Remark(WARNING, "units", told, "no unit makes that right", column)
    units = " or ".join(plausible[:3])
    hint = f"is it in {units}? Let the column's name say so, and a recorder convert it"
    return Remark(PROBLEM, "units", told, hint, column)


def _records(report: CheckedFile) -> Iterator[Remark]:
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


def _masks(report: CheckedFile) -> Iterator[Remark]:
    left = report.left
    for line in left.reading.report_lines():
        yield Remark(NOTE, "read", line)
    for name, reasons in left.columns.items():
        lost, why = sum(reasons.values()), ", ".join(f"{reason} {n}" for reason, n in reasons.items())
        told = f"{name}: {lost} of {left.readings[name]} readings masked ({why})"
        yield Remark(NOTE, "masked", told, name=name, count=lost)
    if report.refused:
        yield Remark(PROBLEM, "gate", report.refused, count=0)
    elif left.gate is not None:
        why = ", ".join(f"{reason} {n}" for reason, n in left.gate.reasons.items() if n)
        told = f"kept {left.gate.kept} of {left.gate.total} {left.gate.unit}" + (f" (excluded: {why})" if why else "")
        yield Remark(NOTE, "gate", told, count=left.gate.kept)


def _coverage(report: CheckedFile) -> Iterator[Remark]:
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
        shown = [_design_value(c, v) for c, v in known.items() if np.isfinite(v)]
        if "Fn_N" not in known and known.get("power_W", 0.0) > 0.0 and "Wf_kg_s" in known:
            shown.insert(2, f"SFC {format_quantity(known['Wf_kg_s'] / known['power_W'] * PER_KWH, 'kg/(kW h)')}")
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


def _design_value(column: str, value: float) -> str:
    if column == "SFC_kg_Ns":
        return f"SFC {format_quantity(value * SFC, 'mg/(N s)')}"
    quantity, unit = split_column(column)
    factor, words = SHOWN.get(unit, (1.0, unit.replace("_", "/")))
    return f"{quantity} {format_quantity(value * factor, words)}"
