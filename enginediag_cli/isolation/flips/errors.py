"""Single errors that may stand behind an answer: of a map, of an instrument, of an input; how large each is stated.

An error acts as a parameter of the statistics does. An instrument that reads wrong by a adds a ∂y/∂(its bias) to the
readings, a map that is wrong by a where these records were flown adds a ∂y/∂θ_q: the same as a change of the health
parameter that multiplies what the map gives. With b ~ N(I Δθ, I) either moves the score by a I d, d being the unit
vector of that parameter. A map error that is the same where training was flown has been identified with the engine
and moves nothing; meant is what differs between there and here.

How wrong the map of one machine alone may still be where a window was flown, after training.

Of the map quantity q with health parameter θ_q and amounts a_j the relative error at map coordinates ξ is

    θ_q + Σ_j a_j φ_j(ξ)        of variance        (1, φ(ξ)) C_q|o (1, φ(ξ))ᵀ,      C_q|o = ((C⁻¹)_qq)⁻¹,

C the posterior covariance of everything uncertain, o all of it but the block of q: training knows what errors do to
readings together far better than which of them does it, and asked is for an error that is wrong alone. Told is the root
of its mean over operating points of the window.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np

from enginediag_cli.engine.instrument_errors import DRIFT
from enginediag_cli.error_model.maps import QUANTITIES, MapErrorModel
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score

HELD = 1e-10
"""Of the scaled covariance, so that what is known to rounding alone can be inverted; as in `Monitor.precision`."""


def left_open(monitor: Monitor, flown: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Standard deviation of the error of each map quantity that is monitored, a share, by its health parameter, at
    operating points column -> (k,); empty where the model has no errors of maps or no point can be computed."""
    engine = monitor.engine
    if not isinstance(engine, MapErrorModel) or not flown:
        return {}
    frozen = engine.frozen(dict(flown), ())
    _, curves = engine.factors(frozen, ())
    seen = np.flatnonzero(curves.any(axis=(1, 2)))
    if not seen.size:
        return {}
    uncertain = np.flatnonzero(np.diag(monitor.uncertainty) > 0)
    place = {monitor.names[i]: k for k, i in enumerate(uncertain)}
    scale = np.sqrt(np.diag(monitor.uncertainty))[uncertain]
    C = monitor.uncertainty[np.ix_(uncertain, uncertain)] / scale / scale[:, None]
    precision = np.linalg.inv(C + HELD * np.eye(len(C)))
    found = {}
    for g, (target, amounts) in enumerate(engine.groups.items()):
        if target not in monitor.monitored or any(name not in place for name in (target, *amounts)):
            continue
        at = np.array([place[target], *(place[name] for name in amounts)])
        alone = np.linalg.inv(precision[np.ix_(at, at)])
        row = scale[at] * np.column_stack([np.ones(len(seen)), curves[seen, g]])
        found[target] = float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", row, alone, row))))
    return found


MAP, SENSOR, INPUT, PRIOR = "map", "sensor", "input", "prior"
"""Kinds of errors."""
SPREAD = "spread between recordings"
ACCURACY = "left open by training"
STATED = "stated accuracy"
PLAUSIBLE = "plausible error"
CHANGE = "plausible change"
PERCENT = 100.0
"""Per cent in one."""


@dataclass(frozen=True)
class Stated:
    """One standard deviation that the error model allows an error, in the parameter's unit, and where it is from."""

    sigma: float
    origin: str


@dataclass(frozen=True)
class SingleError:
    """An error that acts as parameter number `position` of a score does. column: of the instrument, "" of a map; unit:
    in which its size is told, "%" for shares; scale: the parameter's unit in one of these; stated: one standard
    deviation, in `unit`; reading: mean reading of the instrument in the column's unit, NaN where it is not known."""

    what: str
    kind: str
    position: int
    column: str
    unit: str
    scale: float
    stated: float
    origin: str
    reading: float = float("nan")


def single_errors(
    score: Score, stated: Mapping[str, Stated], columns: Mapping[str, str], readings: Mapping[str, float]
) -> tuple[SingleError, ...]:
    """Errors whose effect the statistics of `score` hold. stated: parameter → how large its error is stated, without
    which it is what is plausible of the parameter; columns: parameter → column of its instrument; readings: column →
    mean reading."""
    found = []
    for i, p in enumerate(score.described):
        kind = SENSOR if p.of_sensor else INPUT if p.of_instrument else MAP
        if p.quantity == DRIFT or (kind == MAP and p.quantity not in QUANTITIES):
            continue
        own = stated.get(p.name) or Stated(float(score.prior_sigma[i]), CHANGE if kind == MAP else PLAUSIBLE)
        share = p.unit in ("", "1") and (kind == MAP or p.quantity == "scale")
        scale = (abs(float(score.theta0[i])) or 1.0) / PERCENT if share else 1.0
        column = columns.get(p.name, "")
        unit = "%" if share else p.shown_unit
        reading = readings.get(column, float("nan"))
        found.append(SingleError(p.name, kind, i, column, unit, scale, own.sigma / scale, own.origin, reading))
    return tuple(found)


def columns_of_instruments(monitor: Monitor) -> dict[str, str]:
    """Parameter → column of the instrument whose error it is, of the monitored parameters."""
    engine: Any = monitor.engine
    found = {p.name: c for c in monitor.sensors if c in engine.sensors for p in _errors_of(engine.sensors[c])}
    found.update({name: error.column for name, error in getattr(engine, "errors", {}).items()})
    return {name: column for name, column in found.items() if name in monitor.monitored}


def _errors_of(sensor: Any) -> tuple[Any, ...]:
    return tuple(sensor.parameters()) if hasattr(sensor, "parameters") else ()


def stated_errors(
    monitor: Monitor, readings: Mapping[str, float], flown: Mapping[str, np.ndarray]
) -> dict[str, Stated]:
    """How large errors are allowed where a window was flown: of maps by what training leaves open of them at operating
    points like those in `flown`, column -> (k,), of an instrument by how much recordings differ, its zero and, at its
    mean reading, its span."""
    found = {name: Stated(sigma, ACCURACY) for name, sigma in left_open(monitor, flown).items() if sigma}
    first = len(monitor.names) - len(monitor.offsets)
    spread: dict[str, dict[str, float]] = {}
    for k, offset in enumerate(monitor.offsets):
        column = offset.column or monitor.sensors[offset.sensor]
        if offset.kind in ("bias", "scale"):
            spread.setdefault(column, {})[offset.kind] = float(monitor.prior_sigma[first + k])
    for name, column in columns_of_instruments(monitor).items():
        own, reading = spread.get(column, {}), abs(readings.get(column, 0.0))
        zero, span = own.get("bias", 0.0), own.get("scale", 0.0)
        if monitor.meaning[name].quantity == "scale":
            sigma = hypot(span, zero / reading if reading else 0.0)
        else:
            sigma = hypot(zero, span * reading)
        if sigma:
            found[name] = Stated(sigma, SPREAD)
    return found
