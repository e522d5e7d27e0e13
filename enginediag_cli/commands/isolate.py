"""`enginediag isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

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
    from enginediag_cli.isolation.result import IsolationResult

METHODS = ("posterior", "incremental", "sensitivity", "minmax")
SENTENCES = 10
"""Windows told in words on stderr; beyond that the rows speak for themselves."""


@click.command(
    short_help="Say which parameters changed.",
    epilog=exit_codes("something was isolated and --exit-code given"),
)
@recordings_argument
@statistics_option
@window_options
@origin_options
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default="posterior",
    show_default=True,
    help="posterior: probability of every set of changes; incremental: the tests of the asymptotic local "
    "approach, one parameter more at a time; sensitivity, minmax: its single tests.",
)
@click.option(
    "--faults", metavar="Q", type=click.IntRange(min=1), help="Number of changed parameters, when known."
)
@false_alarm_option
@click.option(
    "--inclusion",
    metavar="P",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.1,
    show_default=True,
    help="Prior probability that a parameter changed (posterior).",
)
@click.option(
    "--coverage",
    metavar="P",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Probability that answer and rivals hold together, and level of intervals.",
)
@click.option(
    "--by",
    type=click.Choice(["parameter", "component"]),
    default="parameter",
    show_default=True,
    help="component: one row per window with the components that changed (posterior), for an engine with "
    "generic maps.",
)
@click.option(
    "--largest",
    metavar="N",
    type=click.IntRange(min=1),
    help="Largest number of parameters that may have changed together.",
)
@exit_code_option
@output_options
@message_options
@pass_messages
def isolate(
    messages: Messages,
    recordings: tuple[str, ...],
    nominal: str | None,
    window: str | None,
    step: str | None,
    linearise: str,
    patterns: tuple[str, ...],
    origin: Origin,
    method: str,
    faults: int | None,
    false_alarm: float,
    inclusion: float,
    coverage: float,
    by: str,
    largest: int | None,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Isolate the parameters, or the components, that changed: one row per window and isolated parameter.

    \b
    enginediag isolate -n nominal.yaml flight.csv
    enginediag residual -n nominal.yaml flight.csv | enginediag isolate -
    enginediag isolate -n nominal.yaml flight.csv --method incremental --linearise nominal

    `probability` is that of exactly this set, `inclusion` that of the parameter in any set; `rivals` are the
    other sets that the data cannot exclude. Sizes are in the parameter's unit, with an interval that holds if
    the set is right.
    """
    from enginediag_cli.commands.component_rows import component_row, component_sentence
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.isolation.components import isolate_components
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.methods import isolate as isolate_score
    from enginediag_cli.isolation.prior import SetPrior
    from enginediag_cli.recordings.provenance import header_lines

    if by == "component" and (method != "posterior" or faults):
        raise click.UsageError("--by component goes with --method posterior and without --faults")
    plan = planned(window, step)
    monitor = load_monitor(messages, nominal, patterns) if nominal else None
    intake = Intake(messages, monitor, plan, linearise, origin)
    options = IsolationOptions(
        faults=faults,
        false_alarm=false_alarm,
        prior=SetPrior(inclusion=inclusion),
        coverage=coverage,
        confidence=coverage,
        largest=largest,
    )
    named = judged = windows = 0

    def rows() -> Iterator[dict[str, Any]]:
        nonlocal named, judged, windows
        for found, units in intake.windows(recordings):
            windows += 1
            verdict = judge(found, false_alarm)
            if by == "component":
                component = isolate_components(verdict.score, options) if verdict.score is not None else None
                judged += component is not None
                named += bool(component and component.components)
                if windows <= SENTENCES and component is not None:
                    messages.note(f"{_where(verdict)}: {component_sentence(component)}")
                yield component_row(verdict, component)
                continue
            result = isolate_score(verdict.score, method, options) if verdict.score is not None else None
            judged += result is not None
            named += bool(result and result.isolated)
            if windows <= SENTENCES:
                _tell(messages, verdict, result, units)
            yield from _rows(verdict, result, units)

    found = rows()
    first = next(found, None)
    notes = {"method": method, "false_alarm": str(false_alarm)}
    head = header_lines(
        "isolate",
        configs=[*([nominal] if nominal else []), *origin.configs],
        notes={**notes, **origin.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], found), provenance=head, live=True)
    intake.report()
    return ending(named, judged, windows, exit_code)


def _rows(
    verdict: Verdict, result: IsolationResult | None, units: dict[str, str]
) -> Iterator[dict[str, Any]]:
    """Rows of one window: one per isolated parameter, or a single one when there is none."""
    from enginediag_cli.residuals.flat import window_row

    row = window_row(verdict.window)
    row.update(
        verdict=verdict.verdict,
        p_value=verdict.test.p_value if verdict.test else None,
        isolated=None,
        probability=None,
        parameter=None,
        inclusion=None,
        change=None,
        lower=None,
        upper=None,
        unit=None,
        percent=None,
        rivals=None,
        rivals_left_out=None,
        note=verdict.reason,
    )
    if result is None:
        yield row
        return
    row.update(
        isolated=list(result.isolated),
        probability=result.probability,
        rivals=[f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in result.rivals],
        rivals_left_out=result.rivals_left_out,
        note=result.note,
    )
    if not result.sizes:
        yield row
    for size in result.sizes:
        yield {
            **row,
            "parameter": size.parameter,
            "inclusion": result.inclusion.get(size.parameter),
            "change": size.change,
            "lower": size.lower,
            "upper": size.upper,
            "unit": units.get(size.parameter, ""),
            "percent": size.percent,
        }


def _where(verdict: Verdict) -> str:
    """Which window it is: its flight and engine, or else file and lines."""
    window = verdict.window
    names = (window.flight and f"flight {window.flight}", window.engine and f"engine {window.engine}")
    return " ".join(filter(None, names)) or f"{window.source}:{window.first_line}-{window.last_line}"


def _tell(
    messages: Messages, verdict: Verdict, result: IsolationResult | None, units: dict[str, str]
) -> None:
    """The answer for one window in words."""
    from enginediag_cli.presentation.sentences import change, no_verdict

    where = _where(verdict)
    if result is None:
        messages.note(no_verdict(verdict.reason, where=where))
        return
    told = [
        change(
            size.parameter,
            size.change,
            size.upper - size.change,
            unit=units.get(size.parameter, "").removeprefix("1"),
            chance=result.inclusion.get(size.parameter),
        )
        for size in result.sizes
    ]
    messages.note(f"{where}: {'; '.join(told) if told else 'no change of a parameter stands out'}")
    if result.rivals:
        rivals = [" & ".join(r.parameters) or "no change" for r in result.rivals[:3]]
        more = len(result.rivals) - len(rivals) + result.rivals_left_out
        behind = f" and {more} more" if more else ""
        messages.note(f"{where}: not excluded either: {'; '.join(rivals)}{behind}")
