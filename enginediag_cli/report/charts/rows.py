"""A row of results, of a file or just made: its cells as texts, numbers and lists, and its place.

Residuals record by record, as columns: what the charts of records read.

Sizes of an answer, flight by flight, as if nothing but the answer had changed.

Where windows stand along an axis: at the number of their flight where flights are numbered, else one after the
other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.fingerprint import given
from enginediag_cli.report.charts.model import Axis, Origin
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.safe_text import unguarded

NOT_KNOWN = float("nan")


@dataclass(frozen=True)
class Row:
    """`cells` as CSV (texts) or JSON (typed) has them."""

    cells: Mapping[str, Any]
    origin: Origin

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def text(self, name: str) -> str:
        """The text of a cell; empty where there is none."""
        value = self.cells.get(name)
        return "" if value is None else unguarded(value) if isinstance(value, str) else str(value)

    def number(self, name: str) -> float:
        """The number of a cell, NaN where there is none. Raises DataError for words."""
        value = self.cells.get(name)
        if value is None or value == "":
            return NOT_KNOWN
        if isinstance(value, bool):
            return float(value)
        try:
            return float(value)
        except (TypeError, ValueError):
            raise DataError(f"{self.origin.file}:{self.origin.row}:{name}: not a number: {value!r}") from None

    def count(self, name: str) -> int:
        """A whole number, 0 where there is none."""
        value = self.number(name)
        return 0 if math.isnan(value) else round(value)

    def flag(self, name: str) -> bool:
        return str(self.cells.get(name)).lower() in ("true", "1", "1.0")

    def list(self, name: str) -> tuple[str, ...]:
        """The entries of a list: "a; b" in CSV."""
        value = self.cells.get(name)
        if value is None or value == "":
            return ()
        if isinstance(value, (list, tuple)):
            return tuple(str(item) for item in value)
        return tuple(part.strip() for part in unguarded(str(value)).split(";") if part.strip())

    @property
    def window(self) -> str:
        """Which flight or window it is of, as `isolate` says it."""
        if flight := self.text("flight"):
            return f"flight {flight}"
        first, last = self.text("first_line"), self.text("last_line")
        return f"lines {first} to {last}" if first else self.text("source")


def rival(text: str) -> tuple[tuple[str, ...], float]:
    """A rival as `isolate` and `trend` write it, "a & b (0.022)": the parameters and their probability."""
    names, _, chance = text.rpartition(" (")
    try:
        value = float(chance.rstrip(")"))
    except ValueError:
        names, value = text, NOT_KNOWN
    return tuple(name.strip() for name in names.split("&") if name.strip() not in ("", "nothing")), value


@dataclass(frozen=True)
class Records:
    """Of one engine, in order: `sigmas` and `residual` (n,) by sensor column, in standard deviations of its noise and
    in its unit; `inputs` (n,) by column; `time_s` (n,), NaN where not known; the flight, file and line of each.

    `altitude` and `power`: the inputs that say how high and how hard the engine runs, "" where not known.
    """

    files: Sequence[str]
    lines: Sequence[int]
    flights: Sequence[str]
    time_s: np.ndarray
    sigmas: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray] = field(default_factory=dict)
    altitude: str = ""
    power: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def since(self, file: str, flight: str) -> Records:
        """From the first record of a flight on; all of them where it is not among these."""
        places = list(zip(self.files, self.flights, strict=True))
        first = places.index((file, flight)) if (file, flight) in places else 0
        return replace(
            self,
            files=self.files[first:],
            lines=self.lines[first:],
            flights=self.flights[first:],
            time_s=self.time_s[first:],
            sigmas={name: values[first:] for name, values in self.sigmas.items()},
            residual={name: values[first:] for name, values in self.residual.items()},
            inputs={name: values[first:] for name, values in self.inputs.items()},
        )

    def origin(self, k: int) -> Origin:
        return Origin(self.files[k], str(self.lines[k]))

    def stretches(self) -> list[tuple[str, np.ndarray]]:
        """Flights, or files where flights are not told, with the places of their records."""
        names = [f"flight {flight}" if flight else file for flight, file in zip(self.flights, self.files, strict=True)]
        keys = list(zip(self.files, names, strict=True))
        return [(key[1], np.array([k for k, other in enumerate(keys) if other == key])) for key in dict.fromkeys(keys)]

    def farthest(self, most: int) -> list[str]:
        """Sensors whose residuals lie farthest from nominal in the last stretch, farthest first."""
        _, last = self.stretches()[-1]
        means = {name: abs(mean_of(values[last])) for name, values in self.sigmas.items()}
        return sorted(means, key=lambda name: -means[name])[:most]


def mean_of(values: np.ndarray) -> float:
    """Of those that are there; 0 of none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else 0.0


ALONE = (
    "Dots: each flight by itself, with 95 % intervals, if nothing but the parameters shown has changed. Dashed, with a "
    "band: what the whole series says."
)
"""What a chart of such sizes says of itself."""


def given_rows(windows: Iterable[tuple[WindowStatistics, Origin]], changed: Sequence[str]) -> list[Row]:
    """Rows as those of `trend --what flights`, of every window with statistics of these parameters."""
    rows: list[Row] = []
    for number, (window, origin) in enumerate(windows, start=1):
        statistics = window.statistics
        if statistics is None or not changed or not set(changed) <= set(statistics.parameters):
            continue
        for name, change, error in zip(changed, *given(statistics, changed), strict=True):
            half = NORMAL_95 * error
            cells = {"flight": window.flight, "number": number, "parameter": name, "change": change}
            rows.append(Row({**cells, "low": change - half, "high": change + half}, origin))
    return rows


@dataclass(frozen=True)
class Order:
    """`x` of each of `names`, which may be flights or windows."""

    names: Sequence[str]
    x: Sequence[float]
    axis: Axis

    def of(self, name: str) -> float | None:
        """Where a flight stands; None where it is not among them."""
        return next((x for known, x in zip(self.names, self.x, strict=True) if known == name), None)

    def at(self, number: float) -> float | None:
        """Where the so manieth stands, counted from 1."""
        k = round(number) - 1 if number == number else -1
        return self.x[k] if 0 <= k < len(self.x) else None


def order_of(rows: Sequence[Row]) -> Order:
    """The order of rows, one for each window."""
    flights = [row.text("flight") for row in rows]
    numbers = [_number(flight) for flight in flights]
    rising = all(b is not None and a is not None and a < b for a, b in pairwise(numbers))
    if numbers and all(n is not None for n in numbers) and rising:
        return Order(flights, [n for n in numbers if n is not None], Axis("flight"))
    named = bool(flights) and all(flights) and len(set(flights)) == len(flights)
    label = "flight, in the order given" if named else "window, in the order given"
    return Order(flights, [float(k) for k in range(1, len(rows) + 1)], Axis(label))


def _number(text: str) -> float | None:
    try:
        return float(int(text))
    except ValueError:
        return None
