"""`simulate`: what the sensors of an engine record, healthy or faulty, and the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from enginediag_cli.api.inputs import (
    EngineLike,
    NominalLike,
    RecordingsLike,
    resolve_baseline,
    resolve_engine,
    resolve_recordings,
)
from enginediag_cli.api.results import Result, Row, frame
from enginediag_cli.errors import DataError, UsageError
from enginediag_cli.progress import each
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.wrapped import NominalEngine
    from enginediag_cli.faults.catalogue import FaultSet
    from enginediag_cli.report.output import Output
    from enginediag_cli.report.result_files import Row as ResultRow
    from enginediag_cli.simulation.flights import ColumnNoise, FlightConditions
    from enginediag_cli.simulation.simulate import Simulated

__all__ = ["SimulationResult", "simulate"]

NOISES = ("none", "gaussian", "uniform", "correlated", "quantised")
REASONS_SHOWN = 5
"""Reasons that are reported one by one; there are rarely more kinds, the rest are counted."""

LOOSE = "the run of these could not be made exact: energy balances to about 1e-6 there"
"""Of records of moving engines."""

Flown = TypeVar("Flown", bound="SimulationResult")
FaultsLike: TypeAlias = Any
"""A path of a fault file, several, or a `FaultSet`."""
HealthLike: TypeAlias = Any
"""A file that `trend` wrote, CSV or JSON, or its result."""


@dataclass(frozen=True)
class SimulationChoices:
    """Arguments of `simulate` other than the engine and its faults."""

    flight: str | Path | None = None
    conditions: RecordingsLike = None
    noise: str | None = None
    flights: int | None = None
    records: int | None = None
    steady: bool = False
    seed: int = 0

    def check(self) -> None:
        """Raise UsageError for choices that exclude each other."""
        if self.noise is not None and self.noise not in NOISES:
            from enginediag_cli.config.fields import near

            raise UsageError(f"--noise: there is no {self.noise!r} ({near(self.noise, NOISES)})")
        if self.flight is not None and self.conditions is not None:
            raise UsageError("--flight and --conditions exclude each other")
        if self.flights is not None and self.conditions is not None:
            raise UsageError("--flights counts generated flights; --conditions brings its own")
        for name, count in (("flights", self.flights), ("records", self.records)):
            if count is not None and count < 1:
                raise UsageError(f"--{name}: {count} is not a number of {name}, from 1 on")

    def operating_conditions(
        self, engine: Engine | NominalEngine, rng: np.random.Generator
    ) -> tuple[FlightConditions, dict[str, ColumnNoise], tuple[str, ...]]:
        """Return operating conditions, noise of each column, and provenance of the conditions."""
        from enginediag_cli.config.validate import load_checked
        from enginediag_cli.errors import Mark
        from enginediag_cli.simulation.flights import KINDS, column_noise, default_plan, generate_flights

        mark, kind = Mark("--noise"), self.noise
        counts = {"flights": self.flights, "records": self.records}
        if self.conditions is not None:
            given, inherited = self._recorded(engine)
            return given, self._correlate(column_noise(KINDS[kind or "gaussian"], engine, mark), engine), inherited
        if self.flight is not None:
            checked = load_checked(own_or_shipped(self.flight), "flight")
            plan = checked.values
            mark = mark if kind else checked.mark(("noise",))
        else:
            plan = default_plan(engine)
        given = generate_flights(plan, engine, rng, **counts)
        noise = column_noise(KINDS[kind] if kind else plan["noise"], engine, mark)
        return given, noise if self.flight is not None else self._correlate(noise, engine), ()

    def _correlate(self, noise: dict[str, ColumnNoise], engine: Engine | NominalEngine) -> dict[str, ColumnNoise]:
        """Correlate readings from record to record as identified, where no noise was chosen."""
        rho1 = getattr(engine, "rho1", {}) if self.noise is None else {}
        return {c: replace(one, correlation=rho1[c]) if c in rho1 else one for c, one in noise.items()}

    def _recorded(self, engine: Engine | NominalEngine) -> tuple[FlightConditions, tuple[str, ...]]:
        """Read conditions record by record, and their provenance."""
        from enginediag_cli.recordings.read import read_all
        from enginediag_cli.simulation.simulate import to_conditions

        source = resolve_recordings(self.conditions)
        if len(source.files) != 1:
            raise UsageError(f"--conditions is one recording, not {len(source.files)}")
        recording = read_all(source.files[0], declared=(*engine.inputs, *engine.optional_inputs))
        given = to_conditions(recording)
        return given if self.records is None else given.slice(0, self.records), recording.provenance


class SimulationResult(Result):
    """A recording, and what is really wrong in it; see `simulate`. Verbs that read recordings take it as it is.

    `judged` counts records; `rows` are the records, with the keys of `columns`.
    """

    def __init__(
        self,
        engine: Engine | NominalEngine,
        faults: FaultSet,
        files: Sequence[str],
        choices: SimulationChoices,
        messages: Any,
    ):
        import numpy as np

        from enginediag_cli.recordings.source import header_lines
        from enginediag_cli.report.tables import output
        from enginediag_cli.simulation.simulate import describe_states, is_dynamic, simulate_in_chunks

        flying, noisy = (np.random.default_rng([choices.seed, stream]) for stream in (0, 1))
        given, noise, inherited = choices.operating_conditions(engine, flying)
        self.engine, self.records = engine, len(given)
        self._states = describe_states(engine) if not choices.steady and is_dynamic(engine, given) else None
        made = {"noise": choices.noise, "flights": choices.flights, "records": choices.records, "states": self._states}
        notes = {"engine": engine.name, **{key: str(value) for key, value in made.items() if value is not None}}
        flight = [] if choices.flight is None else [str(own_or_shipped(choices.flight))]
        configs = [*flight, *files]
        head = header_lines("simulate", seed=choices.seed, configs=configs, notes=notes, inherited=inherited)
        super().__init__(head=lambda: head, summary_columns=output("simulate").terminal, messages=messages)
        self._warn_outside(given)
        self._pieces = simulate_in_chunks(engine, given, faults, noise, noisy, steady=choices.steady)
        self._done: list[Simulated] = []
        self._streamed = False

    def complete(self: Flown, stream: bool = False) -> Flown:
        """Simulate all records, unless they are to come as a stream; return the result."""
        if not stream:
            self._done += self._simulate_pieces()
        return self

    def pieces(self) -> Iterator[Simulated]:
        """Yield recording and truth, some thousand records at a time; those of a stream come once.

        Yields
        ------
        Simulated
            ``columns`` and ``truth``: name to array of shape (n,); units are in the names.

        Raises
        ------
        DataError
            Where a stream has gone by.
        """
        if self._streamed:
            raise DataError("the records have gone by as a stream; simulate without stream=True keeps them")
        if self._done:
            yield from self._done
            return
        self._streamed = True
        yield from self._simulate_pieces()

    def _simulate_pieces(self) -> Iterator[Simulated]:
        """Simulate the pieces; report on all of them after the last."""
        reasons: Counter[str] = Counter()
        for piece in each(self._pieces, "records simulated", size=len):
            reasons.update(piece.reasons)
            if piece.loose:
                reasons[LOOSE] += piece.loose
            self.judged += len(piece)
            yield piece
        self._report(reasons)

    def _compute(self) -> Iterator[Row]:
        return _rows(self.pieces())

    def _warn_outside(self, given: FlightConditions) -> None:
        from enginediag_cli.simulation.flights import outside_envelope

        engine = self.engine
        for column, count in outside_envelope(engine, given).items():
            low, high = engine.envelope[column]
            self.messages.warning(
                f"{count} of {len(given)} records have {column} outside the envelope of {engine.name}, "
                f"{low:g} to {high:g}"
            )

    def _report(self, reasons: Counter[str]) -> None:
        messages, total = self.messages, self.records
        messages.note(f"{total} records simulated", counts={"records": total})
        for reason, count in reasons.most_common(REASONS_SHOWN):
            messages.warning(f"{count} of {total} records: {reason}")
        rest = reasons.most_common()[REASONS_SHOWN:]
        if rest:
            messages.warning(f"{sum(count for _, count in rest)} of {total} records: {len(rest)} other reasons")
        if self._states is not None:
            messages.note(f"integrated along time with the states {self._states}; --steady takes records as steady")

    def __len__(self) -> int:
        """Return the number of records."""
        return self.records

    @property
    def provenance(self) -> tuple[str, ...]:
        """Lines that say which program, files and choices made this; they head a CSV file."""
        return self._head()

    @property
    def columns(self) -> tuple[str, ...] | None:
        """Names of the columns; None where the records are to come as a stream."""
        return tuple(self._done[0].columns) if self._done else None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the recording.

        Returns
        -------
        dict of str to ndarray, shape (records,)
            Units are in the names; NaN where there is no reading; columns of text (``flight``, ``status``) as text.
        """
        return self._concatenate("columns")

    @property
    def truth(self) -> dict[str, NDArray[Any]]:
        """True values by record, arrays of shape (records,): changed parameters and errors of sensors.

        Parameters are in their units; 1 is healthy for an efficiency.
        """
        return self._concatenate("truth")

    def _concatenate(self, what: str) -> dict[str, NDArray[Any]]:
        import numpy as np

        parts = [getattr(piece, what) for piece in self.pieces()]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def to_frame(self) -> Any:
        """`arrays` as a pandas DataFrame, or a pyarrow Table where pandas is not installed."""
        return frame({name: values.tolist() for name, values in self.arrays().items()})

    def save(
        self, path: str | Path, format: str = "auto", *, truth: str | Path | None = None, header: bool = True
    ) -> None:
        """Write the recording as the command's ``-o`` does, completely or not at all.

        Parameters
        ----------
        path : str or Path
            The ending chooses the format: ``.csv``, ``.parquet``, ``.json``, ``.ndjson``; ``.gz`` packs.
        format : {"auto", "csv", "json", "ndjson", "table"}
            Overrides the ending.
        truth : str or Path, optional
            CSV or Parquet file for what is really wrong, record by record.
        header : bool
            Whether the lines of `provenance`, which name the fault files, head the files.

        Raises
        ------
        OSError
            Where a file cannot be written.
        """
        from enginediag_cli.report.output import Output

        self.write(Output(str(path), format, header), None if truth is None else str(truth))

    def write(self, output: Output, truth: str | None = None) -> None:
        """Write the recording to an output, and the truth beside it, piece by piece. Raises DataError, OSError."""
        from itertools import chain

        from enginediag_cli.recordings.write import open_recording_output
        from enginediag_cli.report.output import RECORDING_FORMATS
        from enginediag_cli.simulation.simulate import to_recording

        head = self.provenance if output.header else ()
        pieces = self.pieces()
        first = next(pieces)  # an error in the first piece leaves no output behind
        with ExitStack() as files:
            hidden = files.enter_context(open_recording_output(truth, head)) if truth else None

            def write_truth() -> Iterator[Simulated]:
                for piece in chain([first], pieces):
                    if hidden is not None:
                        hidden.write(to_recording(piece.truth))
                    yield piece

            if output.chosen_format() in RECORDING_FORMATS and not output.columns:
                writer = files.enter_context(output.open_recording(head))
                for piece in write_truth():
                    writer.write(to_recording(piece.columns))
                return
            names = tuple(first.columns)
            output.write_rows(_rows(write_truth()), names, summary=(*self.summary_columns, *names), provenance=head)


