"""Time stamps to seconds: ISO 8601, a stated format, or numbers; with time zones, and clocks that pass midnight.

**Joined series.** Readings with clocks of their own are put into records: exports of one reading a line, and files of
other rates. A record at time t takes the last reading of a series that is not older than stated; or each reading goes
to the record nearest to it, and to no other, so that it counts once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta, timezone, tzinfo
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

import numpy as np

from enginediag_cli.config.fields import closest
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import (
    NATIVE_DIALECT,
    Dialect,
    Recording,
    concat,
    is_missing,
    number_error,
    rechunk,
)
from enginediag_cli.units import DAY_S

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
PAST_MIDNIGHT_S = 0.5 * DAY_S
"""A clock of a day that goes back by more than this has passed midnight, unless the recording has a gap of as much."""


@dataclass
class TimeStamps:
    """Seconds of the stamps in the columns `sources` (date and time of day may be two: joined by a space).

    form: "iso", a format of strptime, or one of NUMBERS; zone: of stamps that do not say, as in `zone_of`; since:
    "first_record" of the file (0 there: small numbers keep all digits), or "epoch", 1970-01-01 UTC. A clock that shows
    no date, or has it in a column of its own in which it stays, is taken a day on where it goes back by more than half
    a day. dialect: how stamps that are numbers are written.
    """

    sources: Sequence[str]
    form: str = "iso"
    zone: str = ""
    since: str = "first_record"
    dialect: Dialect = NATIVE_DIALECT
    _start: float | None = None
    _latest: float = -np.inf  # the last stamp as it was handed out, in s, but for `since`
    _shown: float = np.nan  # the last one as the clock showed it
    _date: date | None = None
    _days: int = 0

    def __post_init__(self) -> None:
        self._tz = parse_zone(self.zone)

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
        parts = [text_cells(recording, column) for column in self.sources]
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
            read, bad, _ = self.dialect.numbers(cells)
            if bad:
                raise number_error(cells[bad[0]], self._place(recording, bad[0]))
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


def make_stamps(time: Mapping[str, Any], dialect: Dialect) -> TimeStamps:
    """The stamps that a section `time` of a recorder declares, in a file that is written so."""
    return TimeStamps(time["from"], time["format"], time["zone"], time["since"], dialect)


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


def parse_zone(zone: str) -> tzinfo:
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


def text_cells(recording: Recording, column: str) -> Sequence[str]:
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


BLOCK = 4096
"""Readings of a series that are in memory at once, 100 kB: a plant's export may have hundreds of tags."""

SHOWN_TAGS = 20
"""Tags of an export that are listed where one is missing."""

RecordTimes = Callable[[Recording], np.ndarray]
"""Times (N,) of records in s, on the clock that all files of a recorder share."""


def last_values(times: np.ndarray, values: np.ndarray, at: np.ndarray, max_age_s: float) -> np.ndarray:
    """(N,) the last of the values (M,) read at `times` (M,), ascending, up to each of the times `at` (N,); NaN where
    there is none so young."""
    if not times.size:
        return np.full(len(at), np.nan)
    last = np.searchsorted(times, at, side="right") - 1
    age = at - times[np.maximum(last, 0)]
    with np.errstate(invalid="ignore"):
        return np.where((last >= 0) & (age <= max_age_s), values[np.maximum(last, 0)], np.nan)


