"""Controls: what moves the actuators of an engine (fuel, vanes, bleed valves, nozzles).

Every control adds its unknowns, equations and parameters to the network, and gives the position of its actuator:

- `Governor` is the fuel control. It gives the required power unless a limit takes over.
- `SetPointControl` keeps a column of the model at its set point, between the stops of its actuator.
- `RecordedPosition` takes the position from the recording.
- `ScheduledPosition` takes the position from a table or a polynomial of a column (`Schedule`).

An `Aim` is what a control works towards: a column of the model at a value, as a surplus that rises with the actuator.
`Stops` are the ends of an actuator; its position between them is an unknown of order one. `Release` says when a control
acts, and where its actuator rests otherwise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.components.base import Actuator, Unknown, scalar
from enginediag_cli.engine.dual import Array, Value, chain, maximum, minimum, select, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


@dataclass(frozen=True)
class Release:
    """It acts while `column` is `side` of `value`; `rest`: +1 where it rests at the low stop, −1 at the high one.
    Within `margin` of the value this is uncertain. `wander`: an input column, 0 where it is not recorded, with what the
    actuator stands off its rest by while released, in its unit; `rest_sigma`: standard deviation of that.

    A combined machine's load control opens the vanes as soon as the firing temperature is at its limit, whatever the
    exhaust temperature is: no surplus of the held quantity says so.
    """

    column: str
    side: str
    value: float
    rest: float
    margin: float = 0.0
    wander: str = ""
    rest_sigma: float = 0.0

    def is_released(self, e: Evaluation, network: Network) -> Array:
        """Records (N,) in which the control does not act."""
        # of an input what is recorded, whatever effects make of it: that is what the control itself goes by
        x = e.leaves[self.column] if self.column in e.leaves else network.read(e, self.column)
        return self.is_beyond(x, e.size)

    def check(self, e: Evaluation, network: Network) -> None:
        """Raises KeyError for a column that the model does not have, ValueError for a wander without an input."""
        if self.column in network.inputs():
            return
        network.read(e, self.column)
        if self.wander:
            raise ValueError(
                f"rest_sigma needs an input in acts_while, one of {', '.join(network.inputs())}: when the actuator "
                f"wanders must be recorded, and {self.column} is what the model finds"
            )

    def is_beyond(self, x: Value, size: int) -> Array:
        plain = np.broadcast_to(np.asarray(value(x)), (size,))
        return plain > self.value if self.side == "at_most" else plain < self.value

    def is_undecided(self, x: Array) -> Array:
        """Values of the column (N,) at which it is uncertain whether it acts."""
        return np.asarray(np.abs(x - self.value) < self.margin)

    def rest_offset(self, e: Evaluation) -> Value:
        """Offset of the actuator from its rest (N,): 0 where it acts."""
        return e[self.wander] * np.where(self.is_beyond(e.leaves[self.column], e.size), 1.0, 0.0)

    def apply(self, surplus: Value, e: Evaluation, network: Network) -> Value:
        """The surplus that drives the actuator (N,): to its rest where the control is released."""
        return select(self.is_released(e, network), np.full(e.size, self.rest), surplus)


PRIOR_SHARE = 0.05
"""How far a value of a schedule plausibly lies from what is stated, as a share of its largest. Judgement."""
REACH = 10.0
"""Bounds of a value, in such standard deviations."""


@dataclass(frozen=True)
class Schedule:
    """v(x): straight lines through (`points`, values), the end values beyond them, or Σ c_i x^i.

    `part`: the control that it belongs to. x is `column`, in its unit: an input (`is_input`) or a model column. Values
    or coefficients, with their parameters `<owner>.value_1`, … are in `unit`.
    """

    part: str
    owner: str
    column: str
    is_input: bool
    points: tuple[float, ...]
    values: tuple[float, ...]
    unit: str

    @staticmethod
    def from_mapping(of: tuple[str, ...], values: Mapping[str, Any], unit: str, inputs: Mapping[str, Any]) -> Schedule:
        """From the file; `of`: the control, and what of it follows the schedule; `inputs`: of the engine without
        controls. ValueError says what is wrong."""
        points, table, law = (tuple(float(v) for v in values[k]) for k in ("points", "values", "polynomial"))
        if bool(values["against"]) == bool(values["input"]):
            raise ValueError("a schedule names what it follows, either `against` a model column or an `input`")
        if bool(table) == bool(law):
            raise ValueError("a schedule has either `points` and `values` or a `polynomial`")
        if table and (len(points) != len(table) or len(points) < 2 or (np.diff(points) <= 0.0).any()):
            raise ValueError("`points` must rise, with one of `values` for each, at least two")
        column = values["against"] or values["input"]
        return Schedule(
            of[0], ".".join(of), column, bool(values["input"]) or column in inputs, points, table or law, unit
        )

    def names(self) -> tuple[str, ...]:
        return tuple(f"{self.owner}.value_{k + 1}" for k in range(len(self.values)))

    def parameters(self) -> tuple[Parameter, ...]:
        found = []
        size = max(abs(v) for v in self.values) or 1.0
        for k, (name, v) in enumerate(zip(self.names(), self.values, strict=True)):
            sigma = PRIOR_SHARE * (size if self.points else abs(v) or size)
            place = f"at {self.points[k]:g}" if self.points else f"coefficient of power {k}"
            found.append(
                Parameter(
                    name,
                    "design",
                    v,
                    v - REACH * sigma,
                    v + REACH * sigma,
                    sigma,
                    self.unit,
                    f"value of the schedule {place}",
                    self.part,
                    f"value_{k + 1}",
                    f"{spelled(self.owner)} {place}",
                    spelled(self.part),
                )
            )
        return tuple(found)

    def evaluate(self, e: Evaluation, network: Network) -> Value:
        """The value in this evaluation (N,)."""
        return self.interpolate(e, e[self.column] if self.is_input else network.read(e, self.column))

    def interpolate(self, e: Evaluation, x: Value) -> Value:
        """The value at x, both (N,)."""
        v = [e[name] for name in self.names()]
        if not self.points:
            total: Value = v[-1]
            for c in reversed(v[:-1]):
                total = total * x + c
            return total
        plain = np.asarray(value(x), dtype=float)
        hats, slopes = self._linear_weights(plain)
        total = 0.0
        for hat, c in zip(hats, v, strict=True):
            total = total + hat * c
        along = sum(s * np.asarray(value(c)) for s, c in zip(slopes, v, strict=True))
        return total + chain(np.zeros_like(plain), (np.asarray(along), x))

    def inverse(self, wanted: float) -> float:
        """An x at which the value is `wanted`, as stated in the file; the nearest point's where there is none."""
        xs = np.asarray(self.points or np.linspace(0.0, 1.0, 101))
        ys = np.asarray(self.values) if self.points else np.polynomial.polynomial.polyval(xs, self.values)
        for k in range(len(xs) - 1):
            low, high = sorted((ys[k], ys[k + 1]))
            if low <= wanted <= high and low < high:
                return float(xs[k] + (wanted - ys[k]) / (ys[k + 1] - ys[k]) * (xs[k + 1] - xs[k]))
        return float(xs[np.argmin(np.abs(ys - wanted))])

    def _linear_weights(self, x: Array) -> tuple[Array, Array]:
        """Weight of each value and its slope along x, (points, N) each."""
        grid = np.asarray(self.points)
        cell = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, len(grid) - 2)
        width = grid[cell + 1] - grid[cell]
        share = np.clip((x - grid[cell]) / width, 0.0, 1.0)
        slope = np.where((x >= grid[0]) & (x <= grid[-1]), 1.0 / width, 0.0)
        k = np.arange(len(grid)).reshape(-1, *([1] * np.ndim(x)))
        lower, upper = k == cell, k == cell + 1
        return lower * (1.0 - share) + upper * share, (upper * 1.0 - lower * 1.0) * slope


