"""What an engine asks for, and which recorded column can be it: exactly, under another name or station, or not."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from enginediag_cli.recordings.header import HeaderEntry
from enginediag_cli.recordings.quantities import Meaning
from enginediag_cli.units import find_unit, split_column


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
