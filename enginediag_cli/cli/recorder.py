"""`enginediag recorder`: a recorder YAML drafted from a foreign file."""

from __future__ import annotations

import click

from enginediag_cli.cli.options import ConfigFile, OutputFile, exit_codes, message_options, pass_messages
from enginediag_cli.report.messages import Messages


@click.command(short_help="Draft a recorder YAML from a foreign file.", epilog=exit_codes())
@click.argument("file", metavar="FILE")
@click.option("--engine", metavar="ENGINE", type=ConfigFile(), help="Look for the inputs and sensors of this engine.")
@click.option(
    "-o", "--output", default="-", metavar="YAML", type=OutputFile(), help="Write to YAML; - is standard output."
)
@message_options
@pass_messages
def recorder(messages: Messages, file: str, engine: str | None, output: str) -> None:
    """Draft from FILE, the recording of somebody else's logger, the recorder YAML that maps it to the program's own.

    \b
    enginediag recorder flight.csv -o recorder.yaml
    enginediag recorder --engine turbofan.yaml flight.csv | less

    Delimiter, decimal mark, encoding, header, units, time stamps and engines are found by their looks. The draft is
    complete YAML that `enginediag check` accepts; comments say what was GUESSED and what is yours to DECIDE.
    """
    import os

    from enginediag_cli.api.files import draft_recorder

    if output != "-" and file != "-" and os.path.exists(output) and os.path.samefile(output, file):
        raise click.UsageError(f"-o {output} is the recording itself")
    draft = draft_recorder(file, engine=engine)
    draft.save(output)
    messages.note(draft.summary())
