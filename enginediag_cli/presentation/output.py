"""Where a command's data go, and in which format."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Any, TextIO

from enginediag_cli.presentation.messages import wants_color
from enginediag_cli.presentation.rows import write_csv, write_json

SUFFIX_FORMATS = {".csv": "csv", ".json": "json"}


@dataclass(frozen=True)
class Output:
    """The user's choice of `-o`, `--format`, `--no-header`, `--color`; opens nothing before data exist."""

    path: str = "-"
    format: str = "auto"
    header: bool = True
    color: str = "auto"

    @property
    def to_stdout(self) -> bool:
        return self.path == "-"

    def chosen_format(self) -> str:
        """csv, json or table; auto goes by the file's suffix, else table on a terminal and csv in a pipe."""
        if self.format != "auto":
            return self.format
        if not self.to_stdout:
            suffix = os.path.splitext(self.path.lower().removesuffix(".gz"))[1]
            return SUFFIX_FORMATS.get(suffix, "csv")
        return "table" if sys.stdout.isatty() else "csv"

    @contextmanager
    def open(self) -> Iterator[TextIO]:
        """The stream to write to, packed for a name in `.gz`.

        A file appears under its name only when the block ends without an error.
        """
        from enginediag_cli.recordings.write import output

        with output(self.path) as stream:
            yield stream

    def write_text(self, text: str) -> None:
        """Write a document (YAML, JSON schema, prose) as it is."""
        with self.open() as stream:
            stream.write(text)

    def write_rows(
        self,
        rows: Iterable[Mapping[str, Any]],
        columns: Sequence[str] | None = None,
        *,
        provenance: Sequence[str] = (),
        live: bool = False,
    ) -> int:
        """Write `rows` in the chosen format as they come and return how many there were.

        `columns` defaults to the keys of the first row. `provenance` lines go above a CSV, each behind `# `,
        unless the user gave --no-header. `live` hands every row on at once, for input that is still growing.
        A table needs all rows to find its widths; csv and json hold one row at a time.
        """
        iterator = iter(rows)
        first = next(iterator, None)  # an error in the first row leaves no output behind, not even a header
        if first is not None:
            columns = tuple(columns or first)
            iterator = chain([first], iterator)
        with self.open() as stream:
            return write_rows(
                iterator,
                columns or (),
                format=self.chosen_format(),
                stream=stream,
                live=live,
                provenance=provenance if self.header else (),
                color=self.color,
            )


def write_rows(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    *,
    format: str,
    stream: TextIO,
    provenance: Sequence[str] = (),
    live: bool = False,
    color: str = "auto",
) -> int:
    """Write `rows` to an open stream as "csv", "json" (one array) or "table"; returns the number of rows."""
    if format == "csv":
        return write_csv(rows, columns, stream, provenance=provenance, live=live)
    if format == "json":
        return write_json(rows, columns, stream, live=live)
    from enginediag_cli.presentation.tables import write_table

    return write_table(rows, columns, stream, color=wants_color(color, stream))
