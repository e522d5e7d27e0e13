"""The monitored parameter: one number that could be wrong with the engine, its sensors or the model.

Health parameters are scale factors of nominal 1 on what a component should do (`hpc.efficiency`); sensor
parameters are a bias of nominal 0 in the sensor's unit or a scale of nominal 1 (`sensor.T3.bias`); design
parameters describe the engine type itself (`hpc.map.work_slope`) and are identified, not monitored;
physics parameters are coefficients of effects, of nominal 0 where the effect is absent.
"""

from __future__ import annotations

from dataclasses import dataclass

FAMILIES = ("health", "sensor", "design", "physics")


@dataclass(frozen=True)
class Parameter:
    """A named number of the model with its nominal value and physical bounds.

    `prior_sigma` says how far the value plausibly lies from nominal, in the parameter's own unit.
    """

    name: str
    family: str
    nominal: float
    lower: float
    upper: float
    prior_sigma: float
    unit: str = ""
    description: str = ""
