"""`enginediag check`: validate YAML files, and say of recordings whether they can be judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from enginediag_cli.cli.intake_options import nominal_options, recorder_options
from enginediag_cli.cli.options import ConfigFile, exit_codes, message_options, output_options, pass_messages
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.safe_text import visible

if TYPE_CHECKING:
    from enginediag_cli.api.files import FileCheck


@click.command(short_help="Validate YAML files and recordings.", epilog=exit_codes())
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(allow_dash=True))
@nominal_options(help="Nominal engine, as written by identify, that the recordings are to be held against.")
@click.option(
    "--engine", metavar="ENGINE", type=ConfigFile(), help="Engine of the recordings, where none is identified."
)
@recorder_options
@output_options
@message_options
@pass_messages
def check(
    messages: Messages,
    files: tuple[str, ...],
    nominal: str | None,
    accept_changed_engine: bool,
    engine: str | None,
    recorder: str | None,
    engine_instance: str,
    output: Output,
) -> ExitCode:
    """Validate files: YAML (.yaml, .yml) by the kind that it names, anything else as a recording, CSV or Parquet.

    \b
    enginediag check configs/turbofan.yaml flight.csv
    enginediag check -n nominal.yaml flight.csv --format csv
    enginediag check -n left.yaml --recorder citation_jt15d.yaml --engine-instance left raw.csv.gz
    zcat flight.csv.gz | enginediag check --engine turbofan.yaml -

    Of a recording it says what detect would find: columns that are missing or misspelt, units that cannot be, frozen
    stretches, gaps, time that runs backwards, records given twice, readings masked and, with -n, how many records
    lie inside the operating points identified, and which input is outside. With --engine, what that engine needs is
    looked for; without either, what any recording shows.

    The report goes to standard output, what keeps a file from being used to standard error; with --format or -o,
    all of it is rows. A recording that can be judged ends with 0, with or without warnings; one that cannot be (no
    column of numbers, an input or all sensors missing, units that cannot be, no record left to judge) ends with 2.
    """
    from enginediag_cli.api.files import check as run
    from enginediag_cli.api.files import recordings_among

    _refuse_idle_options(recordings_among(files))
    result = run(
        files,
        nominal=nominal,
        engine=engine,
        recorder=recorder,
        engine_instance=engine_instance,
        accept_changed_engine=accept_changed_engine,
        messages=messages,
        stream=True,
    )
    if output.format != "auto" or not output.to_stdout:
        output.write_rows(result.rows, result.columns, summary=result.summary_columns)
    else:
        for one in result.files():
            _print(messages, one)
    return ExitCode.DONE if result.ok else ExitCode.TROUBLE


def _refuse_idle_options(recordings: Sequence[str]) -> None:
    """Raises click.UsageError for options of recordings on the command line where no recording is given."""
    source = click.get_current_context().get_parameter_source
    typed = (source(name) for name in ("nominal", "engine", "recorder", "engine_instance"))
    if not recordings and ParameterSource.COMMANDLINE in typed:
        what = "-n, --engine, --recorder and --engine-instance are for recordings, and none is given"
        raise click.UsageError(what)


def _print(messages: Messages, one: FileCheck) -> None:
    """All that is known of a file on standard output; what is doubted, or keeps it from being used, on standard
    error."""
    if one.error is not None:
        messages.problems(one.error)
        return
    fields = {"file": one.file} if one.file else {}
    for level, text in one.lines:
        if level == "note":
            click.echo(visible(text))
        elif level == "warning":
            messages.warning(text, **fields)
        else:
            messages.error(text, **fields)
