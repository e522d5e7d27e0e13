"""The demonstration of `enginediag demo`: its command lines, and the truth compared with the findings.

The steps are the command lines that a user would type. The truth of each flight and the answers of the commands are
read back from the files that they wrote.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from enginediag_cli.engine.engine import Engine
from enginediag_cli.error_model.maps import FAMILY, POINT_FAMILY
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.parameters import Parameter
from enginediag_cli.report.sentences import change, departed, listed, no_verdict, nominal
from enginediag_cli.units import split_column

ENGINE = "turbofan.yaml"
HEALTHY, NOMINAL, PAGE = "healthy.csv", "nominal.yaml", "report.html"
HEALTHY_FLIGHTS = 3
"""Enough to identify noise and its correlation, few enough that the story takes less than a minute."""


@dataclass(frozen=True)
class Case:
    """Flights of one engine: `file` is the stem of its files, `fault` a shipped fault file or "" for none."""

    file: str
    title: str
    flights: int
    fault: str = ""

    @property
    def recording(self) -> str:
        return f"{self.file}.csv"

    @property
    def truth(self) -> str:
        return f"{self.file}_truth.csv"

    @property
    def detected(self) -> str:
        return f"{self.file}_detected.json"

    @property
    def isolated(self) -> str:
        return f"{self.file}_isolated.json"


CASES = (
    Case("fresh", "an engine in which nothing is wrong", 2),
    Case("fouled", "an engine whose high-pressure compressor fouls", 6, "faults/hpc_fouling.yaml"),
    Case("misread", "a healthy engine whose T3 thermocouple reads high", 4, "faults/sensor_T3_bias.yaml"),
)

INGREDIENTS = (ENGINE, *(case.fault for case in CASES if case.fault))
"""Shipped files that the command lines name."""


def record_healthy(seed: int) -> list[str]:
    """Command line that records the healthy flights."""
    return f"simulate {ENGINE} --flights {HEALTHY_FLIGHTS} --seed {seed} -o {HEALTHY}".split()


def identify() -> list[str]:
    """Command line that identifies the engine on them."""
    return f"identify {ENGINE} {HEALTHY} --no-cross-validation -o {NOMINAL}".split()


def fly(case: Case, seed: int) -> list[str]:
    """Command line that records the flights of a case."""
    fault = f"--fault {case.fault} " if case.fault else ""
    flights = f"--flights {case.flights} --seed {seed} --truth {case.truth}"
    return f"simulate {ENGINE} {fault}{flights} -o {case.recording}".split()


def detect(case: Case) -> list[str]:
    """Command line that judges the flights of a case."""
    return f"detect -n {NOMINAL} {case.recording} -o {case.detected}".split()


def isolate(case: Case) -> list[str]:
    """Command line that isolates what has changed in a case."""
    return f"isolate -n {NOMINAL} {case.recording} -o {case.isolated}".split()


def report() -> list[str]:
    """Command line that reports the engine that wears as a page."""
    worn = next(case for case in CASES if case.fault)
    return f"report -n {NOMINAL} {worn.recording} -o {PAGE}".split()


@dataclass(frozen=True)
class TrueChange:
    """A change of a parameter that was simulated, in its unit."""

    parameter: Parameter
    change: float


@dataclass(frozen=True)
class IsolatedChange:
    """An isolated change of a parameter in its unit, with the ends of its interval."""

    parameter: Parameter
    change: float
    lower: float
    upper: float
    inclusion: float | None


@dataclass(frozen=True)
class JudgedFlight:
    """One flight: `put_in` is the mean true change of each parameter that is wrong.

    detection: the row of `detect`. isolated is None where `isolate` was not asked or could not judge.
    """

    name: str
    true_changes: Mapping[str, TrueChange]
    detection: Mapping[str, Any]
    isolated: Mapping[str, IsolatedChange] | None = None
    rivals: tuple[str, ...] = ()
    reason: str = ""

    @property
    def verdict(self) -> str:
        """healthy, fault or no verdict."""
        return str(self.detection["verdict"])


def read_flights(engine: Engine, truth: Path, detected: Path, isolated: Path | None = None) -> list[JudgedFlight]:
    """Flights in the order of `detected`, a JSON file of `detect`, with the truth that `simulate` wrote."""
    put_in = dict(read_true_changes(engine, truth))
    found = {name: list(rows) for name, rows in groupby(_rows(isolated), itemgetter("flight"))} if isolated else {}
    return [_flight(engine, row, put_in[row["flight"]], found.get(row["flight"], [])) for row in _rows(detected)]


def read_true_changes(engine: Engine, path: Path) -> Iterator[tuple[str, dict[str, TrueChange]]]:
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
        yield flight, {known[c].name: TrueChange(known[c], change) for c, change in means.items() if change}


def _columns_of_truth(engine: Engine) -> dict[str, Parameter]:
    """The parameter behind each column of the truth, where a sensor has its column's name: `sensor.T3_K.bias`."""
    own = {n: p for n, p in engine.parameters.items() if not p.belongs_to_sensor}
    errors = {f"sensor.{c}.{p.quantity}": p for c, s in engine.sensors.items() for p in s.parameters()}
    return own | errors


