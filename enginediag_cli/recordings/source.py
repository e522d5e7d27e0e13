"""Where recordings are read from: files, packed files, standard input, pipes, growing files; no folders or devices.

A file's format is recognised by its first bytes. Texts are decoded, limited in line length, and their head may be
looked at before the rest is read.

**Provenance.** The `#` lines at the head of a file state which program, command, configuration and seed made it. The
same run gives the same bytes, so there is no time stamp unless the caller adds one.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import os
import stat
import sys
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from enum import Enum
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

from enginediag_cli import __version__
from enginediag_cli.errors import DataError

Source = str | Path | Iterable[str]

LONGEST_LINE = 1_000_000
"""Characters of a line: a row of statistics may have thousands of cells of 20 characters. A longer one is refused as
soon as so much of it is read, be there gigabytes more."""
LONGEST_DOCUMENT = 200_000_000
"""Characters of a JSON document in one line, as this program writes results: ten thousand engines of 20 kB."""

HEAD_BYTES = 512
"""First bytes of a file, by which formats are recognised."""

FEWEST_BYTES = 16
"""Bytes by which an encoding is recognised: a header line has more."""

GZIP = b"\x1f\x8b"
ZIP_MAGIC = b"PK\x03\x04"

_EXPORT = "export it as CSV or Parquet"
FORMATS: dict[bytes, tuple[str, str]] = {
    b"\x89HDF\r\n\x1a\n": ("an HDF5 file (as MATLAB writes, too, from version 7.3 on)", _EXPORT),
    b"MATLAB": ("a MATLAB .mat file", _EXPORT),
    b"CDF\x01": ("a netCDF file", _EXPORT),
    b"CDF\x02": ("a netCDF file", _EXPORT),
    ZIP_MAGIC: ("a zip archive, or an Excel workbook in a pipe or under another name", "unpack it, or name it .xlsx"),
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": ("an Excel 97 workbook (.xls)", "save it as .xlsx or CSV"),
    b"PAR1": ("a Parquet file, in a pipe or packed, whose index is at its end", "give the file itself by its name"),
    b"\x28\xb5\x2f\xfd": ("packed by zstd", "unpack it, or pack it by gzip"),
    b"BZh": ("packed by bzip2", "unpack it, or pack it by gzip"),
    b"\xfd7zXZ\0": ("packed by xz", "unpack it, or pack it by gzip"),
    b"7z\xbc\xaf\x27\x1c": ("a 7-Zip archive", "unpack it"),
    GZIP: ("packed by gzip twice", "unpack it once"),
    b"SQLite format 3": ("an SQLite database", _EXPORT),
    b"ARROW1": ("an Arrow (Feather) file", _EXPORT),
    b"%PDF": ("a PDF document", _EXPORT),
    b"MDF ": ("an ASAM MDF measurement file", _EXPORT),
    b"TDSm": ("a LabVIEW TDMS file", _EXPORT),
}
"""First bytes → what such a file is, and what to do with it."""


PARQUET_SUFFIXES = (".parquet", ".pq")
"""Names of Parquet files, in any case."""
PARQUET_MAGIC = (b"PAR1", b"PARE")
"""What a Parquet file begins with, whatever it is called; the second where it is encrypted."""
WORKBOOK = "xl/workbook.xml"
"""What is in every .xlsx, and in no other zip archive."""


class Format(Enum):
    """What a file holds, as far as it decides how it is opened."""

    TEXT = "text"
    PARQUET = "Parquet"
    EXCEL = "Excel workbook"


def named_parquet(path: str | Path) -> bool:
    """Whether a file has the name of a Parquet file."""
    return Path(path).suffix.lower() in PARQUET_SUFFIXES


def file_format(source: Source) -> Format:
    """The format by a file's first bytes, or by its name where it is called Parquet; text for standard input, streams
    and pipes."""
    if not isinstance(source, (str, Path)) or str(source) == "-":
        return Format.TEXT
    head = b""
    if os.path.isfile(source):
        with suppress(OSError), open(source, "rb") as stream:
            head = stream.read(4)
    if head == ZIP_MAGIC:
        import zipfile

        with suppress(OSError, zipfile.BadZipFile), zipfile.ZipFile(source) as archive:
            if WORKBOOK in archive.namelist():
                return Format.EXCEL
    return Format.PARQUET if head in PARQUET_MAGIC or named_parquet(source) else Format.TEXT


def needs_whole_file(path: str) -> bool:
    """Whether a file is of a format that can be read only when it is complete."""
    return path.endswith(".gz") or file_format(path) is not Format.TEXT


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
def open_lines(source: Source, codec: str = "utf-8-sig") -> Iterator[tuple[Iterable[str], str]]:
    """The lines of a text and its name; `-` is standard input, what is packed by gzip is unpacked, a byte order mark
    says which Unicode it is. Raises DataError, also for what is no text and for lines that are too long."""
    if not isinstance(source, (str, Path)):
        name = getattr(source, "name", "<stream>")
        yield LimitedLines(source, name), name
        return
    name = "<stdin>" if str(source) == "-" else str(source)
    with ExitStack() as stack:
        try:
            binary = stack.enter_context(open_bytes(source, name))
            head = binary.peek(HEAD_BYTES)[:HEAD_BYTES]
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise DataError(f"{name}: damaged gzip file ({error})") from error
        except OSError as error:
            raise DataError(f"{name}: {error.strerror or error}") from error
        refuse_binary(head, name, codec)
        text = stack.enter_context(io.TextIOWrapper(binary, encoding=detect_bom(head) or codec, newline=""))
        yield LimitedLines(text, name), name


@contextmanager
def open_bytes(source: str | Path, name: str) -> Iterator[Any]:
    """The bytes of a file (`-`: of standard input) as a buffered stream that can be peeked into. Raises OSError, and
    DataError for what is no file."""
    if str(source) == "-":
        # stdin's own text layer may use another encoding and would translate line ends inside quotes
        raw = open(sys.stdin.fileno(), "rb", closefd=False)
    else:
        refuse_devices(source)
        raw = open(source, "rb")
    with raw:
        packed = raw.peek(2)[:2] == GZIP
        if not packed and raw.peek(1) and str(source).endswith(".gz"):
            raise DataError(f"{name}: called .gz, but no gzip file")
        if packed:
            with gzip.GzipFile(fileobj=raw) as inside:
                yield inside
        else:
            yield raw


def refuse_binary(head: bytes, name: str, codec: str = "utf-8") -> None:
    """Raises DataError for the first bytes of a file that is no text (in the encoding `codec`, if that has zeros in
    it), with what it is and what to do."""
    for magic, (what, cure) in FORMATS.items():
        if head.startswith(magic):
            raise DataError(f"{name}: {what}; {cure}")
    if 0 not in head or detect_bom(head) or codecs.lookup(codec).name.startswith(("utf-16", "utf-32")):
        return
    if found := detect_utf_16(head):
        what = "UTF-16 text without a byte order mark"
        raise DataError(f"{name}: {what}; a recorder can state it, `file: {{encoding: {found}}}`")
    raise DataError(f"{name}: no text but binary data (it has NUL bytes); export it as CSV or Parquet")


def detect_utf_16(head: bytes) -> str:
    """The encoding of UTF-16 text without a byte order mark, or "": of Western letters every second byte is zero."""
    for odd, order in ((1, "le"), (0, "be")):
        if len(head) > FEWEST_BYTES and 0.4 * len(head) <= head.count(0) == head[odd::2].count(0):
            return f"utf-16-{order}"
    return ""


def detect_bom(head: bytes) -> str:
    """The encoding that a byte order mark says, or "": UTF-8 needs none."""
    if head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32"
    return "utf-16" if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else ""


class LimitedLines:
    """The lines of a text, one in memory at a time. cut: after the last one, whether that has no line end."""

    def __init__(self, stream: Iterable[str], name: str):
        self.cut = False
        self._lines = self._read(stream, name)

    def __iter__(self) -> Iterator[str]:
        """Raises DataError for a line longer than LONGEST_LINE (in a text that begins as JSON does, LONGEST_DOCUMENT),
        of which no more is read, and for one with a NUL."""
        return self._lines

    def _read(self, stream: Iterable[str], name: str) -> Iterator[str]:
        read = getattr(stream, "readline", None)
        lines = iter(stream) if read is None else iter(partial(read, LONGEST_LINE + 1), "")
        number, line = 0, "\n"
        for line in lines:
            number += 1
            longest = LONGEST_LINE
            if len(line) > longest and read is not None and number == 1 and line[0] in "{[" and line[-1] != "\n":
                line, longest = line + read(LONGEST_DOCUMENT), LONGEST_DOCUMENT
            if len(line) > longest:
                most = f"a line of more than {longest} characters"
                raise DataError(f"{name}:{number}: {most}; no table has such lines: is the file damaged or packed?")
            if "\0" in line:
                where = f"{name}:{number}:{line.index(chr(0)) + 1}"
                raise DataError(f"{where}: a NUL character; the file is damaged or no text")
            yield line
        self.cut = not line.endswith(("\n", "\r"))


def decoding_error(source: Source, name: str, error: UnicodeDecodeError) -> DataError:
    """The error for a byte that is not text in the encoding: line, byte, and how to state another encoding."""
    line, byte = 0, error.object[error.start]
    regular = isinstance(source, (str, Path)) and os.path.isfile(source)
    if regular and not error.encoding.startswith(("utf-16", "utf-32")):
        assert isinstance(source, (str, Path))
        with open_bytes(source, name) as stream:
            for number, text in enumerate(iter(lambda: stream.readline(LONGEST_LINE), b""), start=1):
                try:
                    text.decode(error.encoding)
                except UnicodeDecodeError as found:
                    line, byte = number, found.object[found.start]
                    break
    wanted = "UTF-8" if error.encoding.startswith("utf-8") else error.encoding
    hint = "a recorder can state another, as in `file: {encoding: latin-1}`"
    return DataError(f"{name}:{line}: not {wanted} text: byte 0x{byte:02x} ({hint})".replace(":0:", ":"))


MOST_BLANK_LINES = 2_000_000
"""Blank lines in a row after which a file is refused: packed, gigabytes of them take no room. A sheet has 1,048,576
rows, which may all be there."""


class PeekedLines:
    """An open text file whose head has been read: `provenance`, the `#` lines before the header; `columns`, the cells
    of the header; iterating gives all lines from the first."""

    def __init__(self, stream: Iterable[str], name: str):
        self.name = name
        self.provenance: list[str] = []
        self.columns: tuple[str, ...] = ()
        self._stream = iter(stream)
        self._head: list[str] = []
        rest = self._stream
        try:
            self._peek()
        except (
            UnicodeDecodeError,
            OSError,
            EOFError,
            zlib.error,
        ) as error:  # whoever reads on meets it, and says what it means
            rest = _broken(error)
        self._lines = chain(self._head, rest)

    def _peek(self) -> None:
        for text in self._stream:
            self._head.append(text)
            bare = text.lstrip("\ufeff").strip()
            if bare.startswith("#"):
                self.provenance.append(bare[1:].strip())
            elif bare:
                with suppress(csv.Error):
                    self.columns = tuple(cell.strip() for cell in next(csv.reader([bare]), []))
                return
            if len(self._head) > MOST_BLANK_LINES + 1:  # whoever reads on refuses it
                return

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def __next__(self) -> str:
        return next(self._lines)


def _broken(error: Exception) -> Iterator[str]:
    """Lines that cannot be read."""
    raise error
    yield ""


POLL_S = 0.2
"""Between looks at a file that grows: a row appears at once to an eye, and waiting costs nothing."""


UNREADABLE = "\ufffd"
"""What Python puts in place of bytes that are no text."""


class GrowingFile:
    """Complete lines of a text file; waits at its end for more, and ends when none has come for `idle_s` seconds.

    A last line without an end of line is handed over only when the wait is over. `idle_s` inf waits for ever. The name
    is followed: where another file has taken it, or the file was cut to begin anew, lines go on with that one, whose
    head (`#` lines and the header that was there before) is not handed over again. Bytes that are no text, and a line
    behind the header that is too long for a table, are handed over as U+FFFD: no number, so that a reader passes over
    such a line and counts it, and whoever waits for the next flight is not sent away.
    """

    def __init__(self, path: str, idle_s: float, wait: Callable[[float], None] = time.sleep, codec: str = "utf-8-sig"):
        self.name, self._codec = path, codec
        self._idle_s, self._wait = idle_s, wait
        self._lines = self._read()

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        """The next line. Raises DataError when the file cannot be opened."""
        return next(self._lines)

    def _read(self) -> Iterator[str]:
        header = ""
        again = False
        while True:
            in_head = True
            for line in self._read_one():
                if in_head and not line.startswith("#"):
                    in_head = False
                    if not header and UNREADABLE in line:
                        hint = "a recorder can state another, as in `file: {encoding: latin-1}`"
                        codec = self._codec.removesuffix("-sig").upper()
                        what = f"no {codec} text ({hint}), or longer than {LONGEST_LINE} characters"
                        raise DataError(f"{self.name}: the header is {what}")
                    header, repeated = header or line, again and line == header
                    if repeated:
                        continue
                if not (in_head and again):
                    yield line
            if not self._replaced:
                return
            again = True

    def _read_one(self) -> Iterator[str]:
        """Lines until none has come for long enough, or there is another file to go on with."""
        self._replaced = False
        try:
            stream = open(self.name, encoding=self._codec, errors="replace", newline="")
        except OSError as error:
            raise DataError(f"{self.name}: {error.strerror or error}") from error
        with stream:
            held, idle = "", 0.0
            while True:
                line = stream.readline(LONGEST_LINE + 1)
                if line:
                    held, idle = held + line, 0.0
                    if len(held) > LONGEST_LINE:  # what came of it is dropped, its end awaited
                        held = UNREADABLE + "\n" * held.endswith("\n")
                    if held.endswith("\n"):
                        yield held
                        held = ""
                    continue
                if self._renewed(stream):
                    self._replaced = True
                    break
                if idle >= self._idle_s:
                    break
                self._wait(POLL_S)
                idle += POLL_S
            if held:
                yield held

    def _renewed(self, stream: TextIO) -> bool:
        """Whether the name stands for another file, or the file is shorter than what was read of it."""
        mine = os.fstat(stream.fileno())
        try:
            there = os.stat(self.name)
        except OSError:  # between two files, or the last one was removed
            return False
        if not stat.S_ISREG(mine.st_mode):
            return False
        return not os.path.samestat(mine, there) or mine.st_size < stream.buffer.tell()


def header_lines(
    command: str = "",
    *,
    seed: int | None = None,
    configs: Iterable[str | Path] = (),
    notes: Mapping[str, str] | None = None,
    inherited: Sequence[str] = (),
) -> tuple[str, ...]:
    """Lines without the `#`: tool, command, seed, configuration files with their hashes, notes `key: text`.

    inherited: the provenance of the file that was read; it is kept, indented, below. Files are named without
    their folder, so that the bytes do not depend on where the project lies.
    """
    lines = [f"enginediag: {__version__}"]
    if command:
        lines.append(f"command: {command}")
    if seed is not None:
        lines.append(f"seed: {seed}")
    lines += [f"config: {Path(path).name} sha256:{file_sha256(path)[:16]}" for path in configs]
    lines += [f"{key}: {text}" for key, text in {**current_notes(), **(notes or {})}.items()]
    if inherited:
        lines.append("input:")
        lines += [f"  {line}" for line in inherited]
    return tuple(" ".join(line.splitlines()) for line in lines)


class _CurrentNotes:
    """Settings of the present run that are not on its command line."""

    notes: Mapping[str, str] = {}


@contextmanager
def provenance_notes(notes: Mapping[str, str]) -> Iterator[None]:
    """Within it, notes that every header has: options on which results depend, and that a file or the environment
    gives."""
    before, _CurrentNotes.notes = _CurrentNotes.notes, dict(notes)
    try:
        yield
    finally:
        _CurrentNotes.notes = before


def current_notes() -> dict[str, str]:
    """The notes of `provenance_notes`, for what has a head of its own."""
    return dict(_CurrentNotes.notes)


def file_sha256(path: str | Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes. Raises OSError."""
    import hashlib

    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        for block in iter(lambda: stream.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()
