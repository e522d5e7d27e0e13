"""The identification problem: which parameters are estimated, what is known before, and the readings.

A reading of sensor s in record k of recording r is modelled as

    y_ks = Φ_s(u_k, θ)·(1 + c_rs) + b_rs + noise of standard deviation σ_s

with θ the parameters (prior N(mean, sigma²), hard bounds) and, per recording, nuisance offsets b and c
(prior N(0, sigma²)) where the settings ask for them, or there are enough recordings to see their scatter; those of
inputs change u_k in the same way. Inside the solver both are measured in prior
standard deviations, x = (θ − mean)/sigma, so that nothing depends on the units of a parameter.

**Losses** bound the influence of a gross outlier. They are functions of the normalised residual z = e/σ, written as
ρ(z) with ρ → ½z² for small z, so that the sum over readings is minus a log-likelihood:

    soft_l1   ρ = c²(√(1 + z²/c²) − 1)          ψ = ρ' = z/√(1 + z²/c²)
    huber     ρ = ½z² for |z| ≤ c, c|z| − ½c²   ψ = z clipped to ±c
    none      ρ = ½z²

Source: P. J. Huber, "Robust Estimation of a Location Parameter", Ann. Math. Statist. 35 (1964) 73–101;
P. J. Huber, Robust Statistics (1981), chapter 7, for the regression equations.

**Training recordings** are made of recording tables, one per engine and flight, in the order of the file. Records that
an earlier recording contains as well are dropped, since they would be counted twice as evidence. The same flight may
come under two names, with its clock set differently, or inside a longer file: records are equal if their inputs and
readings are, whatever their file or time.
"""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.engine.declaration import IDENTIFICATION, LOSSES
from enginediag_cli.engine.recall import MOMENT, UNKNOWN_PAST
from enginediag_cli.engine.wrapped import Model
from enginediag_cli.errors import DataError
from enginediag_cli.identification.noise import TIME, record_gaps, record_positions
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import split_column


@dataclass(frozen=True)
class Loss:
    """A loss by name and its scale `c` in standard deviations: readings beyond it count less and less."""

    name: str = "soft_l1"
    scale: float = 2.5

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise ValueError(f"`loss` must be one of {LOSSES}, not {self.name!r}")
        if not self.scale > 0:
            raise ValueError(f"the scale of a loss must be positive, not {self.scale!r}")

    @property
    def robust(self) -> bool:
        """Whether a gross outlier counts less than its square."""
        return self.name != "none"

    def cost(self, z: np.ndarray) -> np.ndarray:
        """ρ(z), any shape, dimensionless."""
        c = self.scale
        if self.name == "soft_l1":
            # z²/(1+√(1+z²/c²)) is c²(√(1+z²/c²)−1) without its cancellation at small z
            return np.asarray(z**2 / (1 + np.sqrt(1 + (z / c) ** 2)))
        if self.name == "huber":
            a = np.abs(z)
            return np.where(a <= c, 0.5 * z**2, c * a - 0.5 * c**2)
        return np.asarray(0.5 * z**2)

    def weight(self, z: np.ndarray) -> np.ndarray:
        """ψ(z)/z, the weight of iteratively reweighted least squares; 1 at z = 0."""
        if self.name == "soft_l1":
            return np.asarray(1 / np.sqrt(1 + (z / self.scale) ** 2))
        if self.name == "huber":
            return self.scale / np.maximum(np.abs(z), self.scale)
        return np.ones_like(z)

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """ψ'(z), never negative; its mean is the bread of the sandwich covariance."""
        if self.name == "soft_l1":
            return np.asarray((1 + (z / self.scale) ** 2) ** -1.5)
        if self.name == "huber":
            return np.asarray(np.abs(z) <= self.scale, float)
        return np.ones_like(z)


@dataclass(frozen=True)
class IdentificationSettings:
    """The `identification:` block as values; the field names are its keys (see `IDENTIFICATION`)."""

    parameters: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()
    prior_mean: Mapping[str, float] = field(default_factory=dict)
    prior_sigma: Mapping[str, float] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    noise_sigma: Mapping[str, float] = field(default_factory=dict)
    noise: str = "estimate"
    monitoring_noise: str = "fit"
    recording_bias_sigma: Mapping[str, float] = field(default_factory=dict)
    recording_scale_sigma: Mapping[str, float] = field(default_factory=dict)
    loss: str = "soft_l1"
    loss_scale: float = 2.5
    cross_validation_block: int = 0
    max_iterations: int = 75

    def reduce_iterations(self, steps: int) -> IdentificationSettings:
        """The rest when so many steps have been taken."""
        return replace(self, max_iterations=max(self.max_iterations - steps, 0))


