"""The journal of trials: finished work, one JSON line each, from which an interrupted run goes on.

The first line says what was run: a journal of something else, or of the same before it was changed, is refused. Every
line is on the disk before the next piece of work counts as begun; a last line cut short is dropped.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.write import output

Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Form(Generic[Key, Value]):
    """How finished work stands in a journal: `line` makes the JSON object of a piece, `entry` reads it back and may
    raise KeyError, TypeError, ValueError or AttributeError for something else.

    head: key of the first line under which stands what was run; what, other: what such a file is called, and one that
    belongs to something else; option: that of the command line which names it.
    """

    head: str
    what: str
    other: str
    option: str
    line: Callable[[Key, Value], Mapping[str, Any]]
    entry: Callable[[Mapping[str, Any]], tuple[Key, Value]]


class Journal(Generic[Key, Value]):
    """A file to which finished work is added, each piece at once and to stay; `run`: hash of all that it depends on."""

    def __init__(self, path: Path, run: str, form: Form[Key, Value]):
        self.path, self._run, self._form = path, run, form

    @property
    def begun(self) -> bool:
        """Whether the file holds anything."""
        return self.path.exists() and self.path.stat().st_size > 0

    def read(self) -> dict[Key, Value]:
        """What was finished before; nothing when there is no file.

        Raises DataError when the file is the journal of something else, or no journal.
        """
        if not self.begun:
            return {}
        form = self._form
        lines = self.path.read_text(encoding="utf-8", errors="replace").split("\n")
        whole, cut = lines[:-1], lines[-1]
        head = _parsed(whole[0]) if whole else None
        if head is None or form.head not in head:
            raise DataError(f"{self.path}: not {form.what}; name another one with {form.option}")
        if head[form.head] != self._run:
            raise DataError(f"{self.path}: {form.other}; remove it or name another one with {form.option}")
        if cut:
            self._rewrite(whole)
        finished = {}
        for number, line in enumerate(whole[1:], start=2):
            found = _parsed(line)
            try:
                if found is None:
                    raise ValueError("not an object")
                key, value = form.entry(found)
            except (KeyError, TypeError, ValueError, AttributeError):
                raise DataError(f"{self.path}:{number}: not a line of {form.what}") from None
            finished[key] = value
        return finished

    def add(self, key: Key, value: Value) -> None:
        """Append one piece and see it on the disk. Raises OSError."""
        lines = [] if self.begun else [self._head()]
        text = "".join(line + "\n" for line in (*lines, self._line(key, value)))
        with open(self.path, "ab", buffering=0) as stream:  # whole lines, whoever else adds to the file
            stream.write(text.encode())
            os.fsync(stream.fileno())

    def write(self, finished: Mapping[Key, Value]) -> None:
        """Replace the journal by one of these pieces, in their order. Raises OSError."""
        self._rewrite([self._head(), *(self._line(key, value) for key, value in finished.items())])

    def _head(self) -> str:
        return json.dumps({self._form.head: self._run})

    def _line(self, key: Key, value: Value) -> str:
        return json.dumps(self._form.line(key, value), ensure_ascii=False)

    def _rewrite(self, lines: Iterable[str]) -> None:
        """These lines, completely or not at all."""
        with output(self.path) as stream:
            stream.writelines(line + "\n" for line in lines)


def _parsed(line: str) -> dict[str, Any] | None:
    """The object of a line; None where it is none, as when it was cut short."""
    try:
        value = json.loads(line)
    except json.JSONDecodeError:
        return None
    return value if isinstance(value, dict) else None
