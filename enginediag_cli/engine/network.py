"""The network: components and shafts in gas-path order, their unknowns and balances, and one evaluation.

`Coupling` says what the shafts drive and which of them turn together. `Demand` is the table from a recorded set point
to the power setting.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components import Unknown
from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.combustion import Afterburner, Burner
from enginediag_cli.engine.components.passages import Inlet
from enginediag_cli.engine.components.shaft_loads import SURPLUS, Gearbox, Load, Propeller
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.controls import Control, DerivedPosition, Governor
from enginediag_cli.engine.dual import Array, Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation, Flow, Hooks, Shaft
from enginediag_cli.engine.gas import Gas
from enginediag_cli.engine.start import correction, total_ratios
from enginediag_cli.engine.term import Effect, Place
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.evaluation import Sensor
    from enginediag_cli.engine.recall import Memory


DEMAND = Section(
    "power demand",
    "the power setting as a recorded set point asks for it: straight lines through the points of a table, which can be "
    "identified, and on beyond its ends",
    (
        Field("column", "text", "column of the set point, such as input_voltage_V"),
        Field("at", "numbers", "set points of the table, rising, in the column's unit"),
        Field("asks", "numbers", "power setting that each of them asks for, in the power setting's unit"),
        Field("sigma", "number", "standard deviation of the prior of each point, in the power setting's unit", None),
    ),
)
SIGMA_SHARE = 0.1
"""Of the largest power setting of the table, where no `sigma` is given. Judgement: a table read off a data sheet."""
LEAST_POINTS = 2
"""Of a straight line."""
LOWEST_SHARE, HIGHEST_SHARE = 0.001, 2.0
"""Bounds of a point of the table, as shares of the largest: a running engine gives some power."""


@dataclass(frozen=True)
class Demand:
    """setting(x) through points (xᵢ, pᵢ); the pᵢ are parameters `power_demand.point_i`, counted from 1."""

    column: str
    setting: str
    points: tuple[tuple[float, float], ...]
    sigma: float | None = None

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], setting: str) -> Demand:
        """From the checked section. Raises ValueError for tables that are none."""
        at, asks = values["at"], values["asks"]
        if len(at) != len(asks) or len(at) < LEAST_POINTS:
            raise ValueError(
                f"`at` has {len(at)} set points and `asks` {len(asks)}: two of each at least, as many of both"
            )
        if not all(a < b for a, b in pairwise(at)):
            raise ValueError("the set points under `at` must rise")
        if min(asks) <= 0.0:
            raise ValueError(f"every {setting} under `asks` must be above 0")
        if split_column(values["column"])[1] == "":
            raise ValueError(f"the column '{values['column']}' has no unit in its name, such as input_voltage_V")
        return cls(values["column"], setting, tuple(zip(at, asks, strict=True)), values["sigma"])

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"power_demand.point_{k}" for k in range(1, len(self.points) + 1))

    def parameters(self) -> tuple[Parameter, ...]:
        unit = split_column(self.setting)[1]
        what, of = split_column(self.column)
        largest = max(abs(p) for _, p in self.points)
        sigma = SIGMA_SHARE * largest if self.sigma is None else self.sigma
        return tuple(
            Parameter(
                name,
                "design",
                p,
                LOWEST_SHARE * largest,
                HIGHEST_SHARE * largest,
                sigma,
                unit,
                f"{self.setting} asked for at {x:g} {of} of {what}",
                "power_demand",
                f"point_{k}",
                f"power demand at {x:g} {of}",
                spelled("power_demand"),
            )
            for k, (name, (x, p)) in enumerate(zip(self.names, self.points, strict=True), start=1)
        )

    def set_point(self, setting: Array) -> Array:
        """The set point that asks for a power setting (N,), by the table as it is stated; at its ends beyond them."""
        x, p = zip(*self.points, strict=True)
        order = np.argsort(p)
        return np.interp(setting, np.array(p)[order], np.array(x)[order])

    def __call__(self, x: Array, theta: Mapping[str, Any]) -> tuple[Array, dict[str, Array], Array]:
        """Power setting at set points (N,), its derivatives (N,) by each of `names`, and by the set point."""
        at = np.array([x for x, _ in self.points])
        p = np.stack(np.broadcast_arrays(*(np.asarray(theta[n], float) for n in self.names)))
        k = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
        share = (x - at[k]) / (at[k + 1] - at[k])
        low, high = (p[k], p[k + 1]) if p.ndim == 1 else (p[k, np.arange(len(x))], p[k + 1, np.arange(len(x))])
        slopes = {
            name: np.where(k == i, 1.0 - share, 0.0) + np.where(k + 1 == i, share, 0.0)
            for i, name in enumerate(self.names)
        }
        return low + share * (high - low), slopes, (high - low) / (at[k + 1] - at[k])


DESIGN_SURPLUS = 1e-3
"""Share of its turbines' power by which a shaft may be out of balance at the design point of an engine with stated
loads: figures of a data sheet have three digits."""


class Coupling:
    """Shafts, their gears and their driven machines."""

    def __init__(self, shafts: Mapping[str, Mapping[str, Any]], components: Sequence[Component]):
        self.shafts = shafts
        self.machines = [c for c in components if isinstance(c, (Load, Propeller))]
        self.gears = [c for c in components if isinstance(c, Gearbox)]
        self.driving = {
            g.values["drives"]: g.values["shaft"] for g in self.gears
        }  # driven shaft → the one that drives it
        self.loaded = {c.values["shaft"] for c in (*self.machines, *self.gears)} | set(self.driving)
        took = {c.values["shaft"] for c in self.machines if c.values.get("law") == SURPLUS}
        self._turning = {name: self._group(name) for name in shafts}
        self.balanced = [s for s in shafts if s not in took and s not in self.driving]

    def coupled_shafts(self, name: str) -> list[str]:
        """The shafts that turn with this one at fixed ratios, that which drives the others first."""
        return self._turning[name]

    def _group(self, name: str) -> list[str]:
        first = self._first(name)
        return [first, *(s for s in self.shafts if s in self.driving and self._first(s) == first)]

    def _first(self, name: str) -> str:
        """The shaft at the beginning of the gears that drive this one."""
        while name in self.driving:
            name = self.driving[name]
        return name

    def ratio(self, name: str, other: str) -> float:
        """Speed of a shaft over that of another which turns with it."""
        return float(self.shafts[name]["design_speed_rpm"] / self.shafts[other]["design_speed_rpm"])

    def missing(self, e: Evaluation, name: str) -> Value:
        """What its turbines give beyond what is taken from a shaft, over what they give."""
        shaft = e.shaft(name)
        taken = shaft.demand_W + e[f"{name}.power_offtake_W"] + shaft.load_W
        return e[f"{name}.mechanical_efficiency"] - taken / shaft.supply_W

    def check_design(self, e: Evaluation) -> None:
        """Raises ValueError for a shaft whose stated loads do not add up to what its turbine gives at design."""
        for name in self.balanced:
            left = scalar(self.missing(e, name)) * scalar(e.shaft(name).supply_W)
            if name in self.loaded and abs(left) > DESIGN_SURPLUS * scalar(e.shaft(name).supply_W):
                more = "more" if left > 0.0 else "less"
                raise ValueError(
                    f"the turbines of shaft '{name}' give {abs(left):.4g} W {more} than is taken from it; leave the "
                    "design_power_W of one machine out, or the pressure_ratio of the turbine behind all of them, or "
                    f"let a machine of this shaft take {abs(left):.4g} W {more}"
                )


STATION_COLUMN = re.compile(r"(?P<what>T|P|W|FAR)(?P<station>.+?)(?:_K|_Pa|_kg_s)?")

OFFTAKE_SHARE = 0.01
"""Generators and pumps take up to about one per cent of a shaft's power, on small jets as on large engines."""
UNSIZED_W = 1.0
"""Spread of an off-take before the engine is sized, and the least there is: any positive number would do."""


