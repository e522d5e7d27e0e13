"""Arguments of the functions of the library: an engine, a nominal state, recordings, and how these become windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from enginediag_cli.api.results import MessageLog, Result, frame
from enginediag_cli.errors import DataError, UsageError
from enginediag_cli.intake.selection import NominalBaseline, RecordingSource
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.intake.loader import RecordingLoader
    from enginediag_cli.report.tables import Table
    from enginediag_cli.residuals.files import WindowReader, WindowSettings
    from enginediag_cli.residuals.monitor import Monitor

__all__ = ["Recordings", "WindowOptions", "load_engine", "load_nominal", "read_recordings"]


IN_MEMORY = "recording.csv"
"""Name under which results call a recording that came as arrays."""


@dataclass(frozen=True)
class Recordings(RecordingSource):
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
        Continue although the recordings cannot be of this engine or in these units.
    """

    scratch: Any = field(default=None, repr=False, compare=False)  # keeps the files of arrays alive

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the numeric columns of all files, one after another.

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
        """Return `arrays` as a pandas DataFrame, or as a pyarrow Table where pandas is not installed."""
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

    Examples
    --------
    >>> from enginediag_cli import load_engine
    >>> engine = load_engine("turbojet.yaml")
    >>> sorted(engine.sensors)[:2]
    ['N1_rpm', 'P3_Pa']
    """
    from enginediag_cli.physics.engine_file import load_engine as load

    return load(own_or_shipped(path))


def load_nominal(
    path: str | Path, *, engine: str | Path | None = None, accept_changed_engine: bool = False
) -> NominalBaseline:
    """Load a nominal state and its engine.

    Parameters
    ----------
    path : str or Path
        Nominal YAML, as `identify` writes it.
    engine : str or Path, optional
        Engine YAML to use in the place of the one that the nominal file holds.
    accept_changed_engine : bool
        Use the engine file although it has changed since the identification.

    Returns
    -------
    Baseline
        ``engine`` and ``nominal``.

    Raises
    ------
    ConfigError
        For files that do not fit each other.
    """
    from enginediag_cli.intake.selection import open_baseline

    return open_baseline(path, engine, accept_changed_engine=accept_changed_engine)


def read_recordings(
    *recordings: RecordingsLike,
    recorder: str | Path | None = None,
    engine_instance: str = "",
    accept_mismatch: bool = False,
) -> Recordings:
    """Describe recordings and how to read them; files are opened when a verb reads them.

    Parameters
    ----------
    *recordings
        Paths; or mappings of column name to array of shape (records,), DataFrames, results of `simulate`.
    recorder : str or Path, optional
        Recorder YAML of foreign files.
    engine_instance : str
        Use only this engine of the recordings.
    accept_mismatch : bool
        Continue although the recordings cannot be of this engine or in these units.

    Returns
    -------
    Recordings

    Raises
    ------
    DataError
        For what is no recording, and for arrays of different lengths.

    Examples
    --------
    >>> from enginediag_cli import read_recordings
    >>> recordings = read_recordings({"flight": [1, 1], "mach": [0.0, 0.3]})
    >>> recordings.arrays()["mach"]
    array([0. , 0.3])
    """
    scratch: list[Any] = []
    files = tuple(_file(item, scratch, len(recordings)) for item in recordings)
    path = str(own_or_shipped(recorder)) if recorder else None
    return Recordings(files, path, engine_instance, accept_mismatch, tuple(scratch))


def resolve_engine(engine: EngineLike) -> Engine:
    """Return the engine of an argument as if it had just been loaded: results do not depend on earlier calls."""
    if isinstance(engine, (str, Path)):
        return load_engine(engine)
    if not hasattr(engine, "forget_start"):
        raise DataError(f"no engine: {type(engine).__name__}; give a path, or what load_engine gives")
    found: Engine = engine
    found.forget_start()
    return found


def resolve_recordings(recordings: RecordingsLike) -> RecordingSource:
    """Return the recordings of an argument."""
    if isinstance(recordings, RecordingSource):
        return recordings
    if isinstance(recordings, (str, Path, Mapping, Result)) or hasattr(recordings, "columns"):
        return read_recordings(recordings)
    if not isinstance(recordings, Sequence):
        raise _no_recording(recordings)
    return read_recordings(*recordings)


def resolve_baseline(nominal: NominalLike, *, accept_changed_engine: bool = False) -> NominalBaseline | None:
    """Return the nominal state of an argument, its engine as if it had just been loaded; None stays None."""
    if nominal is None:
        return None
    if isinstance(nominal, (str, Path)):
        return load_nominal(nominal, accept_changed_engine=accept_changed_engine)
    found: NominalBaseline = (
        nominal if isinstance(nominal, NominalBaseline) else nominal.baseline()
    )  # a result of `identify`
    resolve_engine(found.engine)
    return found


def _file(item: RecordingsLike, scratch: list[Any], among: int) -> str:
    """Return the path of a recording; arrays are first written to a scratch file, with all digits."""
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
    """Return the columns of a mapping or of a DataFrame as lists."""
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


SENTENCES = 10
"""Windows that are described in sentences; beyond that the rows speak for themselves."""
STATISTICS_ALONE = ("window", "step", "linearise", "monitor", "reference", "last", "model_error")
"""Options that recordings need and statistics, which are made already, would ignore."""


@dataclass(frozen=True)
class WindowOptions:
    """How recordings become windows, and which parameters are monitored.

    Attributes
    ----------
    window : int or str, optional
        Length of a window: records (``60``) or time (``"300s"``, ``"10min"``, ``"1h"``); without it each flight is one.
    step : int or str, optional
        From the start of a window to the start of the next; by default the length of a window.
    linearise : {"estimate", "nominal"}
        Point of linearisation: the estimate for each window, or the nominal state (small changes only).
    reference : int
        Number of first records of each flight and engine that are taken as healthy; 0 for none.
    last : int
        Number of last records of each flight and engine that are judged; 0 for all.
    model_error : float, optional
        Relative accuracy of the component maps [1], instead of the value in the nominal file.
    monitor : sequence of str
        Names or shell patterns of the parameters that may have changed; by default those of the engine file.
    accept_changed_engine : bool
        Use the engine file although it has changed since the identification.
    chosen : mapping of str to bool, optional
        Which of these the user has set, where a user may set the default itself; by default, those that differ from
        the defaults.

    Raises
    ------
    UsageError
        For invalid or inconsistent lengths.
    """

    window: int | str | None = None
    step: int | str | None = None
    linearise: str = "estimate"
    reference: int = 0
    last: int = 0
    model_error: float | None = None
    monitor: Sequence[str] = ()
    accept_changed_engine: bool = False
    chosen: Mapping[str, bool] | None = None

    @property
    def judging(self) -> WindowSettings:
        """The plan of windows and the records that are judged."""
        from enginediag_cli.residuals.files import WindowSettings
        from enginediag_cli.residuals.windows import plan_windows

        length, step = (None if value is None else str(value) for value in (self.window, self.step))
        try:
            plan = plan_windows(length, step)
        except ValueError as error:
            raise UsageError(f"--window, --step: {error}") from None
        return WindowSettings(plan, self.linearise, self.reference, self.last, self.model_error)

    def set_by_user(self, source: RecordingSource) -> dict[str, bool]:
        """Return which choices were made that statistics would ignore."""
        if self.chosen is not None:
            return dict(self.chosen)
        plain = WindowOptions()
        made = {name: getattr(self, name) != getattr(plain, name) for name in STATISTICS_ALONE}
        return {**made, "recorder": bool(source.recorder), "engine_instance": bool(source.engine_instance)}


@dataclass(frozen=True)
class Comparison:
    """Recordings and the nominal state to compare them with, None for statistics alone."""

    source: RecordingSource
    given: NominalLike
    options: WindowOptions
    judging: WindowSettings
    messages: Messages

    @cached_property
    def baseline(self) -> NominalBaseline | None:
        """Nominal state and engine, read when they are first needed."""
        return resolve_baseline(self.given, accept_changed_engine=self.options.accept_changed_engine)

    @property
    def nominal(self) -> str:
        """Path of the nominal file; "" where there is none."""
        if isinstance(self.given, (str, Path)):
            return str(self.given)
        return "" if self.baseline is None else self.baseline.path

    @property
    def configs(self) -> list[str]:
        """Files that a result depends on, for its provenance."""
        return [*([self.nominal] if self.nominal else []), *self.source.configs]

    def monitor(self, *, sensors: bool = False, drifts: bool = False) -> Monitor | None:
        """Make the monitor and report doubts about the nominal state.

        sensors: every instrument may be wrong, too; drifts: and may drift within a flight.
        """
        baseline = self.baseline
        if baseline is None:
            return None
        from enginediag_cli.identification.nominal_checks import set_map_accuracy
        from enginediag_cli.report.tables.recordings import report_baseline
        from enginediag_cli.residuals.monitor import build_monitor

        accuracy = self.options.model_error
        report_baseline(self.messages, baseline, self.source.engine_instance)
        if accuracy is not None:
            if accuracy > 0.0 and baseline.nominal.error_model is None:
                self.messages.warning(
                    f"--model-error {accuracy:g} changes nothing: {self.nominal} was identified with maps taken for "
                    "exact; give the option to `enginediag identify`, too"
                )
            baseline = replace(baseline, nominal=set_map_accuracy(baseline.nominal, accuracy))
        return build_monitor(baseline, tuple(self.options.monitor), sensors=sensors, drifts=drifts)

    def files(
        self, monitor: Monitor | None, *, summed: bool = False, series: bool = False, drifts: bool = False
    ) -> WindowReader:
        """Open the recordings as windows.

        summed: the windows of a flight are added; series: they are compared with each other; drifts: drifts of
        instruments in statistics are read, too.
        """
        from enginediag_cli.residuals.files import WindowReader

        given = self.options.set_by_user(self.source)
        intake = open_intake(self.source, monitor)
        return WindowReader(
            intake, monitor, self.judging, summed=summed, user_options=given, series=series, drifts=drifts
        )

    def head(
        self,
        command: str,
        table: Table,
        intake: RecordingLoader,
        notes: Mapping[str, str],
        *,
        configs: Sequence[str] = (),
        last: Mapping[str, str] | None = None,
        judging: WindowSettings | None = None,
    ) -> Callable[[], tuple[str, ...]]:
        """Make the header of a result, once the first file has been opened: the files and choices behind it.

        configs: further files; last: further notes; judging: where it is not that of the options.
        """
        from enginediag_cli.recordings.source import header_lines

        made = {**table.notes, **notes, **self.source.notes, **(judging or self.judging).notes, **(last or {})}
        files = [*self.configs, *configs]
        return lambda: header_lines(command, configs=files, notes=made, inherited=intake.provenance)


def compare(
    nominal: NominalLike, recordings: RecordingsLike, windows: Mapping[str, Any], messages: Messages | None
) -> Comparison:
    """Interpret the arguments of a verb. Raises UsageError, ConfigError."""
    options = WindowOptions(**windows)
    judging = options.judging
    source = resolve_recordings(recordings)
    return Comparison(source, nominal, options, judging, messages if messages is not None else MessageLog())


def open_intake(source: RecordingSource, monitor: Monitor | None) -> RecordingLoader:
    """Open the recordings with the columns of the monitor's engine; without a monitor, statistics alone."""
    from enginediag_cli.intake.loader import RecordingLoader
    from enginediag_cli.intake.selection import required_columns

    if monitor is None:
        return RecordingLoader(source, None, keep_going=True)
    from enginediag_cli.residuals.monitor import recording_agreement

    wanted = required_columns(monitor.engine, monitor.sensors)
    return RecordingLoader(source, wanted, agreement=recording_agreement(monitor), keep_going=True)


def report_exclusions(messages: Messages, files: WindowReader) -> None:
    """Report mismatches, unread files and excluded data."""
    from enginediag_cli.report.sentences import count
    from enginediag_cli.report.tables.recordings import report_excluded, report_mismatches

    report_mismatches(messages, files.intake.mismatches)
    for file, reason in files.intake.unread.items():
        messages.error(f"not read to its end, the other files are judged: {reason}", file=file)
    report_excluded(messages, files.intake.excluded, files.counts, files.extrapolation)
    if files.ledger.repeated:
        messages.warning(f"{count(files.ledger.repeated, 'row')} of statistics given twice, and counted once")
    if files.ledger.overlapping:
        messages.warning(f"{count(files.ledger.overlapping, 'window')} with records that another has, too")
