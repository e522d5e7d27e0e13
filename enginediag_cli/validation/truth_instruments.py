"""Realistic truths: instruments, clocks, probes and recorders with the errors that they have in the field.

**Instruments** differ from flight to flight: reading = (1 + scale) · true + bias, with scale and bias drawn for every
flight and constant in it. Errors of outputs are in proportion to the sensor's noise, so that an engine with better
instruments has smaller ones. Errors of inputs are those of air-data computers, fuel meters and speed pick-ups.

**A heat-soaked probe** reads partly the temperature of the metal around it,

    reading = T + k (T_m − T),        τ dT_m/dt = T − T_m

with T_m at the first record offset by what the engine did before. The share k is small and the lag τ is minutes: a
climb reads low and a descent high.

**Airline sensors**: only what a cockpit shows is recorded. N1, N2, EGT and fuel flow of a turbofan; speed, EGT and fuel
flow of a turbojet; torque, turbine temperature and fuel flow of a turboshaft; power and exhaust temperature of a power
plant.

**Clocks** disagree by up to a second: a bus that collects readings of several computers stamps them on arrival. The
reading of record k is that of the time t_k − τ, with a delay τ per column, the same in all flights of an engine, linear
between records.

**The recorder.** A sensor follows its reading with a first-order lag. Between records the reading is a straight line,
for which the deviation d = shown − true obeys, with a = exp(−Δt/τ) and the slope s_k of the line that ends at record k,

    d_k = a d_{k−1} − τ s_k (1 − a)

Readings are rounded to a step of their own. A cell of an output is missing with probability MISSING, and any cell, of
outputs and inputs, is off by SPIKE times its noise with probability SPIKES.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from enginediag_cli.engine.components.turbomachinery import Turbine
from enginediag_cli.engine.engine import Engine
from enginediag_cli.units import split_column
from enginediag_cli.validation.truth_engines import tabulate_engine

SHARE, LAG_S = (0.003, 0.02), (100.0, 900.0)
"""k and τ, from and to, drawn on a logarithmic scale."""
BEFORE_K = 60.0
"""Standard deviation of the metal's temperature from the gas at the first record."""


