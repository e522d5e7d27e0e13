"""`enginediag isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.answer_options import SENTENCES, Beside, beside_options
from enginediag_cli.commands.intake_options import compared_options, judging_options, source_options, window_options
from enginediag_cli.commands.isolation_options import Further, further_options
from enginediag_cli.commands.judging import Compared, ending, judged_files, tell_files
from enginediag_cli.commands.options import (
    exit_code_option,
    exit_codes,
    false_alarm_option,
    jobs_option,
    message_options,
    output_options,
    pass_messages,
    probability_option,
)
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.faults.chances import INSTRUMENT, PARAMETER
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import COMPONENTS, ISOLATE
from enginediag_cli.progress import each

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.intake.source import Source
    from enginediag_cli.isolation.of_windows import IsolatedWindow
    from enginediag_cli.residuals.files import Judging

METHODS = ("posterior", "incremental", "sensitivity", "minmax")


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
    source: Source,
    compared: Compared,
    judging: Judging,
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
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.of_windows import Isolating
    from enginediag_cli.isolation.prior import SetPrior
    from enginediag_cli.presentation.isolation_rows import beside_cells, isolated_rows, tell_isolated
    from enginediag_cli.presentation.outputs.isolate import COMPONENTS as BY_COMPONENT
    from enginediag_cli.presentation.outputs.isolate import ISOLATE as BY_PARAMETER
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.kept_records import KeptRecords
    from enginediag_cli.work_scope.scope import Scoping

    if by == "component" and (method != "posterior" or faults):
        raise click.UsageError("--by component goes with --method posterior and without --faults")
    if picture_path and by == "component":
        raise click.UsageError("--picture goes with --by parameter")
    plain = not judging.reference  # otherwise the score knows more than the records tell
    further.check(method, by, compared.nominal, not plain)
    monitor = compared.open(
        messages,
        source,
        sensors=further.sensors_watched(method, compared.patterns),
        drifts=True,
        model_error=judging.model_error,
    )
    kept = None
    if monitor is not None and plain and by == "parameter" and further.keeps(method, judging.linearise):
        kept = KeptRecords(monitor, short_windows=not judging.plan.whole)
    options = IsolationOptions(
        faults=faults,
        false_alarm=false_alarm,
        prior=SetPrior(inclusion=inclusion, sensor=sensor_inclusion),
        coverage=coverage,
        confidence=confidence,
        largest=largest,
    )
    files = judged_files(source, monitor, judging)
    asked = further.diagnosis_options(method, judging.linearise, options)
    forms = beside.forms(output)
    flips, scopes = (beside.looked_for(messages, output, name) for name in forms)
    isolating = Isolating(files, asked, false_alarm, by == "component", kept, further.advise, further.extra, flips)
    scoping = Scoping(monitor) if monitor is not None else None
    named = judged = windows = 0
    drawn: list[IsolatedWindow] = []

    def rows() -> Iterator[dict[str, Any]]:
        nonlocal named, judged, windows
        for found in each(isolating.windows(), "windows isolated"):
            windows += 1
            statistics = found.verdict.window.statistics
            if windows == 1 and statistics is not None and monitor is None:
                further.warn_of_sensors(messages, found.known.values())
            judged += found.judged
            named += found.named
            scope = None
            if scoping is not None and scopes(windows, found.named):
                scope = scoping.of_isolated(found, options.prior, largest)
            if picture_path:
                drawn[:] = [*(w for w in drawn if w.named and not found.named), found]
            if windows <= SENTENCES:
                tell_isolated(messages, found, scope)
            for row in isolated_rows(found, asked.catalogue is not None, advice=further.advise):
                yield {**row, **beside_cells(found, scope, forms)}

    found = rows()
    first = next(found, None)
    declared = BY_COMPONENT if by == "component" else BY_PARAMETER
    notes = {**declared.notes, "method": method, "false_alarm": str(false_alarm)}
    head = header_lines(
        "isolate",
        configs=[*compared.configs, *source.configs, *further.files()],
        notes={**notes, **source.notes, **judging.notes, **further.notes},
        inherited=files.intake.provenance,
    )
    summary = COMPONENTS if by == "component" else ISOLATE
    rows_found = chain([first] if first is not None else [], found)
    output.write_rows(rows_found, summary=summary, provenance=head, live=True)
    tell_files(messages, files)
    if picture_path:
        from enginediag_cli.presentation.charts.pictured import of_isolation, write_picture

        write_picture(of_isolation(drawn), picture_path)
    return ending(named, judged, exit_code, files.intake.unread)
