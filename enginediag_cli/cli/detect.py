"""`enginediag detect`: has the engine departed from nominal, window by window?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.detect_follow import Follow, check_follow, follow_options
from enginediag_cli.cli.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.cli.judging import Compared, digits_of, ending, write_result
from enginediag_cli.cli.method_options import Rival, method_options
from enginediag_cli.cli.options import (
    FiniteRange,
    exit_code_option,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.cli.parameter_types import RequiredChange
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.results import Result
    from enginediag_cli.errors import ExitCode


@click.command(
    short_help="Say when an engine departs from nominal.",
    epilog=exit_codes("a fault was found and --exit-code given"),
)
@source_options
@compared_options(help="Nominal engine, as written by identify; not needed for what residual has written.")
@judging_options
@window_options
@false_alarm_option
@method_options
@click.option(
    "--detectable",
    is_flag=True,
    help="Add the smallest change of each parameter that the window would "
    "have shown, in the parameter's unit, and what the window does not excite; JSON always has them.",
)
@click.option(
    "--power",
    metavar="P",
    type=FiniteRange(0.5, 0.9999),
    default=0.9,
    show_default=True,
    help="Probability with which a change counts as shown.",
)
@click.option(
    "--must-show",
    metavar="PATTERN=SIZE",
    type=RequiredChange(),
    multiple=True,
    help="Healthy is only a window that would have shown such a change of the parameters of this name or shell "
    "pattern, in their unit; of a component that of one parameter is enough. Default: efficiency 0.02, flow capacity "
    "and area 0.03. `none`: any window.",
)
@picture_option("the statistic of every window over its threshold")
@follow_options
@jobs_option
@exit_code_option
@output_options
@message_options
@pass_messages
def detect(
    messages: Messages,
    source: Recordings,
    compared: Compared,
    windows: dict[str, Any],
    false_alarm: float,
    rival: Rival,
    detectable: bool,
    power: float,
    must_show: tuple[Any, ...],
    picture_path: str | None,
    follow: Follow,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Test whether monitored parameters have changed, one row per window.

    \b
    enginediag detect -n nominal.yaml flight.csv
    enginediag simulate configs/turbofan.yaml --seed 7 | enginediag detect -n nominal.yaml -
    enginediag detect -n nominal.yaml flight.csv --window 10min --step 1min --detectable
    tail -n +1 -f flight.csv | enginediag detect -n nominal.yaml --follow -

    The verdict is healthy, fault, or no verdict with its reason: an engine that could not be judged, or would not have
    shown a change of the size of --must-show, is never called healthy. `fit` is what no change of parameters explains,
    per degree of freedom: near 1 when model and noise are right.

    With --follow, `log10_e` is the evidence that something has changed since the flight began, as a power of
    ten; the alarm comes when it reaches 1/P of --false-alarm, at any time of the flight, and stays. What one sensor or
    input alone shows is an alarm once it has lasted longer than a gross error, 7 records or 10 minutes. Then `kind`
    says sudden fault, gradual deterioration, sensor jump, sensor drift, present from the start, or cannot tell,
    and onset_s since when, with its 95 % interval.

    With --method, another method judges each window: rows hold the statistic, threshold and p value of each of its
    tests, and what it names in `isolated`, which `isolated_kind` says are parameters of the engine or sensors.
    """
    if rival:
        rival.check(compared.nominal, source.files)
    if follow.wanted:
        check_follow(follow, windows, detectable)
    if picture_path and (follow.wanted or rival):
        raise click.UsageError("--picture goes with neither --follow nor --method")
    if "none" in must_show and len(must_show) > 1:
        raise click.UsageError("--must-show none goes with no other --must-show")
    result = _judged(
        follow,
        rival,
        detectable or output.chosen_format() in ("json", "ndjson"),
        {"power": power, "must_show": "none" if "none" in must_show else must_show},
    )(
        compared.nominal,
        source,
        false_alarm=false_alarm,
        messages=messages,
        stream=True,
        **windows,
        **compared.arguments,
    )
    write_result(result, output, picture_path)
    return ending(result.found, result.judged, exit_code, result.unread)


def _judged(follow: Follow, rival: Rival, detectable: bool, test: dict[str, Any]) -> Callable[..., Result]:
    """The verb of the library that the options ask for, with the arguments that it alone has."""
    from enginediag_cli.api import detection

    if follow.wanted:
        return partial(detection.follow, block=digits_of(follow.window), idle_s=follow.idle_s)
    if rival:
        return partial(detection.detect_by_method, method=rival.name, healthy=rival.healthy)
    return partial(detection.detect, detectable=detectable, **test)
