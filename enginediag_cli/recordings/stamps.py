"""Time stamps to seconds: ISO 8601, a stated format, or numbers; with time zones, and clocks that pass midnight.

Which columns of a foreign file are its clock, and how their stamps are written.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta, timezone, tzinfo
from itertools import pairwise, product
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

import numpy as np

from enginediag_cli.config.hints import closest
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.table_file import NumberForm, is_missing, no_number
from enginediag_cli.recordings.quantities import read_name
from enginediag_cli.recordings.sniff import Sniffed
from enginediag_cli.recordings.source import Dialect
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.unit_words import UnitWord, trailing_unit, unit_word

FRACTION = re.compile(r"(.*?)[.,](\d+)(.*)")
"""A stamp with a fraction of a second: what stands before it, its digits, what stands behind."""

HOUR = re.compile(r"(^|[ T])(\d):")
"""An hour of one digit, as spreadsheets write it."""

NUMBERS = ("seconds", "seconds_of_day", "epoch_s", "epoch_ms", "excel_days")
"""Forms of stamps that are numbers: seconds from anywhere, seconds since midnight, seconds and milliseconds since 1970
in UTC, and days since 30 December 1899, which is how spreadsheets keep local time."""

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
"""Where the seconds of a time stamp begin, as in POSIX."""
SPREADSHEET_EPOCH = datetime(1899, 12, 30)
"""Day 0 of spreadsheets, so that 1 March 1900 is day 61 as in the first of them."""
DAY_S = 86400.0
"""A day of a clock, in s."""
PAST_MIDNIGHT_S = 0.5 * DAY_S
"""A clock of a day that goes back by more than this has passed midnight, unless the recording has a gap of as much."""


@dataclass
class Stamps:
    """Seconds of the stamps in the columns `sources` (date and time of day may be two: joined by a space).

    form: "iso", a format of strptime, or one of NUMBERS; zone: of stamps that do not say, as in `zone_of`; since:
    "first_record" of the file (0 there: small numbers keep all digits), or "epoch", 1970-01-01 UTC. A clock that shows
    no date, or has it in a column of its own in which it stays, is taken a day on where it goes back by more than half
    a day. numbers: how stamps that are numbers are written.
    """

    sources: Sequence[str]
    form: str = "iso"
    zone: str = ""
    since: str = "first_record"
    numbers: NumberForm = field(default_factory=NumberForm)
    _start: float | None = None
    _latest: float = -np.inf  # the last stamp as it was handed out, in s, but for `since`
    _shown: float = np.nan  # the last one as the clock showed it
    _date: date | None = None
    _days: int = 0

    def __post_init__(self) -> None:
        self._tz = zone_of(self.zone)

    def seconds(self, recording: Recording) -> np.ndarray:
        """(N,) s, NaN where a cell is empty. Raises DataError naming the line of a stamp that cannot be read, or that
        the stated zone has twice or not at all."""
        values = self._numbers(recording) if self.form in NUMBERS else self._texts(recording)
        if self.since == "epoch":
            return values
        known = np.flatnonzero(np.isfinite(values))
        if self._start is None and known.size:
            self._start = float(values[known[0]])
        return values - (self._start or 0.0)

    def _place(self, recording: Recording, k: int) -> str:
        return f"{recording.source}:{recording.line[k]}:{'+'.join(self.sources)}"

    def _texts(self, recording: Recording) -> np.ndarray:
        parts = [cells_of(recording, column) for column in self.sources]
        values = np.full(len(recording), np.nan)
        for k, cells in enumerate(zip(*parts, strict=True)):
            text = " ".join(cell.strip() for cell in cells)
            if is_missing(text) or all(map(is_missing, cells)):
                continue
            try:
                stamp, dated = self._read(text)
            except ValueError:
                wanted = "an ISO 8601 time stamp" if self.form == "iso" else f"a time stamp of the form {self.form}"
                raise DataError(f"{self._place(recording, k)}: not {wanted}: {text!r}") from None
            if stamp.tzinfo is not None:
                values[k] = self._latest = (stamp - EPOCH).total_seconds()
                continue
            shown = (stamp - EPOCH.replace(tzinfo=None)).total_seconds()
            if not dated or len(cells) > 1:
                stamp += timedelta(days=self._days_past(shown, stamp.date() if dated else None))
            values[k] = self._latest = self._absolute(stamp, recording, k)
        return values

    def _read(self, text: str) -> tuple[datetime, bool]:
        """The stamp, and whether it has a date. Raises ValueError."""
        if self.form == "iso":
            if len(self.sources) == 1 and ":" in text[:3]:
                return datetime.combine(EPOCH.date(), time.fromisoformat(_padded(text))), False
            return _iso(text), True
        dated = any(mark in self.form for mark in ("%d", "%j", "%x", "%c", "%U", "%W", "%s"))
        stamp = datetime.strptime(text, self.form)
        return (stamp if dated else datetime.combine(EPOCH.date(), stamp.timetz())), dated

    def _days_past(self, shown: float, day: date | None) -> int:
        """Days by which a clock is behind that shows so many seconds, and this date: it has passed midnight where it
        goes back by more than half a day and the date stays."""
        if day != self._date:
            self._date, self._days = day, 0
        elif shown - self._shown < -PAST_MIDNIGHT_S:
            self._days += 1
        self._shown = shown
        return self._days

    def _absolute(self, stamp: datetime, recording: Recording, k: int) -> float:
        """s since 1970 of a stamp of the stated zone. An hour that a clock shows twice is the second one where time
        would go back otherwise."""
        first = (stamp.replace(tzinfo=self._tz) - EPOCH).total_seconds()
        if isinstance(self._tz, timezone):
            return first
        second = (stamp.replace(tzinfo=self._tz, fold=1) - EPOCH).total_seconds()
        if first == second:
            return first
        if second < first:  # as summer time begins the clock leaves out an hour
            raise DataError(f"{self._place(recording, k)}: {stamp} does not exist in {self.zone}; is it another zone?")
        if self._latest == -np.inf:
            what = f"{stamp} comes twice in {self.zone}, and no record before says which it is"
            raise DataError(f"{self._place(recording, k)}: {what}; state the zone as an offset, such as +01:00")
        return second if first < self._latest else first

    def _numbers(self, recording: Recording) -> np.ndarray:
        (column,) = self.sources
        if column in recording.columns:
            read = recording[column]
        else:
            cells = recording.text[column]
            read, bad, _ = self.numbers.values(cells)
            if bad:
                raise no_number(cells[bad[0]], self._place(recording, bad[0]))
        if self.form == "excel_days":
            return self._from_spreadsheet(read, recording)
        if self.form != "seconds_of_day":
            return read * {"seconds": 1.0, "epoch_s": 1.0, "epoch_ms": 1e-3}[self.form]
        known = np.flatnonzero(np.isfinite(read))
        steps = np.diff(read[known], prepend=self._shown)
        days = self._days + np.cumsum(steps < -PAST_MIDNIGHT_S)
        values = np.full(len(read), np.nan)
        values[known] = read[known] + DAY_S * days
        if known.size:
            self._shown, self._days = float(read[known[-1]]), int(days[-1])
        return values

    def _from_spreadsheet(self, days: np.ndarray, recording: Recording) -> np.ndarray:
        values = np.full(len(days), np.nan)
        for k in np.flatnonzero(np.isfinite(days)):
            try:
                # a day has few binary digits left behind the point: to the millisecond, as spreadsheets show
                stamp = SPREADSHEET_EPOCH + timedelta(milliseconds=round(days[k] * DAY_S * 1e3))
            except OverflowError:
                raise DataError(f"{self._place(recording, int(k))}: {days[k]:g} is no day of a spreadsheet") from None
            values[k] = self._latest = self._absolute(stamp, recording, int(k))
        return values


def stamps_of(time: Mapping[str, Any], dialect: Dialect) -> Stamps:
    """The stamps that a section `time` of a recorder declares, in a file that is written so."""
    return Stamps(time["from"], time["format"], time["zone"], time["since"], NumberForm.from_dialect(dialect))


def check_forward(recording: Recording) -> None:
    """Raises DataError with both lines where time_s goes backwards within a flight and engine."""
    time = recording["time_s"]
    known = np.flatnonzero(np.isfinite(time))
    for k in np.flatnonzero(np.diff(time[known]) < 0.0):
        before, after = int(known[k]), int(known[k + 1])
        keys = [recording.text[c] for c in ("flight", "engine") if c in recording.text]
        if all(cells[before] == cells[after] for cells in keys):
            raise DataError(
                f"{recording.source}:{recording.line[after]}: time goes back by {time[before] - time[after]:g} s "
                f"(line {recording.line[before]} is later); sort the file, or map a column to the text column `flight`"
            )


def zone_of(zone: str) -> tzinfo:
    """The time zone of `+02:00`, `-05:30`, `UTC`, "" or an IANA name such as `Europe/Berlin`. Raises ValueError, which
    says what would be one."""
    if zone in ("", "UTC", "Z"):
        return timezone.utc
    hint = "such as +02:00, UTC or Europe/Berlin"
    if zone[0] in "+-":
        hours, _, minutes = zone[1:].partition(":")
        if not (hours.isdecimal() and (minutes or "0").isdecimal() and int(hours) < 24 and int(minutes or 0) < 60):
            raise ValueError(hint)
        east = timedelta(hours=int(hours), minutes=int(minutes or 0))
        return timezone(east if zone[0] == "+" else -east)
    try:
        return ZoneInfo(zone)
    except (ZoneInfoNotFoundError, OSError, ValueError):
        pass
    known = available_timezones()
    if not known:
        raise ValueError("this machine has no list of time zones: pip install tzdata, or state an offset, +02:00")
    close = closest(zone, sorted(known))
    raise ValueError(f"did you mean {close!r}?" if close else hint)


def cells_of(recording: Recording, column: str) -> Sequence[str]:
    """A column's cells as text."""
    if column in recording.text:
        return recording.text[column]
    return ["" if np.isnan(value) else f"{value:.10g}" for value in recording[column]]


def _iso(text: str) -> datetime:
    """ISO 8601 extended format; Python 3.10 knows neither Z nor a fraction of other than 3 or 6 digits."""
    bare = text[:-1] + "+00:00" if text.endswith(("Z", "z")) else text
    try:
        return datetime.fromisoformat(bare)
    except ValueError:
        return datetime.fromisoformat(_padded(bare))


def _padded(text: str) -> str:
    """The stamp with two digits of the hour and six behind the point. Raises ValueError where none are there."""
    text = HOUR.sub(r"\g<1>0\g<2>:", text)
    match = FRACTION.fullmatch(text)
    if match is None:
        if "." in text or "," in text:
            raise ValueError(text)
        return text
    head, digits, rest = match.groups()
    return f"{head}.{digits[:6]:0<6}{rest}"


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
