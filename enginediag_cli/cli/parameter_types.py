"""Values of options: finite numbers, lengths, YAML files that come in, files that go out, and none of these that is one
of those."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterator
from typing import Any

import click

FILE_OF_DEFAULTS = "enginediag.defaults.file"
"""Key of a context's `meta`: the file of options that was read."""

TABLE_SUFFIXES = ("", ".txt", ".dat", ".csv", ".json", ".ndjson", ".jsonl", ".parquet")
"""Endings, besides .gz behind all but .parquet, under which a table can be written; see `Output.chosen_format`."""

CSV_SUFFIXES = ("", ".txt", ".dat", ".csv", ".parquet")
"""Those of tables of columns alone."""

PICTURE_SUFFIXES = ("", ".svg", ".png")
LENGTH = re.compile(r"\s*\d+(\.\d+)?\s*(s|min|h|)\s*")
"""A number of records, or a time."""


class FiniteRange(click.FloatRange):
    """A range of finite numbers: click compares, and nan passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse nan and infinity, too."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


POSITIVE = FiniteRange(min=0, min_open=True)
COUNT = click.IntRange(min=1)


class Length(click.ParamType):
    """A number of records, or a time, as text."""

    name = "length"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse what is neither."""
        if not LENGTH.fullmatch(str(value)):
            self.fail(f"{value!r} is not a number of records (60) or a time (300s, 10min, 1h)", param, ctx)
        return value


class RequiredChange(click.ParamType):
    """PATTERN=SIZE, a shell pattern of parameters and a positive change in their unit; or `none`, which is None."""

    name = "required_change"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Split the text."""
        if value == "none" or isinstance(value, tuple):
            return value
        pattern, _, size = str(value).rpartition("=")
        try:
            number = float(size)
        except ValueError:
            number = math.nan
        if not pattern or not (math.isfinite(number) and number > 0.0):
            self.fail(
                f"{value!r} is not PATTERN=SIZE with a positive size, such as '*.efficiency=0.02', or none", param, ctx
            )
        return pattern, number


class ConfigFile(click.Path):
    """A YAML file that exists. A name that is not in the working folder may be that of a shipped file, such as
    turbofan.yaml or faults/hpc_fouling.yaml."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, readable=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Find the file."""
        if isinstance(value, str) and not os.path.lexists(value):
            from enginediag_cli.errors import DataError
            from enginediag_cli.shipped import own_or_shipped

            try:
                value = str(own_or_shipped(value))
            except DataError as error:
                self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


EXISTING = click.Path(exists=True, dir_okay=False, readable=True)
"""A file that can be read."""


class OutputFile(click.Path):
    """A file to write. It is refused before the work, not after: its folder must exist, and its ending must be one of
    `suffixes` (none: any) unless `--format` chooses. `-` is standard output."""

    def __init__(self, suffixes: tuple[str, ...] = ()) -> None:
        super().__init__(dir_okay=False, allow_dash=True)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse a path that cannot be written."""
        path = os.fspath(value)
        if path == "-":
            if sys.stdout is None or not sys.stdout.writable():
                self.fail("standard output is closed; name a file", param, ctx)
            return path
        folder = os.path.dirname(os.path.abspath(path))
        if not path or os.path.isdir(path) or not os.path.isdir(folder):
            reason = "is a folder" if os.path.isdir(path) else f"there is no folder {folder}"
            self.fail(f"{path or repr(path)}: {reason if path else 'not a file name'}", param, ctx)
        return path

    def check_suffix(self, path: str, param: click.Parameter, ctx: click.Context) -> None:
        """Fail for an ending that this option does not write."""
        suffix = os.path.splitext(path.lower().removesuffix(".gz"))[1]
        if self.suffixes and path != "-" and not path.startswith("/dev/") and suffix not in self.suffixes:
            known = ", ".join(s for s in self.suffixes if s)
            more = "; or choose with --format" if "format" in ctx.params else ""
            self.fail(f"{path}: {suffix} files are not written; possible are {known}{more}", param, ctx)
        if suffix not in self.suffixes or suffix not in (".parquet", ".png"):
            return
        kind, others = ("Parquet", " (.csv, .json, .ndjson)") if suffix == ".parquet" else ("PNG", "")
        if path.lower().endswith(".gz"):
            self.fail(f"{path}: a {kind} file is compressed already; leave out .gz{others}", param, ctx)
        if suffix == ".parquet":
            from enginediag_cli.report.output import check_parquet

            check_parquet(path)
        else:
            from enginediag_cli.report.plotting.svg import png_library

            png_library(path)


class AppendedFile(OutputFile):
    """A file that is not replaced: `-` is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse standard output."""
        if value == "-":
            self.fail("standard output is for data; name a file", param, ctx)
        return super().convert(value, param, ctx)


def check_outputs(context: click.Context) -> None:
    """Refuse an output that is an input of the same command, by whatever path, or that is named twice, and one whose
    ending promises another format. Raises click.BadParameter."""
    inputs = list(_inputs(context))
    written: list[tuple[str, str]] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if not isinstance(parameter.type, OutputFile) or not isinstance(value, str):
            continue
        for what, path in inputs:
            if _is_same_file(value, path):
                raise click.BadParameter(f"{value} is also an input ({what}); it would be lost", context, parameter)
        for what, path in written:
            if value != "-" and os.path.realpath(value) == os.path.realpath(path):
                raise click.BadParameter(f"{value} is also the file of {what}", context, parameter)
        written.append((max(parameter.opts, key=len), value))
        if context.params.get("format", "auto") == "auto" or parameter.name != "output":
            parameter.type.check_suffix(value, parameter, context)


def _inputs(context: click.Context) -> Iterator[tuple[str, str]]:
    """(how it was given, path) of each file that is to be read; "-" is standard input."""
    if FILE_OF_DEFAULTS in context.meta:
        yield "options", context.meta[FILE_OF_DEFAULTS]
    for parameter in context.command.params:
        if not isinstance(parameter.type, click.Path) or isinstance(parameter.type, OutputFile):
            continue
        value = context.params.get(parameter.name or "")
        what = max(parameter.opts, key=len) if isinstance(parameter, click.Option) else parameter.human_readable_name
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if not isinstance(path, str):
                continue
            yield what, path
            if os.path.isdir(path):  # a folder of fault files
                yield from ((what, entry.path) for entry in os.scandir(path) if entry.is_file())


def _is_same_file(output: str, file: str) -> bool:
    """Whether an output is an input: the same regular file, as path, link, or redirected standard stream."""
    import stat

    try:
        out = os.fstat(sys.stdout.fileno()) if output == "-" else os.stat(output)
        read = os.fstat(sys.stdin.fileno()) if file == "-" else os.stat(file)
    except (OSError, ValueError, AttributeError):  # not there yet, closed, or no real stream
        return False
    return stat.S_ISREG(out.st_mode) and os.path.samestat(out, read)
