"""Which further sensor would have told the members of a class apart, had it been recorded in the same window.

Sensors that the engine file describes and these records lack come first; where none of those would tell, gas
temperatures, pressures and shaft speeds that the model gives at other places, as well measured as such instruments are.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.isolation.advice import ODDS, gains
from enginediag_cli.isolation.classes import Class
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.units import UNITS, split_column

TOLD = 2
"""Sensors named at most: the best, and one to choose instead."""
RECORDS = 8
"""Operating points of a window at which the sensors are tried: sensitivities hardly vary more within one."""
SPEED = "rotational speed"
ACCURACY = {"temperature": 0.002, "pressure": 0.003, SPEED: 0.001}
"""Standard deviation of one reading as a share of it: 1 K at 500 K, and what transducers and tachometers do."""
HOTTEST_K = 1300.0
"""Above it no probe is kept in an engine."""


def telling_sensors(
    monitor: Monitor, score: Score, found: Class, inputs: Mapping[str, np.ndarray], records: int
) -> tuple[str, ...]:
    """Columns of sensors that would tell the leading two of `found` apart in so many records, best first; empty where
    none would. inputs: column -> (N,), operating points like those of the window."""
    engine: Any = monitor.engine
    at = np.unique(np.linspace(0, len(next(iter(inputs.values()))) - 1, RECORDS).astype(int))
    here = {column: np.asarray(values)[at] for column, values in inputs.items()}
    known = {**monitor.base, **dict(zip(monitor.monitored, monitor.theta0.tolist(), strict=False))}
    for columns in (_declared(engine, monitor.sensors), _possible(engine, monitor.sensors)):
        if not columns:
            continue
        values = {name: value for name, value in known.items() if name in engine.parameters}
        answer = engine.predict(here, values, sensors=columns, wrt=score.parameters)
        ok = np.asarray(answer.ok)
        if not ok.any():
            continue
        y, J = np.asarray(answer.y)[ok], np.asarray(answer.jacobian)[ok]
        sigma = np.array([_noise(engine, column, y[:, j]) for j, column in enumerate(columns)])
        G = J / sigma[:, None]
        informations = [records / len(G) * G[:, j].T @ G[:, j] for j in range(len(columns))]
        gained = gains(score, found.leading_pair, [np.nan_to_num(each) for each in informations])
        order = [int(j) for j in np.argsort(-gained, kind="stable") if gained[j] >= 2 * np.log(ODDS)]
        if order:
            return tuple(columns[j] for j in order[:TOLD])
    return ()


def _declared(engine: Any, used: tuple[str, ...]) -> tuple[str, ...]:
    """Sensors of the engine file that are not in use."""
    return tuple(column for column in engine.sensors if column not in used)


def _possible(engine: Any, used: tuple[str, ...]) -> tuple[str, ...]:
    """Other columns of the model that an instrument could read."""
    given = {*used, *engine.sensors, *engine.inputs, *engine.optional_inputs}
    columns = getattr(engine, "model_columns", ())
    # of rotational speeds instruments read those of shafts; corrected ones are made of them
    speeds = getattr(getattr(engine, "network", None), "speed_columns", ())
    read = (c for c in columns if _dimension(c) != SPEED or c in speeds)
    return tuple(dict.fromkeys(c for c in read if c not in given and _dimension(c) in ACCURACY))


def _noise(engine: Any, column: str, readings: np.ndarray) -> float:
    """Standard deviation of one reading; infinite where no probe would last."""
    if column in engine.sensors:
        return float(engine.sensors[column].noise_sigma)
    usual, dimension = float(np.abs(np.mean(readings))), _dimension(column)
    if dimension == "temperature" and usual * UNITS[split_column(column)[1]].factor > HOTTEST_K:
        return float("inf")
    return ACCURACY[dimension] * usual


def _dimension(column: str) -> str:
    unit = split_column(column)[1]
    return UNITS[unit].dimension if unit in UNITS else ""
