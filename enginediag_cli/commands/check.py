"""`enginediag check`: validate YAML files, and say of recordings whether they can be judged."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.commands.intake_options import nominal_options, recorder_options
from enginediag_cli.commands.options import ConfigFile, exit_codes, message_options, output_options, pass_messages
from enginediag_cli.errors import ConfigError, DataError, EngineDiagError, ExitCode
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.safe_text import visible

if TYPE_CHECKING:
    from enginediag_cli.intake.accepted import Accepted, Against

YAML_SUFFIXES = (".yaml", ".yml")


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
    from enginediag_cli.intake.intake import refuse_silent_pipe

    recordings = [file for file in files if not file.lower().endswith(YAML_SUFFIXES)]
    against = _against(messages, nominal, engine, recorder, engine_instance, accept_changed_engine, recordings)
    as_rows = output.format != "auto" or not output.to_stdout
    rows: list[dict[str, Any]] = []
    for file in files:
        name = "<stdin>" if file == "-" else file
        try:
            if len(files) > 1:
                refuse_silent_pipe(file)
            if file in recordings:
                rows += _recording(messages, file, against, as_rows)
                continue
            found, remarks = _check_yaml(file)
        except EngineDiagError as error:
            rows += _problem_rows(name, error)
            if not as_rows:
                _tell(messages, error)
        else:
            rows.append({"file": name, "ok": True, "found": found})
            rows += ({**row, "file": name, "ok": True} for row in remarks)
            if not as_rows:
                click.echo(visible(f"{name}: ok, {found}"))
                _engine_page(messages, name, remarks)
    rows += _given_twice(messages, recordings, as_rows)
    if as_rows:
        from enginediag_cli.presentation.acceptance_rows import ACCEPTANCE_COLUMNS, ACCEPTANCE_SUMMARY

        output.write_rows(rows, ACCEPTANCE_COLUMNS, summary=ACCEPTANCE_SUMMARY)
    return ExitCode.DONE if all(row["ok"] for row in rows) else ExitCode.TROUBLE


def _against(
    messages: Messages,
    nominal: str | None,
    engine: str | None,
    recorder: str | None,
    instance: str,
    accept_changed: bool,
    recordings: list[str],
) -> Against:
    """What the recordings are held against. Raises click.UsageError, ConfigError."""
    from enginediag_cli.intake.accepted import Against

    if nominal is not None and engine is not None:
        raise click.UsageError("--nominal names its engine; give either that or --engine")
    if not recordings:
        source = click.get_current_context().get_parameter_source
        typed = (source(name) for name in ("nominal", "engine", "recorder", "engine_instance"))
        if ParameterSource.COMMANDLINE in typed:
            what = "-n, --engine, --recorder and --engine-instance are for recordings, and none is given"
            raise click.UsageError(what)
        return Against()  # what a folder's options give is for its recordings
    mapped = None
    if recorder is not None:
        from enginediag_cli.presentation.left_out import undecided_lines
        from enginediag_cli.recordings.recorder import load_recorder

        mapped = load_recorder(recorder)
        for text in undecided_lines(mapped.undecided):
            messages.warning(text)
    if nominal is not None:
        from enginediag_cli.intake.baseline import open_baseline
        from enginediag_cli.presentation.baseline_doubts import tell_baseline

        baseline = open_baseline(nominal, accept_changed_engine=accept_changed)
        tell_baseline(messages, baseline, instance)
        return Against(baseline.engine, baseline.nominal, mapped, instance)
    if engine is not None:
        from enginediag_cli.physics.engine_file import load_engine

        return Against(load_engine(engine), None, mapped, instance)
    return Against(recorder=mapped, instance=instance)


def _recording(messages: Messages, file: str, against: Against, as_rows: bool) -> Iterator[dict[str, Any]]:
    """The rows of a recording; told as a page unless they are written as rows."""
    from enginediag_cli.intake.accepted import accepted
    from enginediag_cli.presentation.acceptance_rows import acceptance_rows

    for report in accepted(file, against):
        if not as_rows:
            _page(messages, report)
        yield from acceptance_rows(report)


def _page(messages: Messages, report: Accepted) -> None:
    """All that is known of a recording on standard output; what keeps it from being judged on standard error."""
    from enginediag_cli.presentation.acceptance_rows import PROBLEM, headline, remarks

    click.echo(visible(headline(report)))
    for remark in remarks(report):
        if remark.level == PROBLEM:
            messages.error(f"{'<stdin>' if report.file == '-' else report.file}: {remark.told}", file=report.file)
        else:
            click.echo(visible(f"  {remark.line}"))


def _given_twice(messages: Messages, recordings: list[str], as_rows: bool) -> Iterator[dict[str, Any]]:
    """A warning about files that are the same, which every other command refuses together."""
    from enginediag_cli.intake.source import refuse_repeated

    try:
        refuse_repeated(recordings)
    except DataError as error:
        if not as_rows:
            messages.warning(str(error))
        yield {"file": recordings[0], "ok": True, "level": "warning", "about": "repeated", "problem": str(error)}


def _tell(messages: Messages, error: EngineDiagError) -> None:
    if isinstance(error, ConfigError):
        messages.problems(error)
    else:
        messages.error(str(error))


def _problem_rows(file: str, error: EngineDiagError) -> Iterator[dict[str, Any]]:
    """A row per problem, with its place where it is known: of a recording it stands in the text."""
    if not isinstance(error, ConfigError):
        yield {"file": file, "ok": False, "level": "problem", "problem": str(error)}
        return
    for problem in error.problems:
        mark = problem.mark
        yield {
            "file": mark.file,
            "ok": False,
            "level": "problem",
            "line": mark.line or None,
            "column": mark.column or None,
            "problem": problem.message,
            "hint": problem.hint,
        }


def _check_yaml(file: str) -> tuple[str, list[dict[str, Any]]]:
    """What a YAML file is, and rows of what is known of an engine. Raises ConfigError."""
    from enginediag_cli.config.kinds import check_file

    kind, remarks = check_file(file).name, []
    undecided: tuple[str, ...] = ()
    if kind == "recorder":
        from enginediag_cli.recordings.recorder import load_recorder

        undecided = load_recorder(file).undecided
    if kind == "engine":
        from enginediag_cli.physics.engine_file import load_engine
        from enginediag_cli.presentation.engine_overview import overview_rows

        remarks = list(overview_rows(load_engine(file)))
    more = "".join(f"\n  open: {text}" for text in undecided)
    return f"a file of kind {kind}" + (f", a draft with decisions left open:{more}" if undecided else ""), remarks


def _engine_page(messages: Messages, file: str, remarks: list[dict[str, Any]]) -> None:
    """The design table on standard output, what is doubted on standard error."""
    for row in remarks:
        if row["level"] == "warning":
            messages.warning(f"{file}: {row['problem']} ({row['hint']})", file=file)
        else:
            click.echo(visible(f"  {row['name']}: {row['found']}"))