SET_POINT_SHARE = 0.02
"""How far a set point plausibly lies from what is stated, as a share of it. Judgement."""
SET_POINT_REACH = 0.3
"""Bounds of a set point, as a share of it."""


@dataclass
class Aim:
    """`column` at a target: parameter `<owner>.<quantity>` of nominal `value`, or a `schedule`, or, with neither, the
    reading of the column itself that the operating point states (`demand`: the power setting).

    `side`: "" where it is held, else "at_most" or "at_least". `sign`: +1 where the column rises with the actuator,
    −1 where it falls; `lead_s`: times the rate of change of the column is added to it in transients, so that a
    governor acts before the speed is there; found at the design point, where a value that is not stated is taken from,
    too.
    """

    owner: str
    quantity: str
    column: str
    side: str = ""
    value: float | None = None
    schedule: Schedule | None = None
    demand: bool = False
    sign: float = 1.0
    lead_s: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.owner}.{self.quantity}"

    @property
    def is_upper_limit(self) -> bool:
        """Whether it keeps the actuator from going further up, rather than further down."""
        return (self.side == "at_most") == (self.sign > 0.0)

    def parameters(self) -> tuple[Parameter, ...]:
        if self.demand:
            return ()
        if self.schedule is not None:
            return self.schedule.parameters()
        v = 1.0 if self.value is None else self.value
        reach = SET_POINT_REACH * (abs(v) or 1.0)
        unit = split_column(self.column)[1] or "1"
        words = f"{spelled(self.owner)} {spelled(self.quantity)}"
        sigma = SET_POINT_SHARE * (abs(v) or 1.0)
        place = f"{self.column} {self.side.replace('_', ' ') or 'held'}"
        return (
            Parameter(
                self.name,
                "design",
                v,
                v - reach,
                v + reach,
                sigma,
                unit,
                place,
                self.owner,
                self.quantity,
                words,
                spelled(self.owner),
            ),
        )

    def target(self, e: Evaluation, network: Network) -> Value:
        """The value to be met (N,), in the column's unit."""
        if self.demand:
            return e[network.power_setting]
        if self.schedule is not None:
            return self.schedule.evaluate(e, network)
        return e[self.name]

    def surplus(self, e: Evaluation, network: Network) -> Value:
        """± (column / target − 1), (N,): above zero where the actuator stands too far up."""
        found = network.read(e, self.column)
        if self.lead_s:
            found = found + network.rate(e, self.column) * self.lead_s
        return self.sign * (found / self.target(e, network) - 1.0)

    def set_scale(self, e: Evaluation, network: Network, slope: float) -> None:
        """At the design point `e`, where the column changes by `slope` with the actuator."""
        self.sign = 1.0 if slope >= 0.0 else -1.0
        if self.value is None and self.schedule is None:
            self.value = scalar(network.read(e, self.column))


