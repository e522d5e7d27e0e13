"""`enginediag identify`: nominal parameters and noise of an engine from healthy recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.intake_options import model_error_option, source_options
from enginediag_cli.commands.options import (
    ConfigFile,
    FiniteRange,
    exit_codes,
    jobs_option,
    message_options,
    output_file_option,
    pass_messages,
)
from enginediag_cli.commands.picture_option import picture_option
from enginediag_cli.errors import ExitCode
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.identification.problem import TrainingRecording
    from enginediag_cli.intake.source import Source


@dataclass(frozen=True)
class Part:
    """Which records are fitted: the first so many of each recording, and which are held out to judge the fit by."""

    first: int | None
    holdout: float | None
    holdout_last: bool
    probes_left_out: tuple[str, ...] = ()

    @property
    def notes(self) -> dict[str, str]:
        """Choices that the result depends on, for its provenance."""
        told = {} if self.first is None else {"first records": str(self.first)}
        if self.holdout is not None or self.holdout_last:
            told["held out"] = "the last recording" if self.holdout_last else f"last {self.holdout:g} of each recording"
        if self.probes_left_out:
            told["contradicted by heat balances, not fitted"] = ", ".join(self.probes_left_out)
        return told


@click.command(short_help="Fit the nominal engine and its sensor noise.", epilog=exit_codes())
@click.argument("engine_path", metavar="ENGINE.yaml", type=ConfigFile())
@source_options
@click.option(
    "--first",
    type=click.IntRange(min=1),
    metavar="N",
    help="Use only the first N records of each recording, for an engine's early life.",
)
@click.option(
    "--holdout",
    type=FiniteRange(0, 0.9, min_open=True),
    metavar="SHARE",
    help="Keep the last SHARE of each recording out of the fit and judge the fit by it.",
)
@click.option("--holdout-last", is_flag=True, help="Keep the last recording out of the fit and judge by it.")
@click.option("--no-cross-validation", is_flag=True, help="Skip the refits without a block of records.")
@click.option("--keep-probes", is_flag=True, help="Fit probes, too, that the heat balances of the others contradict.")
@model_error_option
@click.option(
    "--allow-bounds", is_flag=True, help="Write it although parameters end at their bounds, or far from their priors."
)
@picture_option("how well each reading is fitted")
@output_file_option("Write the nominal file here, completely or not at all; - is standard output.")
@jobs_option
@message_options
@pass_messages
def identify(
    messages: Messages,
    engine_path: str,
    source: Source,
    first: int | None,
    holdout: float | None,
    holdout_last: bool,
    no_cross_validation: bool,
    keep_probes: bool,
    model_error: float | None,
    allow_bounds: bool,
    picture_path: str | None,
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
    from enginediag_cli.engine.description import EngineDescription
    from enginediag_cli.engine.overview import heating_value_doubts
    from enginediag_cli.identification.identify import identify as run
    from enginediag_cli.identification.nominal_file import write_nominal
    from enginediag_cli.identification.probe_consistency import without_probes, wrong_probes
    from enginediag_cli.identification.repeats import without_repeats
    from enginediag_cli.intake.agreement import agreement_with_engine
    from enginediag_cli.intake.flights import MOST, Thinning, whole_flights
    from enginediag_cli.intake.intake import Intake
    from enginediag_cli.intake.wanted import columns_of
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.presentation.identification_report import (
        bounds_line,
        doubt_lines,
        repeat_lines,
        report_lines,
    )
    from enginediag_cli.presentation.left_out import tell_left_out, tell_mismatches, tell_thinning
    from enginediag_cli.presentation.probe_lines import probe_lines
    from enginediag_cli.residuals.compact import is_smooth
    from enginediag_cli.residuals.monitor import monitor_from_nominal

    engine = load_engine(engine_path)
    for doubt in heating_value_doubts(engine) if hasattr(engine, "network") else ():
        messages.warning(f"{engine_path}: {doubt}")
    described = EngineDescription.of(engine_path, engine.declared)
    agreement = agreement_with_engine(engine)
    intake = Intake(source, columns_of(engine, past=True), agreement=agreement)
    thinning = Thinning(0 if first else MOST)
    training = [flight.recording for flight in whole_flights(intake, thinning)]
    tell_thinning(messages, thinning)
    tell_left_out(messages, intake.left_out)
    tell_mismatches(messages, intake.mismatches)
    training, repeats = without_repeats(training, (*engine.inputs, *engine.sensors))
    for line in repeat_lines(repeats):
        messages.warning(line)
    probes = wrong_probes(engine, training)
    for line in probe_lines(probes, kept=keep_probes):
        messages.warning(line)
    left = () if keep_probes else tuple(w.columns[0] for w in probes if w.told_apart and w.columns[0] in engine.sensors)
    training = without_probes(training, left)
    part = Part(first, holdout, holdout_last, left)
    training, held_out = _divided(training, part)
    result = run(
        engine, training, held_out=held_out, cross_validation=not no_cross_validation, map_accuracy=model_error
    )
    for line in report_lines(result):
        messages.note(line)
    for line in doubt_lines(result):
        messages.warning(line)
    if not result.converged:
        messages.error(f"no nominal state: {result.reason}; nothing is written")
        return ExitCode.NO_VERDICT
    if result.bounds and not allow_bounds:
        messages.error(bounds_line(result.bounds))
        return ExitCode.NO_VERDICT
    if result.far_off and not (allow_bounds or source.accept_mismatch):
        named = ", ".join(e.name for e in result.far_off)
        messages.error(f"no nominal state: {named} where no engine of this kind is; --allow-bounds writes it as it is")
        return ExitCode.NO_VERDICT
    path = _engine_reference(engine_path, output_path)
    nominal = result.nominal(path, described.sha256, _provenance(source, part))
    smooth = is_smooth(monitor_from_nominal(engine, nominal))
    write_nominal(replace(nominal, smooth=smooth, description=described), output_path)
    if picture_path:
        from enginediag_cli.presentation.charts.pictured import of_identification, write_picture

        write_picture(of_identification(result), picture_path)
    return ExitCode.DONE


def _divided(training: list[TrainingRecording], part: Part) -> tuple[list[TrainingRecording], list[TrainingRecording]]:
    """What is fitted, and what is held out."""
    from enginediag_cli.identification.training import first_records, hold_out_end

    if part.first is not None:
        training = first_records(training, part.first)
    if part.holdout is not None:
        return hold_out_end(training, part.holdout)
    if part.holdout_last:
        if len(training) < 2:
            raise click.UsageError("--holdout-last needs at least two recordings")
        return training[:-1], training[-1:]
    return training, []


def _engine_reference(engine_path: str, output_path: str) -> str:
    """Path of the engine file as seen from the nominal file, with forward slashes."""
    import os
    from pathlib import Path

    folder = "." if output_path == "-" else os.path.dirname(output_path) or "."
    return Path(os.path.relpath(engine_path, folder)).as_posix()


def _provenance(source: Source, part: Part) -> dict[str, str]:
    """What made the nominal file: the version and every choice, files by name and hash but not by folder."""
    import os

    from enginediag_cli import __version__
    from enginediag_cli.recordings.provenance import besides, sha256_of

    made = {"enginediag": __version__}
    for number, path in enumerate(source.files, start=1):
        made[f"recording {number}"] = (
            "stdin" if path == "-" else f"{os.path.basename(path)} sha256:{sha256_of(path)[:16]}"
        )
    if source.recorder:
        made["recorder"] = f"{os.path.basename(source.recorder)} sha256:{sha256_of(source.recorder)[:16]}"
    return {**made, **besides(), **source.notes, **part.notes}
