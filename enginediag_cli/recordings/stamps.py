"""Time stamps to seconds: ISO 8601, or a stated format, with time zones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.cells import MISSING
from enginediag_cli.recordings.table import Recording

FRACTION = re.compile(r"(.*?)[.,](\d+)(.*)")
"""A stamp with a fraction of a second: what stands before it, its digits, what stands behind."""

NUMBERS = ("seconds", "seconds_of_day", "epoch_s", "epoch_ms", "excel_days")
"""Forms of stamps that are numbers: seconds from anywhere, seconds since midnight, seconds and milliseconds since 1970
in UTC, and days since 30 December 1899, which is how spreadsheets keep local time."""

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
"""Where the seconds of a time stamp begin, as in POSIX."""


@dataclass
class Stamps:
    """Seconds of the stamps in the columns `sources` (date and time of day may be two: joined by a space).

    form: "iso", or a format of strptime; zone: hours:minutes east of UTC of stamps that do not say, "" for UTC;
    since: "first_record" of the file (0 there: small numbers keep all digits), or "epoch", 1970-01-01 UTC.
    """

    sources: Sequence[str]
    form: str = "iso"
    zone: str = ""
    since: str = "first_record"
    _start: float | None = None

    def seconds(self, recording: Recording) -> np.ndarray:
        """(N,) s, NaN where a cell is empty. Raises DataError naming the line of a stamp that cannot be read."""
        offset = zone_of(self.zone)
        parts = [cells_of(recording, column) for column in self.sources]
        values = np.full(len(recording), np.nan)
        for k, cells in enumerate(zip(*parts, strict=True)):
            text = " ".join(cell.strip() for cell in cells)
            if text.strip().lower() in MISSING:
                continue
            try:
                stamp = _iso(text) if self.form == "iso" else datetime.strptime(text, self.form)
            except ValueError:
                wanted = "an ISO 8601 time stamp" if self.form == "iso" else f"a time stamp of the form {self.form}"
                place = f"{recording.source}:{recording.line[k]}:{'+'.join(self.sources)}"
                raise DataError(f"{place}: not {wanted}: {text!r}") from None
            stamp = stamp if stamp.tzinfo else stamp.replace(tzinfo=offset)
            values[k] = (stamp - EPOCH).total_seconds()
        if self.since == "epoch":
            return values
        known = np.flatnonzero(np.isfinite(values))
        if self._start is None and known.size:
            self._start = float(values[known[0]])
        return values - (self._start or 0.0)


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


def zone_of(zone: str) -> timezone:
    """The time zone of `+02:00`, `-05:30`, `UTC` or "". Raises ValueError."""
    if zone in ("", "UTC", "Z"):
        return timezone.utc
    if zone[0] not in "+-":
        raise ValueError(zone)
    hours, _, minutes = zone[1:].partition(":")
    east = timedelta(hours=int(hours), minutes=int(minutes or 0))
    return timezone(east if zone[0] == "+" else -east)


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
        match = FRACTION.fullmatch(bare)
        if match is None:
            raise
        head, digits, rest = match.groups()
        return datetime.fromisoformat(f"{head}.{digits[:6]:0<6}{rest}")