def select_surplus(first: Aim, limits: tuple[Aim, ...], e: Evaluation, network: Network) -> Value:
    """The surplus that acts (N,): each limit caps or lifts what stands before it, F = max(F, F_i) or min(F, F_i)."""
    F = first.surplus(e, network)
    for limit in limits:
        one = limit.surplus(e, network)
        F = maximum(F, one) if limit.is_upper_limit else minimum(F, one)
    return F


AT_LIMIT = 1e-6
"""Distance from a stop, of the way between the stops, or from a limit, of its value, within which it acts."""

DerivedPosition = Callable[[Evaluation], Value]


@dataclass(frozen=True)
class Pace:
    """How fast an actuator follows in transients: its control's time constant, s, and its largest rate, in its unit per
    second; 0: at once."""

    time_constant_s: float = 0.0
    rate_per_s: float = 0.0


class Control(ABC):
    """One actuator and what moves it."""

    pace = Pace()
    release: Release | None = None  # when it acts, where it does not always

    def __init__(self, name: str, actuator: Actuator):
        self.name, self.actuator = name, actuator

    def inputs(self) -> dict[str, float | None]:
        """Input columns that it reads, with the default of those that are optional."""
        return {}

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    @abstractmethod
    def position(self) -> Mapping[str, DerivedPosition]:
        """The actuator's leaf and how it is found in an evaluation; nothing where it is an unknown already."""

    def close(self, e: Evaluation, network: Network) -> None:  # noqa: B027  most add one, what is given needs none
        """Adds its equation to the balances of `e`."""

    def aims(self) -> tuple[Aim, ...]:
        """What it is after, to be given a sign at the design point."""
        return ()

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        """Limit or stop → records (N,) in which it acts, at a solution."""
        return {}


