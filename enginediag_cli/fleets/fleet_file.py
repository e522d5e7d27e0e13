"""The fleet file: its declaration, and what it names, checked.

It describes builds, how engines are identified, baseline, maintenance and settings of the judgement. Maintenance comes
from a CSV file: which engine, what was done, before which flight or when. Recordings are found by patterns, in order;
their serial numbers come from file names where the file says so.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from pathlib import Path
from typing import Any

from enginediag_cli.config.fields import Field, Section, near
from enginediag_cli.config.files import READING, compile_pattern, matching, named_file, search
from enginediag_cli.config.validate import Checked, load_checked
from enginediag_cli.errors import ConfigError, DataError, Mark, NoVerdictError, Problem
from enginediag_cli.fleets.findings import KINDS, MaintenanceEvent
from enginediag_cli.fleets.margin import LIVES
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.windows import WindowPlan, plan_windows

LINEARISE = ("estimate", "nominal")

_OF_A_BUILD = (
    Field("engine", "text", "engine file, relative to this file; or one that comes with the program", None),
    Field(
        "nominal",
        "text",
        "nominal file of identify, relative to this file; where absent one is identified from the baseline",
        None,
    ),
    Field(
        "recordings",
        "texts",
        "patterns of the recordings, relative to this file, such as 'flights/*.csv' or '**/*.parquet'",
        (),
    ),
    Field("recorder", "text", "recorder of foreign recordings, relative to this file; or a shipped one", None),
)

BUILD = Section("build", "engines of one build: what they are, and which recordings are theirs", _OF_A_BUILD)

ENGINES = Section(
    "engines",
    "how engines are identified",
    (
        Field(
            "serial_from",
            "choice",
            "where the serial number of an engine stands: in the column `engine` of a recording (a recorder may map "
            "another one to it), or in the name of its file",
            "column",
            choices=("column", "file"),
        ),
        Field(
            "pattern",
            "text",
            "with serial_from: file, a regular expression of the file's path with one group, the serial number, such "
            "as 'engine_(\\d+)'",
            "",
        ),
    ),
)

BASELINE = Section(
    "baseline",
    "the early life of each engine, believed healthy: it is judged against that, and the common model is identified "
    "from it",
    (
        Field("flights", "integer", "first flights of each engine", None, minimum=1),
        Field("records", "integer", "flights within the first so many records of each engine", None, minimum=1),
    ),
)

IDENTIFY = Section(
    "identify",
    "the common model, for builds without a nominal file",
    (
        Field("engines", "integer", "from the baseline of at most so many engines", 20, minimum=1),
        Field("records", "integer", "and of at most so many records", 6000, minimum=20),
        Field(
            "model_error", "number", "relative accuracy of the component maps, by hand", None, minimum=0, maximum=0.1
        ),
    ),
)

JUDGE = Section(
    "judge",
    "what is judged, and how strictly",
    (
        Field(
            "fdr",
            "number",
            "false discovery rate: share of healthy engines among those flagged",
            0.05,
            minimum=1e-9,
            maximum=0.5,
        ),
        Field(
            "window",
            "text",
            "cut flights into windows: records (60) or time (300s, 10min, 1h); where absent a flight is one window, "
            "and a recording without flights one window a record",
            None,
        ),
        Field("linearise", "choice", "where the model is linearised", "estimate", choices=LINEARISE),
        Field("sensors", "boolean", "instruments are suspects, too", True),
        Field(
            "limits_K",
            "number_map",
            "highest permitted exhaust temperature by column, at the reference condition, for its margin",
            {},
            unit="K",
        ),
        Field(
            "consumed_limit_K",
            "numbers",
            "margin that engines have lost when they are removed from wing, and its standard deviation, where no "
            "temperature limit is known: [25, 3]",
            None,
            unit="K",
        ),
        Field(
            "taken_off",
            "texts",
            "serial numbers of engines whose recordings end where they were removed from wing because they were worn, "
            "three at least: what they had lost by then is the limit of all others, in place of consumed_limit_K",
            (),
        ),
    ),
)

FLEET_FILE = Section(
    "fleet",
    "a fleet: engines by serial number, their recordings, maintenance, and what to judge",
    (
        Field("kind", "choice", "kind of file", "fleet", choices=("fleet",)),
        Field("description", "text", "what the fleet is", ""),
        Field("sources", "texts", "where its recordings come from", ()),
        *_OF_A_BUILD,
        Field("builds", "section_map", "several builds by name, in place of the four keys above", {}, section=BUILD),
        Field("engines", "section", "how engines are identified", {}, section=ENGINES),
        Field("baseline", "section", "early life, believed healthy", section=BASELINE),
        Field("identify", "section", "the common model", {}, section=IDENTIFY),
        Field(
            "events",
            "text",
            "CSV of maintenance, relative to this file: columns engine, kind (wash, overhaul, exchange), flight or "
            "time_s, component",
            None,
        ),
        Field("judge", "section", "what is judged", {}, section=JUDGE),
    ),
)


COLUMNS = ("engine", "kind", "flight", "time_s", "component")


def read_events(path: Path, *, named: bool = True) -> tuple[MaintenanceEvent, ...]:
    """Read the events of a file of maintenance.

    Parameters
    ----------
    path : Path
        CSV file.
    named : bool
        Whether each event names its engine, as it must where there are several.

    Returns
    -------
    tuple of MaintenanceEvent
        In the order of the file.

    Raises
    ------
    ConfigError
        With every row that is wrong.
    """
    try:
        table = read_all(str(path), declared=("time_s",), by_suffix=False)
    except DataError as error:
        raise ConfigError([Problem(Mark(str(path)), str(error))]) from None
    head = Mark(str(path), int(table.line[0]) - 1 if len(table) else 0)
    known = {*table.text, *table.columns}
    problems = [
        Problem(head, f"unknown column {column!r}", near(column, COLUMNS))
        for column in table.order
        if column not in COLUMNS
    ]
    needed = COLUMNS[:2] if named else COLUMNS[1:2]
    problems += [Problem(head, f"no column {c!r}", "columns: " + ", ".join(COLUMNS)) for c in needed if c not in known]
    if not known & {"flight", "time_s"}:
        problems.append(Problem(head, "no column 'flight' and none 'time_s'", "one of them says when an event was"))
    if problems:
        raise ConfigError(problems)
    events = []
    for k in range(len(table)):
        event = _read_event(table, k)
        place = Mark(str(path), int(table.line[k]))
        wrong = list(_event_problems(event, place, named))
        problems += wrong
        if not wrong:
            events.append(event)
    if problems:
        raise ConfigError(problems)
    return tuple(events)


def _read_event(table: Recording, k: int) -> MaintenanceEvent:
    def text(column: str) -> str:
        return table.text[column][k].strip() if column in table.text else ""

    time = float(table.columns["time_s"][k]) if "time_s" in table.columns else nan
    return MaintenanceEvent(text("engine"), text("kind"), text("flight"), time, text("component"))


def _event_problems(event: MaintenanceEvent, place: Mark, named: bool) -> Iterator[Problem]:
    if named and not event.engine:
        yield Problem(place, "the event names no engine", "its serial number belongs in the column 'engine'")
    if event.kind not in KINDS:
        yield Problem(place, f"unknown kind of event {event.kind!r}", near(event.kind, KINDS))
    if bool(event.flight) == isfinite(event.time_s):
        what = "both a flight and a time" if event.flight else "neither a flight nor a time"
        yield Problem(place, f"the event has {what}", "the first flight after it, or time_s")


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
class FleetBaseline:
    """How much of each engine's early life is believed healthy: flights, or those within so many records."""

    flights: int | None = None
    records: int | None = None

    def count_stretches(self, records: list[int]) -> int:
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
    """A fleet file, checked.

    Attributes
    ----------
    path, description : Path, str
        The file and its description.
    builds : tuple of Build
        Engines of one build each.
    serial_from, pattern : str, re.Pattern or None
        Where serial numbers come from: "column", or "file" by the pattern.
    baseline : FleetBaseline
        Early life, believed healthy.
    plan : WindowPlan or None
        Windows; None for whole flights.
    judge, identify : mapping of str
        Values of these sections.
    events : tuple of MaintenanceEvent
        Maintenance.
    configs : tuple of Path
        Files that it names.
    accept_mismatch : bool
        Whether recordings are used that cannot be of the engine, or in these units.
    """

    path: Path
    description: str
    builds: tuple[Build, ...]
    serial_from: str
    pattern: re.Pattern[str] | None
    baseline: FleetBaseline
    plan: WindowPlan
    judge: Mapping[str, Any]
    identify: Mapping[str, Any]
    events: tuple[MaintenanceEvent, ...] = ()
    configs: tuple[Path, ...] = field(default=())
    accept_mismatch: bool = False

    @property
    def whole_flights(self) -> bool:
        """Whether each flight is one window."""
        return self.plan.whole_flights


