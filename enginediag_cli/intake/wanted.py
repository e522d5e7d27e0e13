"""The columns that an engine reads of a recording, and those of them that a recording lacks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.read import Absent, absent_columns

if TYPE_CHECKING:
    from enginediag_cli.engine.moving.tape import Tapes
    from enginediag_cli.engine.wrapped import Model
    from enginediag_cli.recordings.table import Recording


@dataclass(frozen=True)
class Wanted:
    """Columns by what they are to the engine: `inputs` must be there; `optional` inputs have a value that stands for
    "not recorded"; of the `sensors` one must be there; `others` are further columns asked for by name. `tapes`: where
    the past of every record is kept, for an engine that may remember it; None for one that does not."""

    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    optional: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    engine: str = "the engine"
    tapes: Tapes | None = None

    @property
    def declared(self) -> tuple[str, ...]:
        """All columns that hold numbers, whatever their names say."""
        return tuple(dict.fromkeys((*self.inputs, *self.optional, *self.sensors, *self.others, "time_s")))

    @property
    def given(self) -> tuple[str, ...]:
        """Columns of what the engine is told, which may well stand still; not what it is judged by."""
        return (*self.inputs, *self.optional)

    def absent(self, recording: Recording) -> tuple[Absent, ...]:
        """The sensors that the recording has no column of. Raises DataError, with near matches, when an input or every
        sensor is missing."""
        missing = {a.column: a for a in absent_columns(self.declared, recording.order)}
        needed = [_with_hint(missing[c]) for c in self.inputs if c in missing]
        if needed:
            raise DataError(f"{recording.source}: no column {', '.join(needed)}, which {self.engine} needs")
        sensors = tuple(missing[c] for c in self.sensors if c in missing)
        if self.sensors and len(sensors) == len(self.sensors):
            raise DataError(f"{recording.source}: none of the sensors {', '.join(map(_with_hint, sensors))}")
        return sensors


def columns_of(
    engine: Model, sensors: Iterable[str] | None = None, others: Sequence[str] = (), *, past: bool = False
) -> Wanted:
    """What this engine reads; `sensors`: only these of its own; `past`: its tapes are kept although it remembers
    nothing as it is."""
    name = str(getattr(engine, "name", "the engine"))
    tapes = getattr(engine, "tapes", None) if past or MOMENT in engine.optional_inputs else None
    chosen = tuple(engine.sensors) if sensors is None else tuple(sensors)
    return Wanted(tuple(engine.inputs), chosen, _recorded(engine), tuple(others), name, tapes)


def _recorded(engine: Model) -> tuple[str, ...]:
    """Optional inputs that a recording may have; where a record stands on its tape nobody but the door knows."""
    return tuple(c for c in engine.optional_inputs if c != MOMENT)


def _with_hint(absent: Absent) -> str:
    return absent.column + (f" (did you mean {absent.near!r}?)" if absent.near else "")
