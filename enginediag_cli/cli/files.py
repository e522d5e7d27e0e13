"""Commands for files and for reference.

`check` tests files before they are used, and `recorder` drafts a description of foreign recordings. `schema`,
`physics`, `components`, `glossary` and `man` list what there is, and what it means.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import (
    INPUT,
    MODEL,
    OUTPUT,
    PREFIX,
    ConfigFile,
    complete_terms,
    completions,
    nominal_options,
    option,
    output_file_option,
    output_options,
    recorder_options,
)
from enginediag_cli.errors import ExitCode
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.safe_text import visible

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

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


COMPONENT_COLUMNS = ("component", "title", "unknowns")


def _schemas() -> Iterator[tuple[str, str]]:
    """Every name that has a schema, and what it is."""
    from enginediag_cli.config.validate import FILE_KINDS
    from enginediag_cli.report.tables import OUTPUTS, PREFIX, output

    yield from ((kind.name, kind.help) for kind in FILE_KINDS.values())
    yield from ((f"{PREFIX}{name}", output(name).help) for name in OUTPUTS)


def _complete_schema(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return completions(dict(_schemas()), incomplete)


def _complete_component(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from enginediag_cli.api.files import component_names

    return completions(dict.fromkeys(component_names(), ""), incomplete)


def _complete_word(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from enginediag_cli.glossary import GLOSSARY

    return completions({entry.word: entry.meaning for entry in GLOSSARY}, incomplete)


def _complete_command(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from enginediag_cli.cli.main import COMMANDS

    return completions({name: entry.help for name, entry in COMMANDS.items()}, incomplete)


@command()
@click.argument("kind", required=False, shell_complete=_complete_schema)
def schema(messages: Messages, kind: str | None) -> None:
    """Print the JSON schema (draft-07) of a KIND of YAML file, or of an output; without KIND, list them.

    \b
    enginediag schema engine > engine.schema.json
    enginediag schema output/detect > detect.schema.json

    Schemas of outputs describe --format json and, under `csv`, the columns of the CSV: name, type, unit, and whether a
    cell may be empty. `version` rises when a column is removed or changes its meaning, not when one is added. It is
    `schema` in the header of a CSV and in JSON objects.

    An editor with a YAML language server checks and completes a file whose first line is
    # yaml-language-server: $schema=engine.schema.json
    """
    from enginediag_cli.config.fields import json_schema, near
    from enginediag_cli.config.validate import FILE_KINDS
    from enginediag_cli.report.tables import OUTPUTS, PREFIX, output

    if kind is None:
        every = dict(_schemas())
        width = max(map(len, every))
        for name, help in every.items():
            click.echo(f"{name:<{width}}  {help}")
        return
    name = kind.removeprefix(PREFIX)
    if kind.startswith(PREFIX) and name in OUTPUTS:
        found = output(name).schema()
    elif kind in FILE_KINDS:
        found = json_schema(FILE_KINDS[kind].load_section(), f"enginediag {kind} file")
    else:
        outputs = [f"{PREFIX}{known}" for known in OUTPUTS]
        known, what = (outputs, "output") if kind.startswith(PREFIX) else ([*FILE_KINDS, *outputs], "kind of file")
        raise click.UsageError(f"no {what} {kind!r}; {near(kind, known)}")
    click.echo(json.dumps(found, indent=2, ensure_ascii=False))


@command()
@click.argument("name", required=False, shell_complete=complete_terms)
@option(
    MODEL,
    "--engine",
    metavar="ENGINE.yaml",
    type=ConfigFile(),
    help="List the places on this engine, and the effects that its model carries.",
)
@option(MODEL, "--variables", is_flag=True, help="List the variables of a `law:` of --engine instead.")
@output_options
def physics(messages: Messages, name: str | None, engine: str | None, variables: bool, output: Output) -> None:
    """Show the physical effect NAME with its equation, coefficients, places and reference; or list all effects.

    \b
    enginediag physics
    enginediag physics reynolds_efficiency
    enginediag physics --engine turbofan.yaml
    enginediag physics --engine turbofan.yaml --variables

    Without --engine, the places are those on the shipped engines; with it, NAME may be a law of the engine file. As
    CSV, NAME has one row per coefficient, with --engine one per place; JSON has everything.
    """
    from enginediag_cli.api.files import describe_effect, list_effects, list_law_variables
    from enginediag_cli.report.reference import SITES_COLUMNS, TERMS_COLUMNS, VARIABLES_COLUMNS

    whole = output.chosen_format() != "table" or output.wide or bool(output.columns)
    if variables:
        if engine is None or name is not None:
            raise click.UsageError("--variables needs --engine, and no NAME")
        listed = list_law_variables(engine)
        output.write_rows(listed.rows, VARIABLES_COLUMNS, provenance=listed.provenance)
    elif name is None:
        listed = list_effects(engine)
        # sentences and equations have no room in a table
        columns = None if whole else SITES_COLUMNS if engine else TERMS_COLUMNS
        output.write_rows(listed.rows, columns, provenance=listed.provenance)
    else:
        found = describe_effect(name, engine)
        if whole:
            found.write(output)
        else:
            output.write_text(found.page)


@command()
@click.argument("name", required=False, shell_complete=_complete_component)
@output_options
def components(messages: Messages, name: str | None, output: Output) -> None:
    """Show the component type NAME with its equations, keys, parameters, columns and an example; or list all types.

    \b
    enginediag components
    enginediag components turbine

    Parameters, unknowns, balances and columns have the names of the example. As CSV, NAME has one row per key; JSON has
    everything.
    """
    from enginediag_cli.api.files import describe_component, list_components

    form = output.chosen_format()
    if name is None:
        listed = list_components()
        columns = COMPONENT_COLUMNS if form == "table" else None
        output.write_rows(listed.rows, columns, provenance=listed.provenance)
        return
    found = describe_component(name)
    if form == "table":
        output.write_text(found.page)
    elif form == "json":
        output.write_text(json.dumps(found.document, indent=1, ensure_ascii=False) + "\n")
    else:
        output.write_rows(found.rows, provenance=found.provenance)


@command()
@click.argument("word", required=False, shell_complete=_complete_word)
@option(
    OUTPUT,
    "--format",
    type=click.Choice(["text", "markdown"]),
    default="text",
    show_default=True,
    help="markdown: as a page of the documents.",
)
def glossary(messages: Messages, word: str | None, format: str) -> None:
    """Explain WORD, or all words of the field that the program uses. A misspelt WORD finds the nearest ones.

    \b
    enginediag glossary
    enginediag glossary "ambiguity group"
    enginediag glossary --format markdown
    """
    from enginediag_cli.glossary import GLOSSARY, as_markdown, as_text, search

    entries = GLOSSARY if word is None else search(word)
    if not entries:
        raise click.UsageError(f"the glossary has no word like {word!r}; `enginediag glossary` lists all")
    click.echo(as_markdown(entries) if format == "markdown" else as_text(entries), nl=False)


@command()
@click.argument("command", required=False, shell_complete=_complete_command)
def man(messages: Messages, command: str | None) -> None:
    """Print the manual page (roff) of COMMAND, or of the whole program.

    \b
    enginediag man detect | man -l -
    enginediag man > ~/.local/share/man/man1/enginediag.1
    """
    from enginediag_cli.cli.main import COMMANDS, enginediag
    from enginediag_cli.report.reference import command_page, program_page

    group = click.Context(enginediag, info_name="enginediag", **enginediag.context_settings)
    if command is None:
        click.echo(program_page(group, {name: entry.help for name, entry in COMMANDS.items()}), nl=False)
        return
    found = enginediag.get_command(group, command)
    if found is None:
        from enginediag_cli.config.fields import near

        raise click.UsageError(f"no such command {command!r}; {near(command, COMMANDS)}")
    prefix = f"{PREFIX}_{command}"
    context = click.Context(found, info_name=command, parent=group, auto_envvar_prefix=prefix)
    click.echo(command_page(context), nl=False)
