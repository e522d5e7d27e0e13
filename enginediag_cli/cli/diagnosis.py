"""Commands that judge recordings against a nominal engine: `detect` and `isolate`.

`detect` tests whether the engine has departed from its nominal state: by window, live, or by another method. `isolate`
searches the parameters that changed, with sizes, probabilities and alternatives.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.api.isolation import INSTRUMENT, METHODS, PARAMETER
from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    COUNT,
    EXISTING,
    INPUT,
    JUDGEMENT,
    MODEL,
    OPERATION,
    OUTPUT,
    POSITIVE,
    FiniteRange,
    RequiredChange,
    by_option,
    completions,
    exit_code_option,
    extra_form,
    false_alarm_option,
    is_chosen,
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
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.results import Result
    from enginediag_cli.errors import ExitCode


NOT_WITH_A_METHOD = {
    "follow": "it judges complete windows",
    "idle": "it judges complete windows",
    "detectable": "the smallest detectable change is that of the GLR test",
    "power": "the smallest detectable change is that of the GLR test",
    "must_show": "the smallest detectable change is that of the GLR test",
    "reference": "it compares with the nominal engine, or with what it learns from --healthy",
    "last": "it judges whole recordings",
}
"""Options that only the GLR test has, and why."""

NOT_LIVE = {
    "step": "blocks do not overlap, or their evidence would count twice",
    "detectable": "the smallest detectable change depends on how long it has lasted",
    "reference": "a flight is judged from its first record on",
    "last": "the last records of a flight in progress are unknown",
}
"""Options that --follow does not have, and why."""


class MethodName(click.ParamType):
    """The name of a method; the methods are only loaded when one is asked for."""

    name = "method"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse an unknown name."""
        from enginediag_cli.api.detection import chosen_method
        from enginediag_cli.errors import UsageError

        try:
            chosen_method(value)
        except UsageError as error:
            self.fail(str(error), param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Names of the methods."""
        from enginediag_cli.api.detection import method_names

        return completions(dict(method_names()), incomplete)


@command(finding="a fault was found and --exit-code given")
@recordings_options
@nominal_options("Nominal file of the engine, from identify; not needed for statistics from residual.")
@window_options
@false_alarm_option
@option(
    JUDGEMENT,
    "--power",
    metavar="P",
    type=FiniteRange(0.5, 0.9999),
    default=0.9,
    show_default=True,
    help="Probability of detection that defines the smallest detectable change.",
)
@option(
    JUDGEMENT,
    "--must-show",
    metavar="PATTERN=SIZE",
    type=RequiredChange(),
    multiple=True,
    help="Call a window healthy only if it would have shown this change of the parameters of this name or shell "
    "pattern, in their unit (one per component is enough). Default: efficiency 0.02, flow capacity and area 0.03. "
    "`none`: no such condition.",
)
@option(
    JUDGEMENT,
    "--method",
    metavar="NAME",
    type=MethodName(),
    help="Use another method, such as parity, extended_kalman, pca_raw or incremental (see study).",
)
@option(
    JUDGEMENT,
    "--healthy",
    metavar="FILE",
    multiple=True,
    type=EXISTING,
    help="Healthy recordings from which a --method learns. Repeatable.",
)
@option(
    OPERATION,
    "--follow",
    is_flag=True,
    help="Judge records as they arrive, from standard input or a growing file: one row per --window records (5). "
    "--false-alarm then holds for a whole flight.",
)
@option(
    OPERATION,
    "--idle",
    metavar="SECONDS",
    type=FiniteRange(min=0),
    default=60.0,
    show_default=True,
    help="With --follow: stop when the file has not grown for this time.",
)
@option(
    OUTPUT,
    "--detectable",
    is_flag=True,
    help="Add the smallest detectable change of each parameter, in its unit, and the parameters that the window does "
    "not excite. JSON always has them.",
)
@picture_option("the statistic of every window over its threshold")
@jobs_option
@exit_code_option
@output_options
def detect(
    messages: Messages,
    nominal: str | None,
    source: Recordings,
    method: str | None,
    healthy: tuple[str, ...],
    follow: bool,
    idle: float,
    detectable: bool,
    power: float,
    must_show: tuple[Any, ...],
    picture: str | None,
    exit_code: bool,
    output: Output,
    **choices: Any,
) -> ExitCode:
    """Test whether monitored parameters have changed, one row per window.

    \b
    enginediag detect -n nominal.yaml flight.csv
    enginediag simulate configs/turbofan.yaml --seed 7 | enginediag detect -n nominal.yaml -
    enginediag detect -n nominal.yaml flight.csv --window 10min --step 1min --detectable
    tail -n +1 -f flight.csv | enginediag detect -n nominal.yaml --follow -

    The verdict is healthy, fault, or no verdict with its reason. A window that could not be judged, or that would not
    have shown a change of the size of --must-show, is never called healthy. `fit` is the reduced χ² that no change of
    parameters explains: near 1 when model and noise are right.

    With --follow, `log10_e` is the evidence for a change since the flight began, as a power of ten. The alarm comes
    when it reaches about 0.4/P of --false-alarm, at any time of the flight, and stays: 1/P would be exact if evidence
    grew in small steps, and it exceeds a limit by a factor of 2.5 or so when it passes it. A deviation of a single
    sensor or input is an alarm once it has lasted longer than a gross error: 7 records or 10 minutes. `kind` is then
    that of trend (step, deterioration, comes and goes, intermittent, from start, irregular) or cannot tell; onset_s is
    the onset, with its 95 % interval.

    With --method, another method judges each window: rows hold statistic, threshold and p value of each of its tests.
    `isolated` lists what it names; `isolated_kind` says whether these are parameters of the engine or sensors.
    """
    from enginediag_cli.api import detection

    if healthy and not method:
        raise click.UsageError("--healthy goes with a --method that learns")
    if picture and (follow or method):
        raise click.UsageError("--picture goes with neither --follow nor --method")
    if "none" in must_show and len(must_show) > 1:
        raise click.UsageError("--must-show none excludes any other --must-show")
    settings: dict[str, Any] = {**choices, "messages": messages, "stream": True}
    result: Result
    if method:
        _check_method(method, healthy, nominal, source.files)
        result = detection.detect_by_method(nominal, source, method, healthy=healthy, **settings)
    elif follow:
        _check_follow(nominal, detectable=detectable, **choices)
        block = _block_length(choices["window"])
        result = detection.follow(nominal, source, block=block, idle_s=idle, **settings)
    else:
        detectable = detectable or output.chosen_format() in ("json", "ndjson")
        required = "none" if "none" in must_show else must_show
        result = detection.detect(nominal, source, detectable=detectable, power=power, must_show=required, **settings)
    write_result(result, output, picture)
    return choose_exit_code(result.findings, result.judged, exit_code, result.unread)


def _check_method(name: str, healthy: Sequence[str], nominal: str | None, recordings: Sequence[str]) -> None:
    """Raise click.UsageError for options that another method does not have."""
    from enginediag_cli.api.detection import chosen_method

    method, context = chosen_method(name), click.get_current_context()
    refused = {f"--{o.replace('_', '-')}": why for o, why in NOT_WITH_A_METHOD.items() if is_chosen(context, o)}
    typed = context.get_parameter_source("linearise") is ParameterSource.COMMANDLINE
    if typed and all(f.name != "linearise" for f in method.OPTIONS):
        refused["--linearise"] = "it has no such choice"
    reasons = [f"{option} does not go with --method {name}: {why}" for option, why in refused.items()]
    if nominal is None:
        reasons.append(f"--method {name} needs --nominal")
    if method.learns and not healthy:
        reasons.append(f"--method {name} learns: name healthy recordings with --healthy FILE")
    if healthy and not method.learns:
        reasons.append(f"--healthy does not go with --method {name}: it learns nothing")
    files = [file for file in recordings if file != "-"]
    both = [file for file in files if any(os.path.samefile(file, other) for other in healthy)]
    reasons += [f"{file} is both judged and learnt from: it would always be healthy" for file in both]
    if reasons:
        raise click.UsageError("; ".join(reasons))


def _check_follow(nominal: str | None, **choices: Any) -> None:
    """Raise click.UsageError for options that do not go with --follow."""
    if nominal is None:
        raise click.UsageError("--follow needs --nominal")
    reasons = [f"--{name} does not go with --follow: {why}" for name, why in NOT_LIVE.items() if choices[name]]
    if reasons:
        raise click.UsageError("; ".join(reasons))


def _block_length(window: str | None) -> int | None:
    """Records of a block; None where no window is given. Raises click.UsageError for a time."""
    if window is None:
        return None
    if not window.strip().isdigit() or not int(window):
        raise click.UsageError("with --follow, --window is a number of records")
    return int(window)


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
@option(
    JUDGEMENT,
    "--pool",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    help="Judge the last N flights of each engine together, as one window, across files. Changes are then means over "
    "these flights; what instruments are off by from flight to flight is learnt from all flights of the engine. With "
    "--last, of the last records of each flight.",
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
@by_option("component: one row per window with the changed components (posterior), for an engine with generic maps.")
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
    enginediag isolate -n nominal.yaml --pool 20 flights/*.csv

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
