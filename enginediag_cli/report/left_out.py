"""What was left out of recordings, in lines for standard error.

What should be known of a nominal state before recordings are held against it, as warnings.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from enginediag_cli.intake.baseline import Baseline
from enginediag_cli.intake.left_out import GrossCounts, LeftOut
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import count
from enginediag_cli.residuals.windows import Elsewhere

if TYPE_CHECKING:
    from enginediag_cli.intake.agreement import Disagreement
    from enginediag_cli.intake.flights import Thinning


SOME_LINES = 5
"""Lines of the file that a sentence names: enough to look at; JSON holds more."""


def tell_left_out(
    messages: Messages,
    left_out: Iterable[LeftOut],
    records: Mapping[str, int] | None = None,
    elsewhere: Mapping[Elsewhere, int] | None = None,
) -> None:
    """All of it, `records` being counts of records that came in and were not judged, `elsewhere` of those that lie
    where identification has not been."""
    left_out = list(left_out)
    for text in undecided_lines(dict.fromkeys(text for left in left_out for text in left.undecided)):
        messages.warning(text)
    for left in left_out:
        tell_absent(messages, left)
        for line in left_out_lines(left):
            messages.note(line, file=left.file, engine=left.engine)
    for line in not_judged_lines(records or {}):
        messages.note(line, counts=dict(records or {}))
    for line in elsewhere_lines(elsewhere or {}):
        messages.note(line)


def tell_thinning(messages: Messages, thinning: Thinning) -> None:
    """How many records were taken where there are more than memory should hold."""
    if thinning.halved:
        from enginediag_cli.intake.flights import RUN

        messages.note(
            f"of {thinning.came:,} records one run of {RUN} in {2**thinning.halved} is fitted, evenly spread: "
            f"{thinning.most:,} are as many as memory is taken for"
        )


def undecided_lines(undecided: Collection[str]) -> Iterator[str]:
    """What the recorder leaves open, which may make every answer wrong."""
    for text in undecided:
        yield f"the recorder leaves open: {text}"


def tell_mismatches(messages: Messages, mismatches: Iterable[Disagreement]) -> None:
    """Recordings that cannot be of the engine or in these units, where that was accepted."""
    for one in mismatches:
        messages.warning(f"{one}; accepted", file=one.source, engine=one.engine)


def tell_absent(messages: Messages, left: LeftOut) -> None:
    """Sensors of the engine that a recording has no column of: nothing can be said of them."""
    if not left.absent:
        return
    words = [a.column + (f" (did you mean {a.near!r}?)" if a.near else "") for a in left.absent]
    what = "columns" if len(words) > 1 else "column"
    messages.warning(
        f"{_place(left)}: no {what} {', '.join(words)}: judged without", file=left.file, engine=left.engine
    )


def left_out_lines(left: LeftOut) -> Iterator[str]:
    """One line per column that lost readings, and one per reason for which whole records went."""
    place = _place(left)
    yield from (f"{place}: {line}" for line in left.reading.report_lines())
    for column, reasons in left.columns.items():
        why = ", ".join(f"{reason} {n}" for reason, n in reasons.items())
        yield f"{place}: {column}: {sum(reasons.values())} of {left.readings[column]} readings masked ({why})"
    if left.frozen:
        yield f"{place}: {count(left.frozen, 'record')} in which nothing moves, not judged: the recorder was frozen"
    if left.repeated:
        yield f"{place}: {count(left.repeated, 'record')} that repeat an earlier one, not used again"
    yield from (f"{place}: {line}" for line in gross_lines(left.gross))
    if left.gate is not None:
        yield f"{place}: {left.gate.report_line()}"


def gross_lines(gross: GrossCounts) -> Iterator[str]:
    """What was rejected as gross errors, a line per column; from a few per cent on it is a finding about the sensor."""
    for column, n in sorted(gross.readings.items(), key=lambda item: (-item[1], item[0])):
        share = f"{n} of {gross.judged:,} readings" + (
            f" ({100 * gross.share(column):.2g} %)" if gross.noteworthy(column) else ""
        )
        if column in gross.dead:
            what = "far from anything that the engine can give, not used: the sensor is dead, or its column is another"
        else:
            what = f"{'gross errors (spikes)' if n > 1 else 'a gross error (spike)'}, not used"
            what += ": check the sensor and its wiring" if gross.noteworthy(column) else ""
        yield f"{column}: {share} {'are' if n > 1 else 'is'} {what}{_named_lines(gross.lines.get(column, ()), n)}"
    for column, n in gross.wrong_inputs.items():
        why = f"{column} is wrong there" if column else "most of their readings are wrong there"
        why = "most of its readings are wrong there" if n == 1 and not column else why
        lines = _named_lines(gross.lines.get(column, ()), n)
        yield f"{count(n, 'record')} of {gross.judged:,} not judged: {why}{lines}"
    for column in gross.spoilt:
        yield f"{column}: more than half of the readings are gross errors; all are used, judge without this sensor"
    for column, runs in gross.excursions.items():
        for first, last, n in runs:
            yield (
                f"{column}: short excursion in lines {first} to {last} ({n} records), taken for a disturbance of the "
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


def elsewhere_lines(elsewhere: Mapping[Elsewhere, int]) -> Iterator[str]:
    """Of records outside the operating points identified: which input it is, and what became of them."""
    for judged, what in ((True, "judged with limits as much wider"), (False, "too far to be judged")):
        by = {w.column: n for w, n in elsewhere.items() if w.judged == judged and n}
        if by:
            most = sorted(by, key=lambda column: (-by[column], column))
            inputs = ", ".join(f"{column or 'a combination of inputs'} in {by[column]:,}" for column in most)
            yield f"{count(sum(by.values()), 'record')} outside the operating points identified, {what}: {inputs}"


def _place(left: LeftOut) -> str:
    import os

    name = "stdin" if left.file == "-" else os.path.basename(left.file)
    return name + (f", engine {left.engine}" if left.engine else "")


def tell_baseline(messages: Messages, baseline: Baseline, engine_instance: str = "") -> None:
    """A changed engine file, a nominal file without its checksum, and recordings of another engine."""
    if baseline.changed_engine:
        messages.warning(
            f"{baseline.engine.path} has changed since its nominal state was identified; what follows is judged with "
            "the engine as it is now"
        )
    if baseline.left_aside:
        messages.warning(
            f"{baseline.left_aside} has changed since its nominal state was identified; the engine that was "
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
