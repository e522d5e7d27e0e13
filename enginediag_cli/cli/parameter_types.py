"""What an option's value may be: finite numbers, YAML files that come in, files that go out."""

from __future__ import annotations

import math
import os
import sys
from typing import Any

import click

TABLE_SUFFIXES = ("", ".txt", ".dat", ".csv", ".json", ".ndjson", ".jsonl", ".parquet")
"""Endings, besides .gz behind all but .parquet, under which a table can be written; see `Output.chosen_format`."""

CSV_SUFFIXES = ("", ".txt", ".dat", ".csv", ".parquet")
"""Those of tables of columns alone."""

PICTURE_SUFFIXES = ("", ".svg", ".png")


class FiniteRange(click.FloatRange):
    """A range of numbers that has neither nan nor infinity in it: click compares, and nan passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


class RequiredChange(click.ParamType):
    """PATTERN=SIZE, a shell pattern of parameters and a positive change in their unit; or `none`, which is None."""

    name = "required_change"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
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
    """A YAML file that exists. A name that is not in the working folder may be one that comes with the program,
    such as turbofan.yaml or faults/hpc_fouling.yaml."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, readable=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and not os.path.lexists(value):
            from enginediag_cli.errors import DataError
            from enginediag_cli.shipped import own_or_shipped

            try:
                value = str(own_or_shipped(value))
            except DataError as error:
                self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


class OutputFile(click.Path):
    """A file to write, refused before the work is done, not after: it must lie in a folder that exists, and its ending
    must be one of `suffixes` (none: any), unless `--format` says what is written. `-` is standard output."""

    def __init__(self, suffixes: tuple[str, ...] = ()) -> None:
        super().__init__(dir_okay=False, allow_dash=True)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
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
        """Fails for an ending under which nothing that this option writes is expected."""
        suffix = os.path.splitext(path.lower().removesuffix(".gz"))[1]
        if self.suffixes and path != "-" and not path.startswith("/dev/") and suffix not in self.suffixes:
            known = ", ".join(s for s in self.suffixes if s)
            more = "; or say with --format what is to be written" if "output_format" in ctx.params else ""
            self.fail(f"{path}: {suffix} files are not written; possible are {known}{more}", param, ctx)
        if suffix == ".parquet" and suffix in self.suffixes:
            from enginediag_cli.report.output import check_parquet

            if path.lower() != path.lower().removesuffix(".gz"):
                self.fail(f"{path}: a Parquet file is packed inside; leave out .gz (.csv, .json, .ndjson)", param, ctx)
            check_parquet(path)
        if suffix == ".png" and suffix in self.suffixes:
            from enginediag_cli.report.plotting.svg import png_library

            if path.lower().endswith(".gz"):
                self.fail(f"{path}: a PNG file is packed inside; leave out .gz", param, ctx)
            png_library(path)
