"""Which files may be read: regular ones of a sane size, and inside a YAML file only its own folder's.

A YAML file may come from somebody else. What it names must not make this program read, and by a message show,
files that its user did not mean.

A file that a YAML file names: beside it, or one that comes with the program.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.progress import touched
from enginediag_cli.shipped import shipped

MOST_YAML_BYTES = 20_000_000
"""The largest nominal files, of thousands of operating points, have a tenth of it."""

MOST_TABLE_BYTES = 20_000_000
"""A component map of 500 × 500 points and five columns has less."""

PEEKED_BYTES = 65_536
"""The `kind:` of a file stands in its first lines, behind at most a page of comments."""


@dataclass
class Reading:
    """What the run allows. `allow_outside`: a YAML file may name files anywhere."""

    allow_outside: bool = False


@contextmanager
def outside_allowed() -> Iterator[None]:
    """Within it a YAML file may name files anywhere, as with `--allow-outside`: for a caller who wrote that file."""
    before, READING.allow_outside = READING.allow_outside, True
    try:
        yield
    finally:
        READING.allow_outside = before


READING = Reading()
"""Set by the command line for one run; strict for a library user who sets nothing."""


def read_regular(path: str | Path, most: int = MOST_YAML_BYTES) -> bytes:
    """The bytes of a regular file. Raises ConfigError for a device, pipe or folder, for more than `most` bytes, and
    for a file that cannot be read; nothing is read of the first two."""
    name = str(path)
    try:
        refuse_irregular(path, most)
        touched("read:", name)
        return Path(path).read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ConfigError([Problem(Mark(name), f"cannot read the file: {reason}")]) from error
    except ConfigError:
        raise
    except ValueError as error:  # a NUL in the name
        raise ConfigError([Problem(Mark(name), f"cannot read the file: {error}")]) from error


def refuse_irregular(path: str | Path, most: int, mark: Mark | None = None) -> None:
    """Raises ConfigError (at `mark`, or at the file) unless this is a regular file of at most `most` bytes, and
    OSError when it is not there."""
    found = os.stat(path)
    what, mark = ("the file", Mark(str(path))) if mark is None else (str(path), mark)
    if not stat.S_ISREG(found.st_mode):
        kind = "is a directory" if stat.S_ISDIR(found.st_mode) else "is a device or a pipe"
        raise ConfigError([Problem(mark, f"cannot read {what}: {kind}", "a regular file is wanted here")])
    if found.st_size > most:
        size = f"it has {found.st_size / 1e6:.0f} MB, and at most {most / 1e6:.0f} MB are read"
        raise ConfigError([Problem(mark, f"cannot read {what}: {size}", "is it the right one?")])


def file_inside(owner: str | Path, name: str, mark: Mark | None = None) -> Path:
    """The file `name` that the YAML file `owner` names, which must lie in the owner's folder or come with the program.

    Links are followed before that is judged. Raises ConfigError at `mark` for one outside, unless the user allows it
    (`--allow-outside`), and for a device, a pipe or a file that is too large; what is refused is not read.
    """
    mark = mark or Mark(str(owner))
    folder = Path(owner).parent
    path = folder / name
    try:
        if not READING.allow_outside and not _allowed(path, folder):
            what = f"{name} lies outside the folder of this file"
            raise ConfigError([Problem(mark, what, "put it beside this file, or allow it with --allow-outside")])
        refuse_irregular(path, MOST_TABLE_BYTES, mark)
    except OSError as error:
        raise ConfigError([Problem(mark, f"cannot read {path}: {(error.strerror or str(error)).lower()}")]) from error
    except ConfigError:
        raise
    except ValueError as error:  # a NUL in the name
        raise ConfigError([Problem(mark, f"cannot read {name!r}: {error}")]) from error
    return path


def refuse_other_kind(path: str | Path, kind: str, mark: Mark) -> None:
    """Raises ConfigError at `mark` unless this is a regular file that says `kind: <kind>`. For a file that may lie
    anywhere because a user once named it: what is no such file is not quoted in a message."""
    import re

    try:
        refuse_irregular(path, MOST_YAML_BYTES, mark)
        with open(path, "rb") as stream:
            head = stream.read(PEEKED_BYTES)
    except OSError as error:
        raise ConfigError([Problem(mark, f"cannot read {path}: {(error.strerror or str(error)).lower()}")]) from error
    says = rb"^[\"']?kind[\"']?\s*:\s*[\"']?" + kind.encode() + rb"\b"
    if not re.search(says, head.removeprefix(b"\xef\xbb\xbf"), re.MULTILINE):
        raise ConfigError([Problem(mark, f"{path} is not a file of kind '{kind}'")])


def _allowed(path: Path, folder: Path) -> bool:
    """Whether the file lies, all links followed, in the folder or among the shipped files."""
    from enginediag_cli.errors import DataError
    from enginediag_cli.shipped import shipped_folder

    real = path.resolve()
    if real.is_relative_to(folder.resolve()):
        return True
    try:
        return real.is_relative_to(shipped_folder().resolve())
    except DataError:
        return False


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
