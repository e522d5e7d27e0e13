"""The reference pages of the documents, made from the declarations that the program itself works by.

    python tests/documents/reference.py [--write] [PAGE…]

Without --write it says which pages are out of date (exit code 1). PAGE: commands, yaml, columns, glossary.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from enginediag_cli.cli.main import COMMANDS, enginediag
from enginediag_cli.cli.options import HEADINGS, OPERATION
from enginediag_cli.config.fields import NAME, AnySection, Either, Field, Section, Variants
from enginediag_cli.config.validate import FILE_KINDS
from enginediag_cli.glossary import GLOSSARY, as_markdown
from enginediag_cli.report.tables import OUTPUTS, output

ROOT = Path(__file__).resolve().parents[2]
COMMAND = "python tests/documents/reference.py --write"
WIDTH = 10_000
"""Characters of a line of click's help: no text is wrapped."""

TYPES = {
    "texts": "list of texts",
    "numbers": "list of numbers",
    "scalar": "text or number",
    "range": "[low, high]",
    "number_map": "names to numbers",
    "text_map": "names to texts",
    "any_map": "names to values",
    "section": "mapping",
    "sections": "list of mappings",
    "section_map": "names to mappings",
    "named_sections": "list of named mappings",
}
"""Kinds of fields whose names need words."""


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table in Markdown."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |"
    yield ""


