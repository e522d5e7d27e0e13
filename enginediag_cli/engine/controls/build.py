"""Entries of `controls:` → controls of the network, with every problem at its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.hints import near
from enginediag_cli.engine.components import Component
from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.controls.aim import Aim
from enginediag_cli.engine.controls.control import Control, Pace
from enginediag_cli.engine.controls.governor import Governor
from enginediag_cli.engine.controls.held import Held
from enginediag_cli.engine.controls.recorded import Recorded
from enginediag_cli.engine.controls.release import Release
from enginediag_cli.engine.controls.schedule import Schedule
from enginediag_cli.engine.controls.scheduled import Scheduled
from enginediag_cli.engine.controls.section import FUEL
from enginediag_cli.engine.controls.stops import Stops
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.units import split_column


def controls_of(values: Mapping[str, Any], components: Sequence[Component], checked: Checked) -> tuple[Control, ...]:
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
        return Recorded(name, actuator, entry["recorded"])
    stops = Stops(name, actuator, *_ends(entry, actuator))
    if entry["schedule"]:
        return Scheduled(name, stops, Schedule.declared((name,), entry["schedule"], actuator.unit, inputs))
    return Held(name, stops, _first(entry, "", inputs), tuple(_limits(entry, inputs)), _release(entry, stops))


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
