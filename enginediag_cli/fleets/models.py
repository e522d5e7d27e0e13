"""Models and work of a fleet: the nominal state of each build, the keys of its statistics, and where tasks run.

Nominal state: the build's own nominal file, that of the store, or a common model that is identified now from the
healthy early life of some of its engines. Keys: statistics are kept under recording, nominal state and settings;
`store_status` and `merge_stores` list and unite them. Runners: tasks run in this process, in several processes of this
machine, or on an existing Dask cluster, which retries them. Of a cluster only the scheduler is addressed; recordings,
nominal files and the store are files that the workers see under the same paths.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from enginediag_cli import __version__
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError
from enginediag_cli.fleets.fleet_file import Build, Fleet, FleetBaseline, FleetRecording, natural_order
from enginediag_cli.fleets.store import NOMINALS, RECORDINGS, CondensingSettings, FleetStore
from enginediag_cli.identification.problem import TrainingRecording, training_recordings
from enginediag_cli.intake.agreement import AgreementCheck, check_against_engine
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, RequiredColumns, required_columns
from enginediag_cli.parallel import TASKS_PER_WORKER, ProcessPool
from enginediag_cli.recordings.source import file_sha256
from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.recordings.write import open_binary_output
from enginediag_cli.residuals.windows import group_rows

if TYPE_CHECKING:
    from enginediag_cli.identification.identify import Identification


FEWEST_ENGINES = 3
"""Engines that are kept where their flights hold more records than required: one is no fleet, of two none is
common."""


@dataclass(frozen=True)
class CommonModel:
    """A nominal file written to `path`, the serial numbers that it rests on, and the result behind it."""

    path: Path
    engines: tuple[str, ...]
    records: int
    result: Identification


def model_key(fleet: Fleet, build: Build) -> str:
    """Fingerprint of the common model of a build: its engine, recorder, baseline and settings, but not which
    recordings there are, for a fleet that flew on is compared with the model that it had."""
    assert build.engine is not None
    recorder = file_sha256(build.recorder) if build.recorder else ""
    told = (
        __version__,
        file_sha256(build.engine),
        recorder,
        fleet.baseline,
        sorted(fleet.identify.items()),
        build.name,
    )
    return hashlib.sha256("\n".join(map(str, told)).encode()).hexdigest()[:32]


def identify_common(fleet: Fleet, build: Build, recordings: Sequence[FleetRecording], path: Path) -> CommonModel:
    """Identify the model of a build and write its nominal file, unless another run has done so meanwhile. Raises
    DataError, and NoVerdictError when there is none."""
    from enginediag_cli.engine.load import EngineDescription
    from enginediag_cli.identification.identify import identify
    from enginediag_cli.identification.nominal_file import write_nominal
    from enginediag_cli.identification.probes import drop_probes, wrong_probes
    from enginediag_cli.identification.problem import drop_repeats
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.residuals.monitor import monitor_from_nominal
    from enginediag_cli.residuals.reduced import is_smooth

    assert build.engine is not None
    engine = load_engine(build.engine)
    described = EngineDescription.from_engine_file(str(build.engine), engine.declared)
    wanted, agreement = required_columns(engine, past=True), check_against_engine(engine)
    early = _choose_lives(_early_lives(fleet, build, recordings, wanted, agreement), fleet.identify)
    training = [recording for life in early for recording in life.training()]
    if not training:
        raise NoVerdictError(f"build {build.name}: its recordings hold no record to identify a model from")
    training, _ = drop_repeats(training, (*engine.inputs, *engine.sensors))
    wrong = wrong_probes(engine, training)
    left = tuple(w.columns[0] for w in wrong if w.is_unique and w.columns[0] in engine.sensors)
    training = drop_probes(training, left)
    result = identify(engine, training, map_accuracy=fleet.identify["model_error"])
    if not result.converged or result.bounds:
        why = result.reason if not result.converged else "parameters end at their bounds; identify says more"
        raise NoVerdictError(f"build {build.name}: no nominal state: {why}")
    serials = tuple(life.serial for life in early)
    provenance = {"enginediag": __version__, "fleet": fleet.path.name, "baseline": str(fleet.baseline)}
    provenance |= {"engines": ", ".join(serials)}
    nominal = result.nominal(build.engine.name, described.sha256, provenance)
    smooth = is_smooth(monitor_from_nominal(engine, nominal))
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    write_nominal(replace(nominal, smooth=smooth, description=described), str(partial))
    try:
        os.link(partial, path)  # whoever comes first: two runs at once go on with the same model
    except FileExistsError:
        pass
    finally:
        partial.unlink()
    records = sum(len(next(iter(t.columns.values()))) for t in training)
    return CommonModel(path, serials, records, result)


@dataclass
class _EarlyLife:
    """The first flights of one engine, each as parts of a recording in its order; full: a flight beyond has come."""

    serial: str
    flights: dict[tuple[str, str], list[Recording]] = field(default_factory=dict)
    records: int = 0
    full: bool = False

    def take(self, key: tuple[str, str], part: Recording, baseline: FleetBaseline) -> None:
        if self.full:
            return
        if baseline.flights is not None:
            if not key[1]:  # a recording without flights: every record is one
                part = part.select(slice(0, baseline.flights - self.records))
                self.full = self.records + len(part) >= baseline.flights
            elif key not in self.flights and len(self.flights) >= baseline.flights:
                self.full = True
                return
        else:
            part = part.select(slice(0, (baseline.records or 0) - self.records))
            self.full = self.records + len(part) >= (baseline.records or 0)
        if len(part):
            self.flights.setdefault(key, []).append(part)
            self.records += len(part)

    def forget(self, file: str) -> None:
        """Leave out what was taken of a file that could not be read to its end."""
        gone = [key for key in self.flights if key[0] == file]
        self.records -= sum(len(part) for key in gone for part in self.flights.pop(key))
        self.full = self.full and not gone

    def training(self) -> Iterator[TrainingRecording]:
        by_file: dict[str, list[Recording]] = {}
        for (file, _), parts in self.flights.items():
            by_file.setdefault(file, []).extend(parts)
        for file, parts in by_file.items():
            for found in training_recordings(concat(parts), f"{self.serial}: {os.path.basename(file)}"):
                yield found._replace(engine=self.serial)

    def shortened(self, most: int) -> _EarlyLife:
        """Its first whole flights of at most `most` records, one at least."""
        kept: dict[tuple[str, str], list[Recording]] = {}
        total = 0
        for key, parts in self.flights.items():
            size = sum(map(len, parts))
            if kept and total + size > most:
                break
            kept[key], total = parts, total + size
        return _EarlyLife(self.serial, kept, total, True)


def _early_lives(
    fleet: Fleet,
    build: Build,
    recordings: Sequence[FleetRecording],
    wanted: RequiredColumns,
    agreement: AgreementCheck | None,
) -> list[_EarlyLife]:
    """Early lives of engines, no more recordings read than are needed for the required number; those that
    cannot be of the engine take no part. Raises DataError where none can."""
    wrong: list[EngineDiagError] = []
    most = int(fleet.identify["engines"])
    lives: dict[str, _EarlyLife] = {}
    for recorded in _choose_recordings(recordings, most):
        if not recorded.serial and sum(life.full for life in lives.values()) >= most:
            break
        recorder = str(build.recorder) if build.recorder else None
        source = RecordingSource((recorded.path,), recorder, accept_mismatch=fleet.accept_mismatch)
        intake = RecordingLoader(source, wanted, fleet=True, agreement=agreement)
        try:
            for key, part in _flight_parts(intake, recorded):
                life = lives.setdefault(key[2], _EarlyLife(key[2]))
                life.take(key[:2], part, fleet.baseline)
                if recorded.serial and life.full:
                    break
        except (DataError, NoVerdictError) as error:  # named again, with the reason, when it is condensed
            wrong.append(error)
            for life in lives.values():
                life.forget(recorded.path)
    if wrong and not any(life.records for life in lives.values()):
        raise wrong[0]
    return sorted(lives.values(), key=lambda life: natural_order(life.serial))


def _choose_recordings(recordings: Sequence[FleetRecording], most: int) -> list[FleetRecording]:
    """Those of `most` serial numbers, evenly chosen, where names hold them; else all."""
    serials = sorted({r.serial for r in recordings}, key=natural_order)
    chosen = {serials[k] for k in _evenly_spaced(len(serials), most)}
    return [r for r in recordings if r.serial in chosen]


def _flight_parts(
    intake: RecordingLoader, recorded: FleetRecording
) -> Iterator[tuple[tuple[str, str, str], Recording]]:
    """((file, flight, serial number), records) of each flight in each chunk."""
    for chunk in intake.chunks():
        for (_, flight, engine), rows in group_rows(chunk):
            yield (recorded.path, flight, recorded.serial or engine), chunk.select(rows)


def _choose_lives(lives: Sequence[_EarlyLife], asked: Mapping[str, int]) -> list[_EarlyLife]:
    """As many engines, evenly chosen, and as many whole flights of each, as hold no more records than required."""
    lives = [life for life in lives if life.records]
    lives = [lives[k] for k in _evenly_spaced(len(lives), int(asked["engines"]))]
    if not lives or sum(life.records for life in lives) <= asked["records"]:
        return lives
    short = [life.shortened(int(asked["records"]) // len(lives)) for life in lives]
    fewer = int(len(short) * asked["records"] / max(sum(life.records for life in short), 1))
    return [short[k] for k in _evenly_spaced(len(short), max(fewer, FEWEST_ENGINES))]


def _evenly_spaced(n: int, most: int) -> list[int]:
    """At most `most` of n numbers, evenly chosen."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)).tolist() if n else []


