"""Patterns that a file gives, used in bounded time: regular expressions, and names of files with wildcards."""

from __future__ import annotations

import fnmatch
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from enginediag_cli.errors import DataError

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
    if _ambiguous(parsed, within=False):
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


def _ambiguous(parsed: Any, *, within: bool) -> bool:
    """Whether a repetition holds another one of several lengths, or alternatives. within: this is in a repetition."""
    for op, value in parsed:
        name = str(op)
        if name in REPEATS:
            low, high, inside = value
            if (within and high > low) or _ambiguous(inside, within=within or high > 1):
                return True
        elif name == "BRANCH":
            if within or any(_ambiguous(branch, within=within) for branch in value[1]):
                return True
        elif name == "SUBPATTERN":
            if _ambiguous(value[-1], within=within):
                return True
        elif name in ("ASSERT", "ASSERT_NOT"):
            if _ambiguous(value[1], within=within):
                return True
        elif name == "ATOMIC_GROUP":
            if _ambiguous(value, within=within):
                return True
        elif name == "GROUPREF" and within:
            return True
    return False
