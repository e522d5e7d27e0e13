"""How much of its margin an engine has used, flight by flight and by now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.fleet_judgement.finding import Estimate, FleetSettings, Margin
from enginediag_cli.fleet_judgement.health import FAILED, Course
from enginediag_cli.fleet_judgement.margin import MarginScale
from enginediag_cli.fleet_judgement.rows import Flights
from enginediag_cli.intervals import NORMAL_95

TOGETHER = 10.0
"""Flights of which the weights of the readings are right: those of one flight alone would shrink what it says, and what
is forecast from are many."""


@dataclass(frozen=True)
class Consumption:
    """slope (q,): K of margin per prior standard deviation of each state of the course; by_flight, error (n,): K, of
    each flight alone with one standard error; margin: as of the last flight, without a forecast."""

    slope: np.ndarray
    by_flight: np.ndarray
    error: np.ndarray
    margin: Margin


def consumption_of(flights: Flights, c: Course, scale: MarginScale, settings: FleetSettings) -> Consumption:
    """The margin of an engine whose health has the course c."""
    n, q = len(flights), len(c.parameters)
    unknown = np.full(n, np.nan)
    if not scale.column:
        return Consumption(np.zeros(q), unknown, unknown, Margin(reason=scale.reason))
    names = [flights.described[i].name for i in c.parameters]
    slope = np.array([scale.slope.get(name, 0.0) for name in names]) * c.unit
    mean, covariance = c.told(c.at(n - 1))
    value, error = float(slope @ mean), float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
    used = Estimate(value, value - NORMAL_95 * error, value + NORMAL_95 * error)
    weights = _weights(flights, c, slope)
    level = c.level + of_conditions(flights, c)
    by_flight = (flights.z - level) @ weights
    single = np.sqrt(weights @ c.scatter @ weights) / flights.weight
    limit = settings.limits_K.get(scale.column, float("nan"))
    off = _offset_K(flights, c, scale)
    left = Estimate(*(limit - scale.nominal_K - off - x for x in (used.value, used.high, used.low)))
    return Consumption(slope, by_flight, single, Margin(scale.column, scale.condition, limit, used, left))


def _weights(flights: Flights, c: Course, slope: np.ndarray) -> np.ndarray:
    """Weights (m,) of the readings in what a flight says of the margin: D Jᵀ (J D² Jᵀ + Σ/TOGETHER)⁻¹, in which a
    suspected instrument does not count."""
    q = len(flights.health)
    J = flights.J.mean(axis=0)
    health, wrong = J[:, c.parameters[:q]], FAILED * J[:, c.parameters[q:]]
    inner = health @ health.T + wrong @ wrong.T + c.scatter / TOGETHER
    return np.asarray(np.linalg.solve(inner, health @ slope[:q]))


def of_conditions(flights: Flights, c: Course) -> np.ndarray:
    """What readings (n, m) follow of the conditions flown, by what the course of health leaves of them."""
    weather = flights.readings.weather
    if not weather.shape[1]:
        return np.zeros_like(flights.z)
    left = flights.z - c.level - np.einsum("nmq,nq->nm", flights.J[:, :, c.parameters], c.path)
    H = weather.T @ weather + np.eye(weather.shape[1])
    return np.asarray(weather @ np.linalg.solve(H, weather.T @ left))


def _offset_K(flights: Flights, c: Course, scale: MarginScale) -> float:
    """By how much the engine read hotter than nominal in its baseline."""
    names = [p.name for p in flights.described]
    if scale.sensor not in names:
        return 0.0
    i = names.index(scale.sensor)
    one = flights.J[:, :, i].mean(axis=0)  # what one prior standard deviation of its bias adds to each reading
    s = int(np.argmax(np.abs(one)))
    return float(c.level[s] / one[s] * flights.readings.D[i])


def severity_of(used: Consumption, c: Course) -> Estimate:
    """How far an engine has gone: of its margin, or where no temperature tells, the length of the change of its health
    in prior standard deviations."""
    if used.margin.column:
        return used.margin.consumed_K
    mean, covariance = c.told(c.at(len(c.phi) - 1))
    length = float(np.linalg.norm(mean))
    error = float(np.sqrt(mean @ covariance @ mean) / max(length, 1e-12))
    return Estimate(length, max(length - NORMAL_95 * error, 0.0), length + NORMAL_95 * error)
