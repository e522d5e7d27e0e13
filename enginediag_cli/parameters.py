"""The monitored parameter: one number that could be wrong with the engine, its sensors or the model.

Health parameters are scale factors of nominal 1 on what a component should do (`hpc.efficiency`); sensor
parameters are a bias of nominal 0 in the sensor's unit or a scale of nominal 1 (`sensor.T3.bias`); design
parameters describe the engine type itself (`hpc.map.work_slope`) and are identified, not monitored;
physics parameters are coefficients of effects, of nominal 0 where the effect is absent.

What a parameter means stands in its fields. Its name is how files and commands call it, and is never read for more.
"""

from __future__ import annotations

from dataclasses import dataclass

FAMILIES = ("health", "sensor", "design", "physics")


@dataclass(frozen=True)
class Parameter:
    """A named number of the model with its nominal value, physical bounds and meaning.

    `prior_sigma` says how far the value plausibly lies from nominal, in the parameter's own unit. `component`: the
    part of the engine that an engineer would look at ("hpc", the shaft "hp", the instrument "sensor.T45");
    `quantity`: what of it the number is ("efficiency", "flow_capacity", "bias"); `words`: both as an engineer says
    them, without article ("HPC isentropic efficiency"). `wear`: −1 where wear and damage can only lower the value
    (an efficiency), +1 where they can only raise it, 0 where both occur. `roams`: how far the value may plausibly
    vary along a driver (rms, in its unit) when a place is sought where physics is missing; None where such a search
    has no business.
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
    wear: int = 0
    roams: float | None = None

    @property
    def of_sensor(self) -> bool:
        """Whether it is an error of an instrument, which touches one reading and no balance of the engine."""
        return self.family == "sensor"
