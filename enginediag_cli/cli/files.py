"""`enginediag check` and `recorder`: files before they are used, and a recorder file for foreign recordings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import (
    INPUT,
    MODEL,
    nominal_options,
    option,
    output_file_option,
    output_options,
    recorder_options,
)
from enginediag_cli.cli.parameter_types import ConfigFile
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.safe_text import visible

if TYPE_CHECKING:
    from enginediag_cli.api.files import FileCheck


@command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(allow_dash=True))
@recorder_options
@nominal_options("Nominal file of the engine, from identify, with which the recordings are compared.")
@option(MODEL, "--engine", metavar="ENGINE", type=ConfigFile(), help="Engine file, if there is no nominal file.")
@output_options
def check(messages: Messages, files: tuple[str, ...], output: Output, **against: Any) -> ExitCode:
    """Check files: YAML (.yaml, .yml) by the kind that it names, anything else as a recording, CSV or Parquet.

    \b
    enginediag check configs/turbofan.yaml flight.csv
    enginediag check -n nominal.yaml flight.csv --format csv
    enginediag check -n left.yaml --recorder citation_jt15d.yaml --engine-instance left raw.csv.gz
    zcat flight.csv.gz | enginediag check --engine turbofan.yaml -

    For a recording it reports missing or misspelt columns, impossible units, frozen stretches, gaps, time that runs
    backwards, repeated records and masked readings. With -n it also reports how many records lie inside the identified
    envelope, and which input is outside. With --engine it looks for the columns of that engine.

    The report goes to standard output, what keeps a file from being used to standard error; with --format or -o, all of
    it is rows. The exit code is 0 if every file can be used, with or without warnings, else 2: no column of numbers, an
    input or all sensors missing, impossible units, no record left to judge.
    """
    from enginediag_cli.api.files import check as run
    from enginediag_cli.api.files import recordings_among

    _refuse_idle_options(recordings_among(files))
    result = run(files, messages=messages, stream=True, **against)
    if output.format != "auto" or not output.to_stdout:
        output.write_rows(result.rows, result.columns, summary=result.summary_columns)
    else:
        for one in result.files():
            _print(messages, one)
    return ExitCode.DONE if result.ok else ExitCode.TROUBLE


def _refuse_idle_options(recordings: Sequence[str]) -> None:
    """Raise click.UsageError for options of recordings on the command line where no recording is given."""
    source = click.get_current_context().get_parameter_source
    typed = (source(name) for name in ("nominal", "engine", "recorder", "engine_instance"))
    if not recordings and ParameterSource.COMMANDLINE in typed:
        what = "-n, --engine, --recorder and --engine-instance are for recordings, and none is given"
        raise click.UsageError(what)


def _print(messages: Messages, one: FileCheck) -> None:
    """Print facts about a file on standard output; warnings and errors go to standard error."""
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


@command()
@click.argument("file", metavar="FILE")
@option(INPUT, "--engine", metavar="ENGINE", type=ConfigFile(), help="Look for the inputs and sensors of this engine.")
@output_file_option("Write to YAML; - is standard output.", metavar="YAML")
def recorder(messages: Messages, file: str, engine: str | None, output: str) -> None:
    """Draft the recorder file that maps FILE, a recording of a foreign logger, to the program's own columns.

    \b
    enginediag recorder flight.csv -o recorder.yaml
    enginediag recorder --engine turbofan.yaml flight.csv | less

    Delimiter, decimal mark, encoding, header, units, time stamps and engines are inferred. The draft is complete YAML
    that `enginediag check` accepts; comments mark what was GUESSED and what you must DECIDE.
    """
    from enginediag_cli.api.files import draft_recorder

    if output != "-" and file != "-" and os.path.exists(output) and os.path.samefile(output, file):
        raise click.UsageError(f"-o {output} is the recording itself")
    draft = draft_recorder(file, engine=engine)
    draft.save(output)
    messages.note(draft.summary())
