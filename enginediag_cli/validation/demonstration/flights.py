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

from enginediag_cli.engine.engine import Engine
from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class PutIn:
    """A change of a parameter that was simulated, in its unit."""

    parameter: Parameter
    change: float


@dataclass(frozen=True)
class Size:
    """An isolated change of a parameter in its unit, with the ends of its interval."""

    parameter: Parameter
    change: float
    lower: float
    upper: float
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


def read_flights(engine: Engine, truth: Path, detected: Path, isolated: Path | None = None) -> list[Flight]:
    """Flights in the order of `detected`, a JSON file of `detect`, with the truth that `simulate` wrote."""
    put_in = dict(true_changes(engine, truth))
    found = {name: list(rows) for name, rows in groupby(_rows(isolated), itemgetter("flight"))} if isolated else {}
    return [_flight(engine, row, put_in[row["flight"]], found.get(row["flight"], [])) for row in _rows(detected)]


def true_changes(engine: Engine, path: Path) -> Iterator[tuple[str, dict[str, PutIn]]]:
    """(flight, mean change of each parameter that changed) from a file of `simulate --truth`.

    Changes count from the first record, which lies before the onset of every fault of the demonstration.
    """
    with open(path, encoding="utf-8", newline="") as stream:
        records = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    known = _columns_of_truth(engine)
    columns = [column for column in records[0] if column in known]
    for flight, group in groupby(records, itemgetter("flight")):
        rows = list(group)
        means = {c: sum(float(row[c]) - float(records[0][c]) for row in rows) / len(rows) for c in columns}
        yield flight, {known[c].name: PutIn(known[c], change) for c, change in means.items() if change}


def _columns_of_truth(engine: Engine) -> dict[str, Parameter]:
    """The parameter behind each column of the truth, where a sensor has its column's name: `sensor.T3_K.bias`."""
    own = {n: p for n, p in engine.parameters.items() if not p.of_sensor}
    errors = {f"sensor.{c}.{p.quantity}": p for c, s in engine.sensors.items() for p in s.parameters()}
    return own | errors


def _rows(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return rows


def _flight(
    engine: Engine, detection: Mapping[str, Any], put_in: Mapping[str, PutIn], rows: list[dict[str, Any]]
) -> Flight:
    """One flight from its row of `detect` and its rows of `isolate`, one for each isolated parameter."""
    judged = [row for row in rows if row["isolated"] is not None]
    sizes = {row["parameter"]: _size(engine.parameters[row["parameter"]], row) for row in judged if row["parameter"]}
    rivals = tuple(judged[0]["rivals"] or ()) if judged else ()
    return Flight(
        str(detection["flight"]), put_in, detection, sizes if judged else None, rivals, str(detection["reason"] or "")
    )


def _size(parameter: Parameter, row: Mapping[str, Any]) -> Size:
    return Size(parameter, row["change"], row["lower"], row["upper"], row["inclusion"])
