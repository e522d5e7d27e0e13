"""Flight data out: one header, then chunk after chunk; a file appears complete or not at all.

In CSV numbers are written with 10 significant digits: more than any recorder resolves, and short. A missing value is
an empty cell. A closed pipe is left to the caller.
"""

from __future__ import annotations

import csv
import glob
import gzip
import io
import os
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.file_lock import try_lock
from enginediag_cli.progress import touched, wipe
from enginediag_cli.recordings.source import named_parquet
from enginediag_cli.recordings.table import Recording, RecordingWriter
from enginediag_cli.safe_text import UNSPEAKABLE, guarded, visible

PART = ".part"
"""Ending of a file that is being written, beside its final place and hidden."""
LEFT_BEHIND_S = 60.0
"""Age from which such a file may be a killed run's: one that is at work has locked its own long before."""


class CsvWriter(RecordingWriter):
    """Writes recordings to an open text stream; each is handed on at once."""

    def __init__(self, stream: TextIO, provenance: Sequence[str] = (), *, digits: int = 10):
        """provenance: lines to put behind `# ` at the head; none leaves the head out."""
        self._stream, self._provenance = stream, provenance
        self._csv = csv.writer(stream, lineterminator="\n")
        self._format = f"%.{digits}g"
        self._shown = stream.isatty()

    def _begin(self, recording: Recording) -> None:
        self._stream.writelines(f"# {line}\n" for line in self._provenance)
        self._csv.writerow(map(self._safe, recording.order))

    def _append(self, recording: Recording) -> None:
        if self._shown:
            wipe()
        self._csv.writerows(zip(*(self._cells(recording, c) for c in self._order or ()), strict=True))
        self._stream.flush()

    def _safe(self, text: str) -> str:
        """A text that neither a spreadsheet nor a terminal obeys."""
        return guarded(visible(text) if self._shown else text)

    def _cells(self, recording: Recording, column: str) -> Sequence[str]:
        if column in recording.text:
            return [self._safe(cell) for cell in recording.text[column]]
        values = recording.columns[column]
        cells = list(map(self._format.__mod__, values.tolist()))
        for k in np.flatnonzero(np.isnan(values)):
            cells[k] = ""
        return cells


@contextmanager
def open_output(path: str | Path) -> Iterator[TextIO]:
    """A text stream to `path`: `-` is stdout, `.gz` is packed.

    A file is written beside its final place and renamed when the block ends well, so that an error or an
    interrupt leaves whatever was there before, and of two runs that write the same file one wins, whole. Pipes and
    devices are written to directly. Raises OSError.
    """
    if str(path) == "-":
        yield sys.stdout
        sys.stdout.flush()
        return
    with open_binary_output(path) as raw:
        if Path(os.path.realpath(path)).suffix == ".gz" and raw.seekable():
            # no name and no time in the packed file: the same data give the same bytes
            with gzip.GzipFile(filename="", fileobj=raw, mode="wb", mtime=0) as packed:
                with io.TextIOWrapper(packed, encoding="utf-8", errors=UNSPEAKABLE, newline="") as stream:
                    yield stream
        else:
            with io.TextIOWrapper(raw, encoding="utf-8", errors=UNSPEAKABLE, newline="") as stream:
                yield stream


def _descriptor(path: str | Path) -> int | None:
    """Number of the open file that a name such as /dev/stdout stands for."""
    name = str(path)
    known = {"/dev/stdout": 1, "/dev/stderr": 2}
    folder, _, number = name.rpartition("/")
    return int(number) if folder in ("/dev/fd", "/proc/self/fd") and number.isdigit() else known.get(name)


@contextmanager
def open_binary_output(path: str | Path) -> Iterator[BinaryIO]:
    """As `output`, a stream of bytes, packed nowhere; not for stdout."""
    if (descriptor := _descriptor(path)) is not None:  # what a shell has opened, to be appended to where it says so
        with os.fdopen(os.dup(descriptor), "wb") as stream:
            yield stream
        return
    final = Path(os.path.realpath(path))  # through a symbolic link: replace the file, not the link
    if final.exists() and not final.is_file():
        with open(final, "wb") as stream:
            yield stream
        return
    from tempfile import mkstemp

    _remove_stale(final)
    handle, temporary = mkstemp(prefix=f".{final.name}.", suffix=PART, dir=final.parent)
    same = os.dup(handle)  # the stream's user may close it
    try:
        try_lock(same)
        with os.fdopen(handle, "wb") as raw:
            yield raw
        os.chmod(temporary, _file_mode(final))
        _to_disk(same, path)
        os.replace(temporary, final)
        touched("written:", path)
    except BaseException:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
        raise
    finally:
        os.close(same)


def _to_disk(handle: int, path: str | Path) -> None:
    """See a file on the disk before it takes its name: after a power cut there is the old one or the new one. A disk
    without room, or somebody's quota, may show only now."""
    try:
        os.fsync(handle)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _remove_stale(final: Path) -> None:
    """Remove what runs that were killed have left beside the file: old, and locked by nobody."""
    for entry in final.parent.glob(f".{glob.escape(final.name)}.*{PART}"):
        with suppress(OSError):
            if time.time() - entry.stat().st_mtime < LEFT_BEHIND_S:
                continue
            handle = os.open(entry, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                if try_lock(handle):
                    entry.unlink()
            finally:
                os.close(handle)


@contextmanager
def open_recording_output(
    path: str | Path, provenance: Sequence[str] = (), *, parquet: bool | None = None
) -> Iterator[RecordingWriter]:
    """What writes recordings to `path`, as Parquet or CSV; with None its name says which. Raises DataError, OSError."""
    if named_parquet(path) if parquet is None else parquet:
        from enginediag_cli.recordings.parquet import ParquetWriter

        with open_binary_output(path) as raw, ParquetWriter(raw, str(path), provenance) as writer:
            yield writer
    else:
        with open_output(path) as stream:
            yield CsvWriter(stream, provenance)


def _file_mode(path: Path) -> int:
    """Permissions that a plain open() would have given: those of the file there, or the umask's."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def write_csv(
    path: str | Path, recordings: Iterable[Recording], provenance: Sequence[str] = (), *, digits: int = 10
) -> int:
    """Write the recordings as CSV to a path or, for `-`, to stdout; returns the number of records.

    Raises DataError (columns differ, or nothing to write, not even a header) and OSError.
    """
    sizes = []
    with open_output(path) as stream:
        writer = CsvWriter(stream, provenance, digits=digits)
        for recording in recordings:
            writer.write(recording)
            sizes.append(len(recording))
        if not sizes:
            raise DataError(f"{path}: nothing to write")
    return sum(sizes)
