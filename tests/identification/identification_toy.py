"""A small algebraic engine with the interface of the real one: exact derivatives, fails on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class ToySensor:
    column: str
    noise_sigma: float


@dataclass(frozen=True)
class ToyPrediction:
    y: np.ndarray
    jacobian: np.ndarray
    status: np.ndarray
    columns: tuple[str, ...]
    wrt: tuple[str, ...]

    @property
    def ok(self) -> np.ndarray:
        return self.status <= 1

    def reason(self, k: int) -> str:
        return {0: "", 1: "outside the maps", 2: "hpc: flow balance did not converge", 3: "invalid"}[
            int(self.status[k])
        ]


def health(name: str, sigma: float = 0.03, lower: float = 0.7, upper: float = 1.3) -> Parameter:
    return Parameter(name, "health", 1.0, lower, upper, sigma)


PARAMETERS = (
    health("hpc.efficiency"),
    health("hpt.efficiency"),
    health("hpc.flow_capacity"),
    Parameter("hpc.map.slope", "design", 0.0, -1.0, 1.0, 0.2),
    Parameter("sensor.T45.bias", "sensor", 0.0, -100.0, 100.0, 5.0, "K", component="sensor.T45", quantity="bias"),
)
SENSORS = {s: ToySensor(s, sigma) for s, sigma in (("T3_K", 1.0), ("P3_Pa", 3e3), ("Wf_kg_s", 2e-3), ("T45_K", 2.0))}


def outputs(u: Mapping[str, Any], p: Mapping[str, Any]) -> dict[str, Any]:
    """T3, P3, fuel flow and T45; the turbine's efficiency is seen only times the compressor's."""
    n = u["N1_pct"] / 100
    T0, P0 = (
        288.15 * (1 - 2.25577e-5 * u["altitude_m"]),
        101325 * (1 - 2.25577e-5 * u["altitude_m"]) ** 5.2559,
    )
    PR = 1 + 14 * n ** (2 + p["hpc.map.slope"])
    both = p["hpc.efficiency"] * p["hpt.efficiency"]
    return {
        "T3_K": T0 * (1 + 1.1 * (PR**0.286 - 1) / p["hpc.efficiency"]),
        "P3_Pa": P0 * PR * p["hpc.flow_capacity"] ** 0.3,
        "Wf_kg_s": 0.6 * P0 / 101325 * n**3 * p["hpc.flow_capacity"] ** 1.2 * both**-1.5,
        "T45_K": T0 * (2 + 1.5 * n**2) * both**-0.7 * p["hpc.flow_capacity"] ** -0.2 + p["sensor.T45.bias"],
    }


@dataclass(frozen=True)
class ToyEngine:
    """`fails(inputs, theta) -> (N,) bool` marks records that do not converge."""

    fails: Callable[[Mapping[str, Any], Mapping[str, Any]], np.ndarray] | None = None
    parameter_list: tuple[Parameter, ...] = PARAMETERS
    sensors: Mapping[str, ToySensor] = field(default_factory=lambda: dict(SENSORS))
    name: str = "toy"
    inputs: tuple[str, ...] = ("altitude_m", "N1_pct")
    optional_inputs: Mapping[str, float] = field(default_factory=lambda: {"humidity_kg_kg": 0.0})
    calls: list[int] = field(default_factory=list)
    declared: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, Parameter]:
        return {p.name: p for p in self.parameter_list}

    @property
    def monitored(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameter_list if p.family == "health")

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        *,
        sensors: Sequence[str] | None = None,
        wrt: Sequence[str] = (),
    ) -> ToyPrediction:
        theta: dict[str, Any] = {n: p.nominal for n, p in self.parameters.items()} | dict(parameters or {})
        columns = tuple(sensors or self.sensors)
        N = len(inputs["N1_pct"])
        self.calls.append(N)
        value = outputs(inputs, theta)
        y = np.column_stack([value[c] for c in columns])
        J = np.zeros((N, len(columns), len(wrt)))
        for i, name in enumerate(wrt):  # complex step: exact to rounding
            if name in inputs:
                step = outputs({**inputs, name: inputs[name] + 1e-30j}, theta)
            else:
                step = outputs(inputs, theta | {name: theta[name] + 1e-30j})
            J[:, :, i] = np.column_stack([np.broadcast_to(np.imag(step[c]), N) for c in columns]) / 1e-30
        status = np.zeros(N, np.int8)
        if self.fails is not None:
            status[self.fails(inputs, theta)] = 2
        y[status > 1] = np.nan
        return ToyPrediction(y, J, status, columns, tuple(wrt))


TRUTH = {
    "hpc.efficiency": 0.985,
    "hpt.efficiency": 1.02,
    "hpc.flow_capacity": 0.97,
    "hpc.map.slope": 0.1,
    "sensor.T45.bias": 3.0,
}


def operating_points(n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A flight: altitude wanders slowly, N1 changes at random from record to record."""
    phase = np.linspace(0, 2 * np.pi, n) + rng.uniform(0, 6)
    return {"altitude_m": 5000 + 4000 * np.sin(phase), "N1_pct": rng.uniform(60, 100, n)}


def noise(n: int, sigma: float, rho: float, rng: np.random.Generator) -> np.ndarray:
    """Stationary AR(1) noise (n,) of standard deviation sigma."""
    e = rng.standard_normal(n)
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return sigma * e


def fly(
    engine: ToyEngine,
    rng: np.random.Generator,
    n: int = 200,
    label: str = "flight",
    rho: float = 0.0,
    truth: Mapping[str, float] = TRUTH,
    bias: Mapping[str, float] | None = None,
) -> TrainingRecording:
    """One healthy recording of an engine whose parameters are `truth`, with sensor offsets `bias`."""
    u = operating_points(n, rng)
    value = outputs(u, {p.name: p.nominal for p in PARAMETERS} | dict(truth))
    readings = {
        c: value[c] + noise(n, s.noise_sigma, rho, rng) + (bias or {}).get(c, 0.0) for c, s in engine.sensors.items()
    }
    return TrainingRecording(label, u | readings)