def position_column(leaf: str) -> str:
    """Model column with the position of a controlled actuator: `compressor.vane_closing_deg` is
    `compressor_vane_closing_deg`."""
    return leaf.replace(".", "_")


class Network:
    """Collects unknowns and balances from the components; no engine has code of its own."""

    def __init__(
        self,
        gas: Gas,
        components: Sequence[Component],
        shafts: Sequence[Mapping[str, Any]],
        power_setting: str,
        design: Mapping[str, float],
        start: Mapping[str, float],
        controls: Sequence[Control] = (),
    ):
        self.gas = gas
        self.controls = tuple(controls)
        # the fuel control, where one is declared, and positions that controls set, by the leaf of the actuator
        self.governor = next((c for c in self.controls if isinstance(c, Governor)), None)
        self.derived: dict[str, DerivedPosition] = {
            leaf: at for c in self.controls for leaf, at in c.position().items()
        }
        self.components = tuple(components)
        self.shafts = {s["name"]: s for s in shafts}
        self.power_setting = power_setting
        self.design = dict(design)
        self.coupling = Coupling(self.shafts, components)
        self.loaded_shafts = self.coupling.loaded
        self.speed_columns = {f"{s['speed_label']}_rpm": name for name, s in self.shafts.items()}
        # the first is the one whose fuel the power setting sets or leaves open
        self.burners = [c.name for kind in (Burner, Afterburner) for c in components if isinstance(c, kind)]
        self.inlet_exit = next((c.values["to"] for c in components if isinstance(c, Inlet)), "")
        self.last_turbine_exit = next((c.values["to"] for c in reversed(components) if isinstance(c, Turbine)), "")
        self.neutral: dict[str, Value] = {a.name: a.neutral for c in components for a in c.actuators()}
        self.design_theta2 = 1.0
        self.design_setting = 1.0  # corrected power setting of the design point
        self._start = dict(start)
        self._unknowns: tuple[Unknown, ...] | None = None
        self.remembered: tuple[str, ...] = ()  # leaves of what is remembered: 0 in equilibrium
        self.hooks: Hooks | None = None  # of the effects that the model carries
        self.effects: tuple[Effect, ...] = ()
        self.design_point: Evaluation | None = None  # the sized engine there, before any effect
        self.demand: Demand | None = None  # what sets the power setting, where that is not a column itself
        self.sensors: Mapping[str, Sensor] = {}  # of the engine that this is, by column: where effects on readings act

    # what is given and what is sought

    @property
    def power_leaf(self) -> str | None:
        """The leaf that the power setting fixes; None when it fixes an output through a balance, or asks the fuel
        control for it."""
        if self.governor is not None:
            return None
        if self.power_setting == "Wf_kg_s":
            return f"{self.burners[0]}.fuel_flow"
        if self.power_setting in self.speed_columns:
            return f"{self.speed_columns[self.power_setting]}.speed_rpm"
        return None

    @property
    def air_speed_column(self) -> str | None:
        """The recorded speed of the shaft that turns the first compressor, which air flow follows; None if none is."""
        for c in self.components:
            if isinstance(c, Compressor):
                turning = self.coupling.coupled_shafts(c.values["shaft"])
                found = [s for s in turning if self.shafts[s]["speed"] == "input"]
                return f"{self.shafts[found[0]]['speed_label']}_rpm" if found else None
        return None

    def design_corrected_speed(self, column: str) -> float:
        """N/√θ₂ [rpm] of a speed column at the design point."""
        return float(self.shafts[self.speed_columns[column]]["design_speed_rpm"] / self.design_theta2**0.5)

    @property
    def memories(self) -> tuple[Memory, ...]:
        """Memories of the effects, in their order."""
        return tuple(self.hooks.memories) if self.hooks is not None else ()

    def inputs(self) -> dict[str, float | None]:
        """Input columns and the default of those that are optional, as the network itself reads them."""
        found: dict[str, float | None] = {}
        for c in self.components:
            found.update(c.inputs())
        for column, name in self.speed_columns.items():
            if self.shafts[name]["speed"] == "input":
                found[column] = None
        found[self.power_setting] = None
        for control in self.controls:
            found.update(control.inputs())
        for effect in self.effects:
            for column, default in effect.term.INPUTS.items():
                found.setdefault(column, default)
            if effect.switch:
                found.setdefault(effect.switch, 0.0)
        return found

    def unknowns(self) -> tuple[Unknown, ...]:
        if self._unknowns is None:
            self._unknowns = self._collected_unknowns()
        return self._unknowns

    def open_unknowns(self) -> tuple[Unknown, ...]:
        """Unknowns of the engine without its controls."""
        own = {u.name for control in self.controls for u in control.unknowns()}
        return tuple(u for u in self.unknowns() if u.name not in own)

    @property
    def fuel_unknown(self) -> str:
        """The unknown that stands for fuel flow where that is not given."""
        return f"{self.burners[0]}.corrected_fuel"

    def possible_unknowns(self) -> list[str]:
        """Names of the unknowns of any power setting."""
        return [u.name for c in self.components for u in c.unknowns()] + [f"{s}.corrected_speed" for s in self.shafts]

    def _collected_unknowns(self) -> tuple[Unknown, ...]:
        given = self.power_leaf
        found: list[Unknown] = []
        for c in self.components:
            if not (isinstance(c, Burner) and given == f"{c.name}.fuel_flow"):
                found.extend(c.unknowns())
        for name in self.shafts:
            turning = self.coupling.coupled_shafts(name)
            if name == turning[0] and not any(
                self.shafts[m]["speed"] != "balance" or given == f"{m}.speed_rpm" for m in turning
            ):
                found.append(Unknown(f"{name}.corrected_speed", lower=0.05, upper=2.0))
        found += [u for control in self.controls for u in control.unknowns()]
        if self.hooks is not None:
            found += [Unknown(s.name, s.start) for s in self.hooks.solved]
        return tuple(replace(u, start=self._start.get(u.name, u.start)) for u in found)

    def parameters(self) -> tuple[Parameter, ...]:
        found = [p for c in self.components for p in c.parameters()]
        # cooling air goes through orifices: nobody opens and closes it
        cooling = {f"{c.name}.{port}.fraction" for c in self.components for port in self._cooling_ports(c)}
        found = [replace(p, switches=False) if p.name in cooling else p for p in found]
        for name, s in self.shafts.items():
            found.append(
                Parameter(
                    f"{name}.mechanical_efficiency",
                    "design",
                    s["mechanical_efficiency"],
                    0.7,
                    1.05,
                    0.005,
                    "1",
                    "share of turbine power that reaches the shaft",
                    name,
                    "mechanical_efficiency",
                    f"{spelled(name)} mechanical efficiency",
                    spelled(name),
                )
            )
            found.append(
                Parameter(
                    f"{name}.power_offtake_W",
                    "design",
                    s["power_offtake_W"],
                    -1e7,
                    1e8,
                    self._offtake_spread(name),
                    "W",
                    "power taken from the shaft",
                    name,
                    "power_offtake_W",
                    f"{spelled(name)} power offtake",
                    spelled(name),
                    switches=True,
                )
            )
        found += [p for control in self.controls for p in control.parameters()]
        if self.demand is not None:
            found += self.demand.parameters()
        return (*found, *(p for effect in self.effects for p in effect.parameters()))

    def _offtake_spread(self, name: str) -> float:
        """How far the off-take of a shaft plausibly lies from what is stated, W: a share of the power that it carries
        at the design point, of its compressors or, where it has none, of its turbines."""
        if self.design_point is None:
            return UNSIZED_W
        shaft = self.design_point.shaft(name)
        carried = (scalar(w) for w in (shaft.demand_W, shaft.supply_W, shaft.load_W))
        return max(OFFTAKE_SHARE * next((w for w in carried if w), 0.0), UNSIZED_W)

    def _cooling_ports(self, component: Component) -> list[str]:
        """Bleed ports of a component whose air a turbine takes in again."""
        taken = {
            name
            for c in self.components
            for key in ("cooling_before_rotor", "cooling_after_rotor")
            for name in c.values.get(key, ())
        }
        return [port["name"] for port in component.values.get("ports", ()) if port["name"] in taken]

    def replace_effects(self, effects: Sequence[Effect]) -> Network:
        """The same sized components, carrying these effects and no others."""
        other = copy.copy(self)
        other.effects, other.hooks = tuple(effects), Hooks() if effects else None
        other.remembered = ()
        for effect in effects:
            assert other.hooks is not None
            effect.term.install(Place(other, effect, other.hooks))
        other.remembered = tuple(m.name for m in other.memories if not m.column)
        other._unknowns = None
        return other

    # one evaluation

    def leaves(
        self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Mapping[str, Value]
    ) -> dict[str, Value]:
        """All leaves of a pass: input columns under the names that the components read, parameters, unknowns."""
        found: dict[str, Value] = {**self.neutral, **dict.fromkeys(self.remembered, 0.0), **parameters, **x, **inputs}
        if self.power_leaf:
            found[self.power_leaf] = inputs[self.power_setting]
        for column, name in self.speed_columns.items():
            if self.shafts[name]["speed"] == "input":
                found[f"{name}.speed_rpm"] = inputs[column]
            elif self.shafts[name]["speed"] == "constant":
                found[f"{name}.speed_rpm"] = self.shafts[name]["design_speed_rpm"]
        return found

    def input_leaf(self, column: str) -> str:
        """The leaf that an input column sets, for derivatives with respect to inputs."""
        if column == self.power_setting and self.power_leaf:
            return self.power_leaf
        if column in self.speed_columns and self.shafts[self.speed_columns[column]]["speed"] == "input":
            return f"{self.speed_columns[column]}.speed_rpm"
        return column

    def evaluate(self, e: Evaluation) -> None:
        """All components in order, then the shafts' power balances, the control balance and net thrust."""
        self.open_loop(e)
        if self.power_leaf is None and self.governor is None:
            asked = e[self.power_setting]
            e.balances[f"power setting {self.power_setting}"] = self.read(e, self.power_setting) / asked - 1.0
        for control in self.controls:
            control.close(e, self)
            for leaf in control.position():
                e.outputs[position_column(leaf)] = e[leaf]
        for solved in self.hooks.solved if self.hooks is not None else ():
            e.balances[solved.name] = e[solved.name] / solved.read(e) - 1.0

    def rate(self, e: Evaluation, column: str) -> Value:
        """d(column)/dt, in the column's unit per second: nothing moves in a steady engine."""
        return 0.0

    def paced(self, control: Control, e: Evaluation, surplus: Value) -> Value:
        """What a control has to bring to zero, from by how much its actuator stands too far up: that, when steady."""
        return surplus

    def open_loop(self, e: Evaluation) -> None:
        """The same without what holds the power setting and without the controls."""
        e.make_shaft = self._shaft
        for c in self.components:
            c.evaluate(e)
        self._close(e)

    def size(self, e: Evaluation) -> None:
        """Sizes every component at the design point; ValueError says what cannot be."""
        e.make_shaft = self._shaft
        for c in self.components:
            c.size(e)
            if isinstance(c, Inlet):
                self.design_theta2 = scalar(e.theta2)
        self._close(e)
        self.neutral = {a.name: a.neutral for c in self.components for a in c.actuators()}
        theta, delta = total_ratios({c: e.leaves[c] for c in self.inputs() if c in e.leaves})
        self.design_setting = self._design_setting(e) / scalar(correction(self.power_setting, theta, delta))
        self.design_point = e

    def _design_setting(self, e: Evaluation) -> float:
        """The power setting of a sized design point: what a lever must ask for, or what the model has in its column."""
        asked = self.governor.aim.schedule if self.governor is not None else None
        if self.governor is not None and asked is not None and asked.column == self.power_setting:
            return asked.inverse(scalar(self.read(e, self.governor.aim.column)))
        return scalar(self.read(e, self.power_setting))

    def _shaft(self, e: Evaluation, name: str) -> Shaft:
        """Given speed, or design speed times the unknown times √(θ₂/θ₂,design)."""
        if e.has_leaf(f"{name}.speed_rpm"):
            return Shaft(e[f"{name}.speed_rpm"])
        for other in self.coupling.coupled_shafts(name):
            if e.has_leaf(f"{other}.speed_rpm"):
                return Shaft(e[f"{other}.speed_rpm"] * self.coupling.ratio(name, other))
        root = sqrt(e.theta2 * (1.0 / self.design_theta2))
        leading = self.coupling.coupled_shafts(name)[0]
        return Shaft(e[f"{leading}.corrected_speed"] * (root * self.shafts[name]["design_speed_rpm"]))

    def _close(self, e: Evaluation) -> None:
        for name, s in self.shafts.items():
            shaft = e.shaft(name)
            e.outputs[f"{s['speed_label']}_rpm"] = shaft.speed_rpm
            if name in self.coupling.balanced:
                e.balances[f"{name} power"] = self.coupling.missing(e, name)
        if "gross_thrust_N" in e.outputs:
            e.add_output("Fn_N", e.outputs["gross_thrust_N"] - e.outputs["ram_drag_N"])

    # outputs

    def acting(self, e: Evaluation) -> dict[str, Array]:
        """Limits and stops that act somewhere, and where (N,), at a solution."""
        found = (control.acting(e, self) for control in self.controls)
        return {name: mask for one in found for name, mask in one.items() if np.any(mask)}

    def columns(self, e: Evaluation) -> tuple[str, ...]:
        """Every column that the model gives, as an evaluation shows."""
        stations = (f"{w}{s}{u}" for s in e.flows for w, u in (("T", "_K"), ("P", "_Pa"), ("W", "_kg_s"), ("FAR", "")))
        return (*e.outputs, *stations, "OPR", "EPR", "SFC_kg_Ns")

    def read(self, e: Evaluation, column: str) -> Value:
        """A model column: T<station>_K, P<station>_Pa, W<station>_kg_s, FAR<station>, speeds, thrust, fuel, …

        EPR is the total pressure behind the last turbine over that at the engine's inlet, as instruments take it."""
        if column in e.outputs:
            return e.outputs[column]
        if column == "OPR":
            return e.flows["3"].P / e.flows["2"].P
        if column == "SFC_kg_Ns":
            return e.outputs.get("Wf_total_kg_s", e.outputs["Wf_kg_s"]) / e.outputs["Fn_N"]
        if column == "EPR":
            return e.flows[self.last_turbine_exit].P / e.flows[self.inlet_exit].P
        match = STATION_COLUMN.fullmatch(column)
        if match is None or match["station"] not in e.flows:
            raise KeyError(column)
        flow: Flow = e.flows[match["station"]]
        if match["what"] == "FAR":
            return 0.0 if flow.mixture.far is None else flow.mixture.far
        return {"T": lambda: flow.T, "P": lambda: flow.P, "W": lambda: flow.W}[match["what"]]()
