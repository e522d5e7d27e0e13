"""`enginediag detect --follow`: a flight judged while it is being recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import wraps
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.judging import digits_of, ending, open_intake
from enginediag_cli.commands.options import FiniteRange
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import Judging
    from enginediag_cli.residuals.monitor import Monitor


@dataclass(frozen=True)
class Follow:
    """Choices of `follow_options`; `window`, `step` and `nominal`: as given beside them."""

    wanted: bool
    idle_s: float
    window: str | None
    step: str | None
    nominal: str | None


def follow_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--follow` and `--idle` as one `follow: Follow`; stands below `window_options`, whose options it sees, too."""

    @wraps(function)
    def with_follow(*args: Any, follow: bool, idle: float, **others: Any) -> Any:
        given = click.get_current_context().params
        chosen = Follow(follow, idle, given.get("window"), given.get("step"), given.get("nominal"))
        return function(*args, follow=chosen, **others)

    wanted = click.option(
        "--follow",
        is_flag=True,
        help="Judge records as they come, from standard input or a growing file: one row per --window records (20), "
        "with one probability of a false alarm (--false-alarm) for the whole of each flight.",
    )
    idle = click.option(
        "--idle",
        metavar="SECONDS",
        type=FiniteRange(min=0),
        default=60.0,
        show_default=True,
        help="With --follow, a file to which nothing is added for so long has ended.",
    )
    return wanted(idle(with_follow))


def check_follow(follow: Follow, judging: Judging, detectable: bool) -> None:
    """Raises click.UsageError for choices that do not go with --follow."""
    if follow.nominal is None:
        raise click.UsageError("--follow needs --nominal")
    refused = {
        "--step": (follow.step, "blocks do not overlap, or their evidence would count twice"),
        "--detectable": (detectable, "the smallest change depends on how long it has lasted"),
        "--reference": (judging.reference, "a flight is judged from its first record on"),
        "--last": (judging.last, "the last records of a flight that goes on are not known"),
    }
    reasons = [f"{option} does not go with --follow: {why}" for option, (given, why) in refused.items() if given]
    if reasons:
        raise click.UsageError("; ".join(reasons))
    digits_of(follow.window)


def run_follow(
    messages: Messages,
    follow: Follow,
    source: Source,
    monitor: Monitor,
    false_alarm: float,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """One row per block as it comes, what was left out at the end."""
    from enginediag_cli.detection.following import BLOCK, Following
    from enginediag_cli.presentation.detection_rows import block_row
    from enginediag_cli.presentation.left_out import tell_left_out, tell_mismatches
    from enginediag_cli.presentation.outputs.detect import FOLLOW
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.lagging import with_lagging

    block = digits_of(follow.window) or BLOCK
    intake = open_intake(source, monitor)
    following = Following(intake, with_lagging(monitor), false_alarm, block, follow.idle_s)
    alarms: dict[tuple[str, str, str], bool] = {}
    judged = 0

    def rows() -> Iterator[dict[str, Any]]:
        nonlocal judged
        for report in following.reports():
            alarms[report.key] = report.alarm
            judged += 0 if report.reason else report.judged
            yield block_row(report)

    found = rows()
    first = next(found, None)
    head = header_lines(
        "detect",
        configs=[*([follow.nominal] if follow.nominal else []), *source.configs],
        notes={**FOLLOW.notes, "follow": f"{block} records", "false_alarm": str(false_alarm), **source.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], found), provenance=head, live=True)
    tell_mismatches(messages, intake.mismatches)
    tell_left_out(messages, intake.left_out, following.counts, following.elsewhere)
    counts = {"flights": len(alarms), "alarms": sum(alarms.values())}
    messages.note(f"{counts['alarms']} of {counts['flights']} flights with an alarm", counts=counts)
    return ending(sum(alarms.values()), judged, exit_code)
