"""A realistic truth: all of what this folder holds, drawn for one trial, and recordings as they come of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.validation.blind.truths.airline import airline_sensors
from enginediag_cli.validation.blind.truths.clocks import Clocks, draw_clocks
from enginediag_cli.validation.blind.truths.heat_soak import HeatSoak, draw_heat_soak
from enginediag_cli.validation.blind.truths.instruments import Instruments, draw_instruments
from enginediag_cli.validation.blind.truths.recorder import Recorder, draw_recorder
from enginediag_cli.validation.blind.truths.tables import tabulated

SHAPE = (0.003, 0.015)
"""Error of a map's shape, from and to, drawn on a logarithmic scale: more than an engine file states."""
AIRLINE = 1.0 / 3.0
"""Share of trials with airline sensors only."""
SOAKED = 0.5
"""Share of trials with a heat-soaked probe."""
RHO = (0.0, 0.8)
"""Correlation of noise from record to record, from and to."""

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Realistic:
    """What is wrong with the model and its instruments in one trial. `shape`: error of the maps; `maps`: seed of their
    tables; `sensors`: those recorded, those of a cockpit where `airline`; `rho`: correlation of their noise."""

    shape: float
    maps: int
    airline: bool
    sensors: tuple[str, ...]
    instruments: Instruments
    clocks: Clocks
    soak: HeatSoak | None
    rho: float
    recorder: Recorder

    def only(self, flights: Sequence[int]) -> Realistic:
        """The same of these flights alone, in this order."""
        instruments = replace(self.instruments, flights=tuple(self.instruments.flights[k] for k in flights))
        soak = self.soak and replace(self.soak, before=tuple(self.soak.before[k] for k in flights))
        return replace(self, instruments=instruments, soak=soak)

    def read(self, flight: int, columns: Columns) -> dict[str, np.ndarray]:
        """Time, inputs and true outputs (N,) of one flight → what its instruments show, but for noise."""
        time = columns["time_s"]
        if self.soak is not None and self.soak.column in self.sensors:
            columns = self.soak.read(flight, time, columns)
        columns = self.recorder.follow(time, columns)
        return self.instruments.read(flight, self.clocks.sample(time, columns))

    def write(self, engine: Engine, columns: Columns, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """What the recorder writes of such columns (N,): noise, steps of rounding, missing and gross cells."""
        return self.recorder.write(noisy(engine, self.rho, columns, rng), rng)


def draw_realistic(
    engine: Engine, flights: Sequence[Columns], rng: np.random.Generator, *, airline: float = AIRLINE
) -> Realistic:
    """The errors of one trial with these flights; airline: chance that only a cockpit's sensors are recorded."""
    cockpit = bool(rng.random() < airline)
    soak = draw_heat_soak(engine, len(flights), rng)
    flown = {c: np.concatenate([f[c] for f in flights]) for c in engine.inputs}
    return Realistic(
        float(np.exp(rng.uniform(*np.log(SHAPE)))),
        int(rng.integers(2**62)),
        cockpit,
        airline_sensors(engine) if cockpit else tuple(engine.sensors),
        draw_instruments(engine, len(flights), rng),
        draw_clocks((*engine.inputs, *engine.sensors), rng),
        soak if rng.random() < SOAKED else None,
        float(rng.uniform(*RHO)),
        draw_recorder(engine, flown, rng),
    )


def remembering(white: np.ndarray, rho: float) -> np.ndarray:
    """AR(1) of unit variance from white noise (n, m): e_k = ρ e_{k−1} + √(1 − ρ²) w_k."""
    from scipy.signal import lfilter

    if not rho or not len(white):
        return white
    shocks = np.sqrt(1.0 - rho**2) * white
    shocks[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=0))


def noisy(engine: Engine, rho: float, columns: Columns, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns (N,) with the noise of the sensors, of this correlation."""
    e = remembering(rng.standard_normal((len(columns["time_s"]), len(engine.sensors))), rho)
    noise = {c: s.noise_sigma * e[:, j] for j, (c, s) in enumerate(engine.sensors.items())}
    return {c: v + noise[c] if c in noise else v for c, v in columns.items()}


def realistic_engine(engine: Engine, drawn: Realistic, flown: Columns) -> Engine:
    """The truth engine, whose tables are written, read back and gone; flown: inputs (N,) of all flights."""
    inputs = {c: flown[c] for c in engine.inputs}
    with TemporaryDirectory(prefix="enginediag_sealed_") as folder:
        return tabulated(engine, inputs, drawn.shape, np.random.default_rng(drawn.maps), Path(folder))
