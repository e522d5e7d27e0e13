"""What recordings are read from: files, packed files, standard input and pipes; never folders or devices."""

from __future__ import annotations

import gzip
import os
import stat
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from enginediag_cli.errors import DataError

Source = str | Path | Iterable[str]

SHOWN_BYTES = 1 << 20
"""Bytes of a file read at once when the place of a wrong one is looked for."""


def refuse_devices(path: str | Path) -> None:
    """Raises DataError for what cannot hold a recording or has no end: a folder, a device, a socket. Pipes, terminals
    and process substitution (/dev/fd/63) pass, and so does what is not there: opening it says so better."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return
    if stat.S_ISDIR(mode):
        raise DataError(f"{path}: a folder, not a file; name the recordings in it")
    if stat.S_ISSOCK(mode) or stat.S_ISBLK(mode):
        raise DataError(f"{path}: a {'socket' if stat.S_ISSOCK(mode) else 'device'}, not a file")
    if stat.S_ISCHR(mode) and not _terminal(path):
        raise DataError(f"{path}: a device, not a file")


def _terminal(path: str | Path) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        return os.isatty(handle)
    finally:
        os.close(handle)


@contextmanager
def opened(source: Source, codec: str = "utf-8-sig") -> Iterator[tuple[Iterable[str], str]]:
    """The open text stream and its name; `-` is standard input, `.gz` is unpacked. Raises DataError."""
    if not isinstance(source, (str, Path)):
        yield source, getattr(source, "name", "<stream>")
    elif str(source) == "-":
        # stdin's own text layer may use another encoding and would translate line ends inside quotes
        stream = open(sys.stdin.fileno(), encoding=codec, newline="", closefd=False)
        with stream:
            yield stream, "<stdin>"
    else:
        refuse_devices(source)
        try:
            packed = str(source).endswith(".gz")
            text: TextIO = (
                gzip.open(source, "rt", encoding=codec, newline="")
                if packed
                else open(source, encoding=codec, newline="")
            )
        except OSError as error:
            raise DataError(f"{source}: {error.strerror or error}") from error
        with text:
            yield text, str(source)


def undecodable(source: Source, name: str, error: UnicodeDecodeError) -> DataError:
    """The error for a byte that is not text in the encoding: line, byte, and how to state another encoding."""
    if error.object.startswith(b"PAR1"):
        what = "a Parquet file, in a pipe or packed, whose index stands at its end"
        return DataError(f"{name}: {what}; give the file itself by its name")
    line, byte = 0, error.object[error.start]
    regular = isinstance(source, (str, Path)) and os.path.isfile(source)
    if regular and not error.encoding.startswith("utf-16"):
        assert isinstance(source, (str, Path))
        with gzip.open(source, "rb") if str(source).endswith(".gz") else open(source, "rb") as stream:
            for number, text in enumerate(iter(lambda: stream.readline(SHOWN_BYTES), b""), start=1):
                try:
                    text.decode(error.encoding)
                except UnicodeDecodeError as found:
                    line, byte = number, found.object[found.start]
                    break
    wanted = "UTF-8" if error.encoding.startswith("utf-8") else error.encoding
    hint = "a recorder can state another, as in `file: {encoding: latin-1}`"
    return DataError(f"{name}:{line}: not {wanted} text: byte 0x{byte:02x} ({hint})".replace(":0:", ":"))
