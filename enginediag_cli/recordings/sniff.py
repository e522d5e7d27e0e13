"""How an unknown file is written, judged by its first lines: a guess for the user to confirm."""

from __future__ import annotations

import codecs
import csv
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import islice, pairwise, product

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.quantities import parse_name
from enginediag_cli.recordings.read import open_table
from enginediag_cli.recordings.source import (
    HEAD_BYTES,
    Format,
    detect_bom,
    detect_utf_16,
    file_format,
    open_bytes,
    refuse_binary,
)
from enginediag_cli.recordings.table import (
    DELIMITERS,
    NATIVE_DIALECT,
    WHITESPACE,
    Dialect,
    ReadRequest,
    TableFile,
    is_missing,
)
from enginediag_cli.recordings.write import ParquetTable
from enginediag_cli.units import DAY_S, UnitWord, parse_unit, split_unit

LOOKED_AT = 1 << 18
"""Bytes of the file that are looked at, 256 KiB: some thousand records."""
TABLE_RECORDS = 2000
"""Records of a Parquet file or workbook that are looked at, as many as fit into those bytes of a CSV file."""
MOST_TITLE_LINES = 60
"""Lines among which the header is looked for."""
NUMBERS = 0.6
"""Share of a column's cells that must be numbers, or missing, for it to be one of numbers."""
UNITS_OF_A_ROW = 0.4
"""Share of the cells of a row of units that must be known units; the others are forms of dates and the like."""
MOST_TAGS = 1000
"""Tags of an export of one reading a line that are distinguished."""

FEWEST_LINES = 3
"""Lines that a table without a delimiter must have: two lines of words may be any text."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_GROUPED = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?")
_TAG = re.compile(r"tag|tag ?name|point|point ?name|signal|parameter|param|variable|channel|sensor|item|name", re.I)
_VALUE = re.compile(r"value|val|reading|data|result|average|avg", re.I)
_QUALITY = re.compile(r"quality|status|qual|good|confidence|flag", re.I)


@dataclass(frozen=True)
class LongTable:
    """An export of one reading a line: columns of tag, value and quality ("" where there is none), and the words of
    quality that came with most values."""

    tag: str
    value: str
    quality: str
    good: tuple[str, ...]


@dataclass(frozen=True)
class SniffedTable:
    """dialect: with its header line always stated where lines stand before it; header: the names of columns that can be
    read; units: cells of the unit row, else empty texts; cells: column → texts of the records looked at;
    guessed_encoding: it is not UTF-8; unusable: columns without a name, or with one that another has; invented: the
    names, where no line of the file gives them; repeated: rows that are the header again; odd: rows of other width."""

    source: str
    dialect: Dialect
    header: tuple[str, ...]
    units: tuple[str, ...]
    cells: Mapping[str, Sequence[str]]
    guessed_encoding: bool
    unusable: tuple[str, ...] = ()
    invented: bool = False
    repeated: int = 0
    odd: int = 0
    long: LongTable | None = None

    def values(self, column: str) -> np.ndarray | None:
        """The column's numbers (N,), NaN where missing, or None when it holds text."""
        result, good = [], 0
        for cell in self.cells[column]:
            bare = self._plain(cell)
            number = _NUMBER.fullmatch(bare) is not None
            good += number or is_missing(bare)
            result.append(float(bare) if number else np.nan)
        values = np.array(result)
        return values if good >= NUMBERS * max(len(values), 1) and np.isfinite(values).any() else None

    def words(self, column: str) -> Counter[str]:
        """Words in a column of numbers although no recording knows them for a missing value."""
        bare = (self._plain(cell) for cell in self.cells[column])
        return Counter(cell for cell in bare if not _NUMBER.fullmatch(cell) and not is_missing(cell))

    def _plain(self, cell: str) -> str:
        bare = cell.strip()
        if self.dialect.thousands:
            bare = bare.replace(",", "")
        return bare.replace(",", ".") if self.dialect.decimal == "," else bare


def sniff(path: str) -> SniffedTable:
    """Look at the head of a file (`-`: standard input). Raises DataError when no table is found in it."""
    if file_format(path) is not Format.TEXT:
        with open_table(path) as table:
            return _reshape_long(_first_records(table) if isinstance(table, ParquetTable) else _first_rows(table))
    raw = _head(path)
    text, encoding = _decode(raw)
    lines = text.splitlines()
    if len(raw) == LOOKED_AT:
        lines = lines[:-1]  # the last one may be cut
    try:
        found = _text_table(lines, path)
    except csv.Error as error:
        raise DataError(f"{path}: no table: {error}") from error
    guessed = encoding in ("cp1252", "latin-1")
    return _reshape_long(replace(found, dialect=replace(found.dialect, encoding=encoding), guessed_encoding=guessed))


