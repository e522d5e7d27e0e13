"""What was left out of recordings, in lines for standard error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from enginediag_cli.intake.left_out import LeftOut
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.sentences import count
from enginediag_cli.residuals.admission import Elsewhere


def tell_left_out(
    messages: Messages,
    left_out: Iterable[LeftOut],
    records: Mapping[str, int] | None = None,
    elsewhere: Mapping[Elsewhere, int] | None = None,
) -> None:
    """All of it, `records` being counts of records that came in and were not judged, `elsewhere` of those that lie
    where identification has not been."""
    for left in left_out:
        tell_absent(messages, left)
        for line in left_out_lines(left):
            messages.note(line, file=left.file, engine=left.engine)
    for line in not_judged_lines(records or {}):
        messages.note(line, counts=dict(records or {}))
    for line in elsewhere_lines(elsewhere or {}):
        messages.note(line)


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
    if left.gate is not None:
        yield f"{place}: {left.gate.report_line()}"


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
