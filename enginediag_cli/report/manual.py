"""Manual pages in roff (man(7) macros), from click's declarations: the same text as the help."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping

import click

from enginediag_cli import __version__

VERBATIM = "\b"
"""Click's mark of a paragraph whose lines stay as they are."""


def program_page(context: click.Context, commands: Mapping[str, str]) -> str:
    """The page enginediag(1); `commands`: the line of help of each."""
    lines = [*_head("enginediag", _summary(context.command)), *_synopsis(context), *_description(context.command)]
    lines.append(".SH COMMANDS")
    for name, told in commands.items():
        lines += [".TP", f".BR enginediag\\-{name} (1)", _text(told)]
    return _page([*lines, *_options(context)])


def command_page(context: click.Context) -> str:
    """The page of one command, enginediag-detect(1)."""
    command = context.command
    lines = [*_head(f"enginediag-{context.info_name}", _summary(command)), *_synopsis(context), *_description(command)]
    lines += _options(context)
    if command.epilog:
        lines += [".SH EXIT STATUS", *_paragraphs(command.epilog.replace("Exit codes: ", ""))]
    return _page([*lines, ".SH SEE ALSO", ".BR enginediag (1)"])


def _page(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


def _head(name: str, summary: str) -> Iterator[str]:
    yield f'.TH "{_text(name.upper())}" "1" "" "enginediag {__version__}" "User Commands"'
    yield ".SH NAME"
    yield f"{_text(name)} \\- {_text(summary.rstrip('.'))}"


def _summary(command: click.Command) -> str:
    return command.short_help or (command.help or "").strip().partition("\n")[0]


def _synopsis(context: click.Context) -> Iterator[str]:
    yield ".SH SYNOPSIS"
    yield f".B {_text(context.command_path)}"
    yield _text(" ".join(context.command.collect_usage_pieces(context)))


def _description(command: click.Command) -> Iterator[str]:
    yield ".SH DESCRIPTION"
    yield from _paragraphs(inspect.cleandoc(command.help or ""))


def _options(context: click.Context) -> Iterator[str]:
    yield ".SH OPTIONS"
    for parameter in context.command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None:
            continue
        names, told = record
        yield ".TP"
        yield f"\\fB{_text(names)}\\fR"
        yield _text(" ".join(told.split()))
        variable = getattr(parameter, "envvar", None)
        variables = [variable] if isinstance(variable, str) else variable or ()
        if variables:
            yield ".br"
            yield _text(f"Environment: {', '.join(variables)}")


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        if paragraph.startswith(VERBATIM):
            yield from (".PP", ".nf")
            yield from (_text(line) for line in paragraph.split("\n")[1:])
            yield ".fi"
        else:
            yield ".PP"
            yield _text(" ".join(paragraph.split()))


def _text(text: str) -> str:
    """Text that roff prints as it is: no escapes, no requests, and hyphens that can be copied."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") else text
