"""Results of the verbs of the library: rows with their declaration, messages, files, and a picture."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from enginediag_cli.errors import EngineDiagError, NoVerdictError
from enginediag_cli.recordings.source import header_lines, provenance_notes
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from enginediag_cli.report.output import Output
    from enginediag_cli.report.tables import Table

__all__ = ["DocumentResult", "MessageLog", "Picture", "Result", "header_lines", "provenance_notes"]

Row = dict[str, Any]
Kind = TypeVar("Kind", bound="Result")

SHOWN_ROWS = 20
"""Rows that a notebook shows: what fits on a screen; `to_frame` has all of them."""


class MessageLog(Messages):
    """Collects what a command would write to standard error, instead of writing it.

    Attributes
    ----------
    entries : list of (str, str)
        Level (``"note"``, ``"warning"`` or ``"error"``) and text, in the order in which they came.
    """

    def __init__(self) -> None:
        super().__init__()
        self.entries: list[tuple[str, str]] = []

    def note(self, text: str, **fields: Any) -> None:
        """Keep a fact about the run."""
        self.entries.append(("note", text))

    def warning(self, text: str, **fields: Any) -> None:
        """Keep something that the user should look at."""
        self.entries.append(("warning", text))

    def error(self, text: str, **fields: Any) -> None:
        """Keep why a part of the work was given up."""
        self.entries.append(("error", text))


class Picture:
    """A drawing as SVG text; a notebook shows it.

    Parameters
    ----------
    svg : str
        The drawing.
    """

    def __init__(self, svg: str):
        self.svg = svg

    def save(self, path: str | Path) -> None:
        """Write the picture.

        Parameters
        ----------
        path : str or Path
            Ends in ``.svg`` or ``.png``; ``-`` is standard output.

        Raises
        ------
        DataError
            Without the package that draws PNG.
        OSError
            Where the file cannot be written.
        """
        from enginediag_cli.report.plotting.svg import write_drawing

        write_drawing(self.svg, str(path))

    def _repr_svg_(self) -> str:
        return self.svg


class Result(ABC):
    """Rows that a verb has found, computed as they are read.

    Iterating over a result, or asking for `rows`, computes what is still missing and keeps it; `stream` computes each
    row once and keeps none, so that memory is bounded.

    Attributes
    ----------
    table : Table or None
        Declaration of the columns, with their units.
    messages : Messages
        Where notes and warnings go; a `MessageLog` unless the caller gave another.
    found, judged : int
        Findings, and pieces of data that could be judged, as far as rows have been computed.
    unread : mapping of str to str
        Files that could not be read to their end, with the reason.
    """

    def __init__(
        self,
        *,
        table: Table[Any] | None = None,
        head: Callable[[], tuple[str, ...]] = tuple,
        columns: Sequence[str] | None = None,
        summary_columns: Sequence[str] = (),
        messages: Messages | None = None,
    ):
        self.table = table
        self.summary_columns = tuple(summary_columns or (table.terminal if table else ()))
        self.messages = messages if messages is not None else MessageLog()
        self.findings = self.judged = 0
        self.unread: Mapping[str, str] = {}
        self._head, self._columns = head, columns
        self._rows = self._compute()
        self._kept: list[Row] = []
        self._complete = False

    @abstractmethod
    def _compute(self) -> Iterator[Row]:
        """Compute the rows, one after another; report on all of them after the last."""

    def complete(self: Kind, stream: bool = False) -> Kind:
        """Compute all rows, unless they are to come as a stream; return the result."""
        if not stream:
            _ = self.rows
        return self

    def stream(self) -> Iterator[Row]:
        """Yield every row as it is computed; rows that have been kept come first and are kept no longer.

        Yields
        ------
        dict
            One row, its keys as declared in `table`.
        """
        while self._kept:
            yield self._kept.pop(0)
        yield from self._rows
        self._complete = True

    @property
    def rows(self) -> list[Row]:
        """All rows, in their order."""
        if not self._complete:
            self._kept += self._rows
            self._complete = True
        return self._kept

    def __iter__(self) -> Iterator[Row]:
        """Iterate over all rows."""
        return iter(self.rows)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.rows)

    def __getitem__(self, number: int) -> Row:
        """Return a row by its number, from 0."""
        return self.rows[number]

    @property
    def provenance(self) -> tuple[str, ...]:
        """Lines that say which program, files and choices made this; they head a CSV file. Computes the first row."""
        if not self._kept and not self._complete:
            first = next(self._rows, None)
            self._kept += [] if first is None else [first]
        return self._head()

    @property
    def columns(self) -> tuple[str, ...] | None:
        """Names of the columns where they are known before the first row; None where the first row has them."""
        return None if self._columns is None else tuple(self._columns)

    def array(self, column: str) -> NDArray[np.float64]:
        """Return the numbers of a column.

        Parameters
        ----------
        column : str
            Its name; the unit is the name's suffix, or the one that the schema states.

        Returns
        -------
        ndarray, shape (rows,)
            NaN where a cell is empty.

        Raises
        ------
        KeyError
            Where there is no such column; names the nearest.

        Examples
        --------
        >>> from enginediag_cli import simulate
        >>> simulate("turbojet.yaml", records=2, noise="none").array("altitude_m").shape
        (2,)
        """
        import numpy as np

        names = list(dict.fromkeys(chain.from_iterable(self.rows)))
        if column not in names:
            from enginediag_cli.config.fields import near

            raise KeyError(f"there is no column {column!r} ({near(column, names)})")
        cells = [row.get(column) for row in self.rows]
        return np.array([np.nan if value is None or value == "" else float(value) for value in cells])

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain Python objects, ready for ``json.dump``.

        Returns
        -------
        dict
            ``schema``, ``provenance`` (lines) and ``rows``.
        """
        from enginediag_cli.report.output import plain

        schema = {} if self.table is None else {"schema": self.table.id}
        rows = [plain(row) for row in self.rows]
        return {**schema, "provenance": list(self.provenance), "rows": rows}

    def to_frame(self) -> Any:
        """Return the rows as a table of pandas, or of pyarrow where pandas is not installed.

        Returns
        -------
        pandas.DataFrame or pyarrow.Table
            One column per key; lists as the text that a CSV cell has.

        Raises
        ------
        EngineDiagError
            Where neither package is installed.
        """
        from enginediag_cli.report.output import bare_cells

        names = list(self.columns or dict.fromkeys(chain.from_iterable(self.rows)))
        cells = [bare_cells(row, names) for row in self.rows]
        return frame({name: [row[k] for row in cells] for k, name in enumerate(names)})

    def summary(self) -> str:
        """Return what the command prints on standard error: sentences, warnings and counts.

        Returns
        -------
        str
            One line each. Where messages went elsewhere, the rows as a table.
        """
        rows = self.rows
        log = self.messages
        if isinstance(log, MessageLog) and log.entries:
            return "\n".join(text if level == "note" else f"{level}: {text}" for level, text in log.entries)
        return "\n".join(", ".join(f"{k} {v}" for k, v in row.items() if v not in (None, "")) for row in rows)

    def plot(self) -> Picture:
        """Draw the picture of the command's ``--picture``.

        Returns
        -------
        Picture
            Shown by notebooks; ``save`` writes it as SVG or PNG.

        Raises
        ------
        NoVerdictError
            Where there is nothing to draw.
        """
        raise NoVerdictError("this result has no picture")

    def save(self, path: str | Path, format: str = "auto") -> None:
        """Write the rows as the command's ``-o`` does, completely or not at all.

        Parameters
        ----------
        path : str or Path
            The ending chooses the format: ``.csv``, ``.json``, ``.ndjson``, ``.parquet``; ``.gz`` packs.
        format : {"auto", "csv", "json", "ndjson", "table"}
            Overrides the ending.

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        from enginediag_cli.report.output import Output

        Output(str(path), format).write_rows(
            iter(self.rows), self.columns, summary=self.summary_columns, provenance=self.provenance
        )

    def _repr_html_(self) -> str:
        rows = self.rows
        names = list(dict.fromkeys(chain.from_iterable(rows[:SHOWN_ROWS])))
        from enginediag_cli.report.output import cell

        head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell(row.get(name)))}</td>" for name in names) + "</tr>"
            for row in rows[:SHOWN_ROWS]
        )
        more = f"<p>{len(rows) - SHOWN_ROWS} more rows</p>" if len(rows) > SHOWN_ROWS else ""
        return f"<table><tr>{head}</tr>{body}</table>{more}"


class DocumentResult(Result):
    """Rows, and one document with all details of a result, which is written as JSON."""

    @abstractmethod
    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        """Return the whole result as one object; a value may be an iterator, to bound memory."""

    def to_dict(self) -> dict[str, Any]:
        """Return the document that the command writes as JSON, as plain Python objects.

        Returns
        -------
        dict
            Its keys are those of the command's JSON schema; numbers that JSON lacks are None.
        """
        from enginediag_cli.report.output import finite, plain

        found = self._document(self.provenance)
        whole = {key: list(value) if isinstance(value, Iterator) else value for key, value in found.items()}
        return {key: finite(plain(value)) for key, value in whole.items()}

    def write(self, output: Output) -> None:
        """Write the document, or the rows where `output` is no JSON. Raises DataError, OSError."""
        rows = self.rows
        output.write_document(
            lambda: self._document(self.provenance if output.header else ()),
            rows,
            self.columns,
            summary=self.summary_columns,
            provenance=self.provenance,
        )

    def save(self, path: str | Path, format: str = "auto") -> None:
        """Write the rows, or as ``.json`` the document, as the command's ``-o`` does, completely or not at all.

        Parameters
        ----------
        path : str or Path
            The ending chooses the format: ``.csv``, ``.json``, ``.ndjson``, ``.parquet``; ``.gz`` packs.
        format : {"auto", "csv", "json", "ndjson", "table"}
            Overrides the ending.

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        from enginediag_cli.report.output import Output

        self.write(Output(str(path), format))


def frame(columns: Mapping[str, Sequence[Any]]) -> Any:
    """Make a table of pandas, else of pyarrow.

    Raises
    ------
    EngineDiagError
        Where neither package is installed.
    """
    try:
        import pandas
    except ImportError:
        pass
    else:
        return pandas.DataFrame(dict(columns))
    try:
        import pyarrow
    except ImportError:
        raise EngineDiagError("to_frame needs pandas or pyarrow: pip install 'enginediag[parquet]'") from None
    return pyarrow.table(dict(columns))
