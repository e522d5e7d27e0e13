"""What `residual`, `detect`, `isolate` and `trend` share once their options are read: files as judged windows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import JudgedFiles
    from enginediag_cli.residuals.monitor import Monitor


def open_monitor(
    nominal: str, patterns: tuple[str, ...], accept_changed_engine: bool, *, sensors: bool = False
) -> Monitor:
    """What recordings are compared with; sensors: the bias of every sensor in use may have changed, too."""
    from enginediag_cli.intake.baseline import open_baseline
    from enginediag_cli.residuals.monitor import monitor_of

    baseline = open_baseline(nominal, accept_changed_engine=accept_changed_engine)
    return monitor_of(baseline, patterns, sensors=sensors)


def open_intake(source: Source, monitor: Monitor | None) -> Intake:
    """The recordings, by the columns that the monitor's engine reads; for statistics alone without one."""
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.wanted import columns_of

    return Intake(source, None if monitor is None else columns_of(monitor.engine, monitor.sensors))


def tell_files(messages: Messages, files: JudgedFiles) -> None:
    """What was left out of the files, on stderr."""
    from enginediag_cli.presentation.left_out import tell_left_out

    tell_left_out(messages, files.intake.left_out, files.counts)


def ending(found: int, judged: int, exit_code: bool) -> ExitCode:
    """Exit code: a finding only on request; no verdict when nothing could be judged, or nothing was there."""
    from enginediag_cli.errors import ExitCode

    if found and exit_code:
        return ExitCode.FINDING
    return ExitCode.DONE if judged else ExitCode.NO_VERDICT


def digits_of(window: str | None) -> int | None:
    """A window that is a plain number of records, None where none is given; click's own message for a time."""
    if window is None:
        return None
    if not window.strip().isdigit() or not int(window):
        raise click.UsageError("with --follow, --window is a number of records")
    return int(window)
