"""The recorder YAML: the declaration of its keys, and the `Recorder` that it describes.

`match_to_engine` finds, for a draft, which recorded column is one that the engine needs: exactly, under another name or
station, or not at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section, Variants, near
from enginediag_cli.config.validate import Checked, load_checked
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.recordings.clocks import NUMBERS, parse_zone
from enginediag_cli.recordings.derived import RULES, GapFill
from enginediag_cli.recordings.header import HeaderEntry
from enginediag_cli.recordings.masking import SteadySettings
from enginediag_cli.recordings.quantities import Meaning
from enginediag_cli.recordings.recorder import Channel, Recorder
from enginediag_cli.recordings.table import DELIMITERS, FIXED, LAYOUTS, THOUSANDS, WHITESPACE, is_encoding
from enginediag_cli.units import UnitError, convert, find_unit, split_column, split_header, to_si

_COLUMN = Section(
    "column",
    "where a column comes from and how it is converted",
    (
        Field("from", "text", "source column; {prefix} stands for the engine's prefix"),
        Field("unit", "text", "unit of the source; default: the suffix of its name", None),
        Field("full_scale", "number", "value of the target at 100 %, for sources in pct", None),
        Field("scale", "number", "factor on the source's reading, in its own unit", 1.0),
        Field("offset", "number", "added to the source's reading after the scale, in its own unit", 0.0),
        Field("limits", "range", "what the sensor can truthfully read, in the target's unit", None),
        Field("density_kg_m3", "number", "of the fuel, for a volume flow that becomes a mass flow", None, minimum=1.0),
        Field("fill", "choice", "cells left empty between readings", "none", choices=("none", "hold", "interpolate")),
        Field("fill_records", "integer", "most records that a reading is held, or two lie apart", 0, minimum=0),
    ),
)

_ENGINE = Section(
    "engine",
    "one engine of the file",
    (
        Field("prefix", "text", "text that stands for {prefix}", ""),
        Field("constants", "number_map", "columns with one value, for this engine", {}),
        Field("full_scale", "number_map", "target column to its value at 100 %, for this engine", {}),
    ),
)

_CHECK = Section(
    "check",
    "a ratio of two columns that shows that the file is what it is taken for",
    (
        Field("of", "text", "column above"),
        Field("over", "text", "column below"),
        Field("between", "range", "where the median of the ratio must lie"),
        Field("otherwise", "text", "what to report if it does not"),
    ),
)

_MASKS = Section(
    "masks",
    "how much it takes to mask a value; 0 turns a search off",
    (
        Field("dropped_records", "integer", "missing values in a row: the sensor is dropped", 10, minimum=1),
        Field("stuck_records", "integer", "identical readings in a row", 20, minimum=0),
        Field("outlier_sigma", "number", "robust standard deviations of a gross outlier", 8.0, minimum=0.0),
        Field("frozen_records", "integer", "records in a row in which every column repeats", 20, minimum=0),
    ),
)

_STEADY = Section(
    "steady",
    "conditions for a record to be steady, in the units of the target columns",
    (
        Field("window_s", "number", "time over which spread and slope are taken", 10.0, unit="s", minimum=0.0),
        Field("gap_s", "number", "a longer step of time begins a new stretch", None, unit="s", minimum=0.0),
        Field("spread", "number_map", "largest maximum minus minimum in the window", {}),
        Field("slope", "number_map", "largest trend in the window, per second", {}),
        Field("dwell_s", "number", "time since the last change (heat soak)", 0.0, unit="s", minimum=0.0),
        Field("dwell", "number_map", "spread within dwell_s that counts as a change", {}),
        Field("minimum", "number_map", "smallest value", {}),
        Field("maximum", "number_map", "largest value", {}),
        Field("neighbours", "number_map", "largest difference from the records before and after", {}),
    ),
)

_LONG = Section(
    "long",
    "an export of one reading a line: time, tag, value; each tag becomes a column of this name",
    (
        Field("tag", "text", "column of the tags' names"),
        Field("value", "text", "column of the values"),
        Field("quality", "text", "column of the quality of a value; none if empty", ""),
        Field("good", "texts", "words of the quality of a value that is used, in any case", ()),
        Field("clock", "text", "tag at whose times there is a record; none: whenever a used tag has a value", ""),
        Field("max_age_s", "number", "how long a tag's last value is held; 0: its own time", 0.0, "s", minimum=0.0),
    ),
)

_FILE = Section(
    "file",
    "how the file is written",
    (
        Field("delimiter", "choice", "between cells", "auto", choices=("auto", *DELIMITERS, *LAYOUTS)),
        Field("widths", "numbers", "characters of each column, of delimiter: fixed", ()),
        Field("decimal", "choice", "decimal mark", "point", choices=("point", "comma")),
        Field("thousands", "choice", "mark between groups of three digits", "none", choices=("none", *THOUSANDS)),
        Field("encoding", "text", "of the text, as Python names it: utf-8, latin-1, cp1252", "utf-8"),
        Field("header", "choice", "whether a line names the columns", "line", choices=("line", "none")),
        Field("header_line", "integer", "line of the header; 0: the first that is not blank or #", 0, minimum=0),
        Field("names", "texts", "names of the columns, of header: none; an empty one is not read", ()),
        Field("unit_row", "boolean", "whether a row of units follows the header", False),
        Field("missing", "texts", "further words for a missing value, in any case; a number by its value", ()),
        Field("sheet", "text", "sheet of an Excel workbook; the first if empty", ""),
        Field("long", "section", "an export of one reading a line", None, section=_LONG),
    ),
)

_TIME = Section(
    "time",
    "time stamps that become time_s, in seconds",
    (
        Field("from", "texts", "column of the stamp, or of date and of time"),
        Field(
            "format",
            "text",
            "iso (ISO 8601; a time of day alone may pass midnight), as in strptime ('%d.%m.%Y %H:%M:%S'), or a number: "
            + ", ".join(NUMBERS),
            "iso",
        ),
        Field("zone", "text", "time zone of stamps that do not say: +02:00 or Europe/Berlin; UTC if not given", ""),
        Field(
            "since",
            "choice",
            "where time_s is 0: the first record of the file, or 1970-01-01 UTC",
            "first_record",
            choices=("first_record", "epoch"),
        ),
    ),
)

_JOIN = Section(
    "join",
    "a further file, at another rate; its column c is called NAME.c, with the name of the join",
    (
        Field("recording", "text", "its name, beside the recording: {name} is that of the recording without ending"),
        Field("cut", "text", "end of the recording's name that {name} is without, such as _fast", ""),
        Field("file", "section", "how it is written; none: as the recording", None, section=_FILE),
        Field("time", "section", "its time stamps; none: as the recording's", None, section=_TIME),
        Field(
            "how", "choice", "last value held, or each to one record, the nearest", "hold", choices=("hold", "nearest")
        ),
        Field("max_age_s", "number", "how far a value may be from a record that takes it", unit="s", minimum=0.0),
    ),
)

RECORDER_FILE = Section(
    "recorder",
    "how the columns of a foreign recording become those of the program",
    (
        Field("kind", "choice", "recorder", choices=("recorder",)),
        Field("description", "text", "what recorder and which files"),
        Field("sources", "texts", "where the facts come from", ()),
        Field("decide", "texts", "decisions that a draft leaves open, repeated by every command until removed", ()),
        Field("file", "section", "how the file is written", {}, section=_FILE),
        Field("time", "section", "time stamps; none: time is a number, or not recorded", None, section=_TIME),
        Field("joins", "named_sections", "further files, beside the recording, joined on time", (), section=_JOIN),
        Field("columns", "section_map", "target column (with its SI unit) to its source", section=_COLUMN),
        Field("engines", "section_map", "engines of the file by name; none: one engine", {}, section=_ENGINE),
        Field("constants", "number_map", "columns with one value", {}),
        Field("text", "text_map", "target text column to its source, untouched", {}),
        Field("keep", "texts", "source columns to pass through untouched", ()),
        Field(
            "derived",
            "named_sections",
            "computed columns, in this order",
            (),
            section=Variants(
                "rule", "how the column is computed", {name: rule.section for name, rule in RULES.items()}, "rule"
            ),
        ),
        Field("checks", "named_sections", "proofs that the file is what it is taken for", (), section=_CHECK),
        Field("masks", "section", "search for bad values", {}, section=_MASKS),
        Field("steady", "section", "the stability gate; none: every record is kept", None, section=_STEADY),
        Field("average_s", "number", "windows to average over; 0: none", 0.0, unit="s", minimum=0.0),
    ),
)


def load_channel(checked: Checked, target: str, problems: list[Problem]) -> Channel | None:
    """The channel that a checked recorder file declares for a target; what is wrong with it goes to `problems`."""
    spec = checked.values["columns"][target]
    here = ("columns", target)
    target_unit = split_column(target)[1] or "1"
    unit = spec["unit"] or split_header(spec["from"])[1] or ("1" if target_unit == "1" else "")
    if not unit:
        problems.append(
            checked.problem(
                (*here, "from"), f"the unit of {spec['from']} is not known", "its name has no unit; add 'unit:'"
            )
        )
        return None
    try:
        known = find_unit(target_unit)
        if known.si != known.name and target_unit != "1":
            problems.append(
                checked.problem(
                    here, f"the target {target} is not in SI", f"name it {split_column(target)[0]}_{known.si}"
                )
            )
        if spec["full_scale"] is not None:
            to_si(1.0, unit, spec["full_scale"])
        elif _volume_as_mass(checked, target, unit, problems):
            to_si(1.0, unit)
        elif not _full_scale_per_engine(checked.values, target):
            convert(1.0, unit, target_unit)
    except UnitError as error:
        problems.append(checked.problem((*here, "unit" if spec["unit"] else "from"), str(error)))
        return None
    limits = spec["limits"]
    return Channel(
        target,
        spec["from"],
        unit,
        target_unit,
        spec["full_scale"],
        spec["scale"],
        spec["offset"],
        None if limits is None else (limits[0], limits[1]),
        spec["density_kg_m3"],
        _fill(checked, target, problems),
    )


def _volume_as_mass(checked: Checked, target: str, unit: str, problems: list[Problem]) -> bool:
    """Whether the column turns a volume flow into a mass flow, or says so where it cannot."""
    density = checked.values["columns"][target]["density_kg_m3"]
    volume = find_unit(unit).dimension == "volume flow"
    mass = find_unit(split_column(target)[1] or "1").dimension == "mass flow"
    if volume and mass and density is None:
        problems.append(
            checked.problem(
                ("columns", target),
                f"{unit} is a volume flow and {target} a mass flow",
                "add density_kg_m3:, of jet fuel about 800, at the temperature of the flow meter",
            )
        )
    elif density is not None and not (volume and mass):
        problems.append(
            checked.problem(
                ("columns", target, "density_kg_m3"), "a density turns a volume flow into a mass flow; this is none"
            )
        )
    return volume and mass


def _fill(checked: Checked, target: str, problems: list[Problem]) -> GapFill | None:
    spec = checked.values["columns"][target]
    method, records = spec["fill"], spec["fill_records"]
    if (method == "none") != (records == 0):
        problems.append(
            checked.problem(
                ("columns", target, "fill_records" if method == "none" else "fill"),
                "'fill' and 'fill_records' belong together",
                "such as fill: hold, fill_records: 10",
            )
        )
    return GapFill(method, records) if method != "none" and records else None


def _full_scale_per_engine(values: Mapping[str, Any], target: str) -> bool:
    engines = values["engines"].values()
    return bool(engines) and all(target in engine["full_scale"] for engine in engines)


Place = tuple[str | int, ...]
"""Keys and names on the way to a value of the file."""


MOST_COLUMNS = 2000
"""Columns that a recorder makes; no engine has a tenth of them."""


def load_recorder(path: str | Path) -> Recorder:
    """Load the recorder that a YAML file describes.

    Parameters
    ----------
    path : path

    Returns
    -------
    Recorder

    Raises
    ------
    ConfigError
        With every problem of the file.
    """
    checked = load_checked(path, "recorder")
    values = checked.values
    if len(values["columns"]) > MOST_COLUMNS:
        what = f"{len(values['columns'])} columns, and a recorder makes at most {MOST_COLUMNS}"
        raise ConfigError([checked.problem(("columns",), what)])
    problems: list[Problem] = []
    channels = tuple(load_channel(checked, target, problems) for target in values["columns"])
    settings = values["steady"]
    steady = None
    if settings is not None:
        gap = settings["gap_s"]
        steady = SteadySettings(**{**settings, "gap_s": np.inf if gap is None else gap})
    problems += _file_problems(checked)
    problems += _unknown_columns(checked, steady)
    if problems:
        raise ConfigError(problems)
    engines = values["engines"] or {"": {"prefix": "", "constants": {}, "full_scale": {}}}
    return Recorder(
        str(path), tuple(c for c in channels if c is not None), engines, steady, values["average_s"], values
    )


def _problems_of_file(checked: Checked, here: Place, file: Mapping[str, Any] | None) -> Iterator[Problem]:
    """Problems of a section `file` that only its values together show."""
    if file is None:
        return
    if not is_encoding(file["encoding"]):
        hint = "such as utf-8, latin-1 or cp1252"
        yield checked.problem((*here, "encoding"), f"no encoding {file['encoding']!r}", hint)
    marks = {"decimal mark": file["decimal"], "delimiter": file["delimiter"], "mark of thousands": file["thousands"]}
    for (one, a), (other, b) in combinations(marks.items(), 2):
        if a == b or {a, b} == {"space", WHITESPACE}:
            key = "thousands" if "thousands" in other else "decimal"
            yield checked.problem((*here, key), f"the {one} and the {other} are both {a}s")
    if (file["header"] == "none") != bool(file["names"]):
        hint = "such as header: none, names: [unit, cycle, T3]"
        yield checked.problem((*here, "names"), "'header: none' and 'names' belong together", hint)
    if (file["delimiter"] == FIXED) != bool(file["widths"]):
        hint = "such as delimiter: fixed, widths: [10, 8, 8]"
        yield checked.problem((*here, "widths"), "'delimiter: fixed' and 'widths' belong together", hint)
    if any(width < 1 or width % 1 for width in file["widths"] if width is not None):
        yield checked.problem((*here, "widths"), "widths are whole numbers of characters, from 1")
    if file["names"] and file["widths"] and len(file["names"]) != len(file["widths"]):
        what = f"{len(file['names'])} names for {len(file['widths'])} widths"
        yield checked.problem((*here, "names"), what, "a column that is not read has the name ''")
    long = file["long"]
    if long is not None and bool(long["quality"]) != bool(long["good"]):
        hint = "such as quality: Status, good: [Good]"
        yield checked.problem((*here, "long"), "'quality' and 'good' belong together", hint)


def _problems_of_time(checked: Checked, here: Place, time: Mapping[str, Any] | None) -> Iterator[Problem]:
    """Problems of a section `time` that only its values together show."""
    if time is None:
        return
    if not time["from"]:
        yield checked.problem((*here, "from"), "no column of the time stamp")
    form = time["format"]
    if form not in ("iso", *NUMBERS) and "%" not in form:
        hint = near(form, ["iso", *NUMBERS]) + "; or a format as in strptime, '%d.%m.%Y %H:%M:%S'"
        yield checked.problem((*here, "format"), f"no format of time stamps {form!r}", hint)
    elif form in NUMBERS and len(time["from"]) > 1:
        yield checked.problem((*here, "from"), f"a time of the form {form} is one column")
    try:
        parse_zone(time["zone"])
    except ValueError as error:
        yield checked.problem((*here, "zone"), f"no time zone {time['zone']!r}", str(error))


def _file_problems(checked: Checked) -> Iterator[Problem]:
    """Problems of the sections that say how files are written, and when."""
    values = checked.values
    yield from _problems_of_file(checked, ("file",), values["file"])
    yield from _problems_of_time(checked, ("time",), values["time"])
    timed = values["time"] is not None or "time_s" in values["columns"]
    if values["time"] is not None and "time_s" in values["columns"]:
        yield checked.problem(("time",), "time_s is made twice", "leave it out of 'columns'")
    if values["file"]["long"] is not None and values["time"] is None:
        yield checked.problem(("file", "long"), "a long export needs 'time:', the column of its time stamps")
    for settings in values["joins"]:
        here = ("joins", settings["name"])
        yield from _problems_of_file(checked, (*here, "file"), settings["file"])
        yield from _problems_of_time(checked, (*here, "time"), settings["time"])
        if not timed:
            yield checked.problem(here, "files are joined on time, and this recorder makes no time_s")
        if settings["time"] is None and values["time"] is None:
            yield checked.problem(here, "a joined file needs 'time:', the column of its time stamps")
        if "{name}" not in settings["recording"] or Path(settings["recording"]).name != settings["recording"]:
            hint = "such as '{name}_slow.csv'"
            yield checked.problem((*here, "recording"), "the name of a file beside the recording, with {name}", hint)


def _unknown_columns(checked: Checked, steady: SteadySettings | None) -> list[Problem]:
    """Problems for columns that a rule, a check or the gate names and that nothing makes."""
    values = checked.values
    made = [*values["columns"], *values["constants"], *(["time_s"] if values["time"] else [])]
    for engine in values["engines"].values():
        made += engine["constants"]
    wanted: list[tuple[tuple[str | int, ...], str]] = []
    problems = []
    for settings in values["derived"]:
        rule, here = RULES[settings["rule"]], ("derived", settings["name"])
        units = {c: split_column(c)[1] or "1" for c in (settings["name"], *rule.needs(settings))}
        if len(units) < 2:
            problems.append(checked.problem(here, "it is computed from no other column"))
        elif rule.one_unit and len(set(units.values())) > 1:
            told = ", ".join(f"{column} in {unit}" for column, unit in units.items())
            problems.append(checked.problem(here, f"columns of different units: {told}"))
        for column in rule.needs(settings):
            if column not in made:
                problems.append(
                    checked.problem(
                        ("derived", settings["name"]),
                        f"the column {column} is not made before this",
                        near(column, made),
                    )
                )
        made.append(settings["name"])
    for check in values["checks"]:
        wanted += [(("checks", check["name"], key), check[key]) for key in ("of", "over")]
    if steady is not None:
        wanted += [(("steady",), column) for column in steady.columns]
    if values["average_s"] > 0.0:
        wanted.append((("average_s",), "time_s"))
    problems += [
        checked.problem(place, f"no column {column} is made by this recorder", near(column, made))
        for place, column in wanted
        if column not in made
    ]
    return problems


@dataclass(frozen=True)
class EngineColumns:
    """What an engine file asks for. inputs, sensors: its columns; optional: input → value when not recorded; limits:
    column → lowest and highest value in SI; design_rpm: speed column → design speed."""

    name: str
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    optional: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    design_rpm: Mapping[str, float] = field(default_factory=dict)

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns, in the order in which they are listed."""
        return (*self.inputs, *self.optional, *self.sensors)


