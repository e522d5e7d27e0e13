"""An engine of power laws with the interface of the real one: quick, exact, and known in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.engine.evaluation import P_ISA, T_ISA, standard_atmosphere
from enginediag_cli.parameters import Parameter

CONFIGS = Path(__file__).parents[2] / "configs"
COMPONENTS = ("fan", "booster", "hpc", "hpt", "lpt")
SENSORS = ("N1_rpm", "N2_rpm", "P25_Pa", "T25_K", "P3_Pa", "T3_K", "T45_K", "P5_Pa", "T5_K")
SIZES = (3750.0, 8000.0, 3.6e5, 456.0, 2.05e6, 777.0, 1190.0, 1.57e5, 850.0)
NOT_CONVERGED_ABOVE_M = 13000.0


@dataclass(frozen=True)
class Sensor:
    column: str
    noise_sigma: float
    maximum: float


@dataclass(frozen=True)
class Prediction:
    y: np.ndarray
    status: np.ndarray
    columns: tuple[str, ...]

    def reason(self, k: int) -> str:
        return {1: "hpc: outside the map", 2: "did not converge: hpt flow"}[int(self.status[k])]


class ToyEngine:
    name = "toy turbofan"
    inputs = ("altitude_m", "mach", "dT_isa_K", "Wf_kg_s")
    power_setting = "Wf_kg_s"
    power_range = (0.3, 2.4)

    def __init__(self, sensors: Sequence[str] = SENSORS, optional_inputs: Mapping[str, float] | None = None) -> None:
        size = dict(zip(SENSORS, SIZES, strict=True))
        self.sensors = {s: Sensor(s, 0.002 * size[s], 1.1 * size[s]) for s in sensors}
        self.optional_inputs = dict(optional_inputs or {})
        self.envelope = {"altitude_m": (-300.0, 13000.0), "mach": (0.0, 0.9), "dT_isa_K": (-40.0, 40.0)}
        names = [f"{c}.{q}" for c in COMPONENTS for q in ("efficiency", "flow_capacity")]
        names.append("core_nozzle.area")
        self.parameters = {n: Parameter(n, "health", 1.0, 0.8, 1.2, 0.02) for n in names}
        for name in (f"sensor.{column.split('_')[0]}.bias" for column in sensors):
            self.parameters[name] = Parameter(name, "sensor", 0.0, -1e6, 1e6, 1.0)
        self.monitored = tuple(names)
        rng = np.random.default_rng(0)
        rows = rng.uniform(-1, 1, (len(SENSORS), len(names)))
        self.exponents = {s: dict(zip(names, row, strict=True)) for s, row in zip(SENSORS, rows, strict=True)}
        self.size = size

    def power_from_fraction(self, fraction, inputs):
        """Corrected fuel flow between its limits; Wf = Wf_corrected δ √θ with total conditions."""
        theta, delta = self._theta_delta(inputs["altitude_m"], inputs["mach"], inputs["dT_isa_K"])
        low, high = self.power_range
        return (low + (high - low) * fraction) * delta * np.sqrt(theta)

    def _theta_delta(self, altitude_m, mach, dT_isa_K):
        temperature, pressure = standard_atmosphere(np.asarray(altitude_m, dtype=float))
        ram = 1.0 + 0.2 * np.asarray(mach) ** 2
        return (temperature + dT_isa_K) * ram / T_ISA, pressure * ram**3.5 / P_ISA

    def predict(self, inputs, parameters=None, *, sensors=None, wrt=()) -> Prediction:
        theta, delta = self._theta_delta(inputs["altitude_m"], inputs["mach"], inputs["dT_isa_K"])
        load = inputs["Wf_kg_s"] / (delta * np.sqrt(theta)) / self.power_range[1]
        columns = tuple(sensors or self.sensors)
        y = np.empty((len(load), len(columns)))
        for j, column in enumerate(columns):
            ambient = {"K": theta, "Pa": delta, "rpm": np.sqrt(theta)}[column.rpartition("_")[2]]
            factor = np.ones(len(load))
            bias = 0.0
            for name, value in (parameters or {}).items():
                if name.startswith("sensor."):
                    bias = bias + (value if name == f"sensor.{column.split('_')[0]}.bias" else 0.0)
                else:
                    factor = factor * value ** self.exponents[column][name]
            y[:, j] = self.size[column] * ambient * load**0.3 * factor + bias
        status = np.where(inputs["altitude_m"] > NOT_CONVERGED_ABOVE_M, 2, 0).astype(np.int8)
        y[status == 2] = np.nan
        return Prediction(y, status, columns)
