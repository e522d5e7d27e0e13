"""Instruments that differ from flight to flight: what a reading, of an output or of an input, is off by in one flight.

reading = (1 + scale) · true + bias, with scale and bias drawn anew for every flight and constant in it. Outputs: both
in proportion to the sensor's noise, so that an engine with better instruments has better ones here, too. Inputs: what
air-data computers, fuel meters and speed pick-ups are good for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.units import split_column

QUALITY = (0.3, 1.2)
"""Factor on all of the sizes below, drawn for each engine: fleets are calibrated with more care, or less."""
BIAS = 0.5
"""Standard deviation of an output's offset over its noise. Judgement: sixty records tell an offset of a tenth, so what
is drawn here is plain to see, and far below what a check of the reading itself would find."""
SCALE = 0.0005
"""Standard deviation of an output's scale error."""
INPUT_BIAS: Mapping[str, float] = {
    "altitude_m": 12.0,
    "mach": 0.0015,
    "dT_isa_K": 0.4,
    "ambient_temperature_K": 0.4,
    "ambient_pressure_Pa": 50.0,
    "dP_inlet_Pa": 10.0,
}
"""Standard deviation of an input's offset, in its unit."""
POWER_SCALE, SPEED_SCALE, TEMPERATURE_SCALE = 0.003, 0.0003, 0.001
"""Standard deviation of the scale error of a flow, of a speed, and of a temperature that sets the power (1.3 K)."""


@dataclass(frozen=True)
class Instruments:
    """Of every flight: column → (scale error, bias in the column's unit); `spread`: column → standard deviations of
    both."""

    flights: tuple[Mapping[str, tuple[float, float]], ...]
    spread: Mapping[str, tuple[float, float]]

    def read(self, flight: int, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight as its instruments show them."""
        off = self.flights[flight]
        return {c: v * (1.0 + off[c][0]) + off[c][1] if c in off else v for c, v in columns.items()}


def draw_instruments(engine: Engine, flights: int, rng: np.random.Generator) -> Instruments:
    """Instruments of so many flights."""
    quality = float(rng.uniform(*QUALITY))
    sizes = {c: (SCALE, BIAS * s.noise_sigma) for c, s in engine.sensors.items()}
    sizes |= {c: input_spread(c) for c in engine.inputs}
    spread = {c: (quality * scale, quality * bias) for c, (scale, bias) in sizes.items()}
    drawn = tuple(
        {c: (a * rng.standard_normal(), b * rng.standard_normal()) for c, (a, b) in spread.items()}
        for _ in range(flights)
    )
    return Instruments(drawn, spread)


def input_spread(column: str) -> tuple[float, float]:
    """Standard deviations, from flight to flight, of scale error and bias of an input; one of them is 0."""
    if column in INPUT_BIAS:
        return 0.0, INPUT_BIAS[column]
    unit = split_column(column)[1]
    return {"rpm": SPEED_SCALE, "K": TEMPERATURE_SCALE}.get(unit, POWER_SCALE), 0.0
