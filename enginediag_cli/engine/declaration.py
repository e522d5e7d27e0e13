"""The keys of an engine file, and the controls that its `controls:` block declares.

The keys of a component are declared beside the component itself. Here are those of the rest:

- `physics:` the effects that the model has.
- `identification:` which parameters are estimated, how loosely, and with which noise.
- `mismatch:` what `locate`, `explain` and `refine` assume.
- `controls:` actuators and what moves them. `read_controls` makes the controls of the network and reports every problem
  at its place. `orient` finds the direction in which an actuator moves its column: the sign of dq/dx at the design
  point, with every other balance met.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import Either, Field, Section, Variants, near
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.components import COMPONENTS, Component
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
from enginediag_cli.engine.network import DEMAND
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
        Field("column", "text", "model column or input whose value decides"),
        Field("side", "choice", "it acts while the column is", choices=SIDES),
        Field("value", "number", "this, in the column's unit"),
        Field(
            "margin",
            "number",
            "distance from that value within which it is unknown whether the control acts",
            0.0,
            minimum=0.0,
        ),
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
        return ScheduledPosition(name, stops, Schedule.from_mapping((name,), entry["schedule"], actuator.unit, inputs))
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
        followed = Schedule.from_mapping((name, "set_point"), schedule, unit, inputs)
        return Aim(name, "set_point", column, schedule=followed, lead_s=entry["lead_s"])
    demand = not entry["hold"] and entry["set_point"] is None
    return Aim(name, "set_point", column, value=entry["set_point"], demand=demand, lead_s=entry["lead_s"])


def _release(entry: Mapping[str, Any], stops: Stops) -> Release | None:
    condition = entry["acts_while"]
    if condition is None:
        return None
    nearer = abs(stops.actuator.neutral - stops.low) <= abs(stops.actuator.neutral - stops.high)
    wander = f"{entry['name']}_off_rest_{stops.actuator.unit}" if condition["rest_sigma"] > 0.0 else ""
    return Release(
        condition["column"],
        condition["side"],
        condition["value"],
        1.0 if nearer else -1.0,
        condition["margin"],
        wander,
        condition["rest_sigma"],
    )


def _limits(entry: Mapping[str, Any], inputs: Mapping[str, float | None]) -> Iterator[Aim]:
    for limit in entry["limits"]:
        if (limit["value"] is None) == (limit["schedule"] is None):
            raise ValueError(f"limit {limit['name']} needs either a value or a schedule")
        unit = split_column(limit["column"])[1]
        of = (entry["name"], limit["name"])
        schedule = Schedule.from_mapping(of, limit["schedule"], unit, inputs) if limit["schedule"] else None
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
            aim.set_scale(e, network, slope)


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


LOSSES = ("soft_l1", "huber", "none")
"""Robust losses of a normalised residual; `identification.loss` has their formulas."""
NOISE_CHOICES = ("estimate", "specified")
MONITORING_CHOICES = ("fit", "cross_validation")

IDENTIFICATION = Section(
    "identification",
    "What `identify` estimates from healthy recordings, and how far from nominal it may plausibly lie.",
    (
        Field(
            "parameters",
            "texts",
            "names or patterns (`hpc.*`) of what is estimated; all when empty",
            default=(),
        ),
        Field("fixed", "texts", "names or patterns that keep their nominal value", default=()),
        Field(
            "prior_mean",
            "number_map",
            "parameter: where its prior is centred, if not at nominal",
            default={},
            unit="the parameter's",
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior",
            default={},
            unit="the parameter's",
        ),
        Field("sensors", "texts", "columns that are fitted; every recorded sensor when empty", default=()),
        Field(
            "noise_sigma",
            "number_map",
            "column: standard deviation of one reading, if not the sensor's own",
            default={},
            unit="the column's",
        ),
        Field(
            "noise",
            "choice",
            "`estimate`: noise is what the fit leaves; `specified`: as the sensors state",
            default="estimate",
            choices=NOISE_CHOICES,
        ),
        Field(
            "monitoring_noise",
            "choice",
            "noise that later stages reckon with: `fit`: that of the fit; `cross_validation`: what the model "
            "leaves on records that the fit has not seen, its own error included",
            default="fit",
            choices=MONITORING_CHOICES,
        ),
        Field(
            "recording_bias_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its offset from one recording to the next "
            "(nuisance)",
            default={},
            unit="the column's",
        ),
        Field(
            "recording_scale_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its scale error from one recording to the next "
            "(nuisance)",
            default={},
            unit="fraction",
        ),
        Field("loss", "choice", "robust loss of a normalised residual", default="soft_l1", choices=LOSSES),
        Field(
            "loss_scale",
            "number",
            "residual, in standard deviations, beyond which a reading counts less",
            default=2.5,
            minimum=0.5,
            maximum=100.0,
        ),
        Field(
            "cross_validation_block",
            "integer",
            "records in one contiguous left-out block; 0 for an eighth of all",
            default=0,
            minimum=0,
            unit="records",
        ),
        Field(
            "max_iterations",
            "integer",
            "Gauss–Newton steps of all passes and attempts before giving up; flights of real engines take about 20",
            default=75,
            minimum=1,
        ),
    ),
)


SEARCH_NOISE_CHOICES = ("specified", "estimate")

MISMATCH = Section(
    "mismatch",
    "how `locate`, `explain` and `refine` reckon with this engine",
    (
        Field(
            "nuisance",
            "texts",
            "names or patterns of what is identified along with an effect; default: what "
            "`identification:` estimates, else the monitored parameters and the sensors' scale errors; "
            "besides, the scale of each sensor of which no error is identified and no offsets of recordings are stated",
            (),
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior, if not its own",
            {},
            unit="the parameter's",
        ),
        Field(
            "limits",
            "number_map",
            "coefficient of an effect: largest value that the installation can have, where "
            "that is less than the effect's own bound",
            {},
            unit="the coefficient's",
        ),
        Field(
            "map_accuracy",
            "number",
            "relative accuracy of the component maps: the model-error floor",
            0.003,
            minimum=0.0,
            maximum=0.1,
        ),
        Field("input_noise", "number_map", "input column: standard deviation of one reading", {}, unit="the column's"),
        Field(
            "input_noise_share", "number_map", "input column: standard deviation of one reading, as a share of it", {}
        ),
        Field(
            "noise",
            "choice",
            "specified: noise as the sensors, `identification:` or a nominal file state it; "
            "estimate: what nothing that is looked for explains",
            "specified",
            choices=SEARCH_NOISE_CHOICES,
        ),
    ),
)


SWITCH = Field(
    "switch",
    "text",
    "column of the recordings that is 1 where the effect is on and 0 where it is off or "
    "not recorded; without it the effect is always on",
    "",
)
TERM = Section(
    "term",
    "a physical effect of the library; `enginediag physics` lists them",
    (
        Field("term", "text", "name of the effect"),
        Field("at", "text", "where it acts: a component, a shaft or a sensor"),
        Field(
            "coefficients", "number_map", "its coefficients; those not stated are absent", {}, unit="the coefficient's"
        ),
        Field(
            "standard_errors", "number_map", "of the coefficients, when they were fitted", {}, unit="the coefficient's"
        ),
        SWITCH,
        Field("source", "text", "where the coefficients come from: data and command", ""),
    ),
)
COEFFICIENT = Section(
    "coefficient",
    "a number of a law",
    (
        Field("value", "number", "its value", unit="`unit`"),
        Field("unit", "text", "its unit, 1 for a number", "1"),
        Field("lower", "number", "least that physics allows; default none", None, unit="`unit`"),
        Field("upper", "number", "most that physics allows; default none", None, unit="`unit`"),
        Field(
            "absent",
            "number",
            "value at which the law is not there; at least one coefficient has one",
            None,
            unit="`unit`",
        ),
        Field(
            "prior_sigma",
            "number",
            "how far it plausibly lies from that, or from its value; default: it is not sought",
            None,
            unit="`unit`",
            minimum=0.0,
        ),
        Field("standard_error", "number", "when it was fitted", None, unit="`unit`", minimum=0.0),
        Field("description", "text", "what it is", ""),
    ),
)
LAW = Section(
    "law",
    "an effect outside the library, as a formula of the variables that `enginediag physics --variables` lists",
    (
        Field("law", "text", "a name of your own"),
        Field("at", "text", "where it acts: a parameter of the engine (hpc.efficiency) or a recorded reading (T45_K)"),
        Field(
            "expression",
            "text",
            "f: of a factor (nominal 1) the share that is added, else what is added in the parameter's or reading's "
            "unit; 0 at the design point; numbers, variables, coefficients, + - * / **, exp, ln, sqrt, tanh, min, max",
        ),
        Field("coefficients", "section_map", "its coefficients by name", section=COEFFICIENT),
        Field("statement", "text", "what it says in plain words", ""),
        SWITCH,
        Field("source", "text", "where it comes from: data and command", ""),
    ),
)
EFFECT = Either("effect", "a physical effect that the model carries: a `term` or a `law`", {"term": TERM, "law": LAW})


SHAFT = Section(
    "shaft",
    "what turns together",
    (
        Field("name", "text", "name of the shaft"),
        Field("speed_label", "text", "N1, N2, …: its speed is the column <label>_rpm"),
        Field("design_speed_rpm", "number", "at the design point", unit="rpm", minimum=1.0),
        Field(
            "speed",
            "choice",
            "balance: follows from the power balance; constant: the design speed (synchronous "
            "generator); input: a recorded column",
            "balance",
            choices=("balance", "constant", "input"),
        ),
        Field(
            "mechanical_efficiency",
            "number",
            "share of turbine power that reaches the shaft",
            1.0,
            minimum=0.8,
            maximum=1.0,
        ),
        Field("power_offtake_W", "number", "power taken from the shaft", 0.0, unit="W"),
        Field(
            "inertia_kg_m2",
            "number",
            "polar moment of inertia of all that turns with the shaft; 0: its speed follows at once",
            0.0,
            unit="kg m2",
            minimum=0.0,
        ),
    ),
)
SENSOR = Section(
    "sensor",
    "one measured output; the key of the entry is its column",
    (
        Field(
            "reads",
            "any_map",
            "columns of the model and their weights, {T45_K: 0.6, T5_K: 0.4}; default the column itself",
            None,
        ),
        Field("over", "text", "model column by which the reading is divided (a ratio such as EPR)", None),
        Field("noise_sigma", "number", "standard deviation of one reading, in the column's unit", minimum=0.0),
        Field("maximum", "number", "largest reading, in the column's unit; scales uniform noise", None),
        Field("bias_sigma", "number", "plausible bias, in the column's unit; default 3 noise_sigma", None, minimum=0.0),
        Field("scale_sigma", "number", "plausible scale error", 0.01, minimum=0.0),
        Field("soak", "text", "input column with the heat-soak driver; adds parameter sensor.<quantity>.soak", None),
        Field("soak_sigma", "number", "plausible soak coefficient, reading unit per driver unit", 0.01, minimum=0.0),
    ),
)
DESIGN = Section(
    "design",
    "the design point, at which components are sized",
    (
        Field("altitude_m", "number", "geopotential altitude", 0.0, unit="m"),
        Field("mach", "number", "flight Mach number", 0.0, minimum=0.0, maximum=1.0),
        Field("dT_isa_K", "number", "deviation from the standard atmosphere", 0.0, unit="K"),
        Field("ambient_pressure_Pa", "number", "for ground conditions", 101325.0, unit="Pa"),
        Field("ambient_temperature_K", "number", "for ground conditions", 288.15, unit="K"),
        Field("humidity_kg_kg", "number", "water vapour per dry air", 0.0, unit="kg/kg", minimum=0.0),
        Field("dP_inlet_Pa", "number", "measured inlet loss", 0.0, unit="Pa"),
    ),
)
RANGE = Section(
    "range",
    "lowest and highest value, in the column's unit",
    (Field("low", "number", "lowest value"), Field("high", "number", "highest value")),
)
COMPONENT = Variants("component", "a component of the gas path", {t: c.SECTION for t, c in COMPONENTS.items()})

ENGINE_FILE = Section(
    "engine",
    "an engine as a network of components",
    (
        Field("kind", "choice", "what this file is", "engine", choices=("engine",)),
        Field("description", "text", "which engine it is"),
        Field("sources", "texts", "where its numbers come from", ()),
        Field("name", "text", "short name"),
        Field(
            "fuel_hydrogen_carbon_ratio",
            "number",
            "atoms of hydrogen per atom of carbon",
            1.9185,
            minimum=0.5,
            maximum=4.0,
        ),
        Field("design", "section", "design point", {}, section=DESIGN),
        Field(
            "power_setting",
            "text",
            "column that sets the power: Wf_kg_s, a shaft speed such as N1_rpm, the temperature of a station behind "
            "the burner such as T4_K or T5_K, EPR, Fn_N, power_W (of all loads together), or one machine's "
            "<name>_power_W or <name>_torque_N_m; given as input, the rest are outputs",
        ),
        Field("power_demand", "section", "a recorded set point that the power setting follows", None, section=DEMAND),
        Field("components", "named_sections", "in the order of the gas path", section=COMPONENT),
        Field("shafts", "named_sections", "the shafts", section=SHAFT),
        Field("controls", "named_sections", "what moves the engine's actuators", (), section=CONTROL),
        Field("sensors", "section_map", "measured outputs by column", section=SENSOR),
        Field(
            "monitored",
            "texts",
            "health parameters that are watched; default: all but those of the burner",
            (),
        ),
        Field("envelope", "section_map", "largest range of every input column, {low, high}", section=RANGE),
        Field(
            "power_range",
            "range",
            "corrected power setting from idle to rating (W_f/(δ√θ), N/√θ, T/θ, EPR, F/δ, P/(δ√θ), torque/δ)",
        ),
        Field("start", "number_map", "starting values of unknowns, relative to design", {}),
        Field("physics", "sections", "effects that the model carries beyond its components", (), section=EFFECT),
        Field("identification", "section", "what `identify` estimates", None, section=IDENTIFICATION),
        Field("mismatch", "section", "what `locate`, `explain` and `refine` reckon with", None, section=MISMATCH),
    ),
)
