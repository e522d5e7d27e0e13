"""What to do next, from what was found: only what follows from the answer, no maintenance manual."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from enginediag_cli.parameters import Parameter
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.report.page import State
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
