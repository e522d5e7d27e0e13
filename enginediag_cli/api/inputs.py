"""What the verbs of the library are given: an engine, a nominal state, recordings, as files or as objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from enginediag_cli.api.results import Result, frame
from enginediag_cli.errors import DataError
from enginediag_cli.intake.baseline import Baseline
from enginediag_cli.intake.source import Source
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from enginediag_cli.engine.engine import Engine

IN_MEMORY = "recording.csv"
"""Name under which results call a recording that came as arrays."""


@dataclass(frozen=True)
class Recordings(Source):
    """Recordings of one or several engines, by their files.

    Attributes
    ----------
    files : tuple of str
        CSV, Parquet or Excel files; ``-`` is standard input.
    recorder : str or None
        Recorder YAML of foreign files.
    engine_instance : str
        Use only this engine of the recordings; ``""`` for all.
    accept_mismatch : bool
        Go on with recordings that cannot be of the engine, or in these units.
    """

    scratch: Any = field(default=None, repr=False, compare=False)  # keeps the files of arrays alive

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """The numeric columns of all files, one after another, as they stand in them.

        Returns
        -------
        dict of str to ndarray, shape (records,)
            Units are in the names; NaN where a cell is empty.

        Raises
        ------
        DataError
            Where a file cannot be read.
        """
        import numpy as np

        from enginediag_cli.recordings.read import read_all

        read = [read_all(file) for file in self.files]
        names = dict.fromkeys(name for recording in read for name in recording.columns)
        empty = [np.full(len(recording), np.nan) for recording in read]
        return {
            name: np.concatenate([r.columns.get(name, e) for r, e in zip(read, empty, strict=True)]) for name in names
        }

    def to_frame(self) -> Any:
        """`arrays` as a pandas DataFrame, or a pyarrow Table where pandas is not installed."""
        return frame({name: values.tolist() for name, values in self.arrays().items()})


RecordingsLike: TypeAlias = Any
"""A path, several, a `Recordings`, a result of `simulate` or `residual`, a dict of arrays, or a DataFrame."""
NominalLike: TypeAlias = Any
"""A path of a nominal file, a `Baseline`, a result of `identify`, or None for statistics alone."""

EngineLike: TypeAlias = Any
"""A path of an engine YAML, the name of one that comes with enginediag, or a loaded `Engine`."""


def load_engine(path: str | Path) -> Engine:
    """Load the model of an engine.

    Parameters
    ----------
    path : str or Path
        Engine YAML, or the name of one that comes with enginediag, such as ``turbofan.yaml``.

    Returns
    -------
    Engine
        ``predict(U)`` gives its readings: U is a mapping of input columns to arrays of shape (records,).

    Raises
    ------
    ConfigError
        Every problem of the file, with file:line:column and how to fix it.
    """
    from enginediag_cli.physics.engine_file import load_engine as load

    return load(own_or_shipped(path))


def load_nominal(
    path: str | Path, *, engine: str | Path | None = None, accept_changed_engine: bool = False
) -> Baseline:
    """Load a nominal state and its engine.

    Parameters
    ----------
    path : str or Path
        Nominal YAML, as `identify` writes it.
    engine : str or Path, optional
        Engine YAML to use in the place of the one that the nominal file holds.
    accept_changed_engine : bool
        Use an engine file although it is no longer the one that was identified.

    Returns
    -------
    Baseline
        ``engine`` and ``nominal``.

    Raises
    ------
    ConfigError
        For files that do not fit each other.
    """
    from enginediag_cli.intake.baseline import open_baseline

    return open_baseline(path, engine, accept_changed_engine=accept_changed_engine)


def read_recordings(
    *recordings: RecordingsLike,
    recorder: str | Path | None = None,
    engine_instance: str = "",
    accept_mismatch: bool = False,
) -> Recordings:
    """Say which recordings are meant and how they are to be read; files are opened when a verb reads them.

    Parameters
    ----------
    *recordings
        Paths; or mappings of column name to array of shape (records,), DataFrames, results of `simulate`.
    recorder : str or Path, optional
        Recorder YAML of foreign files.
    engine_instance : str
        Use only this engine of the recordings.
    accept_mismatch : bool
        Go on with recordings that cannot be of the engine, or in these units.

    Returns
    -------
    Recordings

    Raises
    ------
    DataError
        For what is no recording, and for arrays of different lengths.
    """
    scratch: list[Any] = []
    files = tuple(_file(item, scratch, len(recordings)) for item in recordings)
    path = str(own_or_shipped(recorder)) if recorder else None
    return Recordings(files, path, engine_instance, accept_mismatch, tuple(scratch))


def as_engine(engine: EngineLike) -> Engine:
    """The engine that an argument of a verb means, as if it had just been loaded: answers do not depend on what was
    asked of it before."""
    if isinstance(engine, (str, Path)):
        return load_engine(engine)
    if not hasattr(engine, "forget_start"):
        raise DataError(f"no engine: {type(engine).__name__}; give a path, or what load_engine gives")
    found: Engine = engine
    found.forget_start()
    return found


def as_recordings(recordings: RecordingsLike) -> Source:
    """The recordings that an argument of a verb means."""
    if isinstance(recordings, Source):
        return recordings
    if isinstance(recordings, (str, Path, Mapping, Result)) or hasattr(recordings, "columns"):
        return read_recordings(recordings)
    if not isinstance(recordings, Sequence):
        raise _no_recording(recordings)
    return read_recordings(*recordings)


def as_baseline(nominal: NominalLike, *, accept_changed_engine: bool = False) -> Baseline | None:
    """The nominal state that an argument of a verb means, its engine as if it had just been loaded; None stays None."""
    if nominal is None:
        return None
    if isinstance(nominal, (str, Path)):
        return load_nominal(nominal, accept_changed_engine=accept_changed_engine)
    found: Baseline = nominal if isinstance(nominal, Baseline) else nominal.baseline()  # a result of `identify`
    as_engine(found.engine)
    return found


def _file(item: RecordingsLike, scratch: list[Any], among: int) -> str:
    """Path of a recording; what is in memory is written to a scratch file first, with all digits of its numbers."""
    if isinstance(item, (str, Path)):
        return str(item)
    import tempfile

    folder = tempfile.TemporaryDirectory(prefix="enginediag_")
    scratch.append(folder)
    path = Path(folder.name) / (IN_MEMORY if among == 1 else f"recording_{len(scratch)}.csv")
    if isinstance(item, Result):
        item.save(path)
    else:
        _write_columns(_columns(item), path)
    return str(path)


def _no_recording(item: object) -> DataError:
    return DataError(f"no recording: {type(item).__name__}; give a path, a mapping of arrays or a DataFrame")


def _columns(item: Any) -> dict[str, list[Any]]:
    """Columns of a mapping or of a DataFrame as lists."""
    if not (isinstance(item, Mapping) or (hasattr(item, "columns") and hasattr(item, "__getitem__"))):
        raise _no_recording(item)
    if hasattr(item, "to_pydict"):  # pyarrow
        return dict(item.to_pydict())
    found = {str(name): item[name] for name in (item if isinstance(item, Mapping) else item.columns)}
    columns = {name: list(values.tolist() if hasattr(values, "tolist") else values) for name, values in found.items()}
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError("columns of different lengths: " + ", ".join(f"{n} {k}" for n, k in lengths.items()))
    return columns


def _write_columns(columns: Mapping[str, Sequence[Any]], path: Path) -> None:
    from enginediag_cli.report.output import write_csv

    names = tuple(columns)
    rows = (dict(zip(names, values, strict=True)) for values in zip(*columns.values(), strict=True))
    with path.open("w", encoding="utf-8", newline="") as stream:
        write_csv(rows, names, stream)
