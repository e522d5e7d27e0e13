"""Commands that make and use an engine model: `simulate`, `identify` and `residual`.

`simulate` flies an engine, healthy or faulty, and writes what its sensors record. `identify` estimates nominal
parameters and sensor noise from healthy recordings. `residual` reduces recordings to sufficient statistics, or lists
residuals by record.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.api.simulation import NOISES
from enginediag_cli.cli.config import choose_exit_code, command, write_result
from enginediag_cli.cli.options import (
    COUNT,
    CSV_SUFFIXES,
    EXISTING,
    INPUT,
    JUDGEMENT,
    MODEL,
    OUTPUT,
    ConfigFile,
    FiniteRange,
    OutputFile,
    engine_argument,
    jobs_option,
    model_error_option,
    nominal_options,
    option,
    output_file_option,
    output_options,
    picture_option,
    recordings_options,
    seed_option,
    window_options,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

if TYPE_CHECKING:
    from enginediag_cli.api.inputs import Recordings


@command()
@click.argument("engine", metavar="[ENGINE]", required=False, type=ConfigFile())
@nominal_options(
    "Nominal file, from identify, instead of ENGINE: the engine flies with the parameters, errors of maps and sensor "
    "noise that were identified."
)
@option(
    INPUT,
    "--health",
    metavar="FILE",
    type=EXISTING,
    help="What trend found with this nominal file, CSV or JSON, one row per parameter: today's changes of components "
    "are in the engine from the first record on.",
)
@option(INPUT, "--instruments", is_flag=True, help="Also implant the errors of instruments that --health has found.")
@option(INPUT, "--engine-instance", default="", metavar="NAME", help="The engine among those of --health.")
@option(
    INPUT,
    "--flight",
    metavar="FILE",
    type=ConfigFile(),
    help="Flight file (YAML). Default, also without --conditions: a few flights of an airliner.",
)
@option(
    INPUT,
    "--conditions",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, allow_dash=True),
    help="Operating conditions record by record, instead of flights; - is standard input.",
)
@option(INPUT, "--fault", metavar="FILE", type=ConfigFile(), multiple=True, help="Fault file to implant. Repeatable.")
@option(INPUT, "--flights", metavar="N", type=COUNT, help="Number of flights, or of days on the ground.")
@option(INPUT, "--records", metavar="N", type=COUNT, help="Stop after N records.")
@option(
    MODEL,
    "--noise",
    type=click.Choice(NOISES),
    default=None,
    help="Sensor noise. gaussian: sizes of the engine file, or as identified (default); uniform: 1 % of the maximum "
    "reading wide; correlated: gaussian, 0.8 from record to record; quantised: rounding only; none.",
)
@option(MODEL, "--steady", is_flag=True, help="Treat every record as steady, even for an engine with states.")
@option(
    OUTPUT,
    "--truth",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write the true parameters and sensor errors, record by record, to FILE.",
)
@seed_option
@output_options
def simulate(
    messages: Messages, engine: str | None, fault: tuple[str, ...], truth: str | None, output: Output, **choices: Any
) -> None:
    """Simulate what the sensors of ENGINE record, or those of an engine as it was identified.

    \b
    enginediag simulate configs/turbofan.yaml --flights 3 --seed 1 -o healthy.csv
    enginediag simulate configs/turbofan.yaml --fault configs/faults/hpc_fouling.yaml --truth true.csv | head
    enginediag simulate configs/turbofan.yaml --flight configs/flights/sweep.yaml --records 1000 --noise none
    enginediag simulate -n nominal.yaml --health trend.json --flights 3 -o as_it_is_today.csv

    An engine whose file has states (inertia_kg_m2 of a shaft, effects with memory) is integrated over time. Points that
    the engine cannot reach keep their row, with empty readings and the reason in `status`. The same seed gives the same
    flights and the same noise, with faults or without. Faults come on top of what --health found. The header names the
    fault files; omit it with --no-header for a blind diagnosis.
    """
    from enginediag_cli.api.simulation import simulate as run

    if truth == "-":
        raise click.UsageError("--truth needs a file of its own")
    run(engine, faults=fault, messages=messages, stream=True, **choices).write(output, truth)


@command()
@engine_argument
@recordings_options
@option(INPUT, "--first", type=COUNT, metavar="N", help="Use only the first N records of each recording.")
@option(
    JUDGEMENT,
    "--holdout",
    type=FiniteRange(0, 0.9, min_open=True),
    metavar="SHARE",
    help="Exclude the last SHARE of each recording from the fit and judge the fit by it.",
)
@option(JUDGEMENT, "--holdout-last", is_flag=True, help="Exclude the last recording from the fit and judge by it.")
@option(JUDGEMENT, "--no-cross-validation", is_flag=True, help="Skip the refits without one block of records.")
@option(
    JUDGEMENT,
    "--allow-bounds",
    is_flag=True,
    help="Write the nominal file even if parameters are at their bounds or far from their priors.",
)
@option(MODEL, "--keep-probes", is_flag=True, help="Also fit probes that contradict the heat balances of the others.")
@model_error_option
@picture_option("how well each reading is fitted")
@output_file_option("Write the nominal file here, completely or not at all; - is standard output.")
@jobs_option
def identify(
    messages: Messages,
    engine: str,
    source: Recordings,
    no_cross_validation: bool,
    picture: str | None,
    output: str,
    **choices: Any,
) -> ExitCode:
    """Identify the nominal engine from recordings of healthy flights.

    \b
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag identify configs/jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml \\
        --engine-instance left --holdout 0.3 -o left.yaml

    The nominal file goes to standard output or -o, the report to standard error. The `identification:` block of the
    engine file lists the parameters to estimate and their prior sizes.
    """
    from enginediag_cli.api.identification import identify as run

    result = run(engine, source, cross_validation=not no_cross_validation, messages=messages, **choices)
    if result.refusal:
        return ExitCode.NO_VERDICT
    result.save(output)
    if picture:
        result.plot().save(picture)
    return ExitCode.DONE


@command()
@recordings_options
@nominal_options(required=True)
@window_options
@option(
    MODEL, "--sensors", is_flag=True, help="Include bias, scale and drift of every instrument, as isolate needs them."
)
@option(
    OUTPUT,
    "--what",
    type=click.Choice(["statistics", "records"]),
    default="statistics",
    show_default=True,
    help="statistics: one row of sufficient statistics per window; records: one row of residuals per record.",
)
@jobs_option
@output_options
def residual(messages: Messages, nominal: str, source: Recordings, output: Output, **choices: Any) -> ExitCode:
    """Compare recordings with the nominal engine.

    \b
    enginediag residual -n nominal.yaml --sensors flight.csv --window 10min | enginediag isolate -
    enginediag residual -n nominal.yaml flight.csv --what records > residuals.csv

    A row of statistics holds s, F and V of a window (upper triangles), the nominal values, the prior sizes and the
    names of the parameters. detect, isolate and trend need nothing else. The uncertainty of the nominal engine and of
    sensor offsets has columns of its own (nuisance parameters), so that rows add over windows, flights and files; it
    is added to the noise when the rows are read. With --reference it is part of s, F and V.

    Gross errors are excluded from statistics; rows of records keep every reading.
    """
    from enginediag_cli.api.detection import residual as run

    result = run(nominal, source, messages=messages, stream=True, **choices)
    write_result(result, output)
    return choose_exit_code(0, result.judged, False, result.unread)
