"""Readings with clocks of their own, put into records: exports of one reading a line, and files of other rates.

A series is times and values in order. A record at time t takes the last reading of a series that is not older than
stated; or each reading goes to the record nearest to it, and to no other, so that it counts once.

Columns at a lower rate than the file's: empty cells between readings, held or interpolated for a stated while.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.table_file import NumberForm, no_number
from enginediag_cli.recordings.stamps import Stamps
from enginediag_cli.recordings.table import Recording, concat, rechunk

BLOCK = 4096
"""Readings of a series that are in memory at once, 100 kB: a plant's export may have hundreds of tags."""

SHOWN_TAGS = 20
"""Tags of an export that are listed where one is missing."""

Clock = Callable[[Recording], np.ndarray]
"""Times (N,) of records in s, on the clock that all files of a recorder share."""


def latest(times: np.ndarray, values: np.ndarray, at: np.ndarray, max_age_s: float) -> np.ndarray:
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
    of readings and of their records, a reading without a record within `max_age_s` left out; of several readings for
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
    clock: Clock
    nearest: bool
    max_age_s: float
    joined: int = 0
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
                found[j, known] = latest(self._times, values, times, self.max_age_s)
            if done.size:
                keep[: max(int(np.searchsorted(self._times, done[-1], side="right")) - 1, 0)] = False
        self._times, self._values = self._times[keep], self._values[:, keep]
        self.joined += int(np.isfinite(found[:, :final]).sum())
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


def join(chunks: Iterable[Recording], clock: Clock, files: Sequence[JoinedFile]) -> Iterator[Recording]:
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
            yield _with_columns(held, at, final, files)
            held, at = held.select(slice(final, None)), at[final:]
    if held is None:
        return
    yield _with_columns(held, at, len(held), files)
    for file in files:
        if file.columns and not file.joined:
            what = f"no reading within {file.max_age_s:g} s of a record of {held.source}"
            raise DataError(f"{file.path}: {what}: are both on one clock, in one time zone?")


def _with_columns(recording: Recording, at: np.ndarray, final: int, files: Sequence[JoinedFile]) -> Recording:
    columns: dict[str, np.ndarray] = {}
    for file in files:
        found = file.values(at, final)
        columns |= {f"{file.name}.{column}": found[j] for j, column in enumerate(file.columns)}
    return recording.select(slice(0, final)).with_columns(columns)


@dataclass(frozen=True)
class LongForm:
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

    def __init__(self, stamps: Stamps):
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
        return latest(self.times, self._buffer[:, 1], at, max_age_s)

    def forget(self, before: float) -> None:
        """Keep what a time from this one on may take."""
        self._buffer = self._buffer[max(int(np.searchsorted(self.times, before, side="right")) - 1, 0) :]


def pivot(
    chunks: Iterable[Recording],
    form: LongForm,
    stamps: Callable[[], Stamps],
    numbers: NumberForm,
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
                _take(chunk.select(np.flatnonzero(names == tag)), form, series[tag], numbers, text=tag in texts)
            elif len(seen) < SHOWN_TAGS:
                seen[tag] = None
    absent = [tag for tag, one in series.items() if not one.size]
    if absent:
        others = f"; others are {', '.join(seen)}" if seen else ""
        raise DataError(f"{source}: no reading of the tag{'s' * (len(absent) > 1)} {', '.join(absent)}{others}")
    (time,) = next(iter(series.values())).stamps.sources[:1]
    yield from rechunk(_merged(series, form, time, texts, f"{source} (by time)", provenance), chunk_records)


def _take(rows: Recording, form: LongForm, series: _Series, numbers: NumberForm, *, text: bool) -> None:
    times = series.stamps.seconds(rows)
    refuse_backward(rows, times, series.latest)
    cells = rows.text[form.value]
    if text:
        values = np.array([series.words.setdefault(cell.strip(), len(series.words)) for cell in cells], dtype=float)
    else:
        values, bad, _ = numbers.values(cells)
        if bad:
            raise no_number(cells[bad[0]], f"{rows.source}:{rows.line[bad[0]]}:{form.value}")
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
    form: LongForm,
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


def beside(source: object, recording: str, cut: str) -> Path:
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


@dataclass(frozen=True)
class Fill:
    """method: "hold" the last reading, or "interpolate" in time between two (in records without time_s); records: the
    most records that a reading is carried, or that two readings lie apart. What is further stays missing."""

    method: str
    records: int


class Filler:
    """Fills columns of a stream; what waits for the next reading of an interpolated column is handed out later, so the
    result does not depend on chunks."""

    def __init__(self, fills: Mapping[str, Fill]):
        self._fills = fills
        self._reach = max((f.records for f in fills.values()), default=0)
        self._held: Recording | None = None
        self._done = 0

    def add(self, recording: Recording, *, end: bool = False) -> Recording:
        """The records that have become final by these."""
        if not self._fills:
            return recording
        every = concat([self._held, recording]) if self._held is not None else recording
        n = len(every)
        final = n if end else min([n, *(self._ready(every[c], f) for c, f in self._fills.items())])
        final = max(final, self._done)
        time = every["time_s"] if "time_s" in every else np.arange(float(n))
        filled = every.with_columns({c: fill(every[c], time, f) for c, f in self._fills.items()})
        result = filled.select(slice(self._done, final))
        first = max(0, final - self._reach - 1)
        self._held, self._done = every.select(slice(first, None)), final - first
        return result

    def _ready(self, values: np.ndarray, how: Fill) -> int:
        n = len(values)
        if how.method == "hold":
            return n
        known = np.flatnonzero(np.isfinite(values))
        return max(int(known[-1]) + 1 if known.size else 0, n - how.records)


def fill(values: np.ndarray, time: np.ndarray, how: Fill) -> np.ndarray:
    """(N,) values with gaps filled as `how` says; time: (N,) at which they were read."""
    n = len(values)
    known = np.isfinite(values)
    if not known.any():
        return values
    rows = np.arange(n)
    before = np.maximum.accumulate(np.where(known, rows, -1))
    if how.method == "hold":
        carried = ~known & (before >= 0) & (rows - before <= how.records)
        return np.where(carried, values[before], values)
    after = np.minimum.accumulate(np.where(known, rows, n)[::-1])[::-1]
    between = ~known & (before >= 0) & (after < n)
    between &= np.where(between, after - before, 0) <= how.records
    a, b = before[between], after[between]
    span = time[b] - time[a]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(span > 0.0, (time[rows[between]] - time[a]) / span, np.nan)
    result = values.copy()
    result[between] = values[a] + share * (values[b] - values[a])
    return result