@dataclass(frozen=True)
class SoakedProbe:
    """The probe's column, k, τ [s], and T_m − T at the first record of every flight [K]."""

    column: str
    share: float
    lag_s: float
    before: tuple[float, ...]

    def read(self, flight: int, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight, its records equally far apart, with the probe's reading."""
        from scipy.signal import lfilter

        true, good = columns[self.column], np.isfinite(columns[self.column])
        if good.sum() < 2:
            return dict(columns)
        gas = np.interp(time_s, time_s[good], true[good])
        kept = np.exp(-float(np.median(np.diff(time_s))) / self.lag_s)
        metal, _ = lfilter([1.0 - kept], [1.0, -kept], gas, zi=[kept * (gas[0] + self.before[flight])])
        return {**columns, self.column: true + self.share * (metal - true)}


def draw_heat_soak(engine: Engine, flights: int, rng: np.random.Generator) -> SoakedProbe | None:
    """A soaked probe, any of the engine's recorded temperatures; None for an engine that has none."""
    probes = [c for c in engine.sensors if split_column(c)[1] == "K"]
    if not probes:
        return None
    share, lag = (float(np.exp(rng.uniform(*np.log(of)))) for of in (SHARE, LAG_S))
    before = tuple(float(x) for x in BEFORE_K * rng.standard_normal(flights))
    return SoakedProbe(str(rng.choice(probes)), share, lag, before)


QUALITY = (0.3, 1.2)
"""Factor on all of the sizes below, drawn for each engine: fleets are calibrated with more care, or less."""
BIAS = 0.5
"""Standard deviation of an output's offset over its noise. Judgement: sixty records show an offset of a tenth, so what
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
class FlightInstruments:
    """Of every flight: column → (scale error, bias in the column's unit); `spread`: column → standard deviations of
    both."""

    flights: tuple[Mapping[str, tuple[float, float]], ...]
    spread: Mapping[str, tuple[float, float]]

    def read(self, flight: int, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight as its instruments show them."""
        off = self.flights[flight]
        return {c: v * (1.0 + off[c][0]) + off[c][1] if c in off else v for c, v in columns.items()}


def draw_instruments(engine: Engine, flights: int, rng: np.random.Generator) -> FlightInstruments:
    """Instruments of so many flights."""
    quality = float(rng.uniform(*QUALITY))
    sizes = {c: (SCALE, BIAS * s.noise_sigma) for c, s in engine.sensors.items()}
    sizes |= {c: input_spread(c) for c in engine.inputs}
    spread = {c: (quality * scale, quality * bias) for c, (scale, bias) in sizes.items()}
    drawn = tuple(
        {c: (a * rng.standard_normal(), b * rng.standard_normal()) for c, (a, b) in spread.items()}
        for _ in range(flights)
    )
    return FlightInstruments(drawn, spread)


def input_spread(column: str) -> tuple[float, float]:
    """Standard deviations, from flight to flight, of scale error and bias of an input; one of them is 0."""
    if column in INPUT_BIAS:
        return 0.0, INPUT_BIAS[column]
    unit = split_column(column)[1]
    return {"rpm": SPEED_SCALE, "K": TEMPERATURE_SCALE}.get(unit, POWER_SCALE), 0.0


FUEL = "Wf_kg_s"
POWER = "power_W"


def airline_sensors(engine: Engine) -> tuple[str, ...]:
    """The sensors of the engine that a cockpit shows, in the engine's order."""
    turbines = [c for c in engine.network.components if isinstance(c, Turbine)]
    behind = [f"T{t.values['to']}_K" for t in turbines]
    hot = next((c for c in behind if c in engine.sensors), None)
    return tuple(c for c in engine.sensors if c in (FUEL, POWER, hot) or split_column(c)[1] == "rpm")


LARGEST_S = 1.0
"""Delay, early or late, drawn uniformly."""


@dataclass(frozen=True)
class ChannelClocks:
    """Column → delay [s]."""

    delays: Mapping[str, float]

    def sample(self, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight as they are stamped; a record that would lie outside keeps its own reading."""
        return {c: np.interp(time_s - self.delays[c], time_s, v) if c in self.delays else v for c, v in columns.items()}


def draw_clocks(columns: Sequence[str], rng: np.random.Generator) -> ChannelClocks:
    """Delays of these columns."""
    return ChannelClocks({c: float(rng.uniform(-LARGEST_S, LARGEST_S)) for c in columns})


RECORDER_LAG_S = (0.5, 2.0)
"""Lag of a sensor, from and to: from a pressure line to a thermocouple in a housing."""
QUANTUM = (0.3, 2.0)
"""Step of rounding over the noise, from and to, on a logarithmic scale: what buses of 10 to 12 bits have."""
MISSING, SPIKES = 0.05, 0.01
"""Share of cells that are missing, and of cells that are grossly wrong: what is met in recordings that were not
cleaned."""
SPIKE = (10.0, 30.0)
"""Size of a gross error over the noise, from and to; of an input over what such a channel differs by."""
INPUT_QUANTUM = 0.1
"""Step of rounding of an input over what such a channel differs by from flight to flight: its bus is finer than it."""


@dataclass(frozen=True)
class RecorderErrors:
    """Column → lag [s], and → step of rounding in its unit; `sigma`: column → size by which gross errors are measured,
    in its unit, as a share of the reading where the column is among `shares`."""

    lags_s: Mapping[str, float]
    quanta: Mapping[str, float]
    sigma: Mapping[str, float]
    shares: frozenset[str]
    missing: float = MISSING
    spikes: float = SPIKES

    def follow(self, time_s: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns (N,) of one flight, its points equally far apart, as lagging sensors show them."""
        from scipy.signal import lfilter

        found = dict(columns)
        for c, lag in self.lags_s.items():
            if c in columns and np.isfinite(columns[c]).all() and len(time_s) > 1:
                step = float(np.median(np.diff(time_s)))
                kept = np.exp(-step / lag)
                slope = np.diff(columns[c], prepend=columns[c][0]) / step
                found[c] = columns[c] + lfilter([-lag * (1.0 - kept)], [1.0, -kept], slope)
        return found

    def write(self, columns: Mapping[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Columns (N,) with noise as the recording has them."""
        found = dict(columns)
        for c, sigma in self.sigma.items():
            v = np.array(columns[c], float)
            struck = rng.random(len(v)) < self.spikes
            size = rng.choice((-1.0, 1.0), len(v)) * rng.uniform(*SPIKE, len(v)) * sigma
            v = np.where(struck, v + size * (np.abs(v) if c in self.shares else 1.0), v)
            if c in self.quanta:
                v = self.quanta[c] * np.round(v / self.quanta[c])
            if c in self.lags_s:
                v[rng.random(len(v)) < self.missing] = np.nan
            found[c] = v
        return found


def draw_recorder(engine: Engine, flown: Mapping[str, np.ndarray], rng: np.random.Generator) -> RecorderErrors:
    """A recorder of this engine; flown: inputs (N,) of its flights, whose size says what a share of them is."""
    lags = {c: float(rng.uniform(*RECORDER_LAG_S)) for c in engine.sensors}
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    low, high = np.log(QUANTUM)
    quanta = {c: s * float(np.exp(rng.uniform(low, high))) for c, s in sigma.items()}
    shares = set()
    for c in engine.inputs:
        share, bias = input_spread(c)
        sigma[c] = share or bias
        quanta[c] = INPUT_QUANTUM * (share * float(np.median(np.abs(flown[c]))) or bias)
        if share:
            shares.add(c)
    return RecorderErrors(lags, quanta, sigma, frozenset(shares))


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
class RealisticErrors:
    """What is wrong with the model and its instruments in one trial. `shape`: error of the maps; `maps`: seed of their
    tables; `sensors`: those recorded, those of a cockpit where `airline`; `rho`: correlation of their noise."""

    shape: float
    maps: int
    airline: bool
    sensors: tuple[str, ...]
    instruments: FlightInstruments
    clocks: ChannelClocks
    soak: SoakedProbe | None
    rho: float
    recorder: RecorderErrors

    def select_flights(self, flights: Sequence[int]) -> RealisticErrors:
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
        return self.recorder.write(add_sensor_noise(engine, self.rho, columns, rng), rng)


def draw_realistic(
    engine: Engine, flights: Sequence[Columns], rng: np.random.Generator, *, airline: float = AIRLINE
) -> RealisticErrors:
    """The errors of one trial with these flights; airline: chance that only a cockpit's sensors are recorded."""
    cockpit = bool(rng.random() < airline)
    soak = draw_heat_soak(engine, len(flights), rng)
    flown = {c: np.concatenate([f[c] for f in flights]) for c in engine.inputs}
    return RealisticErrors(
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


def correlated_noise(white: np.ndarray, rho: float) -> np.ndarray:
    """AR(1) of unit variance from white noise (n, m): e_k = ρ e_{k−1} + √(1 − ρ²) w_k."""
    from scipy.signal import lfilter

    if not rho or not len(white):
        return white
    shocks = np.sqrt(1.0 - rho**2) * white
    shocks[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=0))


def add_sensor_noise(engine: Engine, rho: float, columns: Columns, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns (N,) with the noise of the sensors, of this correlation."""
    e = correlated_noise(rng.standard_normal((len(columns["time_s"]), len(engine.sensors))), rho)
    noise = {c: s.noise_sigma * e[:, j] for j, (c, s) in enumerate(engine.sensors.items())}
    return {c: v + noise[c] if c in noise else v for c, v in columns.items()}


def realistic_engine(engine: Engine, drawn: RealisticErrors, flown: Columns) -> Engine:
    """The truth engine, whose tables are written, read back and gone; flown: inputs (N,) of all flights."""
    inputs = {c: flown[c] for c in engine.inputs}
    with TemporaryDirectory(prefix="enginediag_sealed_") as folder:
        return tabulate_engine(engine, inputs, drawn.shape, np.random.default_rng(drawn.maps), Path(folder))
