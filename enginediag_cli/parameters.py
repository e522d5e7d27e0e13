"""The monitored parameter: one number that could be wrong with the engine, its sensors or the model.

Health parameters are scale factors of nominal 1 on what a component should do (`hpc.efficiency`); sensor
parameters are a bias of nominal 0 in the sensor's unit or a scale of nominal 1 (`sensor.T3.bias`), input
parameters the same of an instrument that gives the model an input (`input.Wf.scale`); actuator parameters say how far a
valve or a vane is from where it should be (`bleed.hpc.fraction`), of nominal 0; design
parameters describe the engine type itself (`hpc.map.work_slope`) and are identified, not monitored;
physics parameters are coefficients of effects, of nominal 0 where the effect is absent.

The meaning of a parameter is in its fields. Files and commands use its name, which is never parsed for meaning.

The prior probabilities of faults are here too, each for one recording that is judged.

Components wear, and an engine that is judged is seldom new. Valves that bleed a compressor, to keep it from surging or
for the aircraft, leak and stick as often as a module is at fault: a public benchmark of gas-path diagnostics draws its
faults of the variable bleed valve and of the variable vanes as often as those of each module (Simon, D. L. (2010)
Propulsion Diagnostic Method Evaluation Strategy (ProDiMES) User's Guide, NASA/TM-2010-215840), and leaks of bleeds are
among the faults that every programme of single faults holds (Volponi, A. J., DePold, H., Ganguli, R. and Daguang, C.
(2003) Journal of Engineering for Gas Turbines and Power 125, 917–924). Instruments are checked and replaced.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

PARAMETER = 0.1
"""That a parameter of a component has changed, or that a bleed valve stands off where it should: of five components
with two parameters each, one on the average. Judgement, to which `SetPrior.spread` adds a factor of two either way."""
INSTRUMENT = 0.005
"""That an instrument is wrong: of sixteen one is then wrong in one window of thirteen. The chance is taken from every
answer that records cannot defend against a wrong instrument beside it, as single records cannot. Judgement."""
MOST_AT_ONCE = 2
"""Instruments and valves that are wrong at once at most: each fails by itself, and three hardly ever do."""
FORMS = 5
"""Bias, scale, drift, stuck, noise: forms of one fault of an instrument, each as probable as the others."""
UNLISTED = 0.02
"""That what happened is none of what is listed: once in fifty windows. Judgement."""

FAMILIES = ("health", "sensor", "input", "actuator", "design", "physics", "discrepancy", "map_error")

ABBREVIATIONS = frozenset(
    {"lpc", "ipc", "hpc", "lpt", "ipt", "hpt", "lp", "ip", "hp", "itt", "egt", "n1", "n2", "igv", "vsv"}
)
"""Component and shaft names that people write in capitals."""

FARTHEST_READING = 0.3
"""Share of its largest reading by which an instrument may be wrong at most: a probe, a transducer or a meter that is
off by more is dead, or in another unit."""

MEANING = ("name", "family", "component", "quantity", "words", "part", "unit", "wear", "reach")
"""What travels with statistics, so that they are understood where the engine is not at hand."""


@dataclass(frozen=True)
class Parameter:
    """A named number of the model with its nominal value, physical bounds and meaning.

    `prior_sigma` says how far the value plausibly lies from nominal, in the parameter's own unit. `component`: the
    part of the engine that an engineer would look at ("hpc", the shaft "hp", the instrument "sensor.T45");
    `quantity`: what of it the number is ("efficiency", "flow_capacity", "bias"); `words`: both as an engineer says
    them, without article ("HPC isentropic efficiency"), `part` the component alone ("HPC", "T45 sensor"). `wear`: −1
    where wear and damage can only lower the value (an efficiency), +1 where they can only raise it, 0 where both
    occur. `roams`: how far the value may plausibly vary along a driver (rms, in its unit) when a place is sought where
    physics is missing; None where such a search has no business; `proportional`: that range is a part of the nominal
    value and moves with it; `switches`: somebody commands it (a bleed, a load), so that it may change within seconds
    and back, which wear, geometry and losses do not. `reach`: how far an instrument can be wrong, in `prior_sigma`;
    infinite where that is not known.
    """

    name: str
    family: str
    nominal: float
    lower: float
    upper: float
    prior_sigma: float
    unit: str = ""
    description: str = ""
    component: str = ""
    quantity: str = ""
    words: str = ""
    part: str = ""
    wear: int = 0
    roams: float | None = None
    proportional: bool = False
    switches: bool = False
    reach: float = inf

    @property
    def belongs_to_sensor(self) -> bool:
        """Whether it is an error of a measured output, which touches one reading and no balance of the engine."""
        return self.family == "sensor"

    @property
    def belongs_to_instrument(self) -> bool:
        """Whether it is an error of an instrument, of a measured output or of an input of the model."""
        return self.family in ("sensor", "input")

    @property
    def fails_alone(self) -> bool:
        """Whether it seldom changes, and by itself: an instrument or an actuator, which do not wear with the engine."""
        return self.belongs_to_instrument or self.family == "actuator"

    def with_nominal(self, nominal: float) -> Parameter:
        """The same parameter with another nominal value, as identified."""
        roams = self.roams
        if roams is not None and self.proportional:
            roams *= abs(nominal or self.prior_sigma) / abs(self.nominal or self.prior_sigma)
        return replace(self, nominal=nominal, roams=roams)

    @property
    def shown_unit(self) -> str:
        """The unit as a reader sees it: a scale factor, of unit "1", has none."""
        return "" if self.unit == "1" else self.unit

    def as_mapping(self) -> dict[str, Any]:
        """Its meaning (MEANING) as plain values; nominal, bounds and spread stay with the engine."""
        found = {name: getattr(self, name) for name in MEANING}
        if not isfinite(self.reach):
            del found["reach"]
        return found

    @staticmethod
    def from_mapping(values: Mapping[str, Any]) -> Parameter:
        """A parameter of this meaning, without bounds. ValueError says which entry is missing, unknown or wrong."""
        types: dict[str, type | tuple[type, ...]] = dict.fromkeys(MEANING, str)
        types |= {"wear": int, "reach": (int, float)}
        kinds = {"wear": "a whole number", "reach": "a number"}
        values = {"reach": inf, **values}
        for name, kind in types.items():
            if name not in values:
                raise ValueError(f"{name!r} is missing")
            if not isinstance(values[name], kind) or isinstance(values[name], bool):
                raise ValueError(f"{name!r} is not {kinds.get(name, 'a text')}: {values[name]!r}")
        if unknown := [name for name in values if name not in types]:
            raise ValueError(f"unknown entry {unknown[0]!r}")
        if values["family"] not in FAMILIES:
            raise ValueError(f"'family' is none of {', '.join(FAMILIES)}: {values['family']!r}")
        if values["wear"] not in (-1, 0, 1):
            raise ValueError(f"'wear' is none of -1, 0, 1: {values['wear']!r}")
        if not values["name"] or not values["component"]:
            raise ValueError("'name' and 'component' must not be empty")
        if not values["reach"] > 0:
            raise ValueError(f"'reach' is not positive: {values['reach']!r}")
        return Parameter(nominal=0.0, lower=-inf, upper=inf, prior_sigma=inf, **values)


def unspecified(name: str, unit: str = "") -> Parameter:
    """A parameter of which only the name is known: a part of its own, that may change either way."""
    return Parameter(name, "health", 0.0, -inf, inf, inf, unit, component=name, words=name, part=name)


def meanings(parameters: Mapping[str, Parameter], names: Iterable[str]) -> dict[str, Parameter]:
    """The parameters of these names; one that is not described is `unspecified`."""
    return {name: parameters[name] if name in parameters else unspecified(name) for name in names}


def spelled(name: str) -> str:
    """A name with spaces for its dots and underscores and the usual capitals: "hpc" is the "HPC"."""
    parts = name.replace(".", " ").replace("_", " ").split(" ")
    return " ".join(part.upper() if part in ABBREVIATIONS else part for part in parts)