@dataclass(frozen=True)
class BuildModel:
    """The nominal state with which the recordings of a build are compared. identified: None where the nominal file was
    given, or found in the store."""

    build: Build
    settings: CondensingSettings
    identified: CommonModel | None = None


def nominal_path(fleet: Fleet, build: Build, store: FleetStore) -> Path:
    """The nominal file of a build: its own, or where the store has it once it is identified."""
    return build.nominal or store.nominal(model_key(fleet, build))


def build_model(fleet: Fleet, build: Build, recordings: Sequence[FleetRecording], store: FleetStore) -> BuildModel:
    """The nominal state of a build: its own, that of the store, or one identified now. Raises
    ConfigError, DataError, NoVerdictError."""
    path, identified = nominal_path(fleet, build, store), None
    if not path.exists():
        mine = [r for r in recordings if r.build == build.name and not r.trouble]
        identified = identify_common(fleet, build, mine, path)
    return BuildModel(build, condensing_settings(fleet, build, path), identified)


def condensing_settings(fleet: Fleet, build: Build, nominal: Path) -> CondensingSettings:
    """How recordings of a build are reduced to statistics."""
    fingerprint = file_sha256(nominal)
    recorder = os.path.abspath(build.recorder) if build.recorder else ""
    digest = file_sha256(recorder) if recorder else ""
    linearise = str(fleet.judge["linearise"])
    accepted = fleet.accept_mismatch
    return CondensingSettings(os.path.abspath(nominal), fingerprint, recorder, digest, fleet.plan, linearise, accepted)


