"""`enginediag check`: validate YAML and CSV files, all of them, and say everything that is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click

from enginediag_cli.commands.options import exit_codes, message_options, output_options, pass_messages
from enginediag_cli.errors import ConfigError, EngineDiagError, ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.safe_text import visible

YAML_SUFFIXES = (".yaml", ".yml")


COLUMNS = ("file", "ok", "line", "column", "found", "problem", "hint")


@click.command(short_help="Validate YAML and CSV files.", epilog=exit_codes())
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(allow_dash=True))
@output_options
@message_options
@pass_messages
def check(messages: Messages, files: tuple[str, ...], output: Output) -> ExitCode:
    """Validate files: YAML (.yaml, .yml) by the kind that it names, anything else as a CSV recording.

    \b
    enginediag check configs/turbofan.yaml flight.csv
    enginediag check configs/*.yaml --format ndjson
    zcat flight.csv.gz | enginediag check -

    A line per good file goes to standard output, for a recording with what would be masked in it; every
    problem of every other file, with its place and how to mend it, to standard error. With --format or -o, each
    good file and each problem is a row instead.
    """
    as_rows = output.format != "auto" or not output.to_stdout
    rows: list[dict[str, Any]] = []
    for file in files:
        name = "<stdin>" if file == "-" else file
        try:
            found = _check_yaml(file) if file.lower().endswith(YAML_SUFFIXES) else _check_recording(file)
        except EngineDiagError as error:
            rows += _problem_rows(name, error)
            if not as_rows:
                _tell(messages, error)
        else:
            rows.append({"file": name, "ok": True, "found": found})
            if not as_rows:
                click.echo(visible(f"{name}: ok, {found}"))
    if as_rows:
        output.write_rows(rows, COLUMNS, summary=("file", "ok", "line", "problem", "found"))
    return ExitCode.DONE if all(row["ok"] for row in rows) else ExitCode.TROUBLE


def _tell(messages: Messages, error: EngineDiagError) -> None:
    if isinstance(error, ConfigError):
        messages.problems(error)
    else:
        messages.error(str(error))


def _problem_rows(file: str, error: EngineDiagError) -> Iterator[dict[str, Any]]:
    """A row per problem, with its place where it is known: of a recording it stands in the text."""
    if not isinstance(error, ConfigError):
        yield {"file": file, "ok": False, "problem": str(error)}
        return
    for problem in error.problems:
        mark = problem.mark
        yield {
            "file": mark.file,
            "ok": False,
            "line": mark.line or None,
            "column": mark.column or None,
            "problem": problem.message,
            "hint": problem.hint,
        }


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
