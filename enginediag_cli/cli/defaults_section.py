"""What enginediag.yaml may hold: the options of every command, as the commands declare them.

    kind: defaults
    all: {log: runs.jsonl}
    detect: {nominal: nominal.yaml, false-alarm: 0.001, window: 10min}

A key of a command is the long name of an option without its dashes. `all` holds for every command that has the option;
a command's own section goes before it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import click

from enginediag_cli.cli.operation import NOT_IN_FILES, word_of
from enginediag_cli.config.fields import Field, Section

KIND = "defaults"
ALL = "all"
"""The section whose options hold for every command that has them."""


def options_of(command: click.Command) -> dict[str, click.Option]:
    """The options of a command that a file may give, by their names in it."""
    found = [p for p in command.params if isinstance(p, click.Option) and p.name not in NOT_IN_FILES]
    return {word_of(option): option for option in found}


def every_command() -> dict[str, click.Command]:
    """All commands with their options; imports their modules."""
    from enginediag_cli.cli.main import COMMANDS, enginediag

    group = click.Context(enginediag)
    found = {name: enginediag.get_command(group, name) for name in COMMANDS}
    return {name: command for name, command in found.items() if command is not None}


def defaults_section(known: dict[str, click.Command], others: Iterable[str] = ()) -> Section:
    """The declaration of a file: the options of the `known` commands; of `others` only that there may be a section."""
    common: dict[str, Field] = {}
    fields = []
    for name, command in known.items():
        own = [field_of(word, option) for word, option in options_of(command).items()]
        help = (command.short_help or "").rstrip(".")
        fields.append(Field(name, "section", help, default=None, section=Section(name, help, tuple(own))))
        for field in own:
            common[field.name] = _fits_both(common[field.name], field) if field.name in common else field
    every = Section(ALL, "options of every command that has them", tuple(common.values()))
    return Section(
        KIND,
        "defaults of the options of commands",
        (
            Field("kind", "choice", "what this file is", choices=(KIND,)),
            Field(ALL, "section", every.help, default=None, section=every),
            *fields,
            *(Field(name, "section", "", default=None, section=Section(name, "", ())) for name in others),
        ),
    )


def field_of(word: str, option: click.Option) -> Field:
    """An option as a key. Bounds that a value must not reach are left to the option itself."""
    help = (option.help or "").rstrip(".")
    kind = option.type
    if option.multiple or option.nargs != 1:
        return Field(word, "texts", help, default=None)
    if option.is_flag:
        return Field(word, "boolean", help, default=None)
    if isinstance(kind, click.IntRange | click.FloatRange):
        whole = "integer" if isinstance(kind, click.IntRange) else "number"
        return Field(word, whole, help, default=None, minimum=kind.min, maximum=kind.max)
    if isinstance(kind, click.Choice):
        return Field(word, "choice", help, default=None, choices=tuple(map(str, kind.choices)))
    return Field(word, "scalar", help, default=None)


def _fits_both(one: Field, other: Field) -> Field:
    """The key under `all` of an option that two commands have, which each will check by itself."""
    if one.kind != other.kind:
        return Field(one.name, "scalar", one.help, default=None)
    if (one.choices, one.minimum, one.maximum) == (other.choices, other.minimum, other.maximum):
        return one
    kind = "scalar" if one.kind == "choice" else one.kind
    return replace(one, kind=kind, choices=(), minimum=None, maximum=None)


def __getattr__(name: str) -> Section:
    """DEFAULTS_FILE, the declaration of all commands, made when it is asked for."""
    if name == "DEFAULTS_FILE":
        return defaults_section(every_command())
    raise AttributeError(name)
