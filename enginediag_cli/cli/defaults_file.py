"""enginediag.yaml: options that a folder gives to the commands run there, each with its place in the file.

The command line goes before the environment, that before the file, and the file before what is built in.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from enginediag_cli.cli.defaults_section import ALL, KIND, defaults_section, every_command, options_of
from enginediag_cli.cli.operation import APART, NOT_IN_FILES, WHERE, word_of
from enginediag_cli.cli.parameter_types import ConfigFile, OutputFile
from enginediag_cli.config.document import Node, load_document
from enginediag_cli.config.kinds import wanted_kind
from enginediag_cli.config.validate import Checked, validate
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem

ONE_LINE = 1_000_000
"""Characters of a line of YAML: more than any value has."""


@dataclass
class Given:
    """What a file gives to one command: values by the names of its parameters, as click takes defaults, and where each
    of them stands."""

    values: dict[str, Any] = field(default_factory=dict)
    marks: dict[str, Mark] = field(default_factory=dict)


def read_defaults(path: str, name: str, command: click.Command, *, found: bool) -> Given:
    """What the file gives to a command. found: it lies in the working folder and nobody named it, so that what it
    names to be written must lie there, too. Raises ConfigError."""
    from enginediag_cli.cli.main import COMMANDS

    document = load_document(path)
    wanted_kind(document, KIND)
    known = {name: command}
    if document.is_mapping and any(word not in options_of(command) for word in _words(document.value.get(ALL))):
        known = every_command()
    others = [other for other in COMMANDS if other not in known]
    checked = validate(_without(document, others), defaults_section(known, others))
    return _given(checked, command, name, found)


def check_effective(given: Given, context: click.Context, typed: Mapping[str, Any]) -> None:
    """Whether the options of a command take the file's values, where neither command line nor environment has others.
    Raises ConfigError."""
    problems: list[Problem] = []
    for option in context.command.params:
        if option.name in given.marks and option.consume_value(context, typed)[1] is ParameterSource.DEFAULT_MAP:
            problems += _refusals(option, given, context)
    if problems:
        raise ConfigError(sorted(problems, key=lambda problem: problem.mark))


def check_defaults(path: Path) -> None:
    """Whether every command takes what the file gives to it. Raises ConfigError."""
    document = load_document(path)
    commands = every_command()
    checked = validate(document, defaults_section(commands))
    problems: list[Problem] = []
    for name, command in commands.items():
        given = _given(checked, command, name, found=False)
        context = click.Context(command, info_name=name)
        for option in command.params:
            problems += _refusals(option, given, context)
    if problems:
        raise ConfigError(sorted(set(problems), key=lambda problem: problem.mark))


def _given(checked: Checked, command: click.Command, name: str, found: bool) -> Given:
    options = options_of(command)
    given = Given()
    problems: list[Problem] = []
    for section in (ALL, name):
        for word, value in (checked.values.get(section) or {}).items():
            option = options.get(word)
            if option is None or value is None:
                continue
            mark = checked.mark((section, word))
            value = _converted(value, option, os.path.dirname(checked.file))
            if found and _reaches_out(value, option, os.path.dirname(checked.file)):
                what = f"{section}.{word} is not allowed in a file that nobody named"
                problems.append(Problem(mark, what, f"name it: --config {checked.file}"))
            given.values[str(option.name)], given.marks[str(option.name)] = value, mark
    if problems:
        raise ConfigError(problems)
    return given


def _converted(value: Any, option: click.Option, folder: str) -> Any:
    """A value as click takes it from a mapping of defaults: relative paths are those beside the file."""
    if option.nargs != 1:
        return [item.split() for item in value]
    if not isinstance(option.type, click.Path):
        return value
    return [_beside(item, option, folder) for item in value] if option.multiple else _beside(value, option, folder)


def _beside(path: str, option: click.Option, folder: str) -> str:
    if path in ("", "-") or os.path.isabs(path) or not folder:
        return path
    joined = os.path.join(folder, path)
    if isinstance(option.type, ConfigFile) and not os.path.lexists(joined):
        from enginediag_cli.shipped import shipped

        try:
            return str(shipped(path))
        except DataError:
            return joined
    return joined


def _reaches_out(value: Any, option: click.Option, folder: str) -> bool:
    """Whether a file would be written that does not lie in the folder, or the folder's fence be taken down: what comes
    with recordings of somebody else must not do so."""
    if option.name == "allow_outside":
        return bool(value)
    if not isinstance(option.type, OutputFile) or value == "-":
        return False
    return not Path(os.path.realpath(value)).is_relative_to(os.path.realpath(folder or "."))


def _refusals(option: click.Parameter, given: Given, context: click.Context) -> Iterator[Problem]:
    """What an option has against its value in the file."""
    name = str(option.name)
    if name not in given.marks:
        return
    try:
        value = option.type_cast_value(context, given.values[name])
        if option.callback is not None and option.expose_value:  # the others keep what they are given
            option.callback(context, option, value)
    except click.BadParameter as error:
        yield Problem(given.marks[name], f"{word_of(option)}: {error.message.rstrip('.')}")
    except click.UsageError as error:
        yield Problem(given.marks[name], f"{word_of(option)}: {error.message}")


def _words(section: Node | None) -> tuple[str, ...]:
    return tuple(section.value) if section is not None and section.is_mapping else ()


def _without(document: Node, names: list[str]) -> Node:
    """The document without these sections, which are not asked for now."""
    if not document.is_mapping:
        return document
    kept = {key: node for key, node in document.value.items() if key not in names}
    return replace(document, value=kept)


def printed(command: click.Command, name: str, context: click.Context, typed: Mapping[str, Any]) -> str:
    """Every option of a command with its value and, as a comment, where it comes from: as a file that gives the same.
    What has no value is a comment. Raises click.UsageError for a value that is wrong."""
    from enginediag_cli.config.document import dump

    lines = [f"# the options of enginediag {name}, and where each comes from", f"kind: {KIND}", f"{name}:"]
    for parameter in command.get_params(context):
        option = isinstance(parameter, click.Option)
        if parameter.name in APART or parameter is command.get_help_option(context):
            continue
        value, source = parameter.consume_value(context, typed)
        told = value is not None and type(value).__name__ != "Sentinel"
        value = parameter.type_cast_value(context, value if told else None)
        word = word_of(parameter) if option else (parameter.metavar or str(parameter.name))
        if parameter.nargs not in (1, -1) and value:
            value = [" ".join(map(str, item)) for item in value]
        line = dump({word: _plain(value)}, width=ONE_LINE).rstrip("\n")
        line = line[1:-1] if line.startswith("{") else line  # a mapping of one scalar comes in braces
        if value is None or value == ():
            lines.append(f"  # {word}:  # not given")
        else:
            mark = "" if option and parameter.name not in NOT_IN_FILES else "# "
            lines.append(f"  {mark}{line}  # {_source(parameter, source, context)}")
    return "\n".join(lines) + "\n"


def _source(parameter: click.Parameter, source: ParameterSource | None, context: click.Context) -> str:
    if source is ParameterSource.ENVIRONMENT:
        names = [parameter.envvar] if isinstance(parameter.envvar, str) else list(parameter.envvar or ())
        return "environment, " + next((name for name in names if os.environ.get(name)), "")
    if source is ParameterSource.DEFAULT_MAP:
        return str(context.meta[WHERE][parameter.name])
    return "command line" if source is ParameterSource.COMMANDLINE else "default"


def _plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value if isinstance(value, (bool, int, float, str)) or value is None else str(value)
