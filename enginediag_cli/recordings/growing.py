"""Lines of a file that is still being written, as they come."""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Callable, Iterator
from typing import TextIO

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.source import LONGEST_LINE

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
            for line in self._of_one():
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

    def _of_one(self) -> Iterator[str]:
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