def select_middle(above_low: Value, below_high: Value, surplus: Value) -> Value:
    """The middle one of a, −b and F: zero where F = 0 between the stops, F ≥ 0 at the low one (a = 0) and F ≤ 0 at the
    high one (b = 0); F rises with the position. All (N,).

    Source: J.-S. Pang, Math. Oper. Res. 15 (1990) 311–341 (the natural residual of a mixed complementarity problem).
    """
    return maximum(-1.0 * below_high, minimum(above_low, surplus))


STOP_SHARE = 0.1
"""How far a stop plausibly lies from what is stated, as a share of the way between the stops. Judgement."""
BEYOND = 0.5
"""How far beyond a stop the iteration may go on its way, as a share of the way between them."""


@dataclass(frozen=True)
class Stops:
    """x = low + (high − low) (u − 1): position x in the actuator's unit, unknown u from 1 at the low stop to 2."""

    owner: str
    actuator: Actuator
    low: float
    high: float

    @property
    def unknown(self) -> str:
        return f"{self.owner}.position"

    def unknowns(self) -> tuple[Unknown, ...]:
        start = 1.0 + np.clip((self.actuator.neutral - self.low) / (self.high - self.low), 0.0, 1.0)
        return (Unknown(self.unknown, float(start), 1.0 - BEYOND, 2.0 + BEYOND),)

    def parameters(self) -> tuple[Parameter, ...]:
        sigma = STOP_SHARE * (self.high - self.low)
        found = []
        for quantity, nominal in (("low", self.low), ("high", self.high)):
            found.append(
                Parameter(
                    f"{self.owner}.{quantity}",
                    "design",
                    nominal,
                    self.actuator.lower,
                    self.actuator.upper,
                    sigma,
                    self.actuator.unit,
                    f"{quantity} stop of the {self.actuator.words}",
                    self.owner,
                    quantity,
                    f"{spelled(self.owner)} {quantity} stop",
                    spelled(self.owner),
                )
            )
        return tuple(found)

    def position(self, e: Evaluation) -> Value:
        low = e[f"{self.owner}.low"]
        return low + (e[f"{self.owner}.high"] - low) * (e[self.unknown] - 1.0)

    def unknown_from_position(self, e: Evaluation, position: Value) -> Value:
        """u of a position."""
        low = e[f"{self.owner}.low"]
        return 1.0 + (position - low) / (e[f"{self.owner}.high"] - low)

    def acting(self, e: Evaluation, within: float) -> Mapping[str, Array]:
        u = np.asarray(value(e[self.unknown]))
        return {f"{self.owner}.low": u - 1.0 < within, f"{self.owner}.high": 2.0 - u < within}


class SetPointControl(Control):
    """ψ(u − 1, 2 − u, F) = 0: the column is at its set point, or the actuator at a stop; F as `selected` gives
    it."""

    def __init__(self, name: str, stops: Stops, aim: Aim, limits: tuple[Aim, ...], release: Release | None = None):
        super().__init__(name, stops.actuator)
        self.stops, self.aim, self.limits, self.release = stops, aim, limits, release

    def aims(self) -> tuple[Aim, ...]:
        return (self.aim, *self.limits)

    def inputs(self) -> dict[str, float | None]:
        wander = {self.release.wander: 0.0} if self.release is not None and self.release.wander else {}
        return schedule_inputs(self.aims()) | wander

    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.stops.parameters(), *(p for aim in self.aims() for p in aim.parameters()))

    def unknowns(self) -> tuple[Unknown, ...]:
        return self.stops.unknowns()

    def position(self) -> Mapping[str, DerivedPosition]:
        return {self.actuator.name: self._position}

    def _position(self, e: Evaluation) -> Value:
        """Between the stops, or, released, as far off its rest as the wander says."""
        position = self.stops.position(e)
        r = self.release
        return position + r.rest_offset(e) if r is not None and r.wander else position

    def close(self, e: Evaluation, network: Network) -> None:
        u = e[self.stops.unknown]
        F = select_surplus(self.aim, self.limits, e, network)
        if self.release is not None:
            F = self.release.apply(F, e, network)
        e.balances[f"{self.name} position"] = network.paced(self, e, select_middle(u - 1.0, 2.0 - u, F))

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        found = dict(self.stops.acting(e, AT_LIMIT))
        free = ~np.any(list(found.values()), axis=0)
        limits = active_limits(self.limits, e, network)
        return found | {name: mask & free for name, mask in limits.items()}


