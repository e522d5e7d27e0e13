"""`enginediag simulate`: fly an engine, healthy or faulty, and write what its sensors record."""

from __future__ import annotations

import click

from enginediag_cli.api.simulation import NOISES
from enginediag_cli.cli.options import (
    ConfigFile,
    OutputFile,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
    seed_option,
)
from enginediag_cli.cli.parameter_types import CSV_SUFFIXES
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output

CONFIG_FILE = ConfigFile()


@click.command(short_help="Simulate the recording of an engine.", epilog=exit_codes())
@click.argument("engine_file", metavar="ENGINE", type=CONFIG_FILE)
@click.option(
    "--flight",
    metavar="FILE",
    type=CONFIG_FILE,
    help="Flights to fly; without it and --conditions, a few flights of an airliner.",
)
@click.option(
    "--conditions",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, allow_dash=True),
    help="Operating conditions record by record, instead of flights; - is standard input.",
)
@click.option(
    "--fault",
    "faults",
    metavar="FILE",
    type=CONFIG_FILE,
    multiple=True,
    help="Faults to put in; may be given several times.",
)
@click.option(
    "--noise",
    type=click.Choice(NOISES),
    default=None,
    help="Sensor noise: none, gaussian (sizes of the engine file; default), uniform (1 % of the "
    "maximum reading wide), correlated (gaussian, 0.8 from record to record), quantised (rounding "
    "only).",
)
@click.option("--flights", metavar="N", type=click.IntRange(min=1), help="Number of flights, or of days on the ground.")
@click.option("--records", metavar="N", type=click.IntRange(min=1), help="End after N records.")
@click.option(
    "--truth",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write what is really wrong, record by record, to FILE.",
)
@click.option(
    "--steady",
    is_flag=True,
    help="Take every record as steady, also of an engine with states (inertias and the like).",
)
@seed_option
@output_options
@message_options
@pass_messages
def simulate(
    messages: Messages,
    engine_file: str,
    flight: str | None,
    conditions: str | None,
    faults: tuple[str, ...],
    noise: str | None,
    flights: int | None,
    records: int | None,
    truth: str | None,
    steady: bool,
    seed: int,
    output: Output,
) -> None:
    """Simulate what the sensors of ENGINE record.

    \b
    enginediag simulate configs/turbofan.yaml --flights 3 --seed 1 -o healthy.csv
    enginediag simulate configs/turbofan.yaml --fault configs/faults/hpc_fouling.yaml --truth true.csv | head
    enginediag simulate configs/turbofan.yaml --flight configs/flights/sweep.yaml --records 1000 --noise none

    An engine whose file gives states (inertia_kg_m2 of a shaft, terms that remember) is flown along time.
    Points that the engine cannot reach keep their row, with empty readings and the reason in `status`. The
    same seed gives the same flights and the same noise, with faults or without. The header names the fault
    files; leave it out with --no-header where the diagnosis is to be blind.
    """
    from enginediag_cli.api.simulation import simulate as run

    if truth == "-":
        raise click.UsageError("--truth needs a file of its own")
    result = run(
        engine_file,
        flight=flight,
        conditions=conditions,
        faults=faults,
        noise=noise,
        flights=flights,
        records=records,
        steady=steady,
        seed=seed,
        messages=messages,
        stream=True,
    )
    result.write(output, truth)
