"""`enginediag isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.api.isolation import INSTRUMENT, METHODS, PARAMETER
from enginediag_cli.cli.answer_options import Beside, beside_options
from enginediag_cli.cli.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.cli.isolation_options import Further, further_options
from enginediag_cli.cli.judging import Compared, ending, write_result
from enginediag_cli.cli.options import (
    exit_code_option,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
    probability_option,
)
from enginediag_cli.cli.picture_option import picture_option
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.errors import ExitCode


@click.command(
    short_help="Say which parameters changed.",
    epilog=exit_codes("something was isolated and --exit-code given"),
)
@source_options
@compared_options(help="Nominal engine, as written by identify; not needed for what residual has written.")
@judging_options
@window_options
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default="posterior",
    show_default=True,
    help="posterior: probability of every set of changes; incremental: the tests of the asymptotic local "
    "approach, one parameter more at a time; sensitivity, minmax: its single tests, eqs. (13) and (14), in whose Σ "
    "what is uncertain about nominal, instruments and the slopes of the maps counts as noise.",
)
@click.option("--faults", metavar="Q", type=click.IntRange(min=1), help="Number of changed parameters, when known.")
@false_alarm_option
@probability_option("--inclusion", PARAMETER, "Prior probability that a parameter of the engine changed (posterior).")
@probability_option(
    "--sensor-inclusion",
    INSTRUMENT,
    "Prior probability that a sensor is wrong (posterior); no more than two are at once.",
)
@probability_option("--coverage", 0.98, "Probability that answer and rivals hold together.")
@probability_option("--confidence", 0.95, "Level of intervals.")
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
@beside_options
@picture_option("the fingerprint of the last window in which something was isolated")
@jobs_option
@exit_code_option
@output_options
@message_options
@pass_messages
def isolate(
    messages: Messages,
    source: Recordings,
    compared: Compared,
    windows: dict[str, Any],
    method: str,
    faults: int | None,
    false_alarm: float,
    inclusion: float,
    sensor_inclusion: float,
    coverage: float,
    confidence: float,
    by: str,
    largest: int | None,
    further: Further,
    beside: Beside,
    picture_path: str | None,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """Isolate the parameters, or the components, that changed: one row per window and isolated parameter.

    \b
    enginediag isolate -n nominal.yaml flight.csv
    enginediag residual -n nominal.yaml --sensors flight.csv | enginediag isolate -
    enginediag isolate -n nominal.yaml flight.csv --method incremental --linearise nominal
    enginediag isolate -n nominal.yaml flight.csv --catalogue configs/faults --advise

    Every sensor may be wrong, too, of an output (`sensor.T3.bias`) or of an input of the model (`input.Wf.scale`):
    read too high or low, by a scale, drift, be stuck (its records or readings are then not judged) or scatter,
    unless --no-sensors says that none is, or --monitor what may have changed; `verdict` tests all of that, where detect
    tests the engine alone.
    `probability` is that these changed and nothing else that matters: no efficiency by 0.7 %, no flow capacity or
    area by 1 %, nothing else by a third of what is plausible, no instrument. `inclusion` is that of the parameter
    in any set; `rivals` are the other sets that the data cannot exclude. `change` is in the parameter's unit,
    averaged over the sets that hold the parameter and are possible; the interval counts those without it, too, and
    reaches to 0 where they are not excluded. `fit` is what the answer leaves unexplained, per degree of freedom:
    near 1 when it fits; `fit_before` the same without any answer, `explained` the share of the excess that the
    answer takes away. Where the model fits badly whatever is assumed, probabilities and intervals are widened;
    where it then convinces no longer, or fits only with changes that no engine shows, the verdict is `cannot tell`
    and `note` says why. `flips` (json) are the errors that would change the first name: `size` as it would be added
    to what was recorded, one standard deviation as `stated`, what the name `becomes`; the nearest first.
    `work_scope` (json) is by how much turbine temperature and fuel would fall at equal thrust or power if a module
    that is named were as new, with 95 % intervals.
    """
    from enginediag_cli.api.isolation import isolate as run

    if picture_path and by == "component":
        raise click.UsageError("--picture goes with --by parameter")
    result = run(
        compared.nominal,
        source,
        method=method,
        by=by,
        faults=faults,
        largest=largest,
        false_alarm=false_alarm,
        inclusion=inclusion,
        sensor_inclusion=sensor_inclusion,
        coverage=coverage,
        confidence=confidence,
        messages=messages,
        stream=True,
        **further.arguments,
        **beside.arguments(output),
        **windows,
        **compared.arguments,
    )
    write_result(result, output, picture_path)
    return ending(result.found, result.judged, exit_code, result.unread)