def sentence(text: str) -> str:
    """A help text with a capital and a full stop."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if not text or text[-1] in ".!?:" else ".")


# -- commands


def commands() -> Iterator[str]:
    """Every command with its options under their headings."""
    yield from head("Commands", "Every command and its options, as `enginediag COMMAND --help` prints them.")
    yield "Options that every command has stand at the end, under [every command](#every-command). An option's default"
    yield "may come from the environment, `ENGINEDIAG_<COMMAND>_<OPTION>`, or from `enginediag.yaml` in the folder."
    yield ""
    settings = {**enginediag.context_settings, "terminal_width": WIDTH, "max_content_width": WIDTH}
    group = click.Context(enginediag, info_name="enginediag", **settings)
    common: dict[str, str] = {}
    for name in COMMANDS:
        command = enginediag.get_command(group, name)
        assert command is not None
        yield from command_part(command, name, group, common)
        from enginediag_cli.cli.over_time import PARTS

        for part, below in PARTS.items() if name == "fleet" else ():
            yield from command_part(below, f"{name} {part}", group, common)
    yield "## every command"
    yield ""
    yield from table(("option", "meaning"), [(f"`{names}`", text) for names, text in common.items()])


def command_part(command: click.Command, name: str, group: click.Context, common: dict[str, str]) -> Iterator[str]:
    """One command. What every command has goes into `common`."""
    context = click.Context(command, info_name=name, parent=group)
    yield f"## {name}"
    yield ""
    yield f"`enginediag {name} {' '.join(command.collect_usage_pieces(context))}`"
    yield ""
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(command.help or "")):
        if paragraph.startswith("\b"):
            yield from ("```", *paragraph.split("\n")[1:], "```", "")
        else:
            yield from (" ".join(paragraph.split()), "")
    general = {"quiet", "verbose", "color", "debug", "config", "log", "lock", "lock_wait", "print_config"}
    # without click's option for help, whose names are those of the context that a command ran in first
    options = [p for p in command.params if isinstance(p, click.Option)]
    for heading in HEADINGS:
        rows = []
        for option in (o for o in options if getattr(o, "heading", OPERATION) == heading):
            record = option.get_help_record(context)
            if record is None:
                continue
            if option.name in general or not hasattr(option, "heading"):
                common.setdefault(*record)
            else:
                rows.append((f"`{record[0]}`", record[1]))
        if rows:
            yield from (f"**{heading}**", "", *table(("option", "meaning"), rows))
    common.setdefault(", ".join(context.help_option_names), "Show this message and exit.")


# -- YAML files


def yaml_files() -> Iterator[str]:
    """Every kind of YAML file with its keys."""
    yield from head("YAML files", "Every kind of file and its keys. `enginediag check FILE` validates a file.")
    rows = [(f"[{kind.name}](#kind-{kind.name})", sentence(kind.help)) for kind in FILE_KINDS.values()]
    yield from table(("kind", "describes"), rows)
    for kind in FILE_KINDS.values():
        yield from (f"## kind: {kind.name}", "", sentence(kind.help), "")
        if kind.name == "defaults":
            yield "Its sections are the commands, and `all`; its keys are their options: see the page of the commands."
            yield ""
            continue
        yield from section_part(kind.load_section(), kind.name, set())


def section_part(section: AnySection, path: str, done: set[int], named: bool = False) -> Iterator[str]:
    """The keys of a mapping, then the mappings inside it; one that several keys share is shown once."""
    if id(section) in done:
        return
    done.add(id(section))
    if isinstance(section, Section):
        yield from fields_part(section, path, done, named)
        return
    key = section.key if isinstance(section, Variants) else ""
    for name, option in section.options.items():
        here = f"{path}, {key}: {name}" if key else f"{path}, with {name}"
        yield from (f"### {here}", "", sentence(option.help), "")
        yield from fields_part(option, here, done, named)


def fields_part(section: Section, path: str, done: set[int], named: bool) -> Iterator[str]:
    """A table of keys, and what they hold."""
    fields = [*([NAME] if named and all(f.name != "name" for f in section.fields) else []), *section.fields]
    if fields:
        rows = [(f"`{f.name}`", kind_of(f), f.unit, default_of(f), sentence(f.help)) for f in fields]
        yield from table(("key", "value", "unit", "default", "meaning"), rows)
    for field in fields:
        if field.section is None or id(field.section) in done:
            continue
        below = f"{path}.{field.name}"
        if isinstance(field.section, Section):
            yield from (f"### {below}", "", sentence(field.help), "")
        yield from section_part(field.section, below, done, field.kind == "named_sections")


def kind_of(field: Field) -> str:
    """What may stand there."""
    if field.choices:
        return ", ".join(f"`{choice}`" for choice in field.choices)
    low, high = field.minimum, field.maximum
    within = f" {low:g} to {high:g}" if low is not None and high is not None else ""
    if not within:
        within = f" ≥ {low:g}" if low is not None else f" ≤ {high:g}" if high is not None else ""
    return TYPES.get(field.kind, field.kind) + within


def default_of(field: Field) -> str:
    """The default as it would be written."""
    if field.required:
        return "required"
    value: Any = field.default
    if value is None or value in ((), [], {}):
        return ""
    return f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value}`"


# -- columns


def columns() -> Iterator[str]:
    """Every output with its columns and the keys of its JSON document."""
    about = "Every output with its columns. `enginediag schema output/NAME` prints the same as a JSON schema."
    yield from head("Columns of the outputs", about)
    for name in OUTPUTS:
        found = output(name)
        yield from (f"## {name}", "", sentence(found.help), "")
        rows = []
        for column in (*found.columns, *found.families):
            more = f" Only with {column.option}." if column.option else ""
            empty = "" if column.required else "may be empty"
            rows.append((f"`{column.name}`", kind_of(column), column.unit, empty, sentence(column.help) + more))
        yield from table(("column", "value", "unit", "", "meaning"), rows)
        if found.document:
            yield from ("With `--format json`, one object:", "")
            keys = [(f"`{path}`", kind_of(f), f.unit, sentence(f.help)) for path, f in documented(found.document)]
            yield from table(("key", "value", "unit", "meaning"), keys)


def documented(fields: Sequence[Field], path: str = "") -> Iterator[tuple[str, Field]]:
    """Keys of a document with those inside them, each with its path."""
    for field in fields:
        here = f"{path}{field.name}" + ("[]" if field.kind == "sections" else "")
        yield here, field
        if isinstance(field.section, Section):
            yield from documented(field.section.fields, f"{here}.")
        elif isinstance(field.section, Either | Variants):
            for option in field.section.options.values():
                yield from documented(option.fields, f"{here}.")


# -- pages


def head(title: str, about: str) -> Iterator[str]:
    """The head of a page."""
    yield from (f"# {title}", "", about, "")
    yield from (f"Made from the program by `{COMMAND}`.", "")


def glossary() -> Iterator[str]:
    """The words of the field."""
    yield from as_markdown(GLOSSARY).splitlines()


PAGES: dict[str, tuple[str, Callable[[], Iterator[str]]]] = {
    "commands": ("enginediag_cli/COMMANDS.md", commands),
    "columns": ("enginediag_cli/COLUMNS.md", columns),
    "glossary": ("enginediag_cli/GLOSSARY.md", glossary),
    "yaml": ("configs/REFERENCE.md", yaml_files),
}
"""Name of a page → its file and what makes it."""


def text_of(name: str) -> str:
    """A page as it should be."""
    return "\n".join(PAGES[name][1]()).rstrip("\n") + "\n"


def is_current(name: str) -> bool:
    """Whether the file of a page is what the program makes of it now."""
    path = ROOT / PAGES[name][0]
    return path.is_file() and path.read_text(encoding="utf-8") == text_of(name)


def main() -> int:
    """Compare or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=", ".join(PAGES))
    parser.add_argument("--write", action="store_true")
    choice = parser.parse_args()
    old = [name for name in choice.pages or PAGES if not is_current(name)]
    for name in old:
        path = ROOT / PAGES[name][0]
        if choice.write:
            path.write_text(text_of(name), encoding="utf-8")
        print(f"{path.relative_to(ROOT)}: {'written' if choice.write else 'out of date'}")
    return int(bool(old) and not choice.write)


if __name__ == "__main__":
    sys.exit(main())