def load_fleet(path: str | Path) -> Fleet:
    """Read a fleet file and what it names, except the recordings.

    Parameters
    ----------
    path : str or Path
        YAML file.

    Returns
    -------
    Fleet

    Raises
    ------
    ConfigError
        With every problem, its line and column.
    """
    path = Path(path)
    checked = load_checked(path, "fleet")
    values = checked.values
    problems = list(_key_problems(checked))
    builds = []
    events: tuple[MaintenanceEvent, ...] = ()
    for name, place in _build_places(checked):
        try:
            builds.append(_read_build(checked, name, place))
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
        FleetBaseline(values["baseline"]["flights"], values["baseline"]["records"]),
        plan_windows(window) if window else WindowPlan().series_plan,
        values["judge"],
        values["identify"],
        events,
        tuple(dict.fromkeys(named)),
    )


def _build_places(checked: Checked) -> list[tuple[str, tuple[str, ...]]]:
    """Name of each build, and where in the file it stands."""
    if checked.values["builds"]:
        return [(name, ("builds", name)) for name in checked.values["builds"]]
    name = checked.values["engine"] or checked.values["nominal"] or "fleet"
    return [(Path(name).stem, ())]


def _read_build(checked: Checked, name: str, place: tuple[str, ...]) -> Build:
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


