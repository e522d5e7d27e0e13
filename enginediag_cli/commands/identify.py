"""`enginediag identify`: nominal parameters and noise of an engine from healthy recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.options import (
    ConfigFile,
    exit_codes,
    message_options,
    pass_messages,
    recordings_argument,
)
from enginediag_cli.commands.origin import read_mapped
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.engine import Engine
    from enginediag_cli.identification.problem import TrainingRecording

YAML_FILE = ConfigFile()


def _writable(context: click.Context, parameter: click.Parameter, value: str) -> str:
    """Refuse an output that cannot be written before the work is done, not after."""
    import os

    if value != "-" and (os.path.isdir(value) or not os.path.isdir(os.path.dirname(value) or ".")):
        raise click.BadParameter(f"{value}: not a file in a folder that exists", context, parameter)
    return value


@click.command(short_help="Fit the nominal engine and its sensor noise.", epilog=exit_codes())
@click.argument("engine_path", metavar="ENGINE.yaml", type=YAML_FILE)
@recordings_argument
@click.option("--recorder", "recorder_path", type=YAML_FILE, metavar="FILE", help="Recorder of foreign recordings.")
@click.option("--engine-instance", default="", metavar="NAME", help="Use only this engine of the recordings.")
@click.option(
    "--first",
    type=click.IntRange(min=1),
    metavar="N",
    help="Use only the first N records of each recording, for an engine's early life.",
)
@click.option(
    "--holdout",
    type=click.FloatRange(0, 0.9, min_open=True),
    metavar="SHARE",
    help="Keep the last SHARE of each recording out of the fit and judge the fit by it.",
)
@click.option("--holdout-last", is_flag=True, help="Keep the last recording out of the fit and judge by it.")
@click.option("--no-cross-validation", is_flag=True, help="Skip the refits without a block of records.")
@click.option(
    "-o",
    "--output",
    "output_path",
    default="-",
    metavar="FILE",
    callback=_writable,
    help="Write the nominal file here, completely or not at all; - is standard output.",
)
@message_options
@pass_messages
def identify(
    messages: Messages,
    engine_path: str,
    recordings: tuple[str, ...],
    recorder_path: str | None,
    engine_instance: str,
    first: int | None,
    holdout: float | None,
    holdout_last: bool,
    no_cross_validation: bool,
    output_path: str,
) -> ExitCode:
    """Identify the nominal engine from recordings believed healthy.

    \b
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag identify configs/jt15d.yaml flight.csv --recorder configs/recorders/citation_jt15d.yaml \\
        --engine-instance left --holdout 0.3 -o left.yaml

    The nominal file goes to standard output or -o, the report to standard error. What is estimated, and how
    loosely, stands in the `identification:` block of the engine file.
    """
    if holdout is not None and holdout_last:
        raise click.UsageError("--holdout and --holdout-last exclude each other")
    from enginediag_cli.identification.identify import identify as run
    from enginediag_cli.identification.nominal_file import write_nominal
    from enginediag_cli.identification.repeats import without_repeats
    from enginediag_cli.identification.training import first_records, hold_out_end
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.presentation.identification_report import repeat_lines, report_lines

    engine = load_engine(engine_path)
    training = [part for path in recordings for part in _load(messages, engine, path, recorder_path, engine_instance)]
    training, repeats = without_repeats(training, (*engine.inputs, *engine.sensors))
    for line in repeat_lines(repeats):
        messages.warning(line)
    if first is not None:
        training = first_records(training, first)
    held_out: list[TrainingRecording] = []
    if holdout is not None:
        training, held_out = hold_out_end(training, holdout)
    elif holdout_last:
        if len(training) < 2:
            raise click.UsageError("--holdout-last needs at least two recordings")
        training, held_out = training[:-1], training[-1:]
    result = run(engine, training, held_out=held_out, cross_validation=not no_cross_validation)
    for line in report_lines(result):
        messages.note(line)
    if not result.converged:
        messages.error(f"no nominal state: {result.reason}; nothing is written")
        return ExitCode.NO_VERDICT
    path, digest = _engine_reference(engine_path, output_path)
    write_nominal(
        result.nominal(
            path,
            digest,
            _provenance(recordings, recorder_path, engine_instance, first, holdout, holdout_last),
        ),
        output_path,
    )
    return ExitCode.DONE


def _load(
    messages: Messages, engine: Engine, path: str, recorder_path: str | None, instance: str
) -> list[TrainingRecording]:
    """Read, map and mask one file; what was masked or left out goes to standard error."""
    import os

    from enginediag_cli.identification.training import training_recordings

    label = "stdin" if path == "-" else os.path.basename(path)
    if recorder_path is None:
        from enginediag_cli.recordings.quality import mask_gross
        from enginediag_cli.recordings.read import read_all

        recording = read_all(
            path, declared=(*engine.inputs, *engine.optional_inputs, *engine.sensors), required=engine.inputs
        )
        # an input may well stand still for hours; only a sensor that does so is stuck
        recording, inputs = mask_gross(recording, columns=engine.inputs, search=False)
        sensors = [s for s in engine.sensors if s in recording.columns]
        if sensors:
            recording, readings = mask_gross(recording, columns=sensors)
        for line in [*inputs.report_lines(), *(readings.report_lines() if sensors else [])]:
            messages.note(f"{label}: {line}")
        return training_recordings(recording, label, engine=instance)
    mapped = read_mapped(messages, recorder_path, path, instance)
    return [part for m in mapped for part in training_recordings(m.recording, label, engine=instance)]


def _engine_reference(engine_path: str, output_path: str) -> tuple[str, str]:
    """Path of the engine file as seen from the nominal file, with forward slashes, and its SHA-256."""
    import os
    from pathlib import Path

    from enginediag_cli.recordings.provenance import sha256_of

    folder = "." if output_path == "-" else os.path.dirname(output_path) or "."
    return Path(os.path.relpath(engine_path, folder)).as_posix(), sha256_of(engine_path)


def _provenance(
    recordings: tuple[str, ...],
    recorder_path: str | None,
    instance: str,
    first: int | None,
    holdout: float | None,
    holdout_last: bool,
) -> dict[str, str]:
    """What made the nominal file: the version and every choice, files by name and hash but not by folder."""
    import os

    from enginediag_cli import __version__
    from enginediag_cli.identification.nominal import ENGINE_INSTANCE
    from enginediag_cli.recordings.provenance import sha256_of

    made = {"enginediag": __version__}
    for number, path in enumerate(recordings, start=1):
        made[f"recording {number}"] = (
            "stdin" if path == "-" else (f"{os.path.basename(path)} sha256:{sha256_of(path)[:16]}")
        )
    if recorder_path:
        made["recorder"] = f"{os.path.basename(recorder_path)} sha256:{sha256_of(recorder_path)[:16]}"
    if instance:
        made[ENGINE_INSTANCE] = instance
    if first is not None:
        made["first records"] = str(first)
    if holdout is not None or holdout_last:
        made["held out"] = "the last recording" if holdout_last else f"last {holdout:g} of each recording"
    return made