def settings_from_mapping(block: Mapping[str, Any] | None) -> IdentificationSettings:
    """Settings from a validated `identification:` block; keys that are absent keep their defaults."""
    if not block:
        return IdentificationSettings()
    declared = {f.name: f for f in IDENTIFICATION.fields}
    unknown = sorted(set(block) - set(declared))
    if unknown:
        raise ValueError(f"unknown keys in `identification:`: {', '.join(unknown)}")
    values: dict[str, Any] = {
        k: tuple(v) if declared[k].kind == "texts" else v for k, v in block.items() if v is not None
    }
    return IdentificationSettings(**values)


@dataclass(frozen=True)
class OffsetPrior:
    """An error that is constant in one recording: `bias` in the column's unit, `scale` a fraction.

    sensor: column of a measured output, or of an input of the model; prior_sigma: its standard deviation between
    recordings, the likeliest where it was estimated; recordings: from how many, 0 where it is stated; spread: standard
    deviation of ln prior_sigma by what these recordings leave open.
    """

    sensor: str
    kind: str
    prior_sigma: float
    recordings: int = 0
    spread: float = 0.0

    @property
    def next_sigma(self) -> float:
        """Standard deviation of the offset of a further recording, its size integrated out: with ln s ~ N(ln s₀, v²)

        E[s²] = s₀² exp(2 v²)
        """
        return self.prior_sigma * exp(self.spread**2)


class TrainingRecording(NamedTuple):
    """One healthy recording: label (file or flight), columns (N,) by name, regime of each record or None."""

    label: str
    columns: Mapping[str, np.ndarray]
    regimes: np.ndarray | None = None
    engine: str = ""  # of several, which one it is of


@dataclass(frozen=True)
class IdentificationProblem:
    """N records of m sensors from R recordings, p parameters and q offsets per recording."""

    model: Model
    parameters: tuple[Parameter, ...]
    prior_mean: np.ndarray  # (p,)
    prior_sigma: np.ndarray  # (p,)
    lower: np.ndarray  # (p,)
    upper: np.ndarray  # (p,)
    sensors: tuple[str, ...]
    sigma: np.ndarray  # (m,) noise of one reading, in the column's unit
    inflation: np.ndarray  # (m,) κ ≥ 1: readings per independent reading
    inputs: Mapping[str, np.ndarray]  # (N,) each
    measured: np.ndarray  # (N, m), NaN where there is no reading
    recording: np.ndarray  # (N,) index into labels, not decreasing
    labels: tuple[str, ...]
    position: np.ndarray  # (N,) steps since the first record of its recording, see `noise.py`
    time: np.ndarray  # (N,) in s, NaN where unknown
    regimes: np.ndarray  # (N,) text
    offsets: tuple[OffsetPrior, ...]
    loss: Loss
    dropped: Mapping[str, int]  # reason: records that were left out before the fit
    shared: np.ndarray | None = None  # (m,) the part of κ that stands for the model's error, see `map_error.py`

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p estimated parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def input_offsets(self) -> int:
        """How many of the offsets, the last ones, are of inputs."""
        return sum(o.sensor not in self.sensors for o in self.offsets)

    @property
    def gap(self) -> np.ndarray:
        """Steps since the record before, (N,), infinite at the beginning of a recording."""
        return record_gaps(self.position, self.recording)

    def to_physical(self, x: np.ndarray) -> dict[str, float]:
        """Parameter values in their own units from x in prior standard deviations, (p,)."""
        theta = np.clip(self.prior_mean + self.prior_sigma * x, self.lower, self.upper)
        return {p.name: float(v) for p, v in zip(self.parameters, theta, strict=True)}

    def select(self, keep: np.ndarray) -> IdentificationProblem:
        """The same problem with the records where `keep` (N,) is true."""
        inputs = {c: v[keep] for c, v in self.inputs.items()}
        return replace(
            self,
            inputs=inputs,
            measured=self.measured[keep],
            recording=self.recording[keep],
            position=self.position[keep],
            time=self.time[keep],
            regimes=self.regimes[keep],
        )

    def replace_noise(
        self, sigma: np.ndarray, inflation: np.ndarray, shared: np.ndarray | None = None
    ) -> IdentificationProblem:
        """The same problem with other noise, all (m,)."""
        return replace(self, sigma=sigma, inflation=inflation, shared=shared)

    def add_error_parameters(self, model: Model, family: str) -> IdentificationProblem:
        """The same problem for a model that wraps this one's, with its parameters of `family`, about 0, among those
        that are sought."""
        added = tuple(p for p in model.parameters.values() if p.family == family)
        k = len(added)
        return replace(
            self,
            model=model,
            parameters=(*self.parameters, *added),
            prior_mean=np.append(self.prior_mean, np.zeros(k)),
            prior_sigma=np.append(self.prior_sigma, [p.prior_sigma for p in added]),
            lower=np.append(self.lower, np.full(k, -np.inf)),
            upper=np.append(self.upper, np.full(k, np.inf)),
        )