HELPERS = frozenset(
    "time_s altitude_m mach cas_m_s tas_m_s ambient_temperature_K ambient_pressure_Pa relative_humidity TAT_K".split()
)
"""Targets that are of use although an engine does not ask for them: others are computed from them."""

_TURBINE_EXIT = ("EGT_K", "ITT_K")


def match_to_engine(
    entries: Sequence[HeaderEntry], engine: EngineColumns
) -> tuple[list[HeaderEntry], list[tuple[HeaderEntry, str]]]:
    """The entries as columns of the engine: renamed where the engine has one column that they can be, excluded (and
    why) where it has none."""
    here = {e.target for e in entries}
    related: list[HeaderEntry] = []
    left: list[tuple[HeaderEntry, str]] = []
    for e in entries:
        if e.target == "TAT_K" and "T2_K" in engine.columns and not here & {"T2_K"}:
            related.append(_renamed(e, "T2_K", ""))  # the total temperature of the air is that before the engine
            continue
        inlet = e.target in ("T1_K", "T2_K") and not here & {"TAT_K", "ambient_temperature_K"}
        if e.target in engine.columns or e.target in HELPERS or inlet:
            related.append(e)
            continue
        target, doubt = _counterpart(e, here, engine)
        if target:
            related.append(_renamed(e, target, doubt))
        else:
            left.append((e, doubt))
    return related, left


