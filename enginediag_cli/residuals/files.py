"""Windows of files: recordings are condensed, statistics that `residual` wrote are read back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice

from enginediag_cli.engine.drifts import DRIFT, ELAPSED
from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.intake.intake import File, Intake
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.additive import as_read, marginalised, nuisance_of, unmarginalised
from enginediag_cli.residuals.admission import Elsewhere
from enginediag_cli.residuals.economy import Economy
from enginediag_cli.residuals.flat import is_flat
from enginediag_cli.residuals.gross_gate import GrossErrorGate
from enginediag_cli.residuals.groups import FlightHours
from enginediag_cli.residuals.lagging import with_lagging
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import reduced
from enginediag_cli.residuals.reference import last_records, windows_against_reference
from enginediag_cli.residuals.seal import DIGITS, MadeWith, plan_cells
from enginediag_cli.residuals.series_monitor import monitored_as_read
from enginediag_cli.residuals.statistics_file import Ledger, read_statistics, refuse_ignored_options
from enginediag_cli.residuals.window import WindowStatistics, not_read
from enginediag_cli.residuals.windows import WindowPlan

Window = tuple[WindowStatistics, Mapping[str, Parameter]]
"""Statistics of a window, and what its parameters are, by name."""


@dataclass(frozen=True)
class Judging:
    """How recordings become windows: the plan of windows; `linearise` as in `window_statistics`; reference and last:
    counts of records per flight and engine, 0 for none; `model_error`: accuracy of the maps by hand, None for what the
    nominal state says."""

    plan: WindowPlan = field(default_factory=WindowPlan)
    linearise: str = "estimate"
    reference: int = 0
    last: int = 0
    model_error: float | None = None

    @property
    def notes(self) -> Mapping[str, str]:
        """Choices that a result depends on, for its provenance."""
        told = {
            "reference": self.reference and f"first {self.reference}",
            "judged": self.last and f"last {self.last}",
            "model_error": "" if self.model_error is None else f"{self.model_error:g}",
        }
        return {name: str(value) for name, value in told.items() if value}


@dataclass
class JudgedFiles:
    """Windows of the files of an intake; monitor: None where all files hold statistics. `counts`: of records by what
    became of them (`records`, `outside`, `incomplete`, `failed`), of `windows` and of those with `statistics`, as far
    as they have been read; `elsewhere`: of records that training did not cover.
    passing: sees the chunks of recordings on their way. summed: windows of a flight are added up. given: names of the
    choices that the user made, which statistics would ignore. economy: chooses the form of the monitor for each file;
    None: always the one for few records. series: windows are compared with each other, see `series_monitor`, which goes
    without a reference. solutions: windows hold the engine's unknowns, too. additive: windows of recordings hold what
    is uncertain beside the monitored parameters, so that they add, as long as no reference is taken out of them.
    brief: no estimate is sought in recordings that are likelier wrong than the engine, which none explains.
    drifts: what statistics hold of drifts of instruments is read, too, which are suspects of isolation alone.
    `ledger`: what was read of statistics."""

    intake: Intake
    monitor: Monitor | None
    judging: Judging = field(default_factory=Judging)
    passing: Callable[[Iterable[Recording]], Iterable[Recording]] = iter
    summed: bool = False
    given: Mapping[str, object] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)
    economy: Economy | None = None
    series: bool = False
    solutions: bool = False
    additive: bool = False
    brief: bool = False
    drifts: bool = False

    _few: Monitor | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.monitor.nominal if self.monitor else "", summed=self.summed)

    def windows(self) -> Iterator[Window]:
        """All windows in turn. Raises DataError, NoVerdictError."""
        for file in self.intake.files():
            try:
                statistics = file.table is not None and is_flat(file.table.columns)
                for window, known in self._flat(file) if statistics else self._condensed(file):
                    self._count(window)
                    yield window if self.solutions else replace(window, solution=None), known
            except (DataError, NoVerdictError) as error:
                self.intake.excuse(file.name, error)
        for name, reason in self.intake.unread.items():
            yield not_read(name, reason), {}

    def _condensed(self, file: File) -> Iterator[Window]:
        monitor = self.monitor
        if monitor is None:
            raise DataError(f"{file.name}: a recording needs --nominal; only what residual has written does without")
        recordings: Iterable[Recording] = file.masked()
        if ELAPSED in monitor.engine.optional_inputs:
            recordings = FlightHours().written(recordings)
        if self.economy is not None:
            monitor, recordings = self.economy.of(recordings)
        else:
            monitor = self._reduced(monitor)
        gate = GrossErrorGate(monitor)
        recordings = self.passing(gate.clean(recordings))
        for window in self._windows(monitor, recordings, file.name):
            mine = [left for left in self.intake.left_out if left.file == file.name]
            masked = [run for left in mine if left.engine in ("", window.engine) for run in left.stuck]
            here = (window.source, window.flight, window.engine)
            found = next((one for one in self.intake.mismatches if one.concerns(*here)), None)
            yield replace(gate.judged(window, masked), disagreement=found), monitor.meaning
        gate.report(left for left in self.intake.left_out if left.file == file.name)

    def _windows(self, monitor: Monitor, recordings: Iterable[Recording], name: str) -> Iterator[WindowStatistics]:
        judging, linearise = self.judging, self.judging.linearise
        if self.brief:
            recordings = iter(recordings)
            first = list(islice(recordings, 1))  # as soon as records are read, they have been compared with the engine
            recordings = chain(first, recordings)
            if any(m.source == name and not m.flights and m.doubtful for m in self.intake.mismatches):
                linearise = "nominal"
        if self.series or self._adding:
            later = last_records(recordings, judging.last) if judging.last else recordings
            condense = unmarginalised(monitor) if self._adding else partial(monitored_as_read, monitor)
            yield from window_statistics(monitor, later, judging.plan, linearise=judging.linearise, condense=condense)
            return
        yield from windows_against_reference(
            monitor,
            recordings,
            judging.plan,
            judging.reference,
            last=judging.last,
            linearise=linearise,
        )

    @property
    def nuisance(self) -> int:
        """How many parameters are uncertain beside the monitored ones, where windows hold them."""
        if self.monitor is None or not self._adding:
            return 0
        return nuisance_of(self._reduced(self.monitor))

    @property
    def _adding(self) -> bool:
        """Whether windows of recordings hold what is uncertain beside the monitored parameters."""
        return self.additive and not self.judging.reference

    def _reduced(self, monitor: Monitor) -> Monitor:
        self._few = self._few or with_lagging(reduced(monitor))
        return self._few

    def _flat(self, file: File) -> Iterator[Window]:
        assert file.table is not None
        refuse_ignored_options(self.given, file.table.name)
        self.intake.inherit(file.table.provenance)
        form = as_read if self.series else marginalised
        for window, known in read_statistics(file.table.lines, file.table.name, self.ledger):
            drifting = {n for n, p in known.items() if p.of_instrument and p.quantity == DRIFT and not self.drifts}
            if window.statistics is not None:
                window = replace(window, statistics=form(window.statistics).without(drifting))
            yield window, {name: p for name, p in known.items() if name not in drifting}

    def _count(self, window: WindowStatistics) -> None:
        self.counts.update(window.counts)
        self.elsewhere.update(window.elsewhere)


def made_with(files: JudgedFiles, monitor: Monitor) -> MadeWith:
    """How the statistics of these files are made."""
    from enginediag_cli.recordings.provenance import sha256_of

    judging, source = files.judging, files.intake.source
    return MadeWith(
        monitor.nominal,
        **plan_cells(judging.plan),
        linearise=judging.linearise,
        monitor=" ".join(monitor.monitored),
        reference=str(judging.reference),
        last=str(judging.last),
        model_error="" if judging.model_error is None else f"{judging.model_error:g}",
        recorder=sha256_of(source.recorder)[:DIGITS] if source.recorder else "",
        engine_instance=source.engine_instance,
    )