def schedule_inputs(aims: tuple[Aim, ...]) -> dict[str, float | None]:
    """Columns that schedules of the recording's own read."""
    schedules = [aim.schedule for aim in aims if aim.schedule is not None]
    return {s.column: None for s in schedules if s.is_input}


def active_limits(limits: tuple[Aim, ...], e: Evaluation, network: Network) -> dict[str, Array]:
    """Which limits are met (N,)."""
    return {limit.name: np.abs(value(limit.surplus(e, network))) < AT_LIMIT for limit in limits}


FUEL_VALVE = Actuator("fuel", "kg/s", 0.0, 0.0, float("inf"), "fuel valve")


class Governor(Control):
    """F = 0 with F as `selected` gives it: the burner's fuel flow, an unknown already, has no stops of its own."""

    def __init__(self, name: str, aim: Aim, limits: tuple[Aim, ...]):
        super().__init__(name, FUEL_VALVE)
        self.aim, self.limits = aim, limits

    def aims(self) -> tuple[Aim, ...]:
        return (self.aim, *self.limits)

    def inputs(self) -> dict[str, float | None]:
        return schedule_inputs(self.aims())

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(p for aim in self.aims() for p in aim.parameters())

    def position(self) -> Mapping[str, DerivedPosition]:
        return {}

    def close(self, e: Evaluation, network: Network) -> None:
        e.balances[f"{self.name} fuel"] = network.paced(self, e, select_surplus(self.aim, self.limits, e, network))

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        return active_limits(self.limits, e, network)


class RecordedPosition(Control):
    """x = the input column, in the actuator's unit."""

    def __init__(self, name: str, actuator: Actuator, column: str):
        super().__init__(name, actuator)
        self.column = column

    def inputs(self) -> dict[str, float | None]:
        return {self.column: None}

    def position(self) -> Mapping[str, DerivedPosition]:
        return {self.actuator.name: lambda e: e[self.column]}


class ScheduledPosition(Control):
    """x = v(…) between the stops. Of an input it is known at once; of a model column, which lies further down the gas
    path, the position is an unknown and u − u(v) = 0 its balance."""

    def __init__(self, name: str, stops: Stops, schedule: Schedule):
        super().__init__(name, stops.actuator)
        self.stops, self.schedule = stops, schedule

    def inputs(self) -> dict[str, float | None]:
        return {self.schedule.column: None} if self.schedule.is_input else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.stops.parameters(), *self.schedule.parameters())

    def unknowns(self) -> tuple[Unknown, ...]:
        return () if self.schedule.is_input else self.stops.unknowns()

    def position(self) -> Mapping[str, DerivedPosition]:
        return {self.actuator.name: self._scheduled_position if self.schedule.is_input else self.stops.position}

    def close(self, e: Evaluation, network: Network) -> None:
        if not self.schedule.is_input:
            wanted = self.stops.unknown_from_position(e, self._stopped(e, self.schedule.evaluate(e, network)))
            e.balances[f"{self.name} position"] = network.paced(self, e, e[self.stops.unknown] - wanted)

    def acting(self, e: Evaluation, network: Network) -> Mapping[str, Array]:
        u = np.asarray(value(self.stops.unknown_from_position(e, self.schedule.evaluate(e, network))))
        return {f"{self.name}.low": u - 1.0 < -AT_LIMIT, f"{self.name}.high": 2.0 - u < -AT_LIMIT}

    def _scheduled_position(self, e: Evaluation) -> Value:
        return self._stopped(e, self.schedule.interpolate(e, e[self.schedule.column]))

    def _stopped(self, e: Evaluation, position: Value) -> Value:
        low, high = e[f"{self.name}.low"], e[f"{self.name}.high"]
        return minimum(maximum(position, low), high)
