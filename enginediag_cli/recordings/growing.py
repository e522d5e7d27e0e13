"""Lines of a file that is still being written, as they come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.source import LONGEST_LINE

POLL_S = 0.2
"""Between looks at a file that grows: a row appears at once to an eye, and waiting costs nothing."""


class GrowingFile:
    """Complete lines of a text file; waits at its end for more, and ends when none has come for `idle_s` seconds.

    A last line without an end of line is handed over only when the wait is over. `idle_s` inf waits for ever.
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
        try:
            stream = open(self.name, encoding=self._codec, newline="")
        except OSError as error:
            raise DataError(f"{self.name}: {error.strerror or error}") from error
        with stream:
            held, idle = "", 0.0
            while True:
                line = stream.readline(LONGEST_LINE + 1)
                if line:
                    held, idle = held + line, 0.0
                    if len(held) > LONGEST_LINE:
                        raise DataError(f"{self.name}: a line of more than {LONGEST_LINE} characters; is it a table?")
                    if held.endswith("\n"):
                        yield held
                        held = ""
                    continue
                if idle >= self._idle_s:
                    break
                self._wait(POLL_S)
                idle += POLL_S
            if held:
                yield held
