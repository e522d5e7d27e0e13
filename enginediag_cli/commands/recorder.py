"""`enginediag recorder`: a recorder YAML drafted from a foreign file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.options import ConfigFile, OutputFile, exit_codes, message_options, pass_messages
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.recordings.engine_columns import EngineColumns


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
    from enginediag_cli.recordings.draft import draft
    from enginediag_cli.recordings.draft_text import draft_yaml
    from enginediag_cli.recordings.sniff import sniff
    from enginediag_cli.recordings.write import output as opened

    if output != "-" and file != "-" and os.path.exists(output) and os.path.samefile(output, file):
        raise click.UsageError(f"-o {output} is the recording itself")
    wanted = None
    if engine is not None:
        from enginediag_cli.physics.engine_file import load_engine

        wanted = _engine_columns(engine, load_engine(engine))
    found = draft(sniff(file), wanted)
    if output == "-":
        click.echo(draft_yaml(found, engine or ""), nl=False)
    else:
        try:
            with opened(output) as stream:
                stream.write(draft_yaml(found, engine or ""))
        except OSError as error:
            raise DataError(f"{output}: {error.strerror or error}") from error
    messages.note(
        f"{len(found.columns)} columns recognised, {len(found.decisions)} decisions left to you, "
        f"{len(found.unused)} columns not used"
        + (f", {len(found.missing)} required columns not found" if engine else "")
    )


def _engine_columns(path: str, model: Engine) -> EngineColumns:
    """What an engine asks for, with the limits and design speeds that its file states."""
    import os

    from enginediag_cli.recordings.engine_columns import EngineColumns

    # inputs may lie a fifth beyond the envelope that the file states
    limits = {c: (low - 0.2 * (high - low), high + 0.2 * (high - low)) for c, (low, high) in model.envelope.items()}
    limits |= {column: (0.0, sensor.maximum) for column, sensor in model.sensors.items() if sensor.maximum}
    shafts = model.network.shafts
    design = {column: shafts[name]["design_speed_rpm"] for column, name in model.network.speed_columns.items()}
    return EngineColumns(
        os.path.basename(path), tuple(model.inputs), tuple(model.sensors), dict(model.optional_inputs), limits, design
    )
