"""What `residual`, `detect`, `isolate` and `trend` share: options as arguments of the library, and how they end."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.operation import is_chosen
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.results import Result
    from enginediag_cli.errors import ExitCode


@dataclass(frozen=True)
class Compared:
    """What recordings are compared with, as the options of a command name it; `nominal` is None where only statistics
    are read."""

    nominal: str | None
    patterns: tuple[str, ...]
    accept_changed_engine: bool

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the library, with what the user has set."""
        return {
            "monitor": self.patterns,
            "accept_changed_engine": self.accept_changed_engine,
            "chosen": _chosen(),
        }


def _chosen() -> dict[str, bool]:
    """Which options the user has set, by the names of `WindowOptions`."""
    context = click.get_current_context()
    given = {name: is_chosen(context, name) for name in context.params}
    return {**given, "monitor": given.get("patterns", False)}


def write_result(result: Result, output: Output, picture_path: str | None = None) -> None:
    """Write the rows as they come; kept for a picture only where one is drawn."""
    rows = iter(result.rows) if picture_path else None
    head = result.provenance  # computes the first row, which opens the first file: an error leaves no output behind
    output.write_rows(
        rows or result.stream(), result.columns, summary=result.summary_columns, provenance=head, live=True
    )
    if picture_path:
        result.plot().save(picture_path)


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
