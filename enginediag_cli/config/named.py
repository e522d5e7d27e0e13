"""A file that a YAML file names: beside it, or one that comes with the program."""

from __future__ import annotations

from pathlib import Path

from enginediag_cli.config.reading import file_inside
from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.shipped import shipped


def named_file(owner: Path, name: str, what: str, mark: Mark) -> Path:
    """The file `name` beside the YAML file `owner`, or the shipped one of that name; `what` it is, for messages.
    Raises ConfigError."""
    beside = owner.parent / name
    if beside.exists():
        return file_inside(owner, name, mark)
    try:
        return shipped(name)
    except DataError as error:
        raise ConfigError([Problem(mark, f"there is no {what} {beside}", str(error))]) from None
