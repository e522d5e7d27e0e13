"""`enginediag recorder`: a recorder YAML drafted from a foreign file."""

from __future__ import annotations

import click

from enginediag_cli.commands.options import ConfigFile, OutputFile, exit_codes, message_options, pass_messages
from enginediag_cli.presentation.messages import Messages


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

    from enginediag_cli.errors import DataError
    from enginediag_cli.recordings.draft import draft, draft_yaml
    from enginediag_cli.recordings.sniff import sniff
    from enginediag_cli.recordings.write import output as opened

    if output != "-" and file != "-" and os.path.exists(output) and os.path.samefile(output, file):
        raise click.UsageError(f"-o {output} is the recording itself")
    targets: list[str] = []
    if engine is not None:
        from enginediag_cli.physics.engine_file import load_engine

        model = load_engine(engine)
        targets = [*model.inputs, *model.optional_inputs, *model.sensors]
    found = draft(sniff(file), targets)
    if output == "-":
        click.echo(draft_yaml(found, engine or ""), nl=False)
    else:
        try:
            with opened(output) as stream:
                stream.write(draft_yaml(found, engine or ""))
        except OSError as error:
            raise DataError(f"{output}: {error.strerror or error}") from error
    doubts = sum(bool(g.doubt) for g in found.columns.values())
    messages.note(
        f"{len(found.columns)} columns recognised, {doubts} with something to decide, {len(found.unused)} not used"
        + (f", {len(found.missing)} asked for and not found" if engine else "")
    )