def _rows(pieces: Iterable[Simulated]) -> Iterator[Row]:
    for piece in pieces:
        names = tuple(piece.columns)
        for values in zip(*(column.tolist() for column in piece.columns.values()), strict=True):
            yield dict(zip(names, values, strict=True))


def simulate(
    engine: EngineLike | None = None,
    *,
    nominal: NominalLike = None,
    health: HealthLike = None,
    engine_instance: str = "",
    instruments: bool = False,
    flight: str | Path | None = None,
    conditions: RecordingsLike = None,
    faults: FaultsLike = (),
    noise: str | None = None,
    flights: int | None = None,
    records: int | None = None,
    steady: bool = False,
    seed: int = 0,
    messages: Messages | None = None,
    stream: bool = False,
    accept_changed_engine: bool = False,
) -> SimulationResult:
    """Simulate what the sensors of an engine record.

    Points that the engine cannot reach keep their record, with empty readings and the reason in ``status``. The same
    seed gives the same flights and the same noise, with faults or without.

    Parameters
    ----------
    engine : str, Path or Engine, optional
        Engine YAML, or a loaded engine.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine, instead of `engine`: its parameters, errors of maps and sensor noise are as identified.
    health : str, Path or TrendResult, optional
        What `trend` found with this `nominal`, one row per parameter: today's changes of components are in the engine
        from the first record on.
    engine_instance : str
        The engine among those of `health`, where it has several.
    instruments : bool
        Also implant the errors of instruments that `health` has.
    flight : str or Path, optional
        Flight YAML; without it and `conditions`, a few flights of an airliner.
    conditions : recording, optional
        Operating conditions record by record: a path, a mapping of column name to array of shape (records,), or a
        DataFrame; units are in the names.
    faults : path, sequence of paths, or FaultSet
        Faults to implant.
    noise : {"none", "gaussian", "uniform", "correlated", "quantised"}, optional
        Noise of the sensors; that of the flight file, or gaussian, when not given.
    flights, records : int, optional
        Number of flights; end after so many records.
    steady : bool
        Treat every record as steady, even for an engine with states.
    seed : int
        Seed of everything random.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    stream : bool
        Simulate only as records are written, in bounded memory.
    accept_changed_engine : bool
        Use the engine file although it has changed since the identification.

    Returns
    -------
    SimulationResult

    Raises
    ------
    UsageError, ConfigError, DataError

    Examples
    --------
    >>> from enginediag_cli import simulate
    >>> flown = simulate("turbojet.yaml", records=3, noise="none")
    >>> flown.arrays()["status"].tolist()
    ['ok', 'ok', 'ok']
    """
    from enginediag_cli.api.results import MessageLog
    from enginediag_cli.faults.catalogue import FaultSet, load_faults

    choices = SimulationChoices(flight, conditions, noise, flights, records, steady, seed)
    choices.check()
    if (engine is None) == (nominal is None):
        raise UsageError("give ENGINE or --nominal, one of them: a nominal file contains its engine")
    if health is None and (engine_instance or instruments):
        raise UsageError("--engine-instance and --instruments are about what --health found, which is not given")
    if health is not None and nominal is None:
        raise UsageError("--health needs --nominal: what trend found are changes from it")
    log = messages if messages is not None else MessageLog()
    model, files = _identified_engine(nominal, accept_changed_engine) if engine is None else _plain_engine(engine)
    if not isinstance(faults, FaultSet):
        several = [faults] if isinstance(faults, (str, Path)) else list(faults)
        paths = [str(own_or_shipped(file)) for file in several]
        files, faults = [*files, *paths], load_faults(*paths)
    if health is not None:
        if isinstance(health, (str, Path)):
            files.append(str(health))
        found = _health_faults(health, engine_instance, instruments, model, log)
        faults = FaultSet((*found.components, *faults.components), (*found.sensors, *faults.sensors))
    return SimulationResult(model, faults, files, choices, log).complete(stream)


