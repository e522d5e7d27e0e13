"""Files: which ones a run may read, the line of a file under a message, and patterns that are used in bounded time.

Regular files of a sane size are read. A YAML file may come from somebody else: what it names must lie in its own
folder or come with the program, so that nothing else is read or quoted in a message. Regular expressions and wildcards
that a file gives are refused, or given up, where they would take too long.
"""

from __future__ import annotations

import fnmatch
import os
import re
import signal
import stat
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from enginediag_cli.errors import ConfigError, DataError, Mark, Problem
from enginediag_cli.progress import touched
from enginediag_cli.shipped import shipped

MOST_YAML_BYTES = 20_000_000
"""The largest nominal files, of thousands of operating points, have a tenth of it."""

MOST_TABLE_BYTES = 20_000_000
"""A component map of 500 × 500 points and five columns has less."""

PEEKED_BYTES = 65_536
"""The `kind:` of a file is in its first lines, behind at most a page of comments."""


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


WORD = re.compile(r"'[^']*'|\"[^\"]*\"|[^\s,:\[\]{}#]+")

MOST_COLUMNS = 160
"""Characters of a source line that are shown; a file may be a single line of megabytes."""

Lines = dict[str, Sequence[str]]
"""Lines of the files read so far."""


def render(problem: Problem, files: Lines | None = None) -> str:
    """`file:line:col: error: …`, then the source line and a caret where the file can still be read."""
    line = _source_line(problem.mark, {} if files is None else files)
    if line is None:
        return str(problem)
    column = min(problem.mark.column, len(line) + 1) - 1
    begin = max(0, column - MOST_COLUMNS // 2) if len(line) > MOST_COLUMNS else 0
    line, column = line[begin : begin + MOST_COLUMNS], column - begin
    token = WORD.match(line, column)
    underline = "^" + "~" * (len(token.group()) - 1 if token else 0)
    # tabs are kept so that the caret stays under its character
    lead = "".join("\t" if character == "\t" else " " for character in line[:column])
    number = f"{problem.mark.line:>5}"
    return f"{problem}\n{number} | {line}\n{' ' * len(number)} | {lead}{underline}"


def render_all(error: ConfigError) -> str:
    """The problems of a file, one after the other, and how many more there are."""
    files: Lines = {}
    return "\n".join(
        [*(render(problem, files) for problem in error.shown_problems), *([error.rest] if error.rest else [])]
    )


def _source_line(mark: Mark, files: Lines) -> str | None:
    if mark.line < 1 or mark.column < 1:
        return None
    if mark.file not in files:
        try:
            refuse_irregular(mark.file, MOST_YAML_BYTES)
            files[mark.file] = Path(mark.file).read_text(encoding="utf-8-sig", errors="replace").split("\n")
        except (OSError, ValueError):
            files[mark.file] = ()
    lines = files[mark.file]
    line = lines[mark.line - 1].rstrip("\r") if mark.line <= len(lines) else ""
    return line if line.strip() else None


MATCH_S = 2.0
"""Time for one match; an honest pattern finds a serial number in microseconds."""
WALK_S = 30.0
"""Time for one pattern of files: a station's disk has been seen to take a second for 100,000 entries."""
MOST_ENTRIES = 1_000_000
"""Entries of folders that one pattern looks at."""


MOST_LEVELS = 100
"""Folders within folders that ** goes down."""


def compile_pattern(text: str) -> re.Pattern[str]:
    """The regular expression. Raises ValueError for one that is none, and for one whose time may grow exponentially
    with the text: a repetition of what itself may have several lengths or alternatives, as in (a+)+ or (a|aa)*."""
    try:
        pattern = re.compile(text)
        parsed = _parser().parse(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise ValueError(f"not a regular expression: {error}") from error
    if _ambiguous(parsed, repeated=False):
        raise ValueError(
            "a repetition within a repetition, such as (a+)+ or (a|aa)*, can take longer than anybody waits: write it "
            "without the inner or the outer one"
        )
    return pattern


def search(pattern: re.Pattern[str], text: str, name: str) -> re.Match[str] | None:
    """`pattern.search(text)`. Raises DataError, with the name of what gave the pattern, when it takes too long."""
    with _limited(MATCH_S, f"{name}: the pattern {pattern.pattern!r} takes more than {MATCH_S:g} s; simplify it"):
        return pattern.search(text)


def matching(folder: Path, pattern: str) -> list[str]:
    """Paths of all entries below a folder that a pattern names, sorted: * is any part of a name, ** any number of
    folders (no hidden ones, and no links), MOST_LEVELS at the most. A pattern may begin with .. or be absolute. Raises
    DataError where it looks at too many entries, or takes too long."""
    every = Path(pattern).parts
    parts = [part for k, part in enumerate(every) if part != "." and (part != "**" or every[k - 1 : k] != ("**",))]
    return sorted(set(_matching(str(folder), parts, _FolderWalk(pattern))))


class _FolderWalk:
    """What a walk has looked at, and how long it may go on."""

    def __init__(self, pattern: str):
        self._pattern, self._entries, self._until = pattern, 0, time.monotonic() + WALK_S

    def entries(self, folder: str) -> list[os.DirEntry[str]]:
        """Those of a folder; none of what is no folder or cannot be read. Raises DataError."""
        found = []
        try:
            with os.scandir(folder or ".") as every:
                for entry in every:
                    self._entries += 1
                    if self._entries > MOST_ENTRIES or time.monotonic() > self._until:
                        looked = f"looks at more than {min(self._entries, MOST_ENTRIES)} files, or for {WALK_S:g} s"
                        raise DataError(f"the pattern {self._pattern!r} {looked}; name the folder of the recordings")
                    found.append(entry)
        except OSError:
            return []
        return found


def _matching(folder: str, parts: list[str], walk: _FolderWalk) -> Iterator[str]:
    if not parts:
        yield folder
        return
    first, rest = parts[0], parts[1:]
    if first == "**":
        yield from _matching(folder, rest, walk) if rest else ()
        for entry in walk.entries(folder):
            if entry.is_dir(follow_symlinks=False):
                if not _hidden(entry.name) and folder.count(os.sep) < MOST_LEVELS:
                    yield from _matching(entry.path, parts, walk)
            elif not rest and not _hidden(entry.name):
                yield entry.path
    elif any(mark in first for mark in "*?["):
        for entry in walk.entries(folder):
            if fnmatch.fnmatch(entry.name, first) and (_hidden(first) or not _hidden(entry.name)):
                yield from _matching(entry.path, rest, walk)
    else:
        path = os.path.join(folder, first)
        if os.path.lexists(path):
            yield from _matching(path, rest, walk)


def _hidden(name: str) -> bool:
    return name[:1] == "."


@contextmanager
def _limited(seconds: float, message: str) -> Iterator[None]:
    """Raises DataError with this message after so many seconds. The matcher of `re` looks for signals as it goes; where
    there are none (another thread, another system) what `compile_pattern` has let pass goes on."""

    def stop(*_: object) -> None:
        raise DataError(message)

    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _parser() -> Any:
    """The module of the standard library that parses regular expressions, which 3.11 has renamed."""
    import importlib

    try:
        return importlib.import_module("re._parser")
    except ImportError:
        return importlib.import_module("sre_parse")


REPEATS = ("MAX_REPEAT", "MIN_REPEAT")
"""Repetitions that give back what they have taken, as the parser calls them."""


def _ambiguous(parsed: Any, *, repeated: bool) -> bool:
    """Whether a repetition contains another one of several lengths, or alternatives. repeated: this is inside one."""
    for op, value in parsed:
        name = str(op)
        if name in REPEATS:
            low, high, inside = value
            if (repeated and high > low) or _ambiguous(inside, repeated=repeated or high > 1):
                return True
        elif repeated and name in ("BRANCH", "GROUPREF"):
            return True
        elif any(_ambiguous(part, repeated=repeated) for part in _parts(name, value)):
            return True
    return False


def _parts(name: str, value: Any) -> Sequence[Any]:
    """The parsed expressions that an item of a pattern consists of."""
    match name:
        case "BRANCH":
            return tuple(value[1])
        case "SUBPATTERN":
            return (value[-1],)
        case "ASSERT" | "ASSERT_NOT":
            return (value[1],)
        case "ATOMIC_GROUP":
            return (value,)
    return ()
