"""Windows of the real turbofan with a fault, in flight conditions drawn at random, and their scores."""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "residuals"))

from white_statistics import local_statistics

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.relinearise import relinearise
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.simulation.flights import ColumnNoise
from enginediag_cli.validation.studies import known_nominal

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"


@lru_cache(maxsize=2)
def turbofan_monitor(sensors: bool = False) -> Monitor:
    """Eleven health parameters, and with `sensors` the bias of each of nine sensors; noise as in the paper."""
    engine = load_engine(ENGINE)
    noise = {c: ColumnNoise("uniform", width=0.01 * s.maximum) for c, s in engine.sensors.items()}
    return known_nominal(engine, (*engine.monitored, "sensor.*.bias") if sensors else (), noise)


def faulty_window(rng, monitor, change, n=100):
    """Inputs, column -> (n,), and readings (n, m) of an engine with `change`, parameter -> its difference."""
    inputs = {
        "altitude_m": rng.uniform(0, 11e3, n),
        "mach": rng.uniform(0.2, 0.8, n),
        "dT_isa_K": rng.uniform(-10, 10, n),
    }
    inputs["Wf_kg_s"] = monitor.engine.power_from_fraction(rng.uniform(0.5, 1, n), inputs)
    theta = monitor.theta0 + np.array([change.get(name, 0.0) for name in monitor.names])
    y = monitor.predict(inputs, theta)[0]
    return inputs, y + monitor.noise.sigma * 12**0.5 * rng.uniform(-0.5, 0.5, y.shape)


def window_score(monitor, inputs, y) -> Score:
    """The score about the re-estimate, as the tool forms it."""
    return score_and_solution(monitor, inputs, y)[0]


def score_and_solution(monitor, inputs, y) -> tuple[Score, np.ndarray]:
    """The same with the engine's unknowns (nx, n) at nominal, which a window hands on."""

    *nominal, prediction = monitor.predict(inputs, monitor.theta0)

    def predict(theta, rows):
        here = {c: v[rows] for c, v in inputs.items()}
        return monitor.predict(here, theta, nuisance=False, start=prediction.x[:, rows])[:3]

    found = relinearise(predict, y, monitor.hold, monitor.noise, nominal=tuple(nominal))
    assert found.converged.all()
    return fisher_score(local_statistics(found.e, found.J, monitor.noise, monitor.frame)), prediction.x
