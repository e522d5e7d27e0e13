"""`enginediag detect`: has the engine departed from nominal, window by window?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from math import inf
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.answer_options import SENTENCES
from enginediag_cli.commands.detect_follow import Follow, check_follow, follow_options, run_follow
from enginediag_cli.commands.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.commands.judging import Compared, ending, judged_files, tell_files
from enginediag_cli.commands.method_options import Rival, detect_by_method, method_options
from enginediag_cli.commands.options import (
    FiniteRange,
    exit_code_option,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.commands.parameter_types import RequiredChange
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import DETECT

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.source import Source
    from enginediag_cli.residuals.files import Judging


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
    source: Source,
    compared: Compared,
    judging: Judging,
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
        rival.check(rival.chosen(judging.linearise), compared.nominal, source.files)
    if follow.wanted:
        check_follow(follow, judging, detectable)
    if picture_path and (follow.wanted or rival):
        raise click.UsageError("--picture goes with neither --follow nor --method")
    if detectable and power <= false_alarm:
        raise click.UsageError("--power must be larger than --false-alarm")
    if "none" in must_show and len(must_show) > 1:
        raise click.UsageError("--must-show none goes with no other --must-show")
    from enginediag_cli.detection.minimum_change import RequiredPower
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.presentation.detection_rows import detection_row, tell_window
    from enginediag_cli.presentation.outputs.detect import DETECT as DETECT_ROWS
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.economy import Economy

    monitor = compared.open(messages, source, model_error=judging.model_error)
    if follow.wanted and monitor is not None:
        return run_follow(messages, follow, source, monitor, false_alarm, exit_code, output)
    files = judged_files(source, monitor, judging)
    if rival:
        return detect_by_method(messages, rival, files, false_alarm, exit_code, output)
    # whether anything has changed does not depend on what wrong slopes of maps would make of the change
    files.economy = Economy(replace(monitor, slopes=None)) if monitor else None
    tally: Counter[str] = Counter()
    drawn: list[dict[str, Any]] = []
    required = RequiredPower((("*", inf),) if "none" in must_show else must_show, power)
    if monitor is not None:
        required.check(monitor.monitored)
    shown = detectable or output.chosen_format() in ("json", "ndjson")

    def rows() -> Iterator[dict[str, Any]]:
        for found, _ in files.windows():
            verdict = judge(found, false_alarm, required, None if judging.reference else monitor)
            tally[verdict.verdict] += 1
            tell_window(messages, verdict, in_words=tally.total() <= SENTENCES)
            row = detection_row(verdict, shown)
            drawn.extend([row] if picture_path else [])
            yield row

    found = rows()
    first = next(found, None)
    head = header_lines(
        "detect",
        configs=[*compared.configs, *source.configs],
        notes={**DETECT_ROWS.notes, "false_alarm": str(false_alarm), **source.notes, **judging.notes},
        inherited=files.intake.provenance,
    )
    rows_found = chain([first] if first is not None else [], found)
    output.write_rows(rows_found, summary=DETECT, provenance=head, live=True)
    tell_files(messages, files)
    if picture_path:
        from enginediag_cli.presentation.charts.pictured import of_detection, write_picture

        write_picture(of_detection(drawn), picture_path)
    messages.note(", ".join(f"{n} {what}" for what, n in sorted(tally.items())) or "no window", counts=dict(tally))
    return ending(tally["fault"], sum(tally.values()) - tally["no verdict"], exit_code, files.intake.unread)
