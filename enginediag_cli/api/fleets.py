"""`fleet`: many engines, from their recordings to a ranking; and the store in which what they come to is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import RecordingsLike, resolve_recordings
from enginediag_cli.api.results import DocumentResult, MessageLog, Picture, Result, Row
from enginediag_cli.errors import NoVerdictError, UsageError
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    from enginediag_cli.fleets.findings import Acknowledgement
    from enginediag_cli.fleets.fleet_file import Fleet, FleetRecording
    from enginediag_cli.fleets.models import MergeCounts, StoreStatus
    from enginediag_cli.fleets.run import FleetRun

__all__ = ["FleetResult", "StoreResult", "acknowledge", "fleet", "fleet_status", "merge_stores", "prune_store"]

WHAT = ("engines", "health", "flights")
STATUS_COLUMNS = ("recording", "build", "engine", "state")


class FleetResult(DocumentResult):
    """What was found in a fleet; see `fleet`.

    Attributes
    ----------
    run : FleetRun
        Models, recordings with their state, and `finding`: the engines, worst first.
    found, judged : int
        Engines flagged, or with a stuck or noisy instrument; engines with a verdict.
    """

    def __init__(self, run: FleetRun, what: str, head: Callable[[], tuple[str, ...]], messages: Messages):
        from enginediag_cli.report.tables.fleet import TERMINAL

        self.run, self._what = run, what
        super().__init__(head=head, summary_columns=TERMINAL if what == "engines" else (), messages=messages)
        engines, listed = run.finding.engines, run.finding.flagged.engines
        self.findings = sum(engine.serial in listed or bool(engine.instruments) for engine in engines)
        self.judged = sum(engine.verdict != "no verdict" for engine in engines)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.fleet import report_fleet, report_models

        report_models(self.messages, self.run)
        yield from self.tabulate(self._what)
        report_fleet(self.messages, self.run)

    def tabulate(self, what: str) -> list[Row]:
        """Return the rows of one of the tables.

        Parameters
        ----------
        what : {"engines", "health", "flights"}
            Engines, worst first; one row per engine and parameter; or one per engine and flight.

        Returns
        -------
        list of dict
        """
        from enginediag_cli.report.tables.fleet import ROWS

        return list(ROWS[_table(what)](self.run))

    @property
    def engines(self) -> list[Row]:
        """One row per engine, worst first."""
        return self.tabulate("engines")

    @property
    def health(self) -> list[Row]:
        """One row per engine and parameter: its change, with unit and 95 % interval, onset and rate."""
        return self.tabulate("health")

    @property
    def flights(self) -> list[Row]:
        """One row per engine and flight."""
        return self.tabulate("flights")

    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        from enginediag_cli.report.tables.fleet import document

        return document(self.run, provenance)

    def plot(self) -> Picture:
        """Draw the engines by severity with 95 % intervals. Raises NoVerdictError where no engine has a severity."""
        from enginediag_cli.report.plotting.health import fleet_ranking, read_engines
        from enginediag_cli.report.plotting.models import chart_svg

        chart = fleet_ranking("fleet", read_engines(self.to_dict(), "fleet"))
        if not chart.layers:
            raise NoVerdictError("no engine of the fleet has a severity that could be drawn")
        return Picture(chart_svg(chart))


def fleet(
    fleet_file: str | Path,
    recordings: RecordingsLike = (),
    *,
    what: str = "engines",
    jobs: int | None = None,
    scheduler: str = "",
    store: str | Path | None = None,
    accept_mismatch: bool = False,
    messages: Messages | None = None,
) -> FleetResult:
    """Judge all engines of a fleet, rank them by severity, and find what is common to them.

    Parameters
    ----------
    fleet_file : str or Path
        Fleet YAML: recordings, engines, their healthy early life, maintenance, what to judge.
    recordings
        Instead of those in the fleet file; see `read_recordings`.
    what : {"engines", "health", "flights"}
        Table of the rows; the document, `to_dict`, has all three.
    jobs : int, optional
        Number of processes, by default one per core. The result does not depend on it.
    scheduler : str
        Address of a Dask scheduler, instead of processes; needs `store`.
    store : str or Path, optional
        Folder for reduced recordings, so that the next run processes only new ones.
    accept_mismatch : bool
        Go on with recordings that cannot be of the engine, or in these units.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.

    Returns
    -------
    FleetResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    OSError
        Where the store cannot be written.
    """
    if jobs and scheduler:
        raise UsageError("--jobs and --scheduler exclude each other: the cluster has its own workers")
    if scheduler and not store:
        raise UsageError("--scheduler needs --store, a folder that the workers share")
    _table(what)
    import os

    from enginediag_cli.fleets.models import open_runner
    from enginediag_cli.fleets.run import run_fleet
    from enginediag_cli.fleets.store import opened_store
    from enginediag_cli.recordings.source import header_lines

    with _described(fleet_file, recordings) as (described, found):
        if accept_mismatch:
            described = replace(described, accept_mismatch=True)
        with opened_store(store) as kept, open_runner(jobs or os.cpu_count() or 1, scheduler) as runner:
            run = run_fleet(described, found, kept, runner)
    configs = [described.path, *described.configs]
    result = FleetResult(run, what, lambda: header_lines("fleet", configs=configs), _log(messages))
    return result.complete()


class StoreResult(Result):
    """State of the recordings of a fleet in a store, one row each; see `fleet_status`.

    Attributes
    ----------
    standing : Standing
        Keys of reduced recordings, models, content of other fleets, size in bytes.
    found, judged : int
        Reduced recordings, and recordings of the fleet.
    """

    def __init__(self, standing: StoreStatus, messages: Messages):
        self.standing = standing
        super().__init__(columns=STATUS_COLUMNS, messages=messages)
        self.findings, self.judged = sum(bool(key) for _, key in standing.recordings), len(standing.recordings)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.fleet import report_standing, status_rows

        yield from status_rows(self.standing)
        report_standing(self.messages, self.standing)


def fleet_status(
    fleet_file: str | Path, store: str | Path, recordings: RecordingsLike = (), *, messages: Messages | None = None
) -> StoreResult:
    """List which recordings of a fleet are reduced in a store, and which are new.

    Parameters
    ----------
    fleet_file : str or Path
        Fleet YAML.
    store : str or Path
        Folder of the store.
    recordings
        Instead of those in the fleet file; see `read_recordings`.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.

    Returns
    -------
    StoreResult

    Raises
    ------
    ConfigError, DataError, NoVerdictError
    """
    from enginediag_cli.fleets.models import store_status
    from enginediag_cli.fleets.store import FleetStore

    with _described(fleet_file, recordings) as (described, found):
        return StoreResult(store_status(described, found, FleetStore(store)), _log(messages)).complete()


def acknowledge(
    fleet_file: str | Path,
    store: str | Path,
    engine: str,
    recordings: RecordingsLike = (),
    *,
    parameters: Sequence[str] = (),
    note: str = "",
    withdraw: bool = False,
    jobs: int | None = None,
    messages: Messages | None = None,
) -> Acknowledgement | None:
    """Acknowledge what is found in an engine: it is not raised again unless it grows.

    Parameters
    ----------
    fleet_file : str or Path
        Fleet YAML.
    store : str or Path
        Folder of the store, which keeps the acknowledgement.
    engine : str
        Serial number.
    recordings
        Instead of those in the fleet file; see `read_recordings`.
    parameters : sequence of str
        Only these changes; all by default.
    note : str
        Why, in words.
    withdraw : bool
        Raise it again.
    jobs : int, optional
        Number of processes, by default one per core.
    messages : Messages, optional
        Receives what was acknowledged; by default it is collected.

    Returns
    -------
    Acknowledgement or None
        With date, number of flights and the changes with 95 % intervals; None where it was withdrawn.

    Raises
    ------
    UsageError, ConfigError, NoVerdictError, OSError
    DataError
        For an engine or change that is not there.
    """
    from datetime import datetime, timezone

    from enginediag_cli.config.fields import near
    from enginediag_cli.errors import DataError
    from enginediag_cli.fleets.findings import acknowledge_finding
    from enginediag_cli.fleets.store import FleetStore
    from enginediag_cli.report.tables.fleet import report_acknowledged

    kept, log = FleetStore(store), _log(messages)
    known = kept.acknowledgements()
    if withdraw:
        if engine not in known:
            raise DataError(f"--engine: nothing is acknowledged of {engine!r}; {near(engine, known)}")
        kept.keep_acknowledgements({serial: x for serial, x in known.items() if serial != engine})
        log.note(f"engine {engine}: withdrawn, it is raised again")
        return None
    found = fleet(fleet_file, recordings, store=store, jobs=jobs).run.finding
    mine = next((x for x in found.engines if x.serial == engine), None)
    if mine is None:
        raise DataError(f"--engine: no engine is called {engine!r}; {near(engine, [x.serial for x in found.engines])}")
    made = acknowledge_finding(mine, f"{datetime.now(timezone.utc):%Y-%m-%d}", note, parameters)
    kept.keep_acknowledgements({**known, engine: made})
    report_acknowledged(log, [mine.compare_acknowledged(made)])
    return made


def prune_store(
    fleet_file: str | Path,
    store: str | Path,
    recordings: RecordingsLike = (),
    *,
    dry_run: bool = False,
    messages: Messages | None = None,
) -> list[Path]:
    """Remove from a store what a fleet does not need.

    These are other recordings, those reduced with another nominal file or other settings, and incomplete files of
    interrupted runs.

    Parameters
    ----------
    fleet_file : str or Path
        Fleet YAML.
    store : str or Path
        Folder of the store.
    recordings
        Instead of those in the fleet file; see `read_recordings`.
    dry_run : bool
        Remove nothing.
    messages : Messages, optional
        Receives how many files were removed.

    Returns
    -------
    list of Path
        Files that were removed or, with `dry_run`, would be.

    Raises
    ------
    ConfigError, DataError, NoVerdictError, OSError
    """
    from enginediag_cli.fleets.models import prune_store
    from enginediag_cli.fleets.store import FleetStore
    from enginediag_cli.report.sentences import count

    with _described(fleet_file, recordings) as (described, found):
        files = prune_store(described, found, FleetStore(store), only_tell=dry_run)
    _log(messages).note(f"{count(len(files), 'file')} {'would be removed' if dry_run else 'removed'}")
    return files


def merge_stores(into: str | Path, *others: str | Path, messages: Messages | None = None) -> list[MergeCounts]:
    """Copy into a store what only other stores hold; these remain unchanged.

    Parameters
    ----------
    into : str or Path
        Folder of the store, which is made where there is none.
    *others : str or Path
        Folders of the other stores.
    messages : Messages, optional
        Receives the result for each.

    Returns
    -------
    list of MergeCounts
        For each of the others: how many recordings and models were copied, which were there, damaged, or differ.

    Raises
    ------
    DataError, OSError
    """
    from enginediag_cli.fleets.models import merge_stores
    from enginediag_cli.fleets.store import FleetStore
    from enginediag_cli.report.tables.fleet import report_merged

    found = []
    for other in others:
        found.append(merge_stores(FleetStore(into), FleetStore(other)))
        report_merged(_log(messages), str(other), found[-1])
    return found


def _table(what: str) -> str:
    """Return the name of a table. Raises UsageError for an unknown one."""
    if what not in WHAT:
        raise UsageError(f"--what: there is no {what!r}, but {', '.join(WHAT)}")
    return what


@contextmanager
def _described(
    fleet_file: str | Path, recordings: RecordingsLike
) -> Iterator[tuple[Fleet, tuple[FleetRecording, ...]]]:
    """Open a fleet and its recordings; arrays have scratch files within the block.

    Raises UsageError for recordings with a recorder of their own.
    """
    from enginediag_cli.fleets.fleet_file import find_recordings, load_fleet

    source = resolve_recordings(recordings)
    if source.recorder or source.engine_instance:
        raise UsageError(
            "the fleet file says by which recorder its recordings are read, and judges all of their engines"
        )
    described = load_fleet(own_or_shipped(fleet_file))
    described = replace(described, accept_mismatch=source.accept_mismatch)
    yield described, find_recordings(described, source.files)


def _log(messages: Messages | None) -> Messages:
    return messages if messages is not None else MessageLog()