def _key_problems(checked: Checked) -> Iterator[Problem]:
    """What needs more than one key to be seen."""
    values = checked.values
    if values["builds"]:
        for key in BUILD_KEYS:
            if checked.is_given((key,)):
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
        yield checked.problem(("judge", "taken_off"), f"{len(set(taken_off))} engines do not determine a limit", hint)
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


DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True)
class FleetRecording:
    """One recording of a fleet.

    Attributes
    ----------
    path, name : str
        Absolute path, and the name by which recordings are ordered.
    build, serial : str
        Its build, and the serial number of its engine where the file name holds it, else "".
    trouble : str
        Why it is not read; "" where nothing is wrong.
    """

    path: str
    name: str
    build: str
    serial: str = ""
    trouble: str = ""


def natural_order(name: str) -> tuple[tuple[str | int, ...], str]:
    """A key by which flight_9 comes before flight_10."""
    parts = DIGITS.split(name)
    return tuple(int(part) if k % 2 else part for k, part in enumerate(parts)), name


def find_recordings(fleet: Fleet, given: Sequence[str] = ()) -> tuple[FleetRecording, ...]:
    """Find all recordings of a fleet.

    Parameters
    ----------
    fleet : Fleet
        With patterns of files.
    given : sequence of str
        Files in place of its patterns.

    Returns
    -------
    tuple of FleetRecording
        By name; a file that a pattern finds and that cannot be read is among them, with its trouble.

    Raises
    ------
    DataError
        For a recording of two builds.
    NoVerdictError
        When there is none.
    """
    if given and len(fleet.builds) > 1:
        raise DataError("the fleet has several builds, so its file has to say which recordings are whose")
    found: dict[str, FleetRecording] = {}
    for build in fleet.builds:
        for path in given or _matching_paths(fleet, build):
            real = os.path.abspath(path)
            if real in found:
                both = f"of build {found[real].build!r} and of {build.name!r}"
                raise DataError(
                    f"{path}: matches patterns {both}" if found[real].build != build.name else f"{path}: given twice"
                )
            serial, trouble = _serial_number(fleet, path)
            trouble = _irregular_reason(real) or ("" if given else _outside_reason(fleet, real)) or trouble
            found[real] = FleetRecording(real, "", build.name, serial, trouble)
    if not found:
        patterns = ", ".join(p for build in fleet.builds for p in build.recordings)
        told = f"no file matches {patterns}" if patterns else "the file names no recordings"
        raise NoVerdictError(f"{fleet.path}: {told}; name recordings behind it on the command line")
    names = _relative_names(list(found))
    every = [replace(r, name=names[r.path]) for r in found.values()]
    return tuple(sorted(every, key=lambda r: natural_order(r.name)))


def _matching_paths(fleet: Fleet, build: Build) -> list[str]:
    folder = fleet.path.parent
    paths: dict[str, None] = {}
    for pattern in build.recordings:
        hits = matching(folder, pattern)
        # folders that * and ** pass through are none of the recordings; one that is called as they are is named
        everything = Path(pattern).name in ("*", "**")
        kept = (p for p in hits if not (everything and os.path.isdir(p)))
        paths.update(dict.fromkeys(sorted(os.path.normpath(p) for p in kept)))
    return list(paths)


def _irregular_reason(path: str) -> str:
    """Why what lies there is no recording, without looking into it: a pipe would never end."""
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        dangling = os.path.islink(path)
        return (
            "a link to what is not there" if dangling else f"cannot be read: {(error.strerror or str(error)).lower()}"
        )
    if stat.S_ISREG(mode):
        return ""
    kind = "a folder" if stat.S_ISDIR(mode) else "a pipe" if stat.S_ISFIFO(mode) else "a device or a socket"
    return f"{kind}, not a file"


def _outside_reason(fleet: Fleet, path: str) -> str:
    folder = fleet.path.parent.resolve()
    if READING.allow_outside or Path(path).resolve().is_relative_to(folder):
        return ""
    return "lies outside the folder of the fleet file: put it below, or allow it with --allow-outside"


def _relative_names(paths: Sequence[str]) -> dict[str, str]:
    """Path → its part below the folder that all have in common, so that nothing depends on where that lies."""
    common = os.path.commonpath([os.path.dirname(p) for p in paths])
    return {p: Path(os.path.relpath(p, common)).as_posix() for p in paths}


def _serial_number(fleet: Fleet, path: str) -> tuple[str, str]:
    """Serial number by the name of a file, and what is wrong with the name."""
    if fleet.pattern is None:
        return "", ""
    found = search(fleet.pattern, Path(path).as_posix(), str(fleet.path))
    if found is None or not found[1]:
        return "", f"its name has no serial number by the pattern {fleet.pattern.pattern!r}"
    return found[1], ""