def _text_table(lines: Sequence[str], path: str) -> SniffedTable:
    """The table in the lines of a text file; its encoding is the caller's."""
    delimiter, header, width = _table(lines, path)
    rows = list(_split_rows(lines[max(header, 0) :], delimiter))
    rows = [row for row in rows if any(c.strip() for c in row) and not (header < 0 and row[0].startswith("#"))]
    units: tuple[str, ...] = ()
    if header < 0:
        names = tuple(f"c{k + 1}" for k in range(width))
    else:
        names = tuple(cell.strip().lstrip("\ufeff") for cell in rows[0])
        above = next(_split_rows(lines[header - 1 : header], delimiter), []) if header else []
        if above and is_unit_row([above[0].lstrip("#"), *above[1:]], width):
            units = tuple(cell.strip().lstrip("#") for cell in above)
        rows = rows[1:]
    unit_row = bool(header >= 0 and rows and is_unit_row(rows[0], width))
    if unit_row:
        units, rows = tuple(cell.strip() for cell in rows[0]), rows[1:]
    again = [row for row in rows if [c.strip() for c in row] == list(names)]
    body = [row for row in rows if len(row) == width and row not in again]
    counts = Counter(names)
    # a name with the mark of engines in it cannot stand under `from:`
    usable = [k for k, name in enumerate(names) if name and counts[name] == 1 and "{prefix}" not in name]
    plain = all(not line.strip() or line.startswith("#") for line in lines[: max(header, 0)])
    decimal, thousands = _marks(body, delimiter)
    dialect = Dialect(
        delimiter,
        decimal,
        header_line=0 if plain or header < 0 else header + 1,
        unit_row=unit_row,
        names=names if header < 0 else (),
        thousands=thousands,
    )
    return SniffedTable(
        path,
        dialect,
        tuple(names[k] for k in usable),
        tuple(units[k] for k in usable) if units else ("",) * len(usable),
        {names[k]: [row[k] for row in body] for k in usable},
        False,
        tuple(dict.fromkeys(name or f"(column {k + 1})" for k, name in enumerate(names) if k not in usable)),
        invented=header < 0,
        repeated=len(again),
        odd=len(rows) - len(again) - len(body),
    )


def _split_rows(lines: Sequence[str], delimiter: str) -> Iterator[list[str]]:
    if delimiter == WHITESPACE:
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=delimiter)


def _first_rows(table: TableFile) -> SniffedTable:
    """The first rows of a workbook."""
    return _text_table([row.rstrip("\r\n") for row in islice(table.lines, TABLE_RECORDS)], table.name)


def _first_records(table: TableFile) -> SniffedTable:
    """The first records of a Parquet file, which says itself what its columns are."""
    first = next(table.records(ReadRequest((), by_suffix=False), TABLE_RECORDS))
    cells = {name: list(first.text[name]) for name in table.columns}
    return SniffedTable(table.name, NATIVE_DIALECT, table.columns, ("",) * len(table.columns), cells, False)