OWN_COLUMNS = ("dT_isa_K",)
"""Columns of the program that foreign files do not have, with which its own files are drafted, too."""


def match_exactly(e: HeaderEntry, engine: EngineColumns | None) -> HeaderEntry:
    """An entry whose name is that of a column of the engine, or of the program, but for case, spaces and unit."""

    def plain(text: str) -> str:
        return "".join(c for c in text.casefold() if c.isalnum())

    head = plain(split_column(e.column)[0])
    asked = (*engine.inputs, *engine.sensors, *OWN_COLUMNS) if engine else OWN_COLUMNS
    return next((_renamed(e, t, "") for t in asked if plain(split_column(t)[0]) == head and t != e.target), e)


def _renamed(e: HeaderEntry, target: str, doubt: str) -> HeaderEntry:
    meaning = e.meaning or Meaning(target, (), 3.0)
    return replace(e, meaning=replace(meaning, target=target), doubts=(*e.doubts, doubt) if doubt else e.doubts)


def _counterpart(e: HeaderEntry, here: Collection[str], engine: EngineColumns) -> tuple[str, str]:
    """The engine's column that a recorded one can be, and what is doubtful of it; no column where several can be."""
    quantity, own = split_column(e.target)
    if e.target in _TURBINE_EXIT or e.target == "T5_K":
        return _gas_temperature(e, engine, here)
    if quantity.startswith("Ps") and f"P{quantity[2:]}_Pa" in engine.columns and f"P{quantity[2:]}_Pa" not in here:
        target = f"P{quantity[2:]}_Pa"
        return (
            target,
            f"static pressure, some per cent below the total; or give the engine file a sensor {e.target}: "
            + (f"{{reads: {{{target}: 0.95}}}}"),
        )
    station = quantity[1:] if quantity[:1] in ("T", "P") and quantity[1:].isdigit() else ""
    if len(station) > 1:
        # T24 of one numbering is T25 of another, T48 T45: the only station of the same part of the engine
        near = [t for t in engine.columns if _is_station(t, quantity[0], station[0]) and t not in here]
        others = [t for t in here if _is_station(t, quantity[0], station[0]) and t not in engine.columns]
        if len(near) == 1 and len(others) == 1:
            return near[0], f"station {station} of the file taken for the engine's {split_column(near[0])[0][1:]}"
    suffix = [t for t in engine.columns if _is_part(t, quantity, own)]
    if len(suffix) == 1:
        return suffix[0], ""
    if len(suffix) > 1:
        return "", f"{' or '.join(suffix)}"
    return "", ""