def build_problem(
    model: Model, recordings: Sequence[TrainingRecording], settings: IdentificationSettings
) -> IdentificationProblem:
    """Stack recordings and choose parameters, sensors and offsets.

    Records that lack an input or every reading are excluded and counted in `dropped`. Raises DataError for
    unknown names in the settings, for a missing input column, and when no record is left.
    """
    sensors = _recorded_sensors(model, recordings, settings)
    parameters = _chosen_parameters(model, settings, sensors)
    means = np.array([settings.prior_mean.get(p.name, p.nominal) for p in parameters], float)
    sigmas = np.array([settings.prior_sigma.get(p.name, p.prior_sigma) for p in parameters], float)
    bad = [p.name for p, s in zip(parameters, sigmas, strict=True) if not (np.isfinite(s) and s > 0)]
    if bad:
        raise DataError(
            f"the prior sigma of {', '.join(bad)} must be a positive number; "
            "list the parameter under `fixed:` to keep it at nominal"
        )
    noise = np.array([settings.noise_sigma.get(s, model.sensors[s].noise_sigma) or np.nan for s in sensors], float)
    if not np.all(noise > 0):
        lacking = [s for s, v in zip(sensors, noise, strict=True) if not v > 0]
        raise DataError(f"no noise sigma is known for {', '.join(lacking)}; give it under `noise_sigma:`")
    stacked = _stack(model, recordings, sensors)
    return IdentificationProblem(
        model,
        parameters,
        means,
        sigmas,
        np.array([p.lower for p in parameters], float),
        np.array([p.upper for p in parameters], float),
        sensors,
        noise,
        np.ones(len(sensors)),
        stacked.inputs,
        stacked.measured,
        stacked.recording,
        tuple(r.label for r in recordings),
        stacked.position,
        stacked.time,
        stacked.regimes,
        _offsets((*sensors, *model.inputs), settings),
        Loss(settings.loss, settings.loss_scale),
        stacked.dropped,
    )


def match_names(patterns: Sequence[str], known: Sequence[str], what: str) -> list[str]:
    """Names that names and shell patterns stand for. Raises DataError for one that fits nothing."""
    found: list[str] = []
    for pattern in patterns:
        hits = fnmatch.filter(known, pattern)
        if not hits:
            raise DataError(f"`identification:` names an unknown {what} {pattern!r} ({near(pattern, known)})")
        found += [h for h in hits if h not in found]
    return found


def _chosen_parameters(
    model: Model, settings: IdentificationSettings, sensors: tuple[str, ...]
) -> tuple[Parameter, ...]:
    known = list(model.parameters)
    match_names([*settings.prior_mean, *settings.prior_sigma], known, "parameter")
    if settings.parameters:
        chosen = match_names(settings.parameters, known, "parameter")
    else:
        # an effect that the engine file carries has its own coefficient; it is identified only when asked for
        # and a sensor that is not recorded has nothing to say about its own errors
        recorded = {f"sensor.{split_column(s)[0]}" for s in sensors}
        chosen = [
            n
            for n, p in model.parameters.items()
            if p.family != "physics" and (not p.belongs_to_sensor or p.component in recorded)
        ]
    fixed = set(match_names(settings.fixed, known, "parameter"))
    chosen = [n for n in chosen if n not in fixed]
    if not chosen:
        raise DataError("`identification:` leaves no parameter to estimate")
    return tuple(model.parameters[n] for n in chosen)


def _recorded_sensors(
    model: Model, recordings: Sequence[TrainingRecording], settings: IdentificationSettings
) -> tuple[str, ...]:
    known = list(model.sensors)
    match_names([*settings.noise_sigma], known, "sensor")
    between = [*settings.recording_bias_sigma, *settings.recording_scale_sigma]
    match_names(between, [*known, *model.inputs], "sensor or input")
    wanted = match_names(settings.sensors, known, "sensor") if settings.sensors else known
    recorded = tuple(s for s in wanted if any(s in r.columns and np.any(np.isfinite(r.columns[s])) for r in recordings))
    if not recorded:
        raise DataError(f"the recordings hold no reading of any sensor of the engine ({', '.join(wanted)})")
    return recorded


