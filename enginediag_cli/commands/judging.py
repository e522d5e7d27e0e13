"""What `residual`, `detect`, `isolate` and `trend` share once their options are read: files as judged windows."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.operation import is_chosen
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import JudgedFiles, Judging
    from enginediag_cli.residuals.monitor import Monitor


@dataclass(frozen=True)
class Compared:
    """What recordings are compared with, as the options of a command name it; `nominal` is None where only statistics
    are read."""

    nominal: str | None
    patterns: tuple[str, ...]
    accept_changed_engine: bool

    def open(
        self,
        messages: Messages,
        source: Source,
        *,
        sensors: bool = False,
        drifts: bool = False,
        model_error: float | None = None,
    ) -> Monitor | None:
        """The monitor, with what should be known of it on stderr; sensors: every instrument may be wrong, too, drifts:
        and may drift within a flight; model_error: accuracy of the maps by hand."""
        if self.nominal is None:
            return None
        from enginediag_cli.identification.other_accuracy import with_accuracy
        from enginediag_cli.intake.baseline import open_baseline
        from enginediag_cli.presentation.baseline_doubts import tell_baseline
        from enginediag_cli.residuals.monitor import monitor_of

        baseline = open_baseline(self.nominal, accept_changed_engine=self.accept_changed_engine)
        tell_baseline(messages, baseline, source.engine_instance)
        if model_error is not None:
            if model_error > 0.0 and baseline.nominal.error_model is None:
                messages.warning(
                    f"--model-error {model_error:g} changes nothing: {self.nominal} was identified with maps taken for "
                    "exact; give the option to `enginediag identify`, too"
                )
            baseline = replace(baseline, nominal=with_accuracy(baseline.nominal, model_error))
        return monitor_of(baseline, self.patterns, sensors=sensors, drifts=drifts)

    @property
    def configs(self) -> list[str]:
        """Files that a result depends on, for its provenance."""
        return [self.nominal] if self.nominal else []


def judged_files(
    source: Source, monitor: Monitor | None, judging: Judging, *, summed: bool = False, series: bool = False
) -> JudgedFiles:
    """The files as windows; summed: windows of a flight are added up; series: they are compared with each other."""
    from enginediag_cli.residuals.files import JudgedFiles

    return JudgedFiles(open_intake(source, monitor), monitor, judging, summed=summed, given=_given(), series=series)


def _given() -> dict[str, bool]:
    """Which choices the user made, by the names of `residuals.statistics_file.IGNORED`."""
    context = click.get_current_context()
    given = {name: is_chosen(context, name) for name in context.params}
    return {**given, "monitor": given.get("patterns", False)}


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
    """What was left out of the files, on stderr."""
    from enginediag_cli.presentation.left_out import tell_left_out, tell_mismatches
    from enginediag_cli.presentation.sentences import count

    tell_mismatches(messages, files.intake.mismatches)
    for file, reason in files.intake.unread.items():
        messages.error(f"not read to its end, the other files are judged: {reason}", file=file)
    tell_left_out(messages, files.intake.left_out, files.counts, files.elsewhere)
    if files.ledger.repeated:
        messages.warning(f"{count(files.ledger.repeated, 'row')} of statistics given twice, and counted once")
    if files.ledger.overlapping:
        messages.warning(f"{count(files.ledger.overlapping, 'window')} with records that another has, too")


def ending(found: int, judged: int, exit_code: bool, unread: Collection[str] = ()) -> ExitCode:
    """Exit code: a finding only on request; trouble where files were `unread`; no verdict when nothing could be judged,
    or nothing was there."""
    from enginediag_cli.errors import ExitCode

    if found and exit_code:
        return ExitCode.FINDING
    if unread:
        return ExitCode.TROUBLE
    return ExitCode.DONE if judged else ExitCode.NO_VERDICT


def digits_of(window: str | None) -> int | None:
    """A window that is a plain number of records, None where none is given; click's own message for a time."""
    if window is None:
        return None
    if not window.strip().isdigit() or not int(window):
        raise click.UsageError("with --follow, --window is a number of records")
    return int(window)
