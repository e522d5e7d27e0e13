"""What a fleet file describes, checked: builds, how engines are told apart, baseline, maintenance, what is judged."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.config.named import named_file
from enginediag_cli.config.patterns import compile_pattern
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.fleet_judgement.history import Event
from enginediag_cli.fleet_judgement.remaining import LIVES
from enginediag_cli.fleets.events import read_events
from enginediag_cli.fleets.fleet_file import BUILD
from enginediag_cli.residuals.windows import WindowPlan, plan_windows

BUILD_KEYS = tuple(f.name for f in BUILD.fields)


@dataclass(frozen=True)
class Build:
    """Engines of one build. engine: None where `nominal`, which holds it, is given; recordings: patterns."""

    name: str
    engine: Path | None
    nominal: Path | None
    recordings: tuple[str, ...]
    recorder: Path | None


@dataclass(frozen=True)
class Baseline:
    """How much of each engine's early life is believed healthy: flights, or those within so many records."""

    flights: int | None = None
    records: int | None = None

    def stretches(self, records: list[int]) -> int:
        """How many of the first stretches, which hold so many `records` each, belong to it."""
        if self.flights is not None:
            return min(self.flights, len(records))
        total, count = 0, 0
        for n in records:
            total += n
            if total > (self.records or 0):
                break
            count += 1
        return count

    def __str__(self) -> str:
        return f"first {self.flights} flights" if self.flights is not None else f"first {self.records} records"


@dataclass(frozen=True)
class Fleet:
    """A fleet ready to be worked on. serial_from: "column" or "file", by `pattern`; plan: None for whole flights;
    judge, identify: the values of these sections; accept_mismatch: recordings are used that cannot be of the engine, or
    in these units."""

    path: Path
    description: str
    builds: tuple[Build, ...]
    serial_from: str
    pattern: re.Pattern[str] | None
    baseline: Baseline
    plan: WindowPlan
    judge: Mapping[str, Any]
    identify: Mapping[str, Any]
    events: tuple[Event, ...] = ()
    configs: tuple[Path, ...] = field(default=())
    accept_mismatch: bool = False

    @property
    def whole(self) -> bool:
        """Whether each flight is one window."""
        return self.plan.whole_flights


def load_fleet(path: str | Path) -> Fleet:
    """Read a fleet file and what it names, but for the recordings; raises ConfigError with every problem."""
    path = Path(path)
    checked = load_checked(path, "fleet")
    values = checked.values
    problems = list(_problems(checked))
    builds = []
    events: tuple[Event, ...] = ()
    for name, place in _places(checked):
        try:
            builds.append(_build(checked, name, place))
        except ConfigError as error:
            problems += error.problems
    if values["events"]:
        try:
            events = read_events(named_file(path, values["events"], "file of events", checked.mark(("events",))))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    window = values["judge"]["window"]
    named = [file for build in builds for file in (build.engine, build.nominal, build.recorder) if file]
    return Fleet(
        path,
        values["description"],
        tuple(builds),
        values["engines"]["serial_from"],
        compile_pattern(values["engines"]["pattern"]) if values["engines"]["serial_from"] == "file" else None,
        Baseline(values["baseline"]["flights"], values["baseline"]["records"]),
        plan_windows(window) if window else WindowPlan().of_series,
        values["judge"],
        values["identify"],
        events,
        tuple(dict.fromkeys(named)),
    )


def _places(checked: Checked) -> list[tuple[str, tuple[str, ...]]]:
    """Name of each build, and where in the file it stands."""
    if checked.values["builds"]:
        return [(name, ("builds", name)) for name in checked.values["builds"]]
    name = checked.values["engine"] or checked.values["nominal"] or "fleet"
    return [(Path(name).stem, ())]


def _build(checked: Checked, name: str, place: tuple[str, ...]) -> Build:
    """Raises ConfigError for files that are not there."""
    values = checked.values
    for step in place:
        values = values[step]
    owner = Path(checked.file)
    problems: list[Problem] = []
    found: dict[str, Path | None] = {}
    for key, what in (("engine", "engine file"), ("nominal", "nominal file"), ("recorder", "recorder")):
        found[key] = None
        if values[key]:
            try:
                found[key] = named_file(owner, values[key], what, checked.mark((*place, key)))
            except ConfigError as error:
                problems += error.problems
    if not values["engine"] and not values["nominal"]:
        what = f"build '{name}'" if place else "the fleet"
        hint = "give 'engine:', from which a model is identified, or 'nominal:', which holds its engine"
        problems.append(checked.problem(place, f"{what} names neither an engine nor a nominal file", hint))
    if problems:
        raise ConfigError(problems)
    return Build(name, found["engine"], found["nominal"], tuple(values["recordings"]), found["recorder"])


def _problems(checked: Checked) -> Iterator[Problem]:
    """What needs more than one key to be seen."""
    values = checked.values
    if values["builds"]:
        for key in BUILD_KEYS:
            if checked.given((key,)):
                hint = "give it to each of the builds"
                yield checked.problem((key,), f"'{key}' stands beside 'builds', which have their own", hint)
    engines = values["engines"]
    if engines["serial_from"] == "file":
        yield from _pattern_problems(checked, engines["pattern"])
    elif engines["pattern"]:
        hint = "say 'serial_from: file', or leave the pattern out"
        yield checked.problem(
            ("engines", "pattern"), "a pattern of file names, but serial numbers come from a column", hint
        )
    given = [key for key in ("flights", "records") if values["baseline"][key] is not None]
    if len(given) != 1:
        what = "both 'flights' and 'records' are given" if given else "neither 'flights' nor 'records' is given"
        yield checked.problem(("baseline",), f"{what} in baseline", "how much of early life is healthy is one of them")
    limit = values["judge"]["consumed_limit_K"]
    if limit is not None and (len(limit) != 2 or min(limit) <= 0):
        hint = "[margin, standard deviation], such as [25, 3]"
        yield checked.problem(("judge", "consumed_limit_K"), "consumed_limit_K needs two positive numbers", hint)
    taken_off = values["judge"]["taken_off"]
    if taken_off and limit is not None:
        hint = "a limit is stated or learnt"
        yield checked.problem(("judge", "taken_off"), "both 'taken_off' and 'consumed_limit_K' are given", hint)
    if taken_off and len(set(taken_off)) < LIVES:
        hint = f"name {LIVES} at least, or state 'consumed_limit_K'"
        yield checked.problem(("judge", "taken_off"), f"{len(set(taken_off))} engines do not tell a limit", hint)
    if values["judge"]["window"]:
        try:
            plan_windows(values["judge"]["window"])
        except ValueError as error:
            yield checked.problem(("judge", "window"), str(error))


def _pattern_problems(checked: Checked, pattern: str) -> Iterator[Problem]:
    place = ("engines", "pattern")
    example = "such as 'engine_(\\d+)'"
    if not pattern:
        yield checked.problem(("engines",), "serial numbers from file names need a 'pattern'", example)
        return
    try:
        groups = compile_pattern(pattern).groups
    except ValueError as error:
        yield checked.problem(place, str(error), example)
        return
    if groups != 1:
        what = f"the pattern has {groups} groups in brackets where it needs one, the serial number"
        yield checked.problem(place, what, f"{example}; (?:…) groups without being one")