ABANDONED_S = 3600.0
"""Age at which a half-written file is one of a run that was killed: no recording is in work for an hour."""


@dataclass(frozen=True)
class StoreStatus:
    """How far a store holds a fleet.

    Attributes
    ----------
    recordings : tuple of (FleetRecording, str)
        Each with the key of its statistics; "" where the store lacks them.
    models : dict of str to bool
        Build → whether its model is there.
    others : tuple of str
        Keys of recordings of other fleets or settings.
    bytes : int
        Size of the whole store.
    """

    recordings: tuple[tuple[FleetRecording, str], ...]
    models: dict[str, bool]
    others: tuple[str, ...]
    bytes: int


def store_status(fleet: Fleet, recordings: Sequence[FleetRecording], store: FleetStore) -> StoreStatus:
    """Compare a store with a fleet.

    Parameters
    ----------
    fleet : Fleet
        The fleet file.
    recordings : sequence of FleetRecording
        As `find_recordings` gives them.
    store : FleetStore
        The store.

    Returns
    -------
    StoreStatus

    Raises
    ------
    DataError
        When there is no store.
    """
    _require_store(store)
    makings = {}
    for build in fleet.builds:
        path = nominal_path(fleet, build, store)
        makings[build.name] = condensing_settings(fleet, build, path) if path.exists() else None
    there = set(store.keys())
    known = []
    for recorded in recordings:
        making = makings[recorded.build]
        key = making.key(file_sha256(recorded.path)) if making is not None and not recorded.trouble else ""
        known.append((recorded, key if key in there else ""))
    others = sorted(there - {key for _, key in known})
    return StoreStatus(
        tuple(known), {n: m is not None for n, m in makings.items()}, tuple(others), _folder_size(store.folder)
    )


