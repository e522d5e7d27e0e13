"""`enginediag detect`: has the engine departed from nominal, window by window?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import (
    exit_code_option,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
    recordings_argument,
)
from enginediag_cli.commands.origin import Origin, origin_options
from enginediag_cli.commands.windows import (
    Intake,
    ending,
    false_alarm_option,
    load_monitor,
    planned,
    statistics_option,
    window_options,
)
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.errors import ExitCode


@click.command(
    short_help="Say when an engine departs from nominal.",
    epilog=exit_codes("a fault was found and --exit-code given"),
)
@recordings_argument
@statistics_option
@window_options
@origin_options
@false_alarm_option
@click.option(
    "--detectable",
    is_flag=True,
    help="Add the smallest change of each parameter that the window would "
    "have shown, in the parameter's unit, and what the window does not excite.",
)
@click.option(
    "--power",
    metavar="P",
    type=click.FloatRange(0.5, 0.9999),
    default=0.9,
    show_default=True,
    help="Probability with which --detectable counts a change as shown.",
)
@click.option(
    "--follow",
    is_flag=True,
    help="Judge records as they come, from standard input or a growing file: one row per --window records (20), "
    "with one probability of a false alarm (--false-alarm) for the whole of each flight.",
)
@click.option(
    "--idle",
    metavar="SECONDS",
    type=click.FloatRange(min=0),
    default=60.0,
    show_default=True,
    help="With --follow, a file to which nothing is added for so long has ended.",
)
@exit_code_option
@output_options
@message_options
@pass_messages
def detect(
    messages: Messages,
    recordings: tuple[str, ...],
    nominal: str | None,
    window: str | None,
    step: str | None,
    linearise: str,
    patterns: tuple[str, ...],
    origin: Origin,
    false_alarm: float,
    detectable: bool,
    power: float,
    follow: bool,
    idle: float,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Test whether monitored parameters have changed, one row per window.

    \b
    enginediag detect -n nominal.yaml flight.csv
    enginediag simulate configs/turbofan.yaml --seed 7 | enginediag detect -n nominal.yaml -
    enginediag detect -n nominal.yaml flight.csv --window 10min --step 1min --detectable
    tail -n +1 -f flight.csv | enginediag detect -n nominal.yaml --follow -

    The verdict is healthy, fault, or no verdict with its reason: an engine that could not be judged is never
    called healthy. `fit` is what no change of parameters explains, per degree of freedom: near 1 when model
    and noise are right.

    With --follow, `log10_e` is the evidence that something has changed since the flight began, as a power of
    ten; the alarm comes when it reaches 1/P of --false-alarm, at any time of the flight, and stays. Then `kind`
    says sudden fault, gradual deterioration, sensor jump, sensor drift, present from the start, or cannot tell,
    and onset_s since when, with its 95 % interval.
    """
    if follow:
        return _follow(
            messages,
            recordings,
            nominal,
            window,
            step,
            patterns,
            origin,
            false_alarm,
            detectable,
            idle,
            exit_code,
            output,
        )
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.compact import compact

    if detectable and power <= false_alarm:
        raise click.UsageError("--power must be larger than --false-alarm")
    plan = planned(window, step)
    monitor = compact(load_monitor(messages, nominal, patterns)) if nominal else None
    intake = Intake(messages, monitor, plan, linearise, origin)
    tally: Counter[str] = Counter()

    def rows() -> Iterator[dict[str, Any]]:
        for found, _ in intake.windows(recordings):
            verdict = judge(found, false_alarm)
            tally[verdict.verdict] += 1
            yield _row(verdict, detectable, false_alarm, power)

    found = rows()
    first = next(found, None)
    head = header_lines(
        "detect",
        configs=[*([nominal] if nominal else []), *origin.configs],
        notes={"false_alarm": str(false_alarm), **origin.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], found), provenance=head, live=True)
    intake.report()
    messages.note(", ".join(f"{n} {what}" for what, n in sorted(tally.items())) or "no window")
    return ending(tally["fault"], sum(tally.values()) - tally["no verdict"], exit_code)


def _follow(
    messages: Messages,
    recordings: tuple[str, ...],
    nominal: str | None,
    window: str | None,
    step: str | None,
    patterns: tuple[str, ...],
    origin: Origin,
    false_alarm: float,
    detectable: bool,
    idle: float,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    from enginediag_cli.commands.follow import block_length, followed, report_row
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.windows import WindowPlan

    if nominal is None:
        raise click.UsageError("--follow needs --nominal")
    refused = {
        "--step": (step, "blocks do not overlap, or their evidence would count twice"),
        "--detectable": (detectable, "the smallest change depends on how long it has lasted"),
        "--reference": (origin.reference, "a flight is judged from its first record on"),
        "--last": (origin.last, "the last records of a flight that goes on are not known"),
        "--model-error": (origin.model_error, "its bound on false alarms holds for an engine model that is right"),
    }
    reasons = [f"{option} does not go with --follow: {why}" for option, (given, why) in refused.items() if given]
    if reasons:
        raise click.UsageError("; ".join(reasons))
    block = block_length(window)
    intake = Intake(messages, load_monitor(messages, nominal, patterns), WindowPlan(), "nominal", origin)
    alarms: dict[tuple[str, str, str], bool] = {}
    judged = 0

    def rows() -> Iterator[dict[str, Any]]:
        nonlocal judged
        for report in followed(intake, recordings, false_alarm, block, idle):
            alarms[report.key] = report.alarm
            judged += report.judged
            yield report_row(report)

    found = rows()
    first = next(found, None)
    head = header_lines(
        "detect",
        configs=[nominal, *origin.configs],
        notes={"follow": f"{block} records", "false_alarm": str(false_alarm), **origin.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], found), provenance=head, live=True)
    intake.report()
    messages.note(f"{sum(alarms.values())} of {len(alarms)} flights with an alarm")
    return ending(sum(alarms.values()), judged, exit_code)


def _row(verdict: Verdict, detectable: bool, false_alarm: float, power: float) -> dict[str, Any]:
    from enginediag_cli.residuals.flat import window_row

    test, fit, statistics = verdict.test, verdict.fit, verdict.window.statistics
    row = window_row(verdict.window)
    row.update(
        judged=statistics.n if statistics else 0,
        statistic=test.statistic if test else None,
        dof=test.dof if test else None,
        threshold=test.threshold if test else None,
        p_value=test.p_value if test else None,
        alarm=test.alarm if test else None,
        fit=fit.ratio if fit else None,
        verdict=verdict.verdict,
        reason=verdict.reason,
    )
    if detectable:
        row["not_excited"] = None
        if verdict.score is not None and statistics is not None:
            from enginediag_cli.detection.minimum_change import minimum_change

            row["not_excited"] = [str(combination) for combination in statistics.unexcited()]
            sizes = minimum_change(verdict.score, false_alarm=false_alarm, power=power)
            row.update({f"detectable:{a}": x for a, x in zip(verdict.score.parameters, sizes, strict=True)})
    return row
