"""What was put into each flight, and what the commands said about it, read back from the files they wrote."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from enginediag_cli.units import split_column


@dataclass(frozen=True)
class PutIn:
    """A change that was simulated, in the parameter's unit ("" for a scale factor)."""

    change: float
    unit: str


@dataclass(frozen=True)
class Size:
    """An isolated change in the parameter's unit ("" for a scale factor), with the ends of its interval."""

    change: float
    lower: float
    upper: float
    unit: str
    inclusion: float | None


@dataclass(frozen=True)
class Flight:
    """One flight: `put_in` is the mean true change of each parameter that is wrong.

    detection: the row of `detect`. isolated is None where `isolate` was not asked or could not judge.
    """

    name: str
    put_in: Mapping[str, PutIn]
    detection: Mapping[str, Any]
    isolated: Mapping[str, Size] | None = None
    rivals: tuple[str, ...] = ()
    reason: str = ""

    @property
    def verdict(self) -> str:
        """healthy, fault or no verdict."""
        return str(self.detection["verdict"])


def read_flights(truth: Path, detected: Path, isolated: Path | None = None) -> list[Flight]:
    """Flights in the order of `detected`, a JSON file of `detect`, with the truth that `simulate` wrote."""
    put_in = dict(true_changes(truth))
    found = {name: list(rows) for name, rows in groupby(_rows(isolated), itemgetter("flight"))} if isolated else {}
    return [_flight(row, put_in[row["flight"]], found.get(row["flight"], [])) for row in _rows(detected)]


def true_changes(path: Path) -> Iterator[tuple[str, dict[str, PutIn]]]:
    """(flight, mean change of each parameter that changed) from a file of `simulate --truth`.

    Changes count from the first record, which lies before the onset of every fault of the demonstration.
    """
    with open(path, encoding="utf-8", newline="") as stream:
        records = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    columns = [column for column in records[0] if "." in column]
    for flight, group in groupby(records, itemgetter("flight")):
        rows = list(group)
        means = {c: sum(float(row[c]) - float(records[0][c]) for row in rows) / len(rows) for c in columns}
        yield flight, dict(_parameter(column, change) for column, change in means.items() if change)


def _parameter(column: str, change: float) -> tuple[str, PutIn]:
    """The parameter behind a column of the truth: `sensor.T3_K.bias` is `sensor.T3.bias` in K."""
    first, *rest = column.split(".")
    if first != "sensor":
        return column, PutIn(change, "")
    quantity, unit = split_column(rest[0])
    return ".".join([first, quantity, *rest[1:]]), PutIn(change, unit if rest[-1] == "bias" else "")


def _rows(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return rows


def _flight(detection: Mapping[str, Any], put_in: Mapping[str, PutIn], rows: list[dict[str, Any]]) -> Flight:
    """One flight from its row of `detect` and its rows of `isolate`, one for each isolated parameter."""
    judged = [row for row in rows if row["isolated"] is not None]
    sizes = {row["parameter"]: _size(row) for row in judged if row["parameter"]}
    rivals = tuple(judged[0]["rivals"] or ()) if judged else ()
    return Flight(
        str(detection["flight"]), put_in, detection, sizes if judged else None, rivals, str(detection["reason"] or "")
    )


def _size(row: Mapping[str, Any]) -> Size:
    return Size(row["change"], row["lower"], row["upper"], row["unit"].removeprefix("1"), row["inclusion"])
