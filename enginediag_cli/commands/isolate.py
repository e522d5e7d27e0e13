"""`enginediag isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.isolation_options import Further, KeepingIntake, further_options
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
    ending,
    false_alarm_option,
    planned,
    statistics_option,
    window_options,
)
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode

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
@click.option("--faults", metavar="Q", type=click.IntRange(min=1), help="Number of changed parameters, when known.")
@false_alarm_option
@click.option(
    "--inclusion",
    metavar="P",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.1,
    show_default=True,
    help="Prior probability that a parameter of the engine changed (posterior).",
)
@click.option(
    "--sensor-inclusion",
    metavar="P",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.02,
    show_default=True,
    help="Prior probability that a sensor is wrong (posterior); no more than two are at once.",
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
    help="component: one row per window with the components that changed (posterior), for an engine with generic maps.",
)
@click.option(
    "--largest",
    metavar="N",
    type=click.IntRange(min=1),
    help="Largest number of parameters that may have changed together.",
)
@further_options
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
    sensor_inclusion: float,
    coverage: float,
    by: str,
    largest: int | None,
    further: Further,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Isolate the parameters, or the components, that changed: one row per window and isolated parameter.

    \b
    enginediag isolate -n nominal.yaml flight.csv
    enginediag residual -n nominal.yaml --sensors flight.csv | enginediag isolate -
    enginediag isolate -n nominal.yaml flight.csv --method incremental --linearise nominal
    enginediag isolate -n nominal.yaml flight.csv --catalogue configs/faults --advise

    Every sensor may be wrong, too, unless --no-sensors says that none is, or --monitor what may have changed;
    `verdict` tests all of that, where detect tests the engine alone.
    `probability` is that of exactly this set, `inclusion` that of the parameter in any set; `rivals` are the
    other sets that the data cannot exclude. Sizes are in the parameter's unit, with an interval that holds if
    the set is right. `fit` is what the answer leaves unexplained, per degree of freedom: near 1 when it fits. Where the
    model fits badly whatever is assumed, probabilities and intervals are widened; where it then convinces no longer, or
    fits only with changes that no engine shows, the verdict is `cannot tell` and `note` says why.
    """
    from enginediag_cli.commands.isolation_options import advice_for
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.isolation.components import isolate_components
    from enginediag_cli.isolation.diagnosis import diagnose
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.prior import SetPrior
    from enginediag_cli.presentation.component_rows import component_row, component_sentence
    from enginediag_cli.presentation.isolation_rows import isolation_rows, tell, where
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.kept_records import KeptRecords

    if by == "component" and (method != "posterior" or faults):
        raise click.UsageError("--by component goes with --method posterior and without --faults")
    further.check(method, by, nominal, bool(origin.reference or origin.model_error))
    plan = planned(window, step)
    monitor = further.monitor(messages, nominal, patterns, method) if nominal else None
    intake = KeepingIntake(messages, monitor, plan, linearise, origin)
    plain = not (origin.reference or origin.model_error)  # otherwise the score knows more than the records tell
    if monitor is not None and plain and by == "parameter" and further.keeps(method, linearise):
        intake.kept = KeptRecords(monitor, short_windows=window is not None)
    options = IsolationOptions(
        faults=faults,
        false_alarm=false_alarm,
        prior=SetPrior(inclusion=inclusion, sensor=sensor_inclusion),
        coverage=coverage,
        confidence=coverage,
        largest=largest,
    )
    asked = further.diagnosis_options(method, linearise, options)
    named = judged = windows = 0

    def rows() -> Iterator[dict[str, Any]]:
        nonlocal named, judged, windows
        for found, known in intake.windows(recordings):
            windows += 1
            if windows == 1 and found.statistics is not None and nominal is None:
                further.warn_of_sensors(messages, known.values())
            verdict = judge(found, false_alarm)
            if by == "component":
                component = (
                    isolate_components(verdict.score, options, found.statistics) if verdict.score is not None else None
                )
                judged += component is not None
                named += bool(component and component.components and component.adequacy.stands)
                if windows <= SENTENCES and component is not None:
                    messages.note(f"{where(verdict)}: {component_sentence(component, known)}")
                yield component_row(verdict, component, known)
                continue
            diagnosis = advice = None
            if verdict.score is not None:
                model = intake.model(found)
                diagnosis = diagnose(verdict.score, asked, model, found.statistics)
                if further.advise and monitor is not None:
                    advice = advice_for(further, monitor, diagnosis, model() if model else None)
                judged += 1
                named += bool(diagnosis.result.isolated and diagnosis.adequacy.stands)
            if windows <= SENTENCES:
                tell(messages, verdict, diagnosis, known, advice or ())
            yield from isolation_rows(verdict, diagnosis, known, asked.catalogue is not None, advice)

    found = rows()
    first = next(found, None)
    notes = {"method": method, "false_alarm": str(false_alarm)}
    head = header_lines(
        "isolate",
        configs=[*([nominal] if nominal else []), *origin.configs, *further.files()],
        notes={**notes, **origin.notes, **further.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], found), provenance=head, live=True)
    intake.report()
    return ending(named, judged, windows, exit_code)