def _reshape_long(found: SniffedTable) -> SniffedTable:
    """A file with one reading a line as the table of its tags; any other as it is."""
    named = {c: found.values(c) is not None for c in found.header}
    tag = next((c for c, numeric in named.items() if not numeric and _TAG.fullmatch(c.strip())), "")
    value = next((c for c in named if _VALUE.fullmatch(c.strip())), "")
    if not tag or not value or len(named) > 6:
        return found
    tags = Counter(cell.strip() for cell in found.cells[tag])
    records = len(found.cells[tag])
    if not 2 <= len(tags) <= min(MOST_TAGS, records // 2):
        return found
    quality = next((c for c, numeric in named.items() if _QUALITY.fullmatch(c.strip()) and c not in (tag, value)), "")
    good = tuple(w for w, n in Counter(c.strip() for c in found.cells[quality]).most_common(1)) if quality else ()
    by_tag: dict[str, list[str]] = {name: [] for name in tags if name}
    for name, cell in zip(found.cells[tag], found.cells[value], strict=True):
        if name.strip():
            by_tag[name.strip()].append(cell)
    others = {c: found.cells[c] for c in found.header if c not in (tag, value, quality)}
    return replace(
        found,
        header=(*others, *by_tag),
        units=("",) * (len(others) + len(by_tag)),
        cells={**others, **by_tag},
        long=LongTable(tag, value, quality, good),
    )


def _head(path: str) -> bytes:
    """The first bytes, unpacked. Raises DataError for what cannot be read, and for formats that are no text."""
    name = "<stdin>" if path == "-" else path
    try:
        with open_bytes(path, name) as stream:
            raw = bytes(stream.read(LOOKED_AT))
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(f"{name}: {getattr(error, 'strerror', None) or error}") from error
    refuse_binary(raw[:HEAD_BYTES], name, detect_utf_16(raw[:HEAD_BYTES]) or "utf-8")
    return raw


def _decode(raw: bytes) -> tuple[str, str]:
    """The text and the encoding; what is no Unicode is taken for Western European Windows text."""
    unicode = detect_bom(raw) or detect_utf_16(raw[:HEAD_BYTES])
    if unicode:
        return raw.decode(unicode, errors="ignore"), unicode
    try:
        return codecs.getincrementaldecoder("utf-8-sig")().decode(raw), "utf-8"
    except UnicodeDecodeError:
        try:
            return raw.decode("cp1252"), "cp1252"
        except UnicodeDecodeError:
            return raw.decode("latin-1"), "latin-1"


def _table(lines: Sequence[str], path: str) -> tuple[str, int, int]:
    """Delimiter, index of the header (−1 where none names the columns) and width: the header is the first line that is
    as wide as most, before the first with numbers, and that is no row of units."""
    best: tuple[float, str, int, int] | None = None
    shown = [line for line in lines if line.strip() and not line.startswith("#")]
    for delimiter in (*DELIMITERS.values(), WHITESPACE):
        if delimiter == WHITESPACE and best is not None:
            break  # blanks also stand within cells
        widths = [len(row) for row in _split_rows(shown, delimiter)]
        common, count = Counter(widths[len(widths) // 3 :]).most_common(1)[0] if widths else (1, 0)
        if common < 2 or (delimiter == WHITESPACE and len(shown) < FEWEST_LINES):
            continue
        score = count / len(shown) * common
        rows = list(_split_rows(lines[:MOST_TITLE_LINES], delimiter))
        headers = [k for k, row in enumerate(rows) if is_header(row, common) and not is_unit_row(row, common)]
        bare = [k for k in headers if not lines[k].startswith("#")]
        if not headers and not all(is_numeric_row(row) for row in _split_rows(shown[:20], delimiter)):
            continue
        header = bare[0] if bare else headers[-1] if headers else -1
        if best is None or score > best[0]:
            best = (score, delimiter, header, common)
    if best is None:
        raise DataError(f"{path}: no table with a header was found (commas, semicolons, tabs, | and blanks were tried)")
    return best[1:]


def is_header(row: Sequence[str], width: int) -> bool:
    """Whether a row may name columns: most of its cells are words; one that is empty has no name."""
    named = [cell.strip() for cell in row]
    words = sum(bool(c) and not _NUMBER.fullmatch(c.replace(",", ".")) for c in named)
    return len(row) == width and words > width / 2 and sum(map(bool, named)) >= min(width - 1, 0.7 * width)


def is_numeric_row(row: Sequence[str]) -> bool:
    """Whether all cells are numbers: the row of a file without a header."""
    return len(row) > 1 and all(_NUMBER.fullmatch(c.strip()) or not c.strip() for c in row)


def is_unit_row(row: Sequence[str], width: int) -> bool:
    """Whether a row states the units of the columns."""
    cells = [cell.strip(" []()") for cell in row]
    filled = [cell for cell in cells if cell and cell != "-"]
    if len(row) != width or not filled or any(_NUMBER.fullmatch(c) for c in filled):
        return False
    return sum(parse_unit(c) is not None for c in filled) >= UNITS_OF_A_ROW * len(filled)


def _marks(rows: Sequence[Sequence[str]], delimiter: str) -> tuple[str, str]:
    """The decimal mark, and the name of the mark between groups of three digits, empty where there is none."""
    cells = [cell.strip() for row in rows for cell in row]
    grouped = [cell for cell in cells if _GROUPED.fullmatch(cell)]
    commas = sum(bool(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell)) for cell in cells)
    points = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", cell)) for cell in cells)
    surely = any("." in cell or cell.count(",") > 1 for cell in grouped)
    if grouped and (surely or (points and commas == len(grouped))):
        return ".", ","
    return ("," if delimiter != "," and commas > points else "."), ""


STAMP_CELLS = 300
"""Cells that must be stamps of a form, evenly chosen, before a column is taken for a clock."""


DATES = (
    "%Y-%m-%d",
    "%d.%m.%Y",
    "%d/%m/%Y",
    "%m/%d/%Y",
    "%Y/%m/%d",
    "%d-%b-%Y",
    "%d-%b-%y",
    "%d %b %Y",
    "%d/%m/%y",
    "%m/%d/%y",
    "%d.%m.%y",
    "%Y%m%d",
    "%d-%m-%Y",
    "%m-%d-%Y",
    "%b %d %Y",
)


TIMES = ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M", "%I:%M:%S %p", "%I:%M %p", "%H%M%S", "%H:%M:%S:%f")


DAY_FIRST = (("%d/%m/%Y", "%m/%d/%Y"), ("%d/%m/%y", "%m/%d/%y"), ("%d-%m-%Y", "%m-%d-%Y"))
"""Forms of a date that differ in the order of day and month alone."""


EARLIEST_S, LATEST_S = 3e8, 4e9
"""Seconds since 1970 that a clock may show: 1979 to 2096."""


SPREADSHEET_DAYS = (29_000.0, 75_000.0)
"""Days since 30 December 1899 that a clock may show: 1979 to 2105."""


@dataclass(frozen=True)
class ClockColumns:
    """sources: columns of the stamp; form: as in the recorder's `time:`; number: its unit, where it is a plain number
    that becomes the column time_s; doubt: what is to be decided; remark: what was guessed."""

    sources: tuple[str, ...]
    form: str = ""
    number: UnitWord | None = None
    doubt: str = ""
    remark: str = ""


def find_clock(sniffed: SniffedTable) -> ClockColumns | None:
    """The file's clock: date and time of day before a full stamp, UTC before local time, a stamp before a number."""
    text = [c for c in sniffed.header if sniffed.values(c) is None]
    dates = {c: f for c in text if (f := _forms(sniffed, (c,), DATES))}
    times = {c: f for c in text if c not in dates and (f := _forms(sniffed, (c,), TIMES))}
    packed = [c for c in sniffed.header if c not in text and _is_clock_name(c)]
    dates |= {c: f for c in packed if (f := _forms(sniffed, (c,), ("%Y%m%d",)))}
    if dates:
        times |= {c: f for c in packed if c not in dates and (f := _forms(sniffed, (c,), ("%H%M%S",)))}
    pairs = sorted(product(dates, times), key=lambda p: -_prefix_similarity(*p))
    for pair in pairs[:1]:
        forms = [f"{d} {t}" for d in dates[pair[0]] for t in times[pair[1]]]
        return _clock(sniffed, pair, forms)
    for c in sorted(text, key=lambda c: -_prefix_similarity(c)):
        if _is_iso(sniffed, c):
            return _clock(sniffed, (c,), ["iso"])
        forms = _forms(sniffed, (c,), [f"{d}{gap}{t}" for d in DATES for t in TIMES for gap in (" ", "T", ", ")])
        if forms:
            return _clock(sniffed, (c,), forms)
    number = _number(sniffed)
    if number is not None:
        return number
    if times:
        column = next(iter(times))
        return ClockColumns(
            (column,), "iso" if times[column][0] in ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M") else times[column][0]
        )
    if dates:
        column = next(iter(dates))
        return _clock(sniffed, (column,), dates[column])
    return None


def _is_clock_name(column: str) -> bool:
    return bool(parse_name(column).features & {"date", "time", "utc", "epoch", "elapsed", "local"})


def _prefix_similarity(*columns: str) -> int:
    """How much the names say that these columns are the clock, and the same one."""
    features = [parse_name(c).features for c in columns]
    together = set.intersection(*(set(f) for f in features))
    return (
        2 * sum(bool(f & {"date", "time", "epoch"}) for f in features)
        + 2 * any("utc" in f for f in features)
        + ("utc" in together)
        + ("local" in together)
    )


def _sample(sniffed: SniffedTable, columns: Sequence[str]) -> list[str]:
    cells = [" ".join(sniffed.cells[c][k].strip() for c in columns) for k in range(len(sniffed.cells[columns[0]]))]
    filled = [c for c in cells if c.strip() and not is_missing(c)]
    return [filled[k] for k in np.unique(np.linspace(0, len(filled) - 1, STAMP_CELLS).astype(int))] if filled else []


def _forms(sniffed: SniffedTable, columns: Sequence[str], forms: Sequence[str]) -> list[str]:
    """The forms in which all cells can be read."""
    sample = _sample(sniffed, columns)
    return [f for f in forms if sample and all(_read(cell, f) is not None for cell in sample)]


def _read(cell: str, form: str) -> datetime | None:
    try:
        stamp = datetime.strptime(cell, form)
    except ValueError:
        return None
    if "%Y" in form and not 1950 <= stamp.year <= 2100:
        return None
    if form in ("%Y%m%d", "%H%M%S") and len(cell) != (8 if form == "%Y%m%d" else 6):
        return None
    return stamp


def _is_iso(sniffed: SniffedTable, column: str) -> bool:
    sample = _sample(sniffed, (column,))
    stamp = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?\s*(Z|[+-]\d\d:?\d\d)?", re.I)
    return bool(sample) and all(stamp.fullmatch(cell) for cell in sample)


def _clock(sniffed: SniffedTable, columns: tuple[str, ...], forms: Sequence[str]) -> ClockColumns:
    """The form among those possible in which time runs forward, with what is doubtful of it."""
    sample = _sample(sniffed, columns)
    doubt = ""
    form = forms[0]
    for day_first, month_first in DAY_FIRST:
        both = [f for f in forms if f.startswith(day_first)][:1] + [f for f in forms if f.startswith(month_first)][:1]
        if len(both) == 2:
            steps = [_backward(sample, f) for f in both]
            form = both[int(np.argmin(steps))]
            if steps[0] == steps[1]:
                doubt = "day before month, or month before day: nothing in the file says which"
    features = frozenset[str]().union(*(parse_name(c).features for c in columns))
    remark = "local time" if "local" in features else "UTC" if "utc" in features else ""
    return ClockColumns(columns, form, None, doubt, remark)


def _backward(sample: Sequence[str], form: str) -> int:
    stamps = [_read(cell, form) for cell in sample]
    return sum(a is not None and b is not None and b < a for a, b in pairwise(stamps))


def _number(sniffed: SniffedTable) -> ClockColumns | None:
    """A column of numbers that is a clock: seconds since 1970, days of a spreadsheet, seconds of the day, or
    elapsed."""
    for c in sniffed.header:
        name = parse_name(c)
        values = sniffed.values(c)
        if values is None:
            continue
        bare = (split_unit(c) or (c,))[0].strip().casefold()
        only = name.features <= {"date", "time", "utc", "epoch", "elapsed", "local", "engine", "no", "flight"}
        if not (name.features & {"date", "time", "epoch", "elapsed"} and only) and bare not in ("t", "sec"):
            continue
        known = values[np.isfinite(values)]
        middle = float(np.median(known))
        step = np.diff(known)
        if np.all((EARLIEST_S < known) & (known < LATEST_S)):
            return ClockColumns((c,), "epoch_s")
        if np.all((1e3 * EARLIEST_S < known) & (known < 1e3 * LATEST_S)):
            return ClockColumns((c,), "epoch_ms")
        if SPREADSHEET_DAYS[0] < middle < SPREADSHEET_DAYS[1] and np.any(known % 1.0 > 0.0) and "date" in name.features:
            return ClockColumns((c,), "excel_days")
        if known.max() < DAY_S and np.any(step < -0.9 * DAY_S):
            return ClockColumns((c,), "seconds_of_day")
        row = sniffed.units[sniffed.header.index(c)]
        unit = name.unit or parse_unit(row)
        stated = unit is not None and unit.dimension == "time"
        restarts = not stated and bool(np.any(step < 0.0)) and bool(np.all((step == 1.0) | (step < 0.0)))
        return ClockColumns(
            (c,),
            number=unit if stated else UnitWord("s"),
            doubt="a count that begins again: of seconds, or of cycles or flights?" if restarts else "",
            remark="" if stated or ("elapsed" in name.features and "sec" in c.casefold()) else "in seconds",
        )
    return None
