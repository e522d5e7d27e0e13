"""`enginediag simulate`: fly an engine, healthy or faulty, and write what its sensors record."""

from __future__ import annotations

from typing import Any

import click

from enginediag_cli.api.simulation import NOISES
from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import INPUT, MODEL, OUTPUT, option, output_options, seed_option
from enginediag_cli.cli.parameter_types import COUNT, CSV_SUFFIXES, ConfigFile, OutputFile
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output


@command()
@click.argument("engine", metavar="ENGINE", type=ConfigFile())
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
    help="Sensor noise. gaussian: sizes of the engine file (default); uniform: 1 % of the maximum reading wide; "
    "correlated: gaussian, 0.8 from record to record; quantised: rounding only; none.",
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
    messages: Messages, engine: str, fault: tuple[str, ...], truth: str | None, output: Output, **choices: Any
) -> None:
    """Simulate what the sensors of ENGINE record.

    \b
    enginediag simulate configs/turbofan.yaml --flights 3 --seed 1 -o healthy.csv
    enginediag simulate configs/turbofan.yaml --fault configs/faults/hpc_fouling.yaml --truth true.csv | head
    enginediag simulate configs/turbofan.yaml --flight configs/flights/sweep.yaml --records 1000 --noise none

    An engine whose file has states (inertia_kg_m2 of a shaft, effects with memory) is integrated over time. Points that
    the engine cannot reach keep their row, with empty readings and the reason in `status`. The same seed gives the same
    flights and the same noise, with faults or without. The header names the fault files; omit it with --no-header for a
    blind diagnosis.
    """
    from enginediag_cli.api.simulation import simulate as run

    if truth == "-":
        raise click.UsageError("--truth needs a file of its own")
    run(engine, faults=fault, messages=messages, stream=True, **choices).write(output, truth)