def _rows(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return rows


def _flight(
    engine: Engine, detection: Mapping[str, Any], put_in: Mapping[str, TrueChange], rows: list[dict[str, Any]]
) -> JudgedFlight:
    """One flight from its row of `detect` and its rows of `isolate`, one for each isolated parameter."""
    judged = [row for row in rows if row["isolated"] is not None]
    sizes = {row["parameter"]: _size(engine.parameters[row["parameter"]], row) for row in judged if row["parameter"]}
    rivals = tuple(judged[0]["rivals"] or ()) if judged else ()
    return JudgedFlight(
        str(detection["flight"]), put_in, detection, sizes if judged else None, rivals, str(detection["reason"] or "")
    )


def _size(parameter: Parameter, row: Mapping[str, Any]) -> IsolatedChange:
    return IsolatedChange(parameter, row["change"], row["lower"], row["upper"], row["inclusion"])


def describe_identification(found: Nominal, noise_put_in: Mapping[str, float]) -> Iterator[str]:
    """How many parameters were found, and how near the noise is to that of the simulated sensors."""
    own = [
        e for e in found.estimates if e.family not in (FAMILY, POINT_FAMILY)
    ]  # amounts of map error are no parameters of the engine
    count = {status: sum(e.status == status for e in own) for status in ("identified", "weak", "at prior")}
    yield (
        f"{count['identified']} parameters are known well from these flights, {count['weak']} a little; "
        f"{count['at prior']} stay at what was assumed"
    )
    off = {c: found.sigma[c] / noise_put_in[c] - 1 for c in found.sensors}
    worst = max(off, key=lambda c: abs(off[c]))
    yield (
        f"noise of {len(off)} sensors found, all within {100 * abs(off[worst]):.1f} % of what was put in "
        f"(farthest: {split_column(worst)[0]})"
    )


def describe_verdict(flight: JudgedFlight) -> str:
    """What `detect` said about one flight, with the numbers that the verdict rests on."""
    row, where = flight.detection, f"flight {flight.name}"
    if flight.verdict == "no verdict":
        return no_verdict(flight.reason, where=where)
    say = departed if flight.verdict == "fault" else nominal
    return say(row["statistic"], row["threshold"], row["dof"], row["p_value"], where=where)


def describe_isolation(flight: JudgedFlight) -> str:
    """What `isolate` named in one flight, and what it could not exclude."""
    if flight.isolated is None:
        return no_verdict(flight.reason or "nothing could be isolated", where=f"flight {flight.name}")
    told = [_change(size) for size in flight.isolated.values()]
    rival = f" [next best: {flight.rivals[0]}]" if flight.rivals else ""
    return f"flight {flight.name}: {'; '.join(told) or 'no change that matters'}{rival}"


def _change(size: IsolatedChange) -> str:
    return change(size.parameter, size.change, (size.upper - size.lower) / 2, chance=size.inclusion)


def comparison(case: Case, flights: Sequence[JudgedFlight]) -> Iterator[str]:
    """What was put into the flights of a case beside what was found, then everything that was missed or wrong."""
    wrong = [flight for flight in flights if flight.true_changes]
    clean = [flight for flight in flights if not flight.true_changes]
    yield f"{case.title[0].upper()}{case.title[1:]}"
    if clean:
        healthy = sum(flight.verdict == "healthy" for flight in clean)
        yield f"  {_named(clean)}, nothing wrong: {healthy} of {len(clean)} judged healthy"
    if wrong:
        alarms = sum(flight.verdict == "fault" for flight in wrong)
        exact = sum(flight.true_changes.keys() == (flight.isolated or {}).keys() for flight in wrong)
        yield (
            f"  {_named(wrong)}, something wrong: {alarms} of {len(wrong)} detected, {exact} isolated to exactly "
            "what was put in"
        )
        yield from _last(wrong[-1])
    yield from (f"  ! {mistake}" for flight in flights for mistake in mistakes(flight))


def closing(flights: Sequence[JudgedFlight]) -> str:
    """One sentence on whether all was found."""
    wrong = [mistake for flight in flights for mistake in mistakes(flight)]
    if not wrong:
        return (
            f"All {len(flights)} flights were judged rightly, nothing else was blamed, and every true size lies "
            "inside its 95 % interval."
        )
    things = "thing was" if len(wrong) == 1 else "things were"
    return f"In {len(flights)} flights {len(wrong)} {things} missed or wrong; they are marked with ! above."


def mistakes(flight: JudgedFlight) -> Iterator[str]:
    """False alarm, missed fault, wrong or missing parameter, and true size outside its interval."""
    where = f"flight {flight.name}"
    if flight.verdict == "no verdict":
        yield f"{where} could not be judged: {flight.reason}"
    elif flight.verdict == "fault" and not flight.true_changes:
        yield f"{where}: a false alarm"
    elif flight.verdict == "healthy" and flight.true_changes:
        yield f"{where}: the fault was not detected"
    if flight.isolated is None:
        return
    for name, true in flight.true_changes.items():
        if name not in flight.isolated:
            yield f"{where}: {true.parameter.words} was not named"
    for name, size in flight.isolated.items():
        if name not in flight.true_changes:
            yield f"{where}: {size.parameter.words} was named although nothing is wrong with it"
        elif not size.lower <= flight.true_changes[name].change <= size.upper:
            yield f"{where}: the true change of {size.parameter.words} lies outside its 95 % interval"


def _last(flight: JudgedFlight) -> Iterator[str]:
    """True and found changes of one flight, one above the other."""
    where = f"flight {flight.name}"
    for name, true in flight.true_changes.items():
        size = (flight.isolated or {}).get(name)
        yield f"  {where}  put in: {change(true.parameter, true.change)}"
        yield f"  {' ' * len(where)}  found:  {_change(size) if size else 'nothing of the kind'}"


def _named(flights: Sequence[JudgedFlight]) -> str:
    return f"flight{'s' if len(flights) > 1 else ''} {listed([flight.name for flight in flights])}"