def nearest_records(times: np.ndarray, at: np.ndarray, max_age_s: float) -> tuple[np.ndarray, np.ndarray]:
    """For readings at `times` (M,) the records of the times `at` (N,), both ascending, that each is nearest to: indices
    of readings and of their records, without readings that have no record within `max_age_s`; of several readings for
    one record the nearest is last."""
    if not times.size or not at.size:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    after = np.clip(np.searchsorted(at, times), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    record = np.where(np.abs(at[before] - times) <= np.abs(at[after] - times), before, after)
    distance = np.abs(at[record] - times)
    rows = np.flatnonzero(distance <= max_age_s)
    rows = rows[np.argsort(-distance[rows], kind="stable")]
    return rows, record[rows]


@dataclass
class JoinedFile:
    """A further file. name: of the join, by which its columns are called `name.column`; chunks: its records; clock:
    their times; nearest: each reading to the nearest record, else the last one held; max_age_s: how far a reading may
    be from a record; joined: readings that records have taken."""

    name: str
    path: str
    columns: Sequence[str]
    chunks: Iterator[Recording]
    clock: RecordTimes
    nearest: bool
    max_age_s: float
    matches: int = 0
    _ended: bool = False
    _times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _values: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._values = np.zeros((len(self.columns), 0))

    def values(self, at: np.ndarray, final: int) -> np.ndarray:
        """(columns, final) for the first `final` of the records at times (N,), ascending, NaN where one has none; the
        others come again."""
        known = np.flatnonzero(np.isfinite(at))
        times = at[known]
        found = np.full((len(self.columns), len(at)), np.nan)
        if not times.size:
            return found[:, :final]
        self._pull(float(times[-1]))
        done = times[known < final]
        keep = np.ones(len(self._times), bool)
        if self.nearest:
            readings, records = nearest_records(self._times, times, self.max_age_s)
            found[:, known[records]] = self._values[:, readings]
            keep[readings[records < len(done)]] = False
            keep &= self._times > (done[-1] if done.size else -np.inf)
        else:
            for j, values in enumerate(self._values):
                found[j, known] = last_values(self._times, values, times, self.max_age_s)
            if done.size:
                keep[: max(int(np.searchsorted(self._times, done[-1], side="right")) - 1, 0)] = False
        self._times, self._values = self._times[keep], self._values[:, keep]
        self.matches += int(np.isfinite(found[:, :final]).sum())
        return found[:, :final]

    def _pull(self, until: float) -> None:
        """Read on until a reading is later than this."""
        while not self._ended and not (self._times.size and self._times[-1] > until):
            chunk = next(self.chunks, None)
            if chunk is None:
                self._ended = True
                return
            times = self.clock(chunk)
            refuse_backward(chunk, times, float(self._times[-1]) if self._times.size else -np.inf)
            known = np.isfinite(times)
            read = np.array([chunk[c] for c in self.columns]).reshape(len(self.columns), len(chunk))
            self._times = np.concatenate([self._times, times[known]])
            self._values = np.concatenate([self._values, read[:, known]], axis=1)


def refuse_backward(recording: Recording, times: np.ndarray, before: float) -> None:
    """Raises DataError with the line at which times (N,) go back, `before` being the time before them."""
    known = np.flatnonzero(np.isfinite(times))
    back = np.flatnonzero(np.diff(times[known], prepend=before) < 0.0)
    if back.size:
        k = int(known[back[0]])
        raise DataError(
            f"{recording.source}:{recording.line[k]}: time goes back, and files are joined along it; sort it"
        )


def join_files(chunks: Iterable[Recording], clock: RecordTimes, files: Sequence[JoinedFile]) -> Iterator[Recording]:
    """Chunks of records with the columns of further files. Raises DataError where times go back, and for a file that
    has no reading near any record. One record waits for the next, to which a reading may be nearer."""
    held: Recording | None = None
    at = np.zeros(0)
    for chunk in chunks:
        times = clock(chunk)
        known = at[np.isfinite(at)]
        refuse_backward(chunk, times, float(known[-1]) if known.size else -np.inf)
        held, at = (chunk, times) if held is None else (concat([held, chunk]), np.concatenate([at, times]))
        final = len(held) - 1
        if final > 0:
            yield _add_joined_columns(held, at, final, files)
            held, at = held.select(slice(final, None)), at[final:]
    if held is None:
        return
    yield _add_joined_columns(held, at, len(held), files)
    for file in files:
        if file.columns and not file.matches:
            what = f"no reading within {file.max_age_s:g} s of a record of {held.source}"
            raise DataError(f"{file.path}: {what}: are both on one clock, in one time zone?")


def _add_joined_columns(recording: Recording, at: np.ndarray, final: int, files: Sequence[JoinedFile]) -> Recording:
    columns: dict[str, np.ndarray] = {}
    for file in files:
        found = file.values(at, final)
        columns |= {f"{file.name}.{column}": found[j] for j, column in enumerate(file.columns)}
    return recording.select(slice(0, final)).with_columns(columns)


@dataclass(frozen=True)
class LongFormat:
    """An export of one reading a line. tag, value, quality: its columns, quality "" where it has none; good: words of a
    quality whose value is used; clock: the tag at whose times there are records, "" for the times of all; max_age_s:
    how long a value is held."""

    tag: str
    value: str
    quality: str = ""
    good: tuple[str, ...] = ()
    clock: str = ""
    max_age_s: float = 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(c for c in (self.tag, self.value, self.quality) if c)


class _Series:
    """Times, values and codes of texts of one tag, on disk until they are merged. A text is a number: where it stands
    in `words`."""

    def __init__(self, stamps: TimeStamps):
        self.stamps, self.size, self.latest = stamps, 0, -np.inf
        self.words: dict[str, int] = {}
        from tempfile import TemporaryFile

        self._file: Any = TemporaryFile()  # closed when nothing refers to it any more
        self._buffer = np.zeros((0, 2))
        self._read = 0

    def append(self, times: np.ndarray, values: np.ndarray) -> None:
        self._file.write(np.column_stack([times, values]).tobytes())
        self.size += len(times)

    def rewind(self) -> None:
        self._file.seek(0)

    def fill(self) -> None:
        """Have a block in memory behind what is still held."""
        if self._read < self.size:
            raw = np.frombuffer(self._file.read(16 * BLOCK)).reshape(-1, 2)
            self._read += len(raw)
            self._buffer = np.concatenate([self._buffer, raw])

    @property
    def horizon(self) -> float:
        """The time up to which all readings are in memory."""
        return np.inf if self._read >= self.size else float(self._buffer[-1, 0])

    @property
    def times(self) -> np.ndarray:
        return self._buffer[:, 0]

    def values(self, at: np.ndarray, max_age_s: float) -> np.ndarray:
        """(N,) as `latest`."""
        return last_values(self.times, self._buffer[:, 1], at, max_age_s)

    def forget(self, before: float) -> None:
        """Keep what a time from this one on may take."""
        self._buffer = self._buffer[max(int(np.searchsorted(self.times, before, side="right")) - 1, 0) :]


def pivot_long(
    chunks: Iterable[Recording],
    form: LongFormat,
    stamps: Callable[[], TimeStamps],
    dialect: Dialect,
    tags: Collection[str],
    texts: Collection[str],
    chunk_records: int,
) -> Iterator[Recording]:
    """Records of the `tags`, and of those of `texts` as texts, from an export of one reading a line, in any order of
    tags; a tag's own readings must be in order of time. The column of the time holds seconds, as `stamps` give them.
    Raises DataError, also for a tag that has no reading."""
    series = {tag: _Series(stamps()) for tag in (*tags, *texts, *([form.clock] if form.clock else []))}
    source, seen = "", dict[str, None]()
    provenance: tuple[str, ...] = ()
    for chunk in chunks:
        source, provenance = chunk.source, chunk.provenance
        names = np.array(chunk.text[form.tag], dtype=object)
        for tag in dict.fromkeys(names.tolist()):
            if tag in series:
                _take(chunk.select(np.flatnonzero(names == tag)), form, series[tag], dialect, text=tag in texts)
            elif len(seen) < SHOWN_TAGS:
                seen[tag] = None
    absent = [tag for tag, one in series.items() if not one.size]
    if absent:
        others = f"; others are {', '.join(seen)}" if seen else ""
        raise DataError(f"{source}: no reading of the tag{'s' * (len(absent) > 1)} {', '.join(absent)}{others}")
    (time,) = next(iter(series.values())).stamps.sources[:1]
    yield from rechunk(_merged(series, form, time, texts, f"{source} (by time)", provenance), chunk_records)


def _take(rows: Recording, form: LongFormat, series: _Series, dialect: Dialect, *, text: bool) -> None:
    times = series.stamps.seconds(rows)
    refuse_backward(rows, times, series.latest)
    cells = rows.text[form.value]
    if text:
        values = np.array([series.words.setdefault(cell.strip(), len(series.words)) for cell in cells], dtype=float)
    else:
        values, bad, _ = dialect.numbers(cells)
        if bad:
            raise number_error(cells[bad[0]], f"{rows.source}:{rows.line[bad[0]]}:{form.value}")
    if form.quality:
        good = {word.strip().lower() for word in form.good}
        usable = np.array([cell.strip().lower() in good for cell in rows.text[form.quality]], bool)
        values = np.where(usable, values, np.nan)
    known = np.isfinite(times)
    series.append(times[known], values[known])
    if known.any():
        series.latest = float(times[known][-1])


def _merged(
    series: Mapping[str, _Series],
    form: LongFormat,
    time: str,
    texts: Collection[str],
    source: str,
    provenance: tuple[str, ...],
) -> Iterator[Recording]:
    """The records, as far as all series are in memory, and on."""
    for one in series.values():
        one.rewind()
    done, records, horizon = -np.inf, 0, -np.inf
    while horizon < np.inf:
        for one in series.values():
            if not one.times.size or one.horizon <= horizon:
                one.fill()
        horizon = min(one.horizon for one in series.values())
        clocks = [series[form.clock]] if form.clock else list(series.values())
        at = np.unique(np.concatenate([one.times for one in clocks]))
        # more readings at the horizon's own time may follow, so that it waits
        at = at[(at > done) & ((at < horizon) | (horizon == np.inf))]
        columns, text = {time: at}, {}
        for tag, one in series.items():
            values = one.values(at, form.max_age_s)
            if tag in texts:
                words = list(one.words)
                text[tag] = ["" if np.isnan(v) else words[int(v)] for v in values]
            else:
                columns[tag] = values
            one.forget(horizon)
        if not at.size:
            continue
        done = float(at[-1])
        line = records + 1 + np.arange(len(at))
        records += len(at)
        yield Recording(columns, text, (time, *columns.keys() - {time}, *text), line, source, provenance)


def find_joined_path(source: object, recording: str, cut: str) -> Path:
    """The file of a join beside a recording: `{name}` stands for its name without endings, and without `cut` at its
    end. Raises DataError where a recording has no name, or not that end."""
    if not isinstance(source, (str, Path)) or str(source) == "-":
        raise DataError(
            "a recorder that joins files needs a recording with a name, not standard input or a growing file"
        )
    path = Path(source)
    name = path.name.removesuffix(".gz")
    name = name[: -len(Path(name).suffix)] if Path(name).suffix else name
    if cut and not name.endswith(cut):
        raise DataError(f"{path}: its name does not end in {cut!r}, by which the recorder finds the file to join")
    return path.with_name(recording.replace("{name}", name.removesuffix(cut) if cut else name))
