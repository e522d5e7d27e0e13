"""The keys of `controls:` in an engine file.

Entries of `controls:` → controls of the network, with every problem at its place.

Which way an actuator moves what it is to hold: the sign of dq/dx at the design point, all else in balance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.config.hints import near
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.components import Component
from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.controls import (
    Aim,
    Control,
    Governor,
    Pace,
    RecordedPosition,
    Release,
    Schedule,
    ScheduledPosition,
    SetPointControl,
    Stops,
)
from enginediag_cli.engine.dual import Dual, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


FUEL = "fuel"
"""The actuator that every engine has: the fuel valve of its main burner."""
SIDES = ("at_most", "at_least")

SCHEDULE = Section(
    "schedule",
    "a value as a table or a polynomial of something",
    (
        Field("against", "text", "model column or input of the engine; or give `input`", ""),
        Field("input", "text", "column that the recording holds, an input of the engine by this", ""),
        Field("points", "numbers", "where the table has values, rising, in the column's unit", ()),
        Field("values", "numbers", "values there; straight lines between, the end values beyond", ()),
        Field("polynomial", "numbers", "instead of a table: c0, c1, … of c0 + c1 x + …", ()),
    ),
)
LIMIT = Section(
    "limit",
    "a limit that takes over where it is met",
    (
        Field("name", "text", "what `active_limit` calls it"),
        Field("column", "text", "model column that is limited"),
        Field("side", "choice", "which way", choices=SIDES),
        Field("value", "number", "the limit, in the column's unit", None),
        Field("schedule", "section", "the limit as a table or polynomial", None, section=SCHEDULE),
        Field(
            "lead_s",
            "number",
            "in transients of a shaft's speed: what is limited is the speed plus this times its rate of change",
            0.0,
            unit="s",
            minimum=0.0,
        ),
    ),
)
WHILE = Section(
    "acts_while",
    "when a control acts; else its actuator rests at the stop nearest to where nothing sets it",
    (
        Field("column", "text", "model column or input of the engine that tells"),
        Field("side", "choice", "it acts while the column is", choices=SIDES),
        Field("value", "number", "this, in the column's unit"),
        Field("margin", "number", "nearer to it than this nobody can tell whether it acts", 0.0, minimum=0.0),
        Field(
            "rest_sigma",
            "number",
            "how far from its rest the actuator wanders from day to day while released (standard deviation)",
            0.0,
            minimum=0.0,
        ),
    ),
)
CONTROL = Section(
    "control",
    "what moves an actuator of the engine",
    (
        Field("name", "text", "name of the control, the first part of its parameters' names"),
        Field(
            "actuator",
            "text",
            "what it moves: an actuator of a component, such as compressor.vane_closing_deg, or `fuel`",
        ),
        Field(
            "hold", "text", "model column that it keeps at the set point; of fuel, by default, the power setting", ""
        ),
        Field("set_point", "number", "in the unit of that column; default: its value at the design point", None),
        Field("set_point_schedule", "section", "the set point as a table or polynomial", None, section=SCHEDULE),
        Field("low", "number", "lower stop of the actuator, in its unit; default: the component's", None),
        Field("high", "number", "upper stop of the actuator, in its unit; default: the component's", None),
        Field("limits", "named_sections", "limits, the later ones before the earlier ones", (), section=LIMIT),
        Field(
            "lead_s",
            "number",
            "in transients that hold a shaft's speed: what is held is the speed plus this times its rate of change",
            0.0,
            unit="s",
            minimum=0.0,
        ),
        Field(
            "time_constant_s",
            "number",
            "in transients: of the control, which moves the actuator by its error over this; 0: at once",
            0.0,
            unit="s",
            minimum=0.0,
        ),
        Field(
            "rate_per_s",
            "number",
            "in transients: fastest that the actuator moves, in its unit (fuel: kg/s) per second; 0: no limit",
            0.0,
            minimum=0.0,
        ),
        Field("acts_while", "section", "when it acts; default always", None, section=WHILE),
        Field("schedule", "section", "position as a table or polynomial, instead of holding", None, section=SCHEDULE),
        Field("source", "text", "where it comes from", ""),
        Field("standard_errors", "number_map", "of the set point and the stops, as identified", {}),
        Field("recorded", "text", "input column that holds the position, instead of holding", ""),
    ),
)


def read_controls(values: Mapping[str, Any], components: Sequence[Component], checked: Checked) -> tuple[Control, ...]:
    """The controls that the file declares. Raises ConfigError."""
    problems: list[Problem] = []
    actuators = {a.name: a for c in components for a in c.actuators()}
    inputs: dict[str, float | None] = {}
    for c in components:
        inputs.update(c.inputs())
    found: list[Control] = []
    taken: dict[str, str] = {}
    for k, entry in enumerate(values["controls"]):
        leaf = entry["actuator"]
        if leaf != FUEL and leaf not in actuators:
            hint = near(leaf, [FUEL, *actuators])
            problems.append(Problem(checked.mark(("controls", k, "actuator")), f"there is no actuator '{leaf}'", hint))
            continue
        if leaf in taken:
            place = checked.mark(("controls", k, "actuator"))
            problems.append(Problem(place, f"'{leaf}' is moved by {taken[leaf]} already"))
        taken[leaf] = entry["name"]
        try:
            control = _control(entry, actuators.get(leaf), values["power_setting"], inputs)
            control.pace = Pace(entry["time_constant_s"], entry["rate_per_s"])
            found.append(control)
        except ValueError as error:
            problems.append(Problem(checked.mark(("controls", k)), f"{entry['name']}: {error}"))
    if problems:
        raise ConfigError(problems)
    return tuple(found)


def _control(
    entry: Mapping[str, Any], actuator: Actuator | None, power_setting: str, inputs: Mapping[str, float | None]
) -> Control:
    name = entry["name"]
    ways = [key for key in ("hold", "schedule", "recorded") if entry[key]]
    if actuator is None:
        if entry["schedule"] or entry["recorded"] or entry["low"] is not None or entry["high"] is not None:
            raise ValueError("fuel is what holds the power setting or `hold`: it has no schedule, record or stops here")
        return Governor(name, _first(entry, power_setting, inputs), tuple(_limits(entry, inputs)))
    if len(ways) != 1:
        raise ValueError(f"it needs exactly one of hold, schedule and recorded, this one has {len(ways)}")
    if entry["recorded"]:
        return RecordedPosition(name, actuator, entry["recorded"])
    stops = Stops(name, actuator, *_ends(entry, actuator))
    if entry["schedule"]:
        return ScheduledPosition(name, stops, Schedule.declared((name,), entry["schedule"], actuator.unit, inputs))
    return SetPointControl(
        name, stops, _first(entry, "", inputs), tuple(_limits(entry, inputs)), _release(entry, stops)
    )


def _ends(entry: Mapping[str, Any], actuator: Actuator) -> tuple[float, float]:
    low = actuator.lower if entry["low"] is None else entry["low"]
    high = actuator.upper if entry["high"] is None else entry["high"]
    if not actuator.lower <= low < high <= actuator.upper:
        raise ValueError(
            f"stops {low:g} and {high:g} {actuator.unit} must rise and lie within {actuator.lower:g} to "
            f"{actuator.upper:g}, which is as far as the {actuator.words} goes"
        )
    return low, high


def _first(entry: Mapping[str, Any], power_setting: str, inputs: Mapping[str, float | None]) -> Aim:
    """What is held: the column at its set point, or, of fuel with nothing said, the power setting as recorded."""
    name, column = entry["name"], entry["hold"] or power_setting
    unit = split_column(column)[1]
    schedule = entry["set_point_schedule"]
    if schedule and entry["set_point"] is not None:
        raise ValueError("give set_point or set_point_schedule, not both")
    if schedule:
        followed = Schedule.declared((name, "set_point"), schedule, unit, inputs)
        return Aim(name, "set_point", column, schedule=followed, lead_s=entry["lead_s"])
    demand = not entry["hold"] and entry["set_point"] is None
    return Aim(name, "set_point", column, value=entry["set_point"], demand=demand, lead_s=entry["lead_s"])


def _release(entry: Mapping[str, Any], stops: Stops) -> Release | None:
    told = entry["acts_while"]
    if told is None:
        return None
    nearer = abs(stops.actuator.neutral - stops.low) <= abs(stops.actuator.neutral - stops.high)
    wander = f"{entry['name']}_off_rest_{stops.actuator.unit}" if told["rest_sigma"] > 0.0 else ""
    return Release(
        told["column"],
        told["side"],
        told["value"],
        1.0 if nearer else -1.0,
        told["margin"],
        wander,
        told["rest_sigma"],
    )


def _limits(entry: Mapping[str, Any], inputs: Mapping[str, float | None]) -> Iterator[Aim]:
    for limit in entry["limits"]:
        if (limit["value"] is None) == (limit["schedule"] is None):
            raise ValueError(f"limit {limit['name']} needs either a value or a schedule")
        unit = split_column(limit["column"])[1]
        of = (entry["name"], limit["name"])
        schedule = Schedule.declared(of, limit["schedule"], unit, inputs) if limit["schedule"] else None
        kept = limit["column"], limit["side"], limit["value"], schedule
        yield Aim(entry["name"], limit["name"], *kept, lead_s=limit["lead_s"])


def lever(values: Mapping[str, Any]) -> str:
    """The input column that asks the fuel control for power, "" without one."""
    for entry in values["controls"]:
        schedule = entry["set_point_schedule"]
        if entry["actuator"] == FUEL and schedule:
            return str(schedule["input"])
    return ""


UNMOVED = 1e-9
"""Relative change of a column over the whole way of an actuator, or per relative change of fuel, which is none."""


def orient(network: Network, leaves: Mapping[str, Any]) -> None:
    """Gives every aim of every control its sign and, where it has none, its set point. Raises ValueError for an
    actuator that does not move what it is to hold and for a wander without an input that releases it, KeyError for a
    column that the model does not have.

    dq/dx = q_x − q_z F_z⁻¹ F_x along the balances F and unknowns z of the engine without controls, all other actuators
    at neutral and, but for the fuel control itself, at constant power setting.
    """
    if not any(control.aims() for control in network.controls):
        return
    unknowns = [u.name for u in network.open_unknowns()]
    fuel = network.fuel_unknown
    moved = [c.actuator.name for c in network.controls if c.position()]
    e = Evaluation(network.gas, 1, leaves, frozenset([*unknowns, fuel, *moved]))
    with np.errstate(all="ignore"):
        network.open_loop(e)
    held = network.governor.aim.column if network.governor is not None else network.power_setting
    asked = {} if network.power_leaf else {held: network.read(e, held)}
    for control in network.controls:
        if control.release is not None:
            control.release.check(e, network)
        governs = not control.position()
        along = fuel if governs else control.actuator.name
        free = [n for n in unknowns if not (governs and n == fuel)]
        rows = {**e.balances, **({} if governs else asked)}
        if len(rows) != len(free):
            return  # the engine does not close: the check of its unknowns and balances says where
        F, F_x = _slopes(e, rows, free), _slopes(e, rows, [along])[:, 0]
        dz = -np.linalg.solve(F, F_x)
        way = 1.0 if governs else _way(control)
        for aim in control.aims():
            q = network.read(e, aim.column)
            slope = float(_slopes(e, {aim.column: q}, [along])[0, 0] + _slopes(e, {aim.column: q}, free)[0] @ dz)
            size = abs(float(np.ravel(q.v if isinstance(q, Dual) else q)[0])) or 1.0
            if not abs(slope * way) > UNMOVED * size:
                raise ValueError(f"{control.name}: the {control.actuator.words} does not move {aim.column} at design")
            aim.sized(e, network, slope)


def _way(control: Control) -> float:
    """How far the actuator goes, in its unit."""
    far = control.actuator.upper - control.actuator.lower
    return far if np.isfinite(far) else 1.0


def _slopes(e: Evaluation, rows: Mapping[str, Value], names: list[str]) -> np.ndarray:
    """Derivatives (rows, names) of one-point values with respect to leaves."""
    out = np.zeros((len(rows), len(names)))
    for i, y in enumerate(rows.values()):
        if isinstance(y, Dual):
            for j, name in enumerate(names):
                k = e.directions.get(name, len(y.d))
                out[i, j] = y.d[k, 0] if k < len(y.d) else 0.0
    return out