def _no_controls(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Of a model without controls every record counts."""
    return {}


def _offsets(columns: tuple[str, ...], settings: IdentificationSettings) -> tuple[OffsetPrior, ...]:
    """Offsets that are stated, of the sensors first and of inputs last."""
    wanted = [("bias", settings.recording_bias_sigma), ("scale", settings.recording_scale_sigma)]
    return tuple(
        OffsetPrior(s, kind, float(sigma[s])) for s in columns for kind, sigma in wanted if sigma.get(s, 0.0) > 0
    )


class _Stack(NamedTuple):
    """The records of all recordings below each other, as in `Problem`."""

    inputs: dict[str, np.ndarray]
    measured: np.ndarray
    recording: np.ndarray
    position: np.ndarray
    time: np.ndarray
    regimes: np.ndarray
    dropped: dict[str, int]


def _stack(model: Model, recordings: Sequence[TrainingRecording], sensors: tuple[str, ...]) -> _Stack:
    dropped: Counter[str] = Counter()
    optional = dict(model.optional_inputs)
    if any(MOMENT in item.columns for item in recordings):  # what lags is seen by those without memory, too
        optional |= UNKNOWN_PAST
    inputs: dict[str, list[np.ndarray]] = {c: [] for c in (*model.inputs, *optional)}
    measured, recording, positions, times, regimes = [], [], [], [], []
    for index, item in enumerate(recordings):
        missing = [c for c in model.inputs if c not in item.columns]
        if missing:
            raise DataError(f"{item.label}: lacks the input column{'s' * (len(missing) > 1)} {', '.join(missing)}")
        n = len(item.columns[model.inputs[0]])
        keep = np.ones(n, bool)
        values = {c: np.asarray(item.columns[c], float) for c in model.inputs}
        for c, default in optional.items():
            values[c] = np.asarray(item.columns.get(c, np.full(n, default)), float)
        for c in values:
            dropped[f"no {c}"] += int(np.sum(keep & ~np.isfinite(values[c])))
            keep &= np.isfinite(values[c])
        for control, unclear in getattr(model, "undecided", _no_controls)(values).items():
            dropped[f"whether {control} acts"] += int(np.sum(keep & unclear))
            keep &= ~unclear
        y = np.column_stack([np.asarray(item.columns.get(s, np.full(n, np.nan)), float) for s in sensors])
        y[~np.isfinite(y)] = np.nan
        empty = np.isnan(y).all(axis=1)
        dropped["no sensor reading"] += int(np.sum(keep & empty))
        keep &= ~empty
        for c in inputs:
            inputs[c].append(values[c][keep])
        measured.append(y[keep])
        recording.append(np.full(int(keep.sum()), index))
        positions.append(record_positions(item.columns, model.inputs, n)[keep])
        times.append(np.asarray(item.columns.get(TIME, np.full(n, np.nan)), float)[keep])
        labels = np.full(n, "all") if item.regimes is None else np.asarray(item.regimes).astype(str)
        regimes.append(labels[keep])
    if not sum(map(len, measured)):
        raise DataError(
            "no record has all inputs and a sensor reading: " + ", ".join(f"{v} {k}" for k, v in dropped.items() if v)
        )
    return _Stack(
        {c: np.concatenate(v) for c, v in inputs.items()},
        np.concatenate(measured),
        np.concatenate(recording),
        np.concatenate(positions),
        np.concatenate(times),
        np.concatenate(regimes),
        {k: v for k, v in dropped.items() if v},
    )


SNAPSHOTS = 2.0
"""Fewer records per flight than this on average: the flights of one engine are one recording of snapshots."""


def training_recordings(recording: Recording, label: str, *, engine: str = "") -> list[TrainingRecording]:
    """Split a recording by its text columns `engine` and `flight`; a `phase` column becomes the regime of each record.

    Parameters
    ----------
    recording : Recording
    label : str
        Name of the recording in messages and offsets.
    engine : str
        Keep this instance alone; "" for all.

    Returns
    -------
    list of TrainingRecording
        One per engine and flight, in the order of the file.

    Raises
    ------
    DataError
        For an engine that the recording does not have.
    """
    engines = recording.text.get("engine")
    if engine and engines is not None:
        if engine not in engines:
            known = ", ".join(dict.fromkeys(engines))
            raise DataError(f"{recording.source}: no record of engine {engine!r}; it has {known}")
        recording = recording.select(np.asarray(engines) == engine)
    keys = _keys(recording)
    found = []
    for key in dict.fromkeys(keys):
        part = recording.select(np.array([k == key for k in keys], bool)) if len(set(keys)) > 1 else recording
        regimes = np.asarray(part.text["phase"]) if "phase" in part.text else None
        name = " ".join([label, *(f"{what} {k}" for what, k in zip(("engine", "flight"), key, strict=False) if k)])
        found.append(TrainingRecording(name, dict(part.columns), regimes))
    return found


def _keys(recording: Recording) -> list[tuple[str, ...]]:
    n = len(recording)
    engines, flights = (list(recording.text.get(c, [""] * n)) for c in ("engine", "flight"))
    by_flight: list[tuple[str, ...]] = list(zip(engines, flights, strict=True))
    if n < SNAPSHOTS * len(set(by_flight)):
        return [(e,) for e in engines]
    return by_flight


def first_records(recordings: Sequence[TrainingRecording], n: int) -> list[TrainingRecording]:
    """At most the first n records of each recording: early life of each engine."""
    return [select_records(r, slice(0, n)) for r in recordings]


def hold_out_end(
    recordings: Sequence[TrainingRecording], fraction: float
) -> tuple[list[TrainingRecording], list[TrainingRecording]]:
    """The first part of each recording for training, and the last `fraction` of its records to judge by."""
    train, test = [], []
    for r in recordings:
        n = len(next(iter(r.columns.values())))
        cut = n - round(fraction * n)
        if cut > 0:
            train.append(select_records(r, slice(0, cut)))
        if cut < n:
            test.append(select_records(r, slice(cut, n)))
    return train, test


def select_records(r: TrainingRecording, rows: slice | np.ndarray) -> TrainingRecording:
    """Some of the records."""
    regimes = None if r.regimes is None else r.regimes[rows]
    return r._replace(columns={c: v[rows] for c, v in r.columns.items()}, regimes=regimes)


FEWEST = 5
"""Records that must be repeated before it is more than chance: coarse readings at a standstill agree now and then."""
SHARE = 0.5
"""Share of the records of the shorter of two recordings that must be in both: flights do not share half."""


@dataclass(frozen=True)
class Repeat:
    """`records` of the recording `label` are in the earlier recording `original`, too; `whole`: all of them do."""

    label: str
    original: str
    records: int
    whole: bool


def drop_repeats(
    recordings: Sequence[TrainingRecording], columns: Sequence[str]
) -> tuple[list[TrainingRecording], tuple[Repeat, ...]]:
    """Drop records that an earlier recording contains as well; records that repeat within one recording stay.

    Parameters
    ----------
    recordings : sequence of TrainingRecording
    columns : sequence of str
        Inputs and sensors of the engine, by which records are compared.

    Returns
    -------
    list of TrainingRecording
        The recordings with every record once, in their order, without those of which nothing remains.
    tuple of Repeat
        What was dropped.
    """
    kept: list[TrainingRecording] = []
    found: list[Repeat] = []
    seen: list[tuple[str, frozenset[bytes]]] = []
    for recording in recordings:
        keys = _record_keys(recording, columns)
        own = frozenset(key for key in keys if key)
        again = np.zeros(len(keys), bool)
        for label, theirs in seen:
            common = own & theirs
            shorter = min(len(own), len(theirs))
            if not common or len(common) < min(FEWEST, shorter) or len(common) < SHARE * shorter:
                continue
            here = np.array([key in common for key in keys]) & ~again
            again |= here
            if here.any():
                found.append(Repeat(recording.label, label, int(here.sum()), bool(here.all())))
        seen.append((recording.label, own))
        if not again.any():
            kept.append(recording)
        elif not again.all():
            kept.append(select_records(recording, ~again))
    return kept, tuple(found)


def _record_keys(recording: TrainingRecording, columns: Sequence[str]) -> list[bytes]:
    """One key per record, empty where it has no number at all; -0.0 is 0.0, and a missing value is one."""
    n = len(next(iter(recording.columns.values()))) if recording.columns else 0
    table = np.column_stack(
        [np.asarray(recording.columns.get(c, np.full(n, np.nan)), float) for c in columns] or [np.zeros((n, 0))]
    )
    table = np.where(np.isfinite(table), table + 0.0, np.nan)
    something = np.isfinite(table).any(axis=1)
    return [row.tobytes() if there else b"" for row, there in zip(table, something, strict=True)]
