"""The nominal state of an engine, from which later stages measure departures: estimates, noise, envelope, quality.

**Envelope** of the operating points that identification has seen. Inputs are scaled so that 1 is the spread of the
training points, or a step that matters physically where they hardly spread. The training points are covered by at most
`MAX_POINTS` of them (farthest-point sampling, T. F. Gonzalez, Theoret. Comput. Sci. 38 (1985) 293–306). A point is
outside when the nearest of these is farther than the cover's own radius plus a margin: the 0.95 quantile of the
distance from a training point to the nearest one of another stretch of the recordings, but no less than 0.25 and no
more than 1.

**Quality**: how well the model reproduces readings, as RMS per sensor and regime and as χ² per reading. Flows,
pressures, forces and powers are judged in per cent of the prediction, temperatures, speeds and all else in the column's
own unit, as the field does.

**Regime** of each record: ground, climb, cruise or descent where the recordings state it, else a band of power.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.error_model.maps import FAMILY, POINT_FAMILY, ErrorModel
from enginediag_cli.identification.covariance import Combination
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.instruments import SensorLag
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import (
    IdentificationProblem,
    IdentificationSettings,
    Model,
    OffsetPrior,
    TrainingRecording,
    build_problem,
)
from enginediag_cli.units import find_unit, split_column

RELATIVE_DIMENSIONS = ("pressure", "mass flow", "power", "force", "torque", "flow per pressure")
EVERYTHING = "all"


@dataclass(frozen=True)
class SensorQuality:
    """Fit of one sensor in one regime: `rms` in `unit`, `chi2` the mean of (e/σ)², outliers included."""

    sensor: str
    regime: str
    n: int
    rms: float
    unit: str
    chi2: float


def shown_unit(column: str) -> str:
    """'%' for a quantity that is judged relative to its value, else the unit in the column's name."""
    suffix = split_column(column)[1]
    return "%" if suffix and find_unit(suffix).dimension in RELATIVE_DIMENSIONS else suffix


def sensor_quality(
    sensors: Sequence[str], residual: np.ndarray, predicted: np.ndarray, sigma: np.ndarray, regimes: np.ndarray
) -> tuple[SensorQuality, ...]:
    """Quality of m sensors over everything and in each regime.

    residual and predicted: (N, m) in the column's unit, NaN = missing; regimes: (N,) text. A sensor
    without readings in a regime has no entry there.
    """
    names = sorted(set(regimes.tolist()) - {EVERYTHING})
    masks = [(EVERYTHING, np.ones(len(regimes), bool))]
    masks += [(r, regimes == r) for r in names] if len(names) > 1 else []
    table = []
    for s, sensor in enumerate(sensors):
        unit = shown_unit(sensor)
        shown = 100 * residual[:, s] / predicted[:, s] if unit == "%" else residual[:, s]
        for regime, mask in masks:
            rows = mask & np.isfinite(shown)
            if rows.any():
                chi2 = float(np.mean((residual[rows, s] / sigma[s]) ** 2))
                rms = float(np.sqrt(np.mean(shown[rows] ** 2)))
                table.append(SensorQuality(sensor, regime, int(rows.sum()), rms, unit, chi2))
    return tuple(table)


CLIMB_RATE_M_S = 2.5
"""About 500 ft/min: beyond it an aircraft is climbing or descending."""

GROUND_MACH = 0.1
"""Below it an aircraft stands, taxies or begins its run: no airliner flies as slowly."""
AMBIENT = (
    "altitude",
    "mach",
    "dT_isa",
    "humidity",
    "P0",
    "T0",
    "Pamb",
    "Tamb",
    "ambient_pressure",
    "ambient_temperature",
    "dP_inlet",
    "dP_exhaust",
)
"""Quantities that describe the surroundings, not the power setting."""

SMALLEST_BAND = 0.005
"""A power setting that varies by less than this share of itself is one regime."""


