"""`enginediag check`: validate YAML and CSV files, all of them, and say everything that is wrong."""

from __future__ import annotations

import click

from enginediag_cli.commands.options import exit_codes, message_options, pass_messages
from enginediag_cli.errors import ConfigError, EngineDiagError, ExitCode
from enginediag_cli.presentation.messages import Messages

YAML_SUFFIXES = (".yaml", ".yml")


@click.command(short_help="Validate YAML and CSV files.", epilog=exit_codes())
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@message_options
@pass_messages
def check(messages: Messages, files: tuple[str, ...]) -> ExitCode:
    """Validate files: YAML (.yaml, .yml) by the kind that it names, anything else as a CSV recording.

    \b
    enginediag check configs/turbofan.yaml flight.csv
    zcat flight.csv.gz | enginediag check -

    A line per good file goes to standard output, for a recording with what would be masked in it; every
    problem of every other file, with its place and how to mend it, to standard error.
    """
    result = ExitCode.DONE
    for file in files:
        try:
            found = _check_yaml(file) if file.lower().endswith(YAML_SUFFIXES) else _check_recording(file)
        except ConfigError as error:
            messages.problems(error)
            result = ExitCode.TROUBLE
        except EngineDiagError as error:
            messages.error(str(error))
            result = ExitCode.TROUBLE
        else:
            click.echo(f"{'<stdin>' if file == '-' else file}: ok, {found}")
    return result


def _check_yaml(file: str) -> str:
    from enginediag_cli.config.kinds import check_file

    return f"a file of kind {check_file(file).name}"


def _check_recording(file: str) -> str:
    """What a CSV file holds, and what an analysis would not use of it."""
    from enginediag_cli.recordings.quality import mask_gross
    from enginediag_cli.recordings.read import read_all

    recording = read_all(file)
    _, report = mask_gross(recording)
    found = f"{len(recording)} records, {len(recording.columns)} columns of numbers"
    if recording.text:
        found += f", {len(recording.text)} of text"
    return "\n  ".join([found, *report.report_lines()])
