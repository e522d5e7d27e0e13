"""`--picture` of commands whose answer is also a chart."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import click

from enginediag_cli.cli.parameter_types import PICTURE_SUFFIXES, OutputFile

Function = TypeVar("Function", bound=Callable[..., object])


def picture_option(what: str) -> Callable[[Function], Function]:
    """`--picture FILE` as `picture_path: str | None`; what: is drawn."""
    return click.option(
        "--picture",
        "picture_path",
        metavar="FILE.svg|png",
        type=OutputFile(PICTURE_SUFFIXES),
        help=f"Draw {what} into FILE (.png needs the extra enginediag[report]).",
    )