def _is_station(target: str, kind: str, first: str) -> bool:
    quantity = split_column(target)[0]
    return quantity[:1] == kind and quantity[1:].isdigit() and quantity[1] == first and len(quantity) > 2


def _is_part(target: str, quantity: str, unit: str) -> bool:
    """Whether a column is that quantity of some part: `reduction_gear_torque_N_m` is a torque."""
    name, own = split_column(target)
    same = find_unit(own or "1").dimension == find_unit(unit or "1").dimension
    return same and name.endswith(f"_{quantity}")


def _gas_temperature(e: HeaderEntry, engine: EngineColumns, here: Collection[str]) -> tuple[str, str]:
    """An EGT or ITT is the temperature between or behind the turbines, wherever its probes are."""
    stations = [t for t in engine.sensors if t in _TURBINE_EXIT or (t.startswith("T") and t[1:2] in ("4", "5", "6"))]
    stations = [t for t in stations if t not in here]
    between = [t for t in stations if t.startswith("T4") and len(split_column(t)[0]) > 2]
    name = split_column(e.target)[0]
    if e.target == "ITT_K" and len(between) == 1:
        return between[0], ""
    sure = [t for t in stations if t in _TURBINE_EXIT]
    stations = sure if len(sure) == 1 else stations
    if len(stations) == 1:
        return stations[0], f"{name} taken for {stations[0]}; where its probes lie elsewhere, " + _READS.format(
            name=name
        )
    if len(stations) > 1:
        return "", f"{name} is measured at {' or '.join(stations)}, or between: map it, or " + _READS.format(name=name)
    return "", ""


_READS = "give the engine file a sensor {name}_K: {{reads: {{T45_K: 0.5, T5_K: 0.5}}}}"


def advise_on_missing(target: str, made: Collection[str], engine: EngineColumns) -> str:
    if target in engine.inputs:
        if target in ("altitude_m", "mach", "dT_isa_K") and not {"altitude_m", "mach", "cas_m_s"} & set(made):
            return "on a test bench hold it under constants"
        if target == "dT_isa_K":
            return "needs an air temperature and an altitude"
        if target == "mach":
            return "needs an airspeed and an altitude"
        return "an input: the engine cannot be judged without it"
    return "a sensor of the engine file that is not recorded; remove it there, or map a column"