def assign_regimes(recordings: Sequence[Mapping[str, np.ndarray]], inputs: Sequence[str]) -> list[np.ndarray]:
    """Regime label of each record, one (N,) text array per recording.

    A `phase` column is used as it is; else altitude_m against time_s; where a recording has neither, all
    recordings are cut at the pooled terciles of the first input that is not ambient; `all` without one.
    """
    labels = [_flight_regimes(columns) for columns in recordings]
    flown = [label for label in labels if label is not None]
    if len(flown) == len(recordings):
        return flown
    for name in inputs:
        if all(name in columns for columns in recordings) and not _is_ambient(name):
            return _power_regimes([np.asarray(columns[name], float) for columns in recordings], name)
    return [np.full(len(next(iter(columns.values()))), "all") for columns in recordings]


def _is_ambient(name: str) -> bool:
    return split_column(name)[0] in AMBIENT


def _flight_regimes(columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
    if "phase" in columns:
        return np.asarray(columns["phase"]).astype(str)
    if "altitude_m" not in columns or "time_s" not in columns:
        return None
    altitude, time = (np.asarray(columns[c], float) for c in ("altitude_m", "time_s"))
    if len(time) < 3 or not np.all(np.diff(time) > 0) or not np.ptp(altitude) > 100.0:
        return None
    rate = np.gradient(altitude, time)
    label = np.where(rate > CLIMB_RATE_M_S, "climb", np.where(rate < -CLIMB_RATE_M_S, "descent", "cruise"))
    if "mach" in columns:
        slow = np.asarray(columns["mach"], float) < GROUND_MACH
        label = np.where(slow & (label == "cruise"), "ground", label)
    return label


def _power_regimes(values: Sequence[np.ndarray], name: str) -> list[np.ndarray]:
    pooled = np.concatenate(values)
    pooled = pooled[np.isfinite(pooled)]
    if not len(pooled) or np.ptp(pooled) <= SMALLEST_BAND * abs(np.median(pooled)):
        return [np.full(len(v), "all") for v in values]
    low, high = np.quantile(pooled, [1 / 3, 2 / 3])
    words = (f"low {name}", f"middle {name}", f"high {name}")
    return [np.where(v <= low, words[0], np.where(v <= high, words[1], words[2])) for v in values]


def predict_held_out(
    problem: IdentificationProblem, fit: Fit, held_out: Sequence[TrainingRecording], settings: IdentificationSettings
) -> tuple[IdentificationProblem, np.ndarray]:
    """The problem of the held-out recordings, and its readings as predicted (N, m) at the fit of another one. Offsets
    of a recording are those of the fitted one of its label, else zero."""
    other = build_problem(problem.model, add_regimes(problem.model, held_out), settings)
    other = replace(
        other,
        parameters=problem.parameters,
        prior_mean=problem.prior_mean,
        prior_sigma=problem.prior_sigma,
        lower=problem.lower,
        upper=problem.upper,
    )
    z = np.zeros((len(other.labels), len(other.offsets)))
    known = {(o.sensor, o.kind): j for j, o in enumerate(problem.offsets)}
    for r, label in enumerate(other.labels):
        if label in problem.labels:
            for j, o in enumerate(other.offsets):
                z[r, j] = fit.z[problem.labels.index(label), known[o.sensor, o.kind]]
    predicted, _ = predict(other, fit.x, z)
    return other, predicted


def add_regimes(engine: Model, recordings: Sequence[TrainingRecording]) -> list[TrainingRecording]:
    """The recordings with a regime for each record; regimes that are given stay."""
    recordings = [TrainingRecording(*r) for r in recordings]
    found = assign_regimes([r.columns for r in recordings], engine.inputs) if recordings else []
    return [
        r if r.regimes is not None else r._replace(regimes=label) for r, label in zip(recordings, found, strict=True)
    ]


MAX_POINTS = 150
"""Points of the cover: what a nominal file may hold; the threshold widens where more would be needed."""
MARGIN_RANGE = (0.25, 1.0)
"""Least and largest distance, in spreads of the inputs, up to which a point counts as seen. Judgement: less would
refuse the next flight on the same route, more would admit another regime."""
STRETCHES = 10
"""Parts of a recording, for each of which it is found how far it is from the others."""
REACH = 3.0
"""Distance beyond the threshold, in spreads of the inputs, up to which a model of errors that widens by itself still
answers. Judgement: false alarms stay at nominal much farther out, but there other physics than that of the maps begins,
of which it says nothing."""
REACH_OF_RANGE = 0.5
"""How far beyond its range an input may be then, as a share of the range, though no less than the spread that is still
the same operation: what training held constant says nothing of what the engine does elsewhere. A plant at base load
does not show what its vanes do below."""
BLOCK = 100
"""Operating points whose distances are computed at once: with a full cover 0.1 MB, which stay in the cache."""
MINIMUM_SPREAD = {
    "mach": 0.05,
    "altitude_m": 2000.0,
    "dT_isa_K": 10.0,
    "humidity_kg_kg": 0.005,
    "ambient_temperature_K": 5.0,
    "ambient_pressure_Pa": 1500.0,
    "dP_inlet_Pa": 100.0,
    "T4_K": 5.0,
}
"""Least spread of an input, in its unit: where training held it constant, so much more is still the same operation.
Judgement by what the model's error changes with."""
RELATIVE_SPREAD = 0.03
"""Least spread, as a share of the largest value seen, of an input that is not in the table above."""


@dataclass(frozen=True)
class Envelope:
    """Cover of the operating points seen: d inputs, points (n, d) in the columns' units."""

    inputs: tuple[str, ...]
    scale: np.ndarray  # (d,)
    low: np.ndarray  # (d,) smallest and largest value seen
    high: np.ndarray  # (d,)
    points: np.ndarray  # (n, d)
    threshold: float  # distance in scaled inputs

    def distance(self, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Scaled distance of N operating points to the nearest point seen, (N,); NaN for a missing input."""
        u = self._scaled(inputs)
        return _nearest(u, self.points / self.scale)[0]

    def outside(self, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
        """True for operating points that training did not cover, (N,); a missing input counts as outside."""
        return ~(self.distance(inputs) <= self.threshold)

    def reachable(self, inputs: Mapping[str, np.ndarray], distance: np.ndarray) -> np.ndarray:
        """True where a model of errors that widens by itself may answer, (N,): operating points at `distance` (N,)."""
        u = self._scaled(inputs) * self.scale
        over = np.maximum(u - self.high, self.low - u)
        # the scale is the least spread wherever it is more than half of the range
        near = np.all(over <= np.maximum(REACH_OF_RANGE * (self.high - self.low), self.scale), axis=1)
        return np.asarray((distance <= self.threshold) | (near & (distance <= self.threshold + REACH)))

    def farthest_input(self, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Number of the input that is farthest beyond its range, (N,); −1 where none is: a combination not seen."""
        u = self._scaled(inputs)
        over = np.maximum(u - self.high / self.scale, self.low / self.scale - u)
        return np.where(over.max(axis=1) > 0.0, over.argmax(axis=1), -1)

    @np.errstate(over="ignore")
    def reason(self, inputs: Mapping[str, np.ndarray], k: int) -> str:
        """Why record k is outside, in words; '' when it is not."""
        point = {c: np.atleast_1d(np.asarray(inputs[c], float))[k : k + 1] for c in self.inputs}
        if not self.outside(point)[0]:
            return ""
        value = np.array([point[c][0] for c in self.inputs])
        if not np.isfinite(value).all():
            return f"{self.inputs[int(np.argmin(np.isfinite(value)))]} is missing"
        beyond = np.maximum(value - self.high, self.low - value) / self.scale
        j = int(np.argmax(beyond))
        if beyond[j] > 0:
            side = "above" if value[j] > self.high[j] else "below"
            return f"{self.inputs[j]} {value[j]:.4g} is {side} what was seen ({self.low[j]:.4g} to {self.high[j]:.4g})"
        index = int(_nearest(value[None] / self.scale, self.points / self.scale)[1][0])
        j = int(np.argmax(np.abs(value - self.points[index]) / self.scale))
        return (
            f"no record seen is near this combination; the nearest has {self.inputs[j]} "
            f"{self.points[index, j]:.4g} instead of {value[j]:.4g}"
        )

    @np.errstate(over="ignore")  # an input near the largest number is infinitely far
    def _scaled(self, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
        columns = [np.atleast_1d(np.asarray(inputs[c], float)) for c in self.inputs]
        return np.column_stack(np.broadcast_arrays(*columns)) / self.scale


def learn_envelope(inputs: Mapping[str, np.ndarray]) -> Envelope:
    """Envelope of N records from their inputs, column: (N,), all finite and in the order of time."""
    names = tuple(inputs)
    u = np.column_stack([np.asarray(inputs[c], float) for c in names])
    low, high = u.min(axis=0), u.max(axis=0)
    least = np.array(
        [MINIMUM_SPREAD.get(c, RELATIVE_SPREAD * max(abs(low[j]), abs(high[j]), 1e-12)) for j, c in enumerate(names)]
    )
    scale = np.maximum(u.std(axis=0), least)
    v = u / scale
    chosen, radius = _cover(v)
    margin = float(np.clip(_own_distance(v), *MARGIN_RANGE))
    return Envelope(names, scale, low, high, u[chosen], radius + margin)


def _cover(v: np.ndarray) -> tuple[np.ndarray, float]:
    """Indices of a cover of the points (N, d) and its radius; starts at the point nearest to the median."""
    first = int(np.argmin(np.sum((v - np.median(v, axis=0)) ** 2, axis=1)))
    chosen = [first]
    d2 = np.sum((v - v[first]) ** 2, axis=1)
    while len(chosen) < min(MAX_POINTS, len(v)) and d2.max() > (0.1 * MARGIN_RANGE[0]) ** 2:
        chosen.append(int(np.argmax(d2)))
        d2 = np.minimum(d2, np.sum((v - v[chosen[-1]]) ** 2, axis=1))
    return np.array(chosen), float(np.sqrt(d2.max()))


def _own_distance(v: np.ndarray) -> float:
    """0.95 quantile of the distance to the nearest point of another stretch, over about 1,000 points."""
    if len(v) < 2 * STRETCHES:
        return MARGIN_RANGE[1]
    stretch = np.arange(len(v)) * STRETCHES // len(v)
    sample = np.arange(0, len(v), max(1, len(v) // 1000))
    nearest = [_nearest(v[sample[stretch[sample] == i]], v[sample[stretch[sample] != i]])[0] for i in range(STRETCHES)]
    return float(np.quantile(np.concatenate(nearest), 0.95))


@np.errstate(all="ignore")  # a wild input is as far away as can be
def _nearest(v: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to and index of the nearest of `points` (n, d) for each row of v (N, d); NaN for NaN.

    All distances are compared, by |v − p|² = |v|² − 2 v·p + |p|² about the centre of the points; that to the nearest is
    computed as it stands. A cover is small, and importing a search tree takes longer than a flight's distances.
    """
    index = np.zeros(len(v), int)
    centre = points.mean(axis=0)
    about = points - centre
    half = 0.5 * np.sum(about**2, axis=1)
    for first in range(0, len(v), BLOCK):
        rows = slice(first, first + BLOCK)
        index[rows] = np.argmin(half - (v[rows] - centre) @ about.T, axis=1)  # less ½|v|², the same for all
    distance = np.sqrt(np.sum((v - points[index]) ** 2, axis=1))
    distance[~np.isfinite(v).all(axis=1)] = np.nan
    return distance, index


ENGINE_INSTANCE = "engine instance"
"""Key of `provenance` that names the engine, of those that a recording distinguishes, which was identified."""
STATUSES = ("identified", "weak", "at prior", "at bound")
IDENTIFIED, WEAK = 0.75, 0.1
"""Shares of the prior variance that the data removed: half the prior's sigma is left, or 95 % of it."""


@dataclass(frozen=True)
class Estimate:
    """One parameter in its own unit. `from_data` is 1 − posterior variance / prior variance.

    Status: identified (the data at least halved the prior's standard deviation), weak, at prior (the value is
    what was assumed before, not a finding), at bound (the data push against a physical limit).
    """

    name: str
    family: str
    unit: str
    value: float
    standard_error: float
    prior_mean: float
    prior_sigma: float
    from_data: float
    status: str


@dataclass(frozen=True)
class SensorNoise:
    """Noise of one reading in the column's unit, correlation from one record to the next, and readings.

    `sigma_from` (see `noise.SIGMA_FROM`) and `degrees` of freedom say how well sigma is known, `rho1_error` how well
    rho1 is, and `rho1_common` an error of rho1 that all sensors share; `kurtosis` is the excess kurtosis. A file
    without them has noise that is certain and Gaussian.
    """

    sensor: str
    sigma: float
    rho1: float
    n: int
    n_effective: float
    outliers: int
    sigma_from: str = "stated"
    degrees: float = 0.0
    rho1_error: float = 0.0
    rho1_common: float = 0.0
    kurtosis: float = 0.0


@dataclass(frozen=True)
class Nominal:
    """Nominal parameters, noise, and what they are worth, as identified from healthy recordings.

    `covariance` (p, p) is that of the estimates, in their units and order. `noise_correlation` (m, m) is
    between sensors in one record. `recording_offsets`: recording → "column bias" or "column scale" → value.
    `smooth`: whether a fit over the operating points stands for what is uncertain about it (see `residuals.reduced`),
    None where that was not tried. `error_model`: by how much the maps may be wrong, None for a model without maps.
    `lagging`: readings that lag behind the model where the engine moves.
    `description`: the engine that was identified, as text, which stands for its file; None in older files.
    `sealed`: false when it was read from a file without a checksum, which may have been
    edited by anyone.
    """

    engine_path: str
    engine_sha256: str
    inputs: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    covariance: np.ndarray
    noise: tuple[SensorNoise, ...]
    noise_correlation: np.ndarray
    offsets: tuple[OffsetPrior, ...]
    recording_offsets: Mapping[str, Mapping[str, float]]
    in_sample: tuple[SensorQuality, ...]
    cross_validated: tuple[SensorQuality, ...]
    held_out: tuple[SensorQuality, ...]
    unidentified: tuple[Combination, ...]
    envelope: Envelope
    records: Mapping[str, int]
    provenance: Mapping[str, str]
    sealed: bool = True
    smooth: bool | None = None
    error_model: ErrorModel | None = None
    description: EngineDescription | None = None
    sensor_lags: tuple[SensorLag, ...] = ()

    @property
    def engine_instance(self) -> str:
        """The engine whose recordings were used, where one was chosen by name; '' otherwise."""
        return self.provenance.get(ENGINE_INSTANCE, "")

    @property
    def theta0(self) -> dict[str, float]:
        """Nominal value of every estimated parameter, amounts of map error among them."""
        return {e.name: e.value for e in self.estimates}

    @property
    def engine_values(self) -> dict[str, float]:
        """Nominal value of every estimated parameter of the engine itself, amounts of map error left aside."""
        return {e.name: e.value for e in self.estimates if e.family not in (FAMILY, POINT_FAMILY)}

    @property
    def sensors(self) -> tuple[str, ...]:
        """Columns that were fitted."""
        return tuple(n.sensor for n in self.noise)

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of one reading per sensor, in the column's unit."""
        return {n.sensor: n.sigma for n in self.noise}

    @property
    def rho1(self) -> dict[str, float]:
        """Lag-1 correlation between consecutive records per sensor."""
        return {n.sensor: n.rho1 for n in self.noise}


def estimate_status(from_data: float, at_bound: bool) -> str:
    """Status of an estimate from the share that the data contributed."""
    if at_bound:
        return "at bound"
    if from_data >= IDENTIFIED:
        return "identified"
    return "weak" if from_data >= WEAK else "at prior"
