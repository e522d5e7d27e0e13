"""What is read: recordings and their recorder, the columns that an engine needs of them, and the nominal state.

Imports no numerics, so that the command line can name its inputs before anything is read.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from enginediag_cli.errors import DataError

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.recall import Tapes
    from enginediag_cli.engine.wrapped import Model
    from enginediag_cli.identification.nominal import Nominal
    from enginediag_cli.recordings.table import MissingColumn, Recording


STDIN = "-"
"""A file's name that stands for standard input."""


@dataclass(frozen=True)
class RecordingSource:
    """`files` as given, "-" for standard input; `recorder`: recorder file of foreign recordings, if they are;
    `engine_instance`: use only this engine of the recordings, "" for all; `accept_mismatch`: go on with a recording
    that cannot be of the engine, or in these units."""

    files: tuple[str, ...]
    recorder: str | None = None
    engine_instance: str = ""
    accept_mismatch: bool = False

    @property
    def configs(self) -> list[str]:
        """Files beside the recordings that a result depends on."""
        return [self.recorder] if self.recorder else []

    @property
    def notes(self) -> Mapping[str, str]:
        """Choices that a result depends on, for its provenance."""
        found = {"engine instance": self.engine_instance} if self.engine_instance else {}
        return found | ({"mismatch": "accepted"} if self.accept_mismatch else {})

    def label(self, file: str) -> str:
        """How a file is called: without its folder, unless two files would be called alike."""
        if file == STDIN:
            return "stdin"
        name = os.path.basename(file)
        return name if [os.path.basename(f) for f in self.files].count(name) == 1 else file


def refuse_duplicates(files: Sequence[str]) -> None:
    """Raises DataError when two of the files are the same one, or have the same bytes: what a recording says would
    count twice. Pipes are not looked into."""
    by_size: dict[int, list[str]] = {}
    for file in files:
        path = Path(file)
        if file != STDIN and path.is_file() and os.access(file, os.R_OK) and path.stat().st_size:
            by_size.setdefault(path.stat().st_size, []).append(file)
    for alike in by_size.values():
        seen: dict[str, str] = {}
        for file in alike if len(alike) > 1 else []:
            first = seen.get(digest := _digest(file))
            if first is not None:
                same = "are the same file" if os.path.samefile(first, file) else "hold the same bytes"
                raise DataError(f"{first} and {file} {same}: what they say would count twice; give one of them")
            seen[digest] = file


def _digest(file: str) -> str:
    from enginediag_cli.recordings.source import file_sha256

    return file_sha256(file)


@dataclass(frozen=True)
class RequiredColumns:
    """Columns by what they are to the engine: `inputs` must be there; `optional` inputs have a value that stands for
    "not recorded"; of the `sensors` one must be there; `others` are further columns asked for by name. `tapes`: where
    the past of every record is kept, for an engine with memory; None for one without."""

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
    def input_columns(self) -> tuple[str, ...]:
        """Columns of the engine's inputs, which may well be constant; not what it is judged by."""
        return (*self.inputs, *self.optional)

    def find_missing(self, recording: Recording) -> tuple[MissingColumn, ...]:
        """The sensors that the recording has no column of. Raises DataError, with near matches, when an input or every
        sensor is missing."""
        from enginediag_cli.recordings.table import find_missing_columns

        missing = {a.column: a for a in find_missing_columns(self.declared, recording.order)}
        needed = [str(missing[c]) for c in self.inputs if c in missing]
        if needed:
            raise DataError(f"{recording.source}: no column {', '.join(needed)}, which {self.engine} needs")
        sensors = tuple(missing[c] for c in self.sensors if c in missing)
        if self.sensors and len(sensors) == len(self.sensors):
            raise DataError(f"{recording.source}: none of the sensors {', '.join(map(str, sensors))}")
        return sensors


def required_columns(
    engine: Model, sensors: Iterable[str] | None = None, others: Sequence[str] = (), *, past: bool = False
) -> RequiredColumns:
    """List the columns that an engine needs of a recording.

    Parameters
    ----------
    engine : Model
    sensors : iterable of str, optional
        Only these of its sensors; all by default.
    others : sequence of str
        Further columns of numbers.
    past : bool
        Whether its tapes are kept although the engine has no memory as it is.

    Returns
    -------
    RequiredColumns
    """
    from enginediag_cli.engine.recall import MOMENT

    name = str(getattr(engine, "name", "the engine"))
    tapes = getattr(engine, "tapes", None) if past or MOMENT in engine.optional_inputs else None
    # where a record stands on its tape is no column of a recording
    optional = tuple(c for c in engine.optional_inputs if c != MOMENT)
    chosen = tuple(engine.sensors) if sensors is None else tuple(sensors)
    return RequiredColumns(tuple(engine.inputs), chosen, optional, tuple(others), name, tapes)


@dataclass(frozen=True)
class NominalBaseline:
    """An engine with the power setting of its nominal state. `path`: the nominal file; `changed_engine`: SHA-256 of an
    engine file that is not the one identified, where that was accepted, else ""; `left_aside`: an engine file that is
    not the one identified and was not used, else ""."""

    engine: Engine
    nominal: Nominal
    path: str
    changed_engine: str = ""
    unused_engine: str = ""

    def other_instance(self, wanted: str) -> tuple[str, str] | None:
        """(engine identified, engine of the recordings) where both are named and differ."""
        from enginediag_cli.identification.nominal_checks import instance_conflict

        return instance_conflict(self.nominal, wanted)


def open_baseline(
    nominal_path: str | Path, engine_path: str | Path | None = None, *, accept_changed_engine: bool = False
) -> NominalBaseline:
    """Open a nominal file and its engine: the one that the file contains, whatever has become of the engine file.

    An engine file that is given, and the one that an older nominal file names, is used itself. It must be the one that
    was identified, unless a changed one is accepted.

    Parameters
    ----------
    nominal_path : path
    engine_path : path, optional
    accept_changed_engine : bool

    Returns
    -------
    NominalBaseline

    Raises
    ------
    ConfigError
        For files that do not fit each other.
    """
    from enginediag_cli.identification.nominal_checks import (
        build_described_engine,
        changed_engine_file,
        check_nominal_fits,
    )
    from enginediag_cli.identification.nominal_file import engine_file, read_nominal, refuse_changed_engine
    from enginediag_cli.physics.engine_file import load_engine

    nominal = read_nominal(nominal_path)
    described = None if engine_path or accept_changed_engine else nominal.description
    changed = left_aside = ""
    if described is None:
        path = engine_path or engine_file(nominal, nominal_path)
        changed = refuse_changed_engine(nominal, path, accept=accept_changed_engine, nominal_path=nominal_path)
        build = partial(load_engine, path)
    else:
        left_aside = changed_engine_file(described, nominal_path)
        build = partial(build_described_engine, described, nominal_path)
    engine = build()
    other = [c for c in nominal.inputs if c not in engine.inputs]
    if len(other) == 1:
        engine = build(power_setting=other[0])
    check_nominal_fits(nominal, engine, nominal_path)
    return NominalBaseline(engine, nominal, str(nominal_path), changed, left_aside)
