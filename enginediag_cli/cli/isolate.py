"""`enginediag isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.api.isolation import INSTRUMENT, METHODS, PARAMETER
from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    INPUT,
    JUDGEMENT,
    MODEL,
    OUTPUT,
    exit_code_option,
    extra_form,
    false_alarm_option,
    jobs_option,
    nominal_options,
    option,
    output_options,
    picture_option,
    probability_option,
    recordings_options,
    window_options,
    work_scope_option,
)
from enginediag_cli.cli.parameter_types import COUNT, POSITIVE
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.errors import ExitCode


@command(finding="something was isolated and --exit-code given")
@recordings_options
@option(
    INPUT,
    "--catalogue",
    metavar="FILE",
    type=click.Path(exists=True, readable=True),
    multiple=True,
    help="Fault file, or a folder of them: name the faults that fit. Repeatable.",
)
@nominal_options("Nominal file of the engine, from identify; not needed for statistics from residual.")
@window_options
@option(
    MODEL,
    "--sensors/--no-sensors",
    default=None,
    help="Whether instruments, also those of model inputs, may be wrong. Default: yes with the posterior and without "
    "--monitor, because a wrong sensor would otherwise be attributed to the engine.",
)
@option(
    MODEL,
    "--one-sided",
    is_flag=True,
    help="Changes have known signs: efficiencies fall; other parameters follow the signs of the catalogue.",
)
@option(
    MODEL,
    "--nonlinear",
    type=click.Choice(["auto", "always", "never"]),
    default="auto",
    show_default=True,
    help="Fit the leading sets with the full model: auto when changes are too large for the quadratic likelihood.",
)
@option(
    JUDGEMENT,
    "--method",
    type=click.Choice(METHODS),
    default="posterior",
    show_default=True,
    help="posterior: probability of every set of changes. Tests of the asymptotic local approach: incremental adds one "
    "parameter at a time; sensitivity and minmax are its eqs. (13) and (14), with the uncertainty of nominal engine, "
    "instruments and map slopes added to the noise.",
)
@option(JUDGEMENT, "--faults", metavar="Q", type=COUNT, help="Number of changed parameters, if known.")
@option(JUDGEMENT, "--largest", metavar="N", type=COUNT, help="Largest number of parameters that changed together.")
@false_alarm_option
@probability_option("--inclusion", PARAMETER, "Prior probability that an engine parameter changed (posterior).")
@probability_option(
    "--sensor-inclusion", INSTRUMENT, "Prior probability that a sensor is wrong (posterior), at most two at once."
)
@probability_option("--coverage", 0.98, "Probability that the answer and its alternatives cover together.")
@probability_option("--confidence", 0.95, "Confidence level of intervals.")
@option(
    OUTPUT,
    "--by",
    type=click.Choice(["parameter", "component"]),
    default="parameter",
    show_default=True,
    help="component: one row per window with the changed components (posterior), for an engine with generic maps.",
)
@option(OUTPUT, "--advise", is_flag=True, help="Recommend the next recording that best separates the alternatives.")
@option(
    OUTPUT,
    "--extra-sensor",
    metavar="COLUMN SIGMA",
    type=(str, POSITIVE),
    multiple=True,
    help="Further sensor for --advise: a column of the model, and its noise. Repeatable.",
)
@option(
    OUTPUT,
    "--flips/--no-flips",
    default=None,
    help="Sensitivity of the conclusion: the smallest error of a map, sensor or input, or change of the prior, that "
    "changes the first name. Default: in sentences and JSON; --flips or --wide adds it to tables and CSV.",
)
@work_scope_option
@picture_option("the fingerprint of the last window with an isolated change")
@jobs_option
@exit_code_option
@output_options
def isolate(
    messages: Messages,
    nominal: str | None,
    source: Recordings,
    by: str,
    extra_sensor: tuple[tuple[str, float], ...],
    flips: bool | None,
    work_scope: bool | None,
    picture: str | None,
    exit_code: bool,
    output: Output,
    **choices: Any,
) -> ExitCode:
    """Isolate the parameters, or the components, that changed: one row per window and isolated parameter.

    \b
    enginediag isolate -n nominal.yaml flight.csv
    enginediag residual -n nominal.yaml --sensors flight.csv | enginediag isolate -
    enginediag isolate -n nominal.yaml flight.csv --method incremental --linearise nominal
    enginediag isolate -n nominal.yaml flight.csv --catalogue configs/faults --advise

    Sensors of outputs (`sensor.T3.bias`) and of model inputs (`input.Wf.scale`) may be wrong, too: biased, scaled,
    drifting, stuck (then excluded) or noisy. `verdict` tests all of that, where detect tests the engine alone.
    `probability` is the posterior probability that these parameters changed and nothing else that matters: no
    efficiency by 0.7 %, no flow capacity or area by 1 %, nothing else by a third of its plausible size, no instrument.
    `inclusion` is the probability that the parameter is in any set. `rivals` are the alternative sets that the data
    cannot exclude.
    `change` is in the parameter's unit, averaged over the possible sets with this parameter. Its interval also counts
    the sets without it and reaches 0 where these are not excluded. `fit` is the reduced χ² with the answer, near 1 when
    it fits; `fit_before` is the same without any answer, `explained` the explained share of the excess. Where the model
    fits poorly whatever is assumed, probabilities and intervals are widened. If the answer is then not convincing, or
    needs changes that no engine shows, the verdict is `cannot tell`, with the reason in `note`. `flips` (JSON) lists
    the errors that would change the first name, the smallest first: their `size`, one standard deviation (`stated`),
    and the name that results (`becomes`). `work_scope` (JSON) is the reduction of turbine temperature and fuel flow at
    equal thrust or power if a named module were restored, with 95 % intervals.
    """
    from enginediag_cli.api.isolation import isolate as run

    if picture and by == "component":
        raise click.UsageError("--picture goes with --by parameter")
    result = run(
        nominal,
        source,
        by=by,
        extra_sensors=dict(extra_sensor),
        flips=extra_form(flips, output, with_wide=True),
        work_scope=extra_form(work_scope, output),
        messages=messages,
        stream=True,
        **choices,
    )
    write_result(result, output, picture)
    return choose_exit_code(result.findings, result.judged, exit_code, result.unread)
