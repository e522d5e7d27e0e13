"""Every error that a user can cause, and the exit codes of the program.

Exit codes: 0 done, 1 finding (only on request), 2 bad usage, configuration or data,
3 no verdict (did not converge, or too little data to judge), 70 internal error, 75 another run holds the lock (the
same command may succeed later), 130 interrupted.
"No verdict" never looks like "healthy" (0) or "faulty" (1).
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple


class ExitCode(IntEnum):
    DONE = 0
    FINDING = 1
    TROUBLE = 2
    NO_VERDICT = 3
    INTERNAL = 70
    LOCKED = 75
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class Mark(NamedTuple):
    """A place in a file; line and column count from 1, 0 where unknown."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return ":".join([self.file, *(str(n) for n in (self.line, self.column) if n)])


class Problem(NamedTuple):
    """One problem: where it is, what it is, and how to fix it."""

    mark: Mark
    message: str
    hint: str = ""

    def __str__(self) -> str:
        return f"{self.mark}: error: {self.message}" + (f" ({self.hint})" if self.hint else "")


class EngineDiagError(Exception):
    """Base of every error that the user can fix; shown in one line, without a traceback."""

    exit_code = ExitCode.TROUBLE


class UsageError(EngineDiagError, ValueError):
    """Options, or arguments of the same names, that do not go together."""


class WorkerDiedError(EngineDiagError):
    """A process that shares the work was ended from outside, as by the system when memory runs out."""


MOST_PROBLEMS = 50
"""Problems of a file that are reported; more help nobody, and a hostile file could have a million."""


class ConfigError(EngineDiagError, ValueError):
    """All problems of one configuration file at once; its text has the first `MOST_PROBLEMS`."""

    def __init__(self, problems: Sequence[Problem]):
        self.problems = tuple(problems)
        super().__init__("\n".join([*(str(p) for p in self.shown_problems), *([self.rest] if self.rest else [])]))

    @property
    def shown_problems(self) -> tuple[Problem, ...]:
        return self.problems[:MOST_PROBLEMS]

    @property
    def rest(self) -> str:
        """How many problems are not reported, in words; empty if all are."""
        more = len(self.problems) - MOST_PROBLEMS
        return f"and {more} more problem{'s' if more > 1 else ''}" if more > 0 else ""


class DataError(EngineDiagError, ValueError):
    """A recording that cannot be read; the message carries file, line and column."""


class NoVerdictError(EngineDiagError):
    """The question was understood but these data cannot answer it."""

    exit_code = ExitCode.NO_VERDICT
