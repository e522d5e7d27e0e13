"""Excel workbooks in, a sheet row by row as a text table; openpyxl is imported when one is read, never before."""

from __future__ import annotations

import csv
import io
import os
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.csv_in import table_records
from enginediag_cli.recordings.formats.table_file import Asked, TableFile
from enginediag_cli.recordings.source import OWN, Peeked, refuse_devices
from enginediag_cli.recordings.table import Recording

CONTENTS = "xl/workbook.xml"
"""What is in every .xlsx, and in no other zip archive."""
MOST_TEXT_BYTES = 500_000_000
"""Unpacked size of a workbook's texts, which are in memory at once."""
MOST_BYTES = 20_000_000_000
"""Unpacked size of a workbook: a full sheet of a million rows and a thousand columns."""


def is_excel(path: str | Path) -> bool:
    """Whether a regular file is an Excel workbook (.xlsx), whatever it is called."""
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as stream:
            if stream.read(4) != b"PK\x03\x04":
                return False
        with zipfile.ZipFile(path) as archive:
            return CONTENTS in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


class ExcelTable(TableFile):
    """An open workbook. The line of a record is the row of the sheet."""

    def __init__(self, path: str | Path, sheet: str = ""):
        """sheet: its name; the first if empty. Raises DataError: no openpyxl, damaged, too large, no such sheet."""
        refuse_devices(path)
        self.name = str(path)
        try:
            import openpyxl
        except ImportError as error:
            raise DataError(
                f"{path}: an Excel workbook needs openpyxl, which is not installed ({error}): "
                "pip install 'enginediag[excel]', or save it as CSV"
            ) from None
        self._refuse_bombs()
        with self._readable():
            self._book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
            names = self._book.sheetnames
        if sheet and sheet not in names:
            raise DataError(f"{path}: no sheet {sheet!r}; there are {', '.join(names)}")
        self._sheet = sheet or names[0]
        self.lines = peeked = Peeked(self._text(","), self.name)
        self.provenance, self.columns = peeked.provenance, peeked.columns

    def close(self) -> None:
        self._book.close()

    def records(self, asked: Asked, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Numbers are written as the dialect says, which their cells do not depend on."""
        written = replace(asked.dialect, delimiter="\t", widths=(), encoding=OWN.encoding)
        rows = self._text("\t", asked.dialect.decimal)
        yield from table_records(rows, self.name, replace(asked, dialect=written), chunk_records)

    def _text(self, delimiter: str, decimal: str = ".") -> Iterator[str]:
        """The rows as lines of text."""
        with self._readable():
            for row in self._book[self._sheet].iter_rows(values_only=True):
                line = io.StringIO()
                csv.writer(line, delimiter=delimiter, lineterminator="\n").writerow(_texts(row, decimal))
                yield line.getvalue()

    def _refuse_bombs(self) -> None:
        with self._readable(), zipfile.ZipFile(self.name) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
        texts = sizes.get("xl/sharedStrings.xml", 0)
        if texts > MOST_TEXT_BYTES or sum(sizes.values()) > MOST_BYTES:
            told = f"{max(texts, sum(sizes.values())) / 1e6:.0f} MB when unpacked"
            raise DataError(f"{self.name}: a workbook of {told}, which is not read; save the sheet as CSV")

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Errors of a damaged workbook, with its name."""
        try:
            yield
        except DataError:
            raise
        except (OSError, zipfile.BadZipFile, KeyError, ValueError, SyntaxError, TypeError, AttributeError) as error:
            first = (str(error).splitlines() or [""])[0]
            raise DataError(f"{self.name}: a damaged Excel workbook ({first}); save it anew, or as CSV") from error


def _texts(cells: Sequence[Any], decimal: str) -> list[str]:
    return [_text(cell, decimal) for cell in cells]


def _text(cell: Any, decimal: str) -> str:
    """A cell as CSV has it: stamps as ISO 8601, midnight as a date alone, durations in seconds."""
    if cell is None:
        return ""
    if isinstance(cell, (bool, int)):
        return str(int(cell))
    if isinstance(cell, float):
        return repr(cell).removesuffix(".0").replace(".", decimal)
    if isinstance(cell, datetime):
        return cell.date().isoformat() if cell.time() == time() else cell.isoformat(" ")
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds()).replace(".", decimal)
    if isinstance(cell, (date, time)):
        return cell.isoformat()
    return " ".join(str(cell).splitlines())