def _plain_engine(engine: EngineLike) -> tuple[Engine, list[str]]:
    model = resolve_engine(engine)
    return model, [str(model.path)]


def _identified_engine(nominal: NominalLike, accept_changed_engine: bool) -> tuple[NominalEngine, list[str]]:
    """Build the engine of a nominal state, with its parameters and noise; also name the nominal file."""
    from enginediag_cli.engine.wrapped import NominalEngine

    baseline = resolve_baseline(nominal, accept_changed_engine=accept_changed_engine)
    assert baseline is not None
    found, engine = baseline.nominal, baseline.engine
    model = engine if found.error_model is None else found.error_model.wrap(engine)
    files = [path for path in (baseline.path,) if Path(path).is_file()]
    return NominalEngine(model, engine, found.theta0, found.sigma, found.rho1), files


def _health_faults(
    health: HealthLike, instance: str, instruments: bool, engine: Engine | NominalEngine, messages: Any
) -> FaultSet:
    """Make the faults that bring an engine into the state in which `trend` found it at its last flight."""
    from enginediag_cli.engine.instrument_errors import forms
    from enginediag_cli.faults.catalogue import faults_from_changes
    from enginediag_cli.report.sentences import change as words

    rows, name = _health_rows(health, instance)
    changes = [(row, size) for row in rows if not isnan(size := row.number("change"))]
    wrong = {e.parameter.name: e.parameter for column in engine.inputs for e in forms(engine, column)}
    meaning = {**wrong, **engine.parameters}
    sizes: dict[str, float] = {}
    for row, size in changes:
        parameter = row.text("parameter")
        known = meaning.get(parameter)
        if instruments or known is None or not known.belongs_to_instrument:
            sizes[parameter] = sizes.get(parameter, 0.0) + size
    whose = f"engine {name}: " if name else ""
    faults = faults_from_changes(f"found in engine {name}" if name else "found", sizes, engine)
    verdict = rows[0].text("verdict")
    if sizes:
        messages.note(f"{whose}flown with {'; '.join(words(meaning[n], size) for n, size in sizes.items() if size)}")
    else:
        messages.warning(f"{whose}flown as identified: trend's verdict is {verdict!r}, and names no change to implant")
    others = sorted({rival for row, _ in changes for rival in row.list("rivals")})
    if others:
        messages.warning(f"{whose}the likeliest suspects were implanted; trend also suspects {', '.join(others)}")
    return faults