def prune_store(
    fleet: Fleet, recordings: Sequence[FleetRecording], store: FleetStore, *, only_tell: bool = False
) -> list[Path]:
    """Remove what is not this fleet's, and what killed runs have left half-written; the files, removed or, with
    `only_tell`, to be removed. Raises DataError when there is no store, OSError."""
    found = store_status(fleet, recordings, store)
    files = [store.path(key) for key in found.others]
    mine = {nominal_path(fleet, build, store) for build in fleet.builds}
    files += [path for path in sorted((store.folder / NOMINALS).glob("*.yaml")) if path not in mine]
    files += [path for path in store.partial() if time.time() - path.stat().st_mtime > ABANDONED_S]
    for path in files if not only_tell else ():
        path.unlink(missing_ok=True)
    return files


@dataclass(frozen=True)
class MergeCounts:
    """Outcome of merging a store into another one.

    Attributes
    ----------
    copied, present : int
        Recordings that were copied, and that the store had.
    damaged : tuple of str
        Files that were excluded.
    models : int
        Nominal files copied.
    other_models : tuple of str
        Keys of models that differ between the two stores.
    """

    copied: int
    present: int
    damaged: tuple[str, ...]
    models: int
    other_models: tuple[str, ...]


def merge_stores(into: FleetStore, other: FleetStore) -> MergeCounts:
    """Copy into a store what another one has and it lacks.

    Parameters
    ----------
    into, other : FleetStore
        Store that receives, and store that is read.

    Returns
    -------
    MergeCounts

    Raises
    ------
    DataError
        When the other store does not exist.
    OSError
    """
    _require_store(other)
    copied, there, damaged = 0, 0, []
    for key in other.keys():
        if into.path(key).exists():
            there += 1
        elif other.find(key) is None:
            damaged.append(key)
        else:
            _copy_file(other.path(key), into.path(key))
            copied += 1
    models, differ = 0, []
    for path in sorted((other.folder / NOMINALS).glob("*.yaml")):
        mine = into.nominal(path.stem)
        if not mine.exists():
            _copy_file(path, mine)
            models += 1
        elif file_sha256(mine) != file_sha256(path):
            differ.append(path.stem)
    merge_acknowledgements(into, other)
    return MergeCounts(copied, there, tuple(damaged), models, tuple(differ))


def merge_acknowledgements(into: FleetStore, other: FleetStore) -> None:
    """Of each engine the later one of two stores."""
    mine, theirs = into.acknowledgements(), other.acknowledgements()
    later = {serial: x for serial, x in theirs.items() if serial not in mine or x.date > mine[serial].date}
    if later:
        into.keep_acknowledgements({**mine, **later})


