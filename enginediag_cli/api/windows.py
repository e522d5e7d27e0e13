"""What `residual`, `detect`, `isolate` and `trend` share: recordings as windows that a monitor judges."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import NominalLike, RecordingsLike, as_baseline, as_recordings
from enginediag_cli.api.results import MessageLog
from enginediag_cli.errors import UsageError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.intake.baseline import Baseline
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.source import Source
    from enginediag_cli.report.outputs.declared import Table
    from enginediag_cli.residuals.files import JudgedFiles, Judging
    from enginediag_cli.residuals.monitor import Monitor

SENTENCES = 10
"""Windows that are described in sentences; beyond that the rows speak for themselves."""
STATISTICS_ALONE = ("window", "step", "linearise", "monitor", "reference", "last", "model_error")
"""Options that recordings need and statistics, which are made already, would ignore."""


@dataclass(frozen=True)
class WindowOptions:
    """How recordings become windows, and what of the engine is watched.

    Attributes
    ----------
    window : int or str, optional
        Length of a window: records (``60``) or time (``"300s"``, ``"10min"``, ``"1h"``); without it each flight is one.
    step : int or str, optional
        From the start of a window to that of the next; the window's length when not given.
    linearise : {"estimate", "nominal"}
        Where the model is linearised: at the estimate for each window, or at nominal, for small changes only.
    reference : int
        Judge each flight and engine against its own first records, so many of them; 0 for none.
    last : int
        Judge only the last records of each flight and engine, so many of them; 0 for all.
    model_error : float, optional
        Relative accuracy of the component maps [1], instead of what the nominal state holds.
    monitor : sequence of str
        Names or shell patterns of the parameters that may have changed; those of the engine file when empty.
    accept_changed_engine : bool
        Use an engine file although it is no longer the one that was identified.
    chosen : mapping of str to bool, optional
        Which of these a user has set, for a front end whose users may set a value that is the default; by comparison
        with the defaults when not given.

    Raises
    ------
    UsageError
        For lengths that are none, or do not fit together.
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
    def judging(self) -> Judging:
        """The plan of windows and the records that are judged."""
        from enginediag_cli.residuals.files import Judging
        from enginediag_cli.residuals.windows import plan_windows

        length, step = (None if value is None else str(value) for value in (self.window, self.step))
        try:
            plan = plan_windows(length, step)
        except ValueError as error:
            raise UsageError(f"--window, --step: {error}") from None
        return Judging(plan, self.linearise, self.reference, self.last, self.model_error)

    def set_by_user(self, source: Source) -> dict[str, bool]:
        """Which choices were made that statistics would ignore."""
        if self.chosen is not None:
            return dict(self.chosen)
        plain = WindowOptions()
        made = {name: getattr(self, name) != getattr(plain, name) for name in STATISTICS_ALONE}
        return {**made, "recorder": bool(source.recorder), "engine_instance": bool(source.engine_instance)}


@dataclass(frozen=True)
class Comparison:
    """Recordings, and the nominal state that they are held against, None for statistics alone."""

    source: Source
    given: NominalLike
    options: WindowOptions
    judging: Judging
    messages: Messages

    @cached_property
    def baseline(self) -> Baseline | None:
        """Nominal state and engine, read when they are first needed."""
        return as_baseline(self.given, accept_changed_engine=self.options.accept_changed_engine)

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
        """The monitor, after messages of what should be known of the nominal state; sensors: every instrument may be
        wrong, too, drifts: and may drift within a flight."""
        baseline = self.baseline
        if baseline is None:
            return None
        from enginediag_cli.identification.nominal_checks import with_accuracy
        from enginediag_cli.report.left_out import tell_baseline
        from enginediag_cli.residuals.monitor import monitor_of

        accuracy = self.options.model_error
        tell_baseline(self.messages, baseline, self.source.engine_instance)
        if accuracy is not None:
            if accuracy > 0.0 and baseline.nominal.error_model is None:
                self.messages.warning(
                    f"--model-error {accuracy:g} changes nothing: {self.nominal} was identified with maps taken for "
                    "exact; give the option to `enginediag identify`, too"
                )
            baseline = replace(baseline, nominal=with_accuracy(baseline.nominal, accuracy))
        return monitor_of(baseline, tuple(self.options.monitor), sensors=sensors, drifts=drifts)

    def files(
        self, monitor: Monitor | None, *, summed: bool = False, series: bool = False, drifts: bool = False
    ) -> JudgedFiles:
        """The recordings as windows; summed: windows of a flight are added up; series: they are compared with each
        other; drifts: what statistics hold of drifts of instruments is read, too."""
        from enginediag_cli.residuals.files import JudgedFiles

        given = self.options.set_by_user(self.source)
        intake = open_intake(self.source, monitor)
        return JudgedFiles(intake, monitor, self.judging, summed=summed, given=given, series=series, drifts=drifts)

    def head(
        self,
        command: str,
        table: Table,
        intake: Intake,
        notes: Mapping[str, str],
        *,
        configs: Sequence[str] = (),
        last: Mapping[str, str] | None = None,
        judging: Judging | None = None,
    ) -> Callable[[], tuple[str, ...]]:
        """The head of a result, once the first file has been opened: the files and choices that made it; configs:
        further files, last: further notes, judging: where it is not that of the options."""
        from enginediag_cli.recordings.provenance import header_lines

        made = {**table.notes, **notes, **self.source.notes, **(judging or self.judging).notes, **(last or {})}
        files = [*self.configs, *configs]
        return lambda: header_lines(command, configs=files, notes=made, inherited=intake.provenance)


def compare(
    nominal: NominalLike, recordings: RecordingsLike, windows: Mapping[str, Any], messages: Messages | None
) -> Comparison:
    """What the arguments of a verb mean. Raises UsageError, ConfigError."""
    options = WindowOptions(**windows)
    judging = options.judging
    source = as_recordings(recordings)
    return Comparison(source, nominal, options, judging, messages if messages is not None else MessageLog())


def open_intake(source: Source, monitor: Monitor | None) -> Intake:
    """The recordings, by the columns that the monitor's engine reads; for statistics alone without one."""
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.wanted import columns_of

    if monitor is None:
        return Intake(source, None, keep_going=True)
    from enginediag_cli.residuals.monitor import agreement_with

    wanted = columns_of(monitor.engine, monitor.sensors)
    return Intake(source, wanted, agreement=agreement_with(monitor), keep_going=True)


def tell_files(messages: Messages, files: JudgedFiles) -> None:
    """What was left out of the files."""
    from enginediag_cli.report.left_out import tell_left_out, tell_mismatches
    from enginediag_cli.report.sentences import count

    tell_mismatches(messages, files.intake.mismatches)
    for file, reason in files.intake.unread.items():
        messages.error(f"not read to its end, the other files are judged: {reason}", file=file)
    tell_left_out(messages, files.intake.left_out, files.counts, files.elsewhere)
    if files.ledger.repeated:
        messages.warning(f"{count(files.ledger.repeated, 'row')} of statistics given twice, and counted once")
    if files.ledger.overlapping:
        messages.warning(f"{count(files.ledger.overlapping, 'window')} with records that another has, too")