def _health_rows(health: HealthLike, instance: str) -> tuple[list[ResultRow], str]:
    """Choose the rows of one engine of what `trend` found, and the name of the engine. Raises DataError, UsageError."""
    import os

    from enginediag_cli.report.plotting import RowOrigin
    from enginediag_cli.report.result_files import TREND, Row, read_result, table_kind

    if isinstance(health, (str, Path)):
        label = os.path.basename(str(health))
        read = read_result(str(health), label)
        rows, of_trend = list(read.rows), read.kind is TREND
    else:
        label = "the result"
        rows = [Row(row, RowOrigin(label, str(k))) for k, row in enumerate(health.rows, start=1)]
        of_trend = bool(rows) and table_kind(tuple(rows[0].cells)) is TREND
    if not of_trend or not rows:
        raise DataError(
            f"{label}: no rows by parameter of trend; write them with `enginediag trend -n … -o found.json`"
        )
    engines = list(dict.fromkeys(row.text("engine") for row in rows))
    if instance and instance not in engines:
        raise UsageError(f"--engine-instance: {label} has no engine {instance!r}, but {', '.join(engines)}")
    if len(engines) > 1 and not instance:
        raise UsageError(f"{label} has engines {', '.join(engines)}; choose one with --engine-instance")
    name = instance or engines[0]
    return [row for row in rows if row.text("engine") == name], name
