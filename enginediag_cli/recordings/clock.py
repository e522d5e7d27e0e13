"""Which columns of a foreign file are its clock, and how their stamps are written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise, product

import numpy as np

from enginediag_cli.recordings.formats.cells import is_missing
from enginediag_cli.recordings.quantities import read_name
from enginediag_cli.recordings.sniff import Sniffed
from enginediag_cli.recordings.unit_words import UnitWord, trailing_unit, unit_word

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
DAY_S = 86400.0
"""Seconds of a day."""
SPREADSHEET_DAYS = (29_000.0, 75_000.0)
"""Days since 30 December 1899 that a clock may show: 1979 to 2105."""


@dataclass(frozen=True)
class Clock:
    """sources: columns of the stamp; form: as in the recorder's `time:`; number: its unit, where it is a plain number
    that becomes the column time_s; doubt: what is to be decided; remark: what was guessed."""

    sources: tuple[str, ...]
    form: str = ""
    number: UnitWord | None = None
    doubt: str = ""
    remark: str = ""


def find_clock(sniffed: Sniffed) -> Clock | None:
    """The file's clock: date and time of day before a full stamp, UTC before local time, a stamp before a number."""
    text = [c for c in sniffed.header if sniffed.values(c) is None]
    dates = {c: f for c in text if (f := _forms(sniffed, (c,), DATES))}
    times = {c: f for c in text if c not in dates and (f := _forms(sniffed, (c,), TIMES))}
    packed = [c for c in sniffed.header if c not in text and _is_clock_name(c)]
    dates |= {c: f for c in packed if (f := _forms(sniffed, (c,), ("%Y%m%d",)))}
    if dates:
        times |= {c: f for c in packed if c not in dates and (f := _forms(sniffed, (c,), ("%H%M%S",)))}
    pairs = sorted(product(dates, times), key=lambda p: -_affinity(*p))
    for pair in pairs[:1]:
        forms = [f"{d} {t}" for d in dates[pair[0]] for t in times[pair[1]]]
        return _clock(sniffed, pair, forms)
    for c in sorted(text, key=lambda c: -_affinity(c)):
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
        return Clock((column,), "iso" if times[column][0] in ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M") else times[column][0])
    if dates:
        column = next(iter(dates))
        return _clock(sniffed, (column,), dates[column])
    return None


def _is_clock_name(column: str) -> bool:
    return bool(read_name(column).features & {"date", "time", "utc", "epoch", "elapsed", "local"})


def _affinity(*columns: str) -> int:
    """How much the names say that these columns are the clock, and the same one."""
    features = [read_name(c).features for c in columns]
    together = set.intersection(*(set(f) for f in features))
    return (
        2 * sum(bool(f & {"date", "time", "epoch"}) for f in features)
        + 2 * any("utc" in f for f in features)
        + ("utc" in together)
        + ("local" in together)
    )


def _sample(sniffed: Sniffed, columns: Sequence[str]) -> list[str]:
    cells = [" ".join(sniffed.cells[c][k].strip() for c in columns) for k in range(len(sniffed.cells[columns[0]]))]
    filled = [c for c in cells if c.strip() and not is_missing(c)]
    return [filled[k] for k in np.unique(np.linspace(0, len(filled) - 1, STAMP_CELLS).astype(int))] if filled else []


def _forms(sniffed: Sniffed, columns: Sequence[str], forms: Sequence[str]) -> list[str]:
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


def _is_iso(sniffed: Sniffed, column: str) -> bool:
    sample = _sample(sniffed, (column,))
    stamp = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?\s*(Z|[+-]\d\d:?\d\d)?", re.I)
    return bool(sample) and all(stamp.fullmatch(cell) for cell in sample)


def _clock(sniffed: Sniffed, columns: tuple[str, ...], forms: Sequence[str]) -> Clock:
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
    features = frozenset[str]().union(*(read_name(c).features for c in columns))
    remark = "local time" if "local" in features else "UTC" if "utc" in features else ""
    return Clock(columns, form, None, doubt, remark)


def _backward(sample: Sequence[str], form: str) -> int:
    stamps = [_read(cell, form) for cell in sample]
    return sum(a is not None and b is not None and b < a for a, b in pairwise(stamps))


def _number(sniffed: Sniffed) -> Clock | None:
    """A column of numbers that is a clock: seconds since 1970, days of a spreadsheet, seconds of the day, or
    elapsed."""
    for c in sniffed.header:
        name = read_name(c)
        values = sniffed.values(c)
        if values is None:
            continue
        bare = (trailing_unit(c) or (c,))[0].strip().casefold()
        only = name.features <= {"date", "time", "utc", "epoch", "elapsed", "local", "engine", "no", "flight"}
        if not (name.features & {"date", "time", "epoch", "elapsed"} and only) and bare not in ("t", "sec"):
            continue
        known = values[np.isfinite(values)]
        middle = float(np.median(known))
        step = np.diff(known)
        if np.all((EARLIEST_S < known) & (known < LATEST_S)):
            return Clock((c,), "epoch_s")
        if np.all((1e3 * EARLIEST_S < known) & (known < 1e3 * LATEST_S)):
            return Clock((c,), "epoch_ms")
        if SPREADSHEET_DAYS[0] < middle < SPREADSHEET_DAYS[1] and np.any(known % 1.0 > 0.0) and "date" in name.features:
            return Clock((c,), "excel_days")
        if known.max() < DAY_S and np.any(step < -0.9 * DAY_S):
            return Clock((c,), "seconds_of_day")
        row = sniffed.units[sniffed.header.index(c)]
        unit = name.unit or unit_word(row)
        stated = unit is not None and unit.dimension == "time"
        restarts = not stated and bool(np.any(step < 0.0)) and bool(np.all((step == 1.0) | (step < 0.0)))
        return Clock(
            (c,),
            number=unit if stated else UnitWord("s"),
            doubt="a count that begins again: of seconds, or of cycles or flights?" if restarts else "",
            remark="" if stated or ("elapsed" in name.features and "sec" in c.casefold()) else "in seconds",
        )
    return None