def _copy_file(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with open(source, "rb") as given, open_binary_output(target) as stream:
        shutil.copyfileobj(given, stream)


def _require_store(store: FleetStore) -> None:
    if not any((store.folder / name).is_dir() for name in (RECORDINGS, NOMINALS)):
        raise DataError(f"{store.folder}: there is no store of a fleet; `enginediag fleet … --store` makes one")


def _folder_size(folder: Path) -> int:
    return sum(path.stat().st_size for path in _folder_files(folder))


def _folder_files(folder: Path) -> Iterator[Path]:
    for where, _, names in os.walk(folder):
        yield from (Path(where) / name for name in names)


Task = TypeVar("Task")
Result = TypeVar("Result")

ADVICE = "statistics already computed are kept with --store; use fewer --jobs"
"""Where worker processes keep dying."""


class Runner(Protocol):
    """A place to work. `work`, tasks and results must be picklable."""

    @property
    def workers(self) -> int:
        """How many tasks are done at a time."""

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """Number, from 0, and result of each task as it is finished, in any order; tasks are taken as there is room
        for them. Raises what `work` raises."""

    def close(self) -> None:
        """Let the workers go."""


class SerialRunner:
    """One worker: this process."""

    workers = 1

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`, in order."""
        for number, task in enumerate(tasks):
            yield number, work(task)

    def close(self) -> None:
        """There is nobody to let go."""


@contextmanager
def open_runner(jobs: int, scheduler: str = "") -> Iterator[Runner]:
    """Open the place where tasks of a fleet run.

    Parameters
    ----------
    jobs : int
        1: this process; more: so many processes of this machine.
    scheduler : str
        Address of a Dask scheduler; "" for none.

    Yields
    ------
    Runner

    Raises
    ------
    DataError
        When Dask is not installed, or the cluster cannot be reached.
    """
    runner: Runner
    if scheduler:
        runner = DaskRunner(scheduler)
    elif jobs == 1:
        runner = SerialRunner()
    else:
        runner = ProcessPool(jobs, ADVICE)
    try:
        yield runner
    finally:
        runner.close()


RETRIES = 1
"""Times that a task that failed is begun again, for what passes by itself, such as a file server out of reach. One
whose worker died is begun again by the cluster's own rule."""
CONNECT_S = 5
"""Seconds that a scheduler may take to answer, and its first worker to be there."""
KEPT = "statistics already computed are kept with --store"
HINT = "pip install 'enginediag[fleet]'"


class DaskRunner:
    """The workers of the cluster whose scheduler is at `address`."""

    def __init__(self, address: str):
        """Raises DataError when nobody answers there, or Dask is not installed."""
        try:
            from distributed import Client
        except ImportError:
            raise DataError(f"--scheduler needs Dask, which is not installed: {HINT}, or work with --jobs") from None
        try:
            self._client: Any = _connect_in_time(partial(Client, address, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TimeoutError, asyncio.TimeoutError) as error:
            raise DataError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None

        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
        except (TimeoutError, asyncio.TimeoutError):  # one only from Python 3.11 on
            self._client.close()
            raise DataError(f"--scheduler {address}: it has no workers; start some, such as `dask worker`") from None
        self._check_versions(address)

    def _check_versions(self, address: str) -> None:
        """DataError unless every worker has this version of the program."""
        try:
            found = self._client.run(worker_version)
        except ModuleNotFoundError:
            found = {"its workers": "none"}
        for worker, other in found.items():
            if other != __version__:
                self._client.close()
                raise DataError(f"--scheduler {address}: {worker} has enginediag {other}, here is {__version__}")

    @property
    def workers(self) -> int:
        """Threads of the cluster as it is now; one where it has none yet."""
        return max(sum(self._client.nthreads().values()), 1)

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """As `Runner.run`. Raises ClusterError when a task has killed its workers, or the scheduler is gone."""
        from distributed import as_completed

        waiting = enumerate(tasks)
        numbers: dict[str, int] = {}
        finished = as_completed(loop=self._client.loop)

        def hand_out(count: int) -> None:
            for number, task in islice(waiting, count):
                # the number is part of the name: two tasks that are alike are two all the same
                future = self._client.submit(work, task, retries=RETRIES, pure=False)
                numbers[future.key] = number
                finished.add(future)

        hand_out(TASKS_PER_WORKER * self.workers)
        try:
            for future in finished:
                yield numbers.pop(future.key), self._result(future)
                hand_out(max(TASKS_PER_WORKER * self.workers - len(numbers), 0))
        finally:
            finished.clear()

    @staticmethod
    def _result(future: Any) -> Any:
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            what = f"a task has ended its workers, at last {error.last_worker.address}, perhaps because memory ran out"
            raise ClusterError(f"{what}; {KEPT}") from None
        except FutureCancelledError:
            raise ClusterError(f"the scheduler is gone; {KEPT}") from None
        finally:
            future.release()

    def close(self) -> None:
        """Leave the cluster, which goes on without us."""
        self._client.close()


def _connect_in_time(connect: Callable[[], Any]) -> Any:
    """What `connect` gives. TimeoutError where something listens that never answers, for which Dask waits on and on."""
    found: Future[Any] = Future()

    def work() -> None:
        try:
            found.set_result(connect())
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return found.result(2 * CONNECT_S)
    except FutureTimeoutError:
        if found.done():
            raise
        raise TimeoutError("what listens there does not answer as a scheduler does") from None


def worker_version() -> str:
    """Of the program, where this is called."""
    return __version__


class ClusterError(EngineDiagError):
    """The cluster could not do what it was given."""
