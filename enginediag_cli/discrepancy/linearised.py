"""The problem, linear in everything that may be wrong: residuals at the fit without an effect, and derivatives.

One row is one reading of one sensor in one record, in standard deviations that the engine file states:

    y = X x + g_l a + error,   x ~ N(0, I)

X are the derivatives by all that identification may absorb, in prior standard deviations: health, instruments,
offsets of recordings, errors of maps. g_l is the derivative by the parameter of place l, the amplitude a in a
record in the parameter's unit. Records that follow each other are pooled until few enough are left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.drivers import AMBIENT_PRESSURE, INLET_TEMPERATURE, MACH, TIME
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Driver, DriverValues, Effect
from enginediag_cli.error_model.maps import QUANTITIES, turbomachines
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy, ExtendedModel
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    driver_values,
    identify_with,
    nuisance,
    stack_column,
)
from enginediag_cli.mismatch.fit.projection import derivatives, nuisance_columns
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.physics.registry import effect, term

MOST_RECORDS = 320
"""Records after pooling: work grows with their third power, a hypothesis takes 0.05 s with so many."""
COUPLED_FROM = 5
"""Sensors from which errors that several of them share are distinguishable from errors of each."""
MOST_ROWS = 1000
"""Readings after pooling where sensors are coupled by small errors of all places."""
LEVERS = ("customer_bleed", "power_offtake", "tat_probe_heating", "humidity")
"""Terms whose first amplitude is a place: air or power that leaves where the engine has no parameter, and air that is
not what it is taken for."""
FURTHER = ("lower_heating_value_J_kg", "velocity_coefficient")
"""Quantities of components that may vary, too, by their own prior standard deviation."""
FAST_S = 120.0
"""Usual step of time up to which consecutive records are of one state of weather and wear, s."""
SLOW_SHARE, INSTRUMENT_SHARE = 0.1, 0.025
"""Shares of the range along a driver by which air and instruments may change within seconds and back. Judgement."""
LEAST_BREATHING = 0.001
"""Part by which geometry and efficiencies may change within seconds, however exact the maps. Judgement."""
AS_LARGE_AS_IT_IS = 10.0
"""Prior standard deviation of the factor on an amplitude that is fitted: nothing is known of it beforehand."""
LEAST_MOVED = 0.1
"""Root sum of squares over all readings, in stated noise, below which a direction moves nothing."""
TIME_COLUMN = "time_s"
STATIC_TEMPERATURE = Driver("static_temperature", "static temperature of the ambient air", "K")
RECORDED_RATE = Driver("rate", "rate of change of the power setting", "1/s")


@dataclass(frozen=True)
class CandidatePlace:
    """Where something may be missing. `parts`: parameter → its share of the amplitude; `scale`: how far the amplitude
    may vary along a driver, rms, in its unit; `abrupt`: how far within seconds and back; `sign`: of the amplitude, by
    physics, 0 where both occur; `through`: the effect that brings the parameter in."""

    name: str
    words: str
    component: str
    parts: Mapping[str, float]
    scale: float
    abrupt: float
    sign: int = 0
    unit: str = "1"
    through: Effect | None = None
    quantity: str = ""


@dataclass(frozen=True)
class LinearProblem:
    """N pooled records, m sensors, p nuisance columns, L places.

    y (N, m): residuals over the stated noise, 0 where `keep` (N, m) is False; X (N, m, p); G (N, m, L) by the
    amplitude of each place; `count` (N,): records pooled in each; `groups` (p,): 0, or the number of the machine and
    quantity (`machines`) whose map error it is; `time_s` (N,), NaN without a clock; `flight`, `engine` (N,): numbers;
    `aircraft` (N,): number of the flight, one for engines side by side;
    `points` (N, d): operating points in units of their own spread; `drivers`: values (N,) each; `expected` (m,):
    what the model errs by on readings that identification has not seen, in stated noise; `map_accuracy`: relative,
    as stated; `pooled` (M,): pooled record of each of M records read.
    """

    sensors: tuple[str, ...]
    y: np.ndarray
    keep: np.ndarray
    X: np.ndarray
    G: np.ndarray
    places: tuple[CandidatePlace, ...]
    groups: np.ndarray
    machines: tuple[str, ...]
    count: np.ndarray
    time_s: np.ndarray
    flight: np.ndarray
    engine: np.ndarray
    aircraft: np.ndarray
    points: np.ndarray
    drivers: tuple[DriverValues, ...]
    expected: np.ndarray = field(default_factory=lambda: np.ones(1))
    labels: tuple[str, ...] = ()
    map_accuracy: float = 0.003
    pooled: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def __len__(self) -> int:
        """N."""
        return len(self.y)

    @property
    def coupled(self) -> bool:
        """Whether small errors of all places couple the sensors."""
        return len(self.sensors) >= COUPLED_FROM

    @property
    def has_clock(self) -> bool:
        """Whether every record has a time."""
        return bool(np.isfinite(self.time_s).all())

    @property
    def moments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Moment of each record (N,), and time (T,), s, and aircraft (T,) of each moment: engines side by side share
        what switches for both."""
        N = len(self)
        if not self.has_clock or len(np.unique(self.aircraft)) == len(np.unique(self.flight)):
            return np.arange(N), self.time_s, self.flight
        steps = np.diff(self.time_s)[self.flight[1:] == self.flight[:-1]]
        step = float(np.median(steps[steps > 0.0]))
        number = np.round(self.time_s / step).astype(int)
        keys, moment = np.unique(np.column_stack([self.aircraft, number]), axis=0, return_inverse=True)
        return moment.ravel(), keys[:, 1] * step, keys[:, 0]

    def place(self, name: str) -> int:
        """Number of the place of that name. Raises KeyError."""
        for number, p in enumerate(self.places):
            if p.name == name:
                return number
        raise KeyError(name)


def fit_without_effects(dataset: Dataset) -> IdentifiedHypothesis:
    """The fit of everything that identification may absorb, with nothing missing."""
    return identify_with(dataset, NULL_HYPOTHESIS, nuisance(dataset))


def fit_with_members(
    found: IdentifiedHypothesis, members: Sequence[tuple[CandidatePlace, np.ndarray]]
) -> IdentifiedHypothesis:
    """The fit with amplitudes (records of the fit,) at places: their shapes are held, their sizes fitted, and so is
    everything that identification may absorb."""
    dataset = found.evidence
    carried = {e.label for e in dataset.engine.effects}
    levers = {
        p.through.label: p.through for p, _ in members if p.through is not None and p.through.label not in carried
    }
    engine = dataset.engine.replace_effects((*dataset.engine.effects, *levers.values()))
    discrepancies, curves = [], {}
    for k, (place, amplitude) in enumerate(members):
        for name, share in place.parts.items():
            p = engine.parameters[name]
            column = f"member {k + 1} {name}"
            at = found.theta.get(name, p.nominal)
            curves[column] = np.zeros(dataset.records)
            curves[column][found.number] = np.clip(share * amplitude, p.lower - at, p.upper - at)
            discrepancies.append(Discrepancy(name, column, AS_LARGE_AS_IT_IS))
    hypothesis = Hypothesis((), tuple(discrepancies), curves)
    return identify_with(replace(dataset, engine=engine), hypothesis, nuisance(dataset), found)


def linearise(found: IdentifiedHypothesis) -> LinearProblem:
    """The linear problem at a fit, pooled."""
    problem, fit, dataset = found.problem, found.fit, found.evidence
    sigma = np.array([_stated_sigma(dataset, s) for s in problem.sensors])
    free = ~fit.at_bound
    J, offsets = nuisance_columns(found)
    x = np.concatenate([fit.x[free], fit.z.ravel()])
    X = np.concatenate([J[:, :, free], offsets], axis=2) / sigma[:, None]
    # what the hypothesis of the fit moves is sought: it stays in y, and its columns are the places'
    sought = set(found.hypothesis.names)
    absorbed = np.array([p.name not in sought for p, f in zip(problem.parameters, free, strict=True) if f])
    absorbed = np.concatenate([absorbed, np.ones(offsets.shape[2], bool)])
    e = fit.equations.residual / sigma
    keep = np.isfinite(e) & ~fit.failed[:, None]
    # residuals where everything is as expected beforehand
    y = np.where(keep, np.nan_to_num(e) + X @ x, 0.0)
    places = candidate_places(dataset, problem.sensors)
    G = _place_columns(found, places) / sigma[:, None]
    groups, machines = _map_groups(found, free, offsets.shape[2])
    X, groups = compress_columns(np.where(keep[:, :, None], X, 0.0)[:, :, absorbed], groups[absorbed])
    values = driver_values(dataset, found.theta)
    drivers = [DriverValues(d.driver, d.name, d.values[found.number], d.short) for d in values]
    whole = LinearProblem(
        tuple(problem.sensors),
        y,
        keep,
        X,
        np.where(keep[:, :, None], G, 0.0),
        tuple(places),
        groups,
        machines,
        np.ones(len(y)),
        stack_column(dataset, TIME_COLUMN)[found.number],
        np.asarray(problem.recording, int),
        np.array([dataset.engines.index(dataset.flights[r].engine) for r in problem.recording]),
        _aircraft(dataset)[np.asarray(problem.recording, int)],
        _operating_points(found, drivers),
        tuple(drivers) + _further_drivers(found),
        np.array([max(1.0, dataset.noise.sigma[s] / v) for s, v in zip(problem.sensors, sigma, strict=True)]),
        tuple(problem.labels),
        max(dataset.settings.map_accuracy, LEAST_BREATHING),
        np.arange(len(y)),
    )
    most = MOST_RECORDS
    if whole.coupled:
        most = min(most, MOST_ROWS // len(problem.sensors))
    return pool_records(whole, most)


def compress_columns(X: np.ndarray, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (N, m, p) of each group by their principal directions, those that move no reading left out: the same
    prior covariance X Xᵀ with fewer columns."""
    N, m, _ = X.shape
    parts, numbers = [], []
    for g in np.unique(groups):
        U, S, _ = np.linalg.svd(X[:, :, groups == g].reshape(N * m, -1), full_matrices=False)
        few = S > LEAST_MOVED
        parts.append((U[:, few] * S[few]).reshape(N, m, -1))
        numbers += [int(g)] * int(few.sum())
    return np.concatenate(parts, axis=2), np.array(numbers, int)


def candidate_places(dataset: Dataset, sensors: Sequence[str]) -> list[CandidatePlace]:
    """Everything that a search may move: parameters that say how far they roam, heating value and nozzle coefficients,
    all cooling flows together, bleeds and loads without a parameter, instruments."""
    engine = dataset.engine
    step_s = _usual_step(dataset)
    own = {p.name for s in sensors for p in engine.sensors[s].parameters()}
    accuracy = max(dataset.settings.map_accuracy, LEAST_BREATHING)
    found = []
    for p in engine.parameters.values():
        if p.belongs_to_sensor and p.name not in own:
            continue
        if p.roams is None and p.quantity not in FURTHER:
            continue
        scale = p.roams if p.roams is not None else p.prior_sigma
        if p.switches:
            scale = max(scale, p.prior_sigma)
        sign = 1 if p.switches else 0
        name, words = (p.component, p.part) if p.belongs_to_sensor else (p.name, p.words)
        abrupt = _abrupt(scale, step_s, p.switches, p.belongs_to_sensor, accuracy * _size(p))
        found.append(
            CandidatePlace(name, words, p.component, {p.name: 1.0}, scale, abrupt, sign, p.unit, None, p.quantity)
        )
    found += _cooling_together(found, engine)
    return found + _lever_places(engine, step_s)


def _lever_places(engine: Engine, step_s: float) -> list[CandidatePlace]:
    found = []
    for lever in LEVERS:
        for site in term(lever).sites(engine.network):
            e = effect(engine, lever, site.name)
            first = e.term.amplitudes()[0]
            title = e.term.TITLE[0].lower() + e.term.TITLE[1:]
            words = title if site.everywhere else f"{title} at {spelled(site.name)}"
            scale = abs(first.typical)
            abrupt = scale if e.term.SWITCHES or not step_s <= FAST_S else SLOW_SHARE * scale
            sign = 1 if first.lower >= first.absent else 0
            unit = e.parameters()[0].unit
            found.append(
                CandidatePlace(e.label, words, site.component, {e.amplitudes[0]: 1.0}, scale, abrupt, sign, unit, e)
            )
    return found


def _size(p: Parameter) -> float:
    """Nominal size of a parameter, of which accuracies are parts."""
    return abs(p.nominal) or p.prior_sigma


def _abrupt(scale: float, step_s: float, commanded: bool, instrument: bool, accuracy: float) -> float:
    """How far an amplitude may change between two records and back."""
    if commanded or not step_s <= FAST_S:
        return scale
    if instrument:
        return INSTRUMENT_SHARE * scale
    return min(scale, accuracy)


def _cooling_together(places: Sequence[CandidatePlace], engine: Engine) -> list[CandidatePlace]:
    """All cooling flows of the turbines by one factor, as one place."""
    own = [
        p
        for p in places
        if p.quantity == "fraction"
        and not any(engine.parameters[n].switches for n in p.parts if n in engine.parameters)
    ]
    if len(own) < 2:
        return []
    parts = {n: engine.parameters[n].nominal for p in own for n in p.parts}
    parts = {n: v for n, v in parts.items() if v > 0.0}
    share = max(p.scale / engine.parameters[n].nominal for p in own for n in p.parts if n in parts)
    return [CandidatePlace("cooling flows", "all cooling flows together", "cooling", parts, share, share)]


def _stated_sigma(dataset: Dataset, sensor: str) -> float:
    """Noise of a reading as the engine file states it: what the model is expected to reproduce."""
    stated = (dataset.engine.declared.get("identification") or {}).get("noise_sigma") or {}
    return float(stated.get(sensor) or dataset.engine.sensors[sensor].noise_sigma)


def _aircraft(dataset: Dataset) -> np.ndarray:
    """Number of the aircraft's flight of each recording: engines of one file fly side by side."""
    keys = [(f.file, "" if f.file else k) for k, f in enumerate(dataset.flights)]
    first = {key: keys.index(key) for key in keys}
    engines = [[g.engine for g in dataset.flights if g.file == f.file] for f in dataset.flights]
    side_by_side = [len(set(own)) == len(own) for own in engines]
    return np.array([first[key] if s else k for k, (key, s) in enumerate(zip(keys, side_by_side, strict=True))])


def _usual_step(dataset: Dataset) -> float:
    """Median time between records, s; NaN without a clock."""
    steps = [np.diff(np.asarray(f.columns[TIME_COLUMN], float)) for f in dataset.flights if TIME_COLUMN in f.columns]
    every = np.concatenate(steps) if steps else np.zeros(0)
    every = every[np.isfinite(every) & (every > 0.0)]
    return float(np.median(every)) if len(every) else np.nan


def _place_columns(found: IdentifiedHypothesis, places: Sequence[CandidatePlace]) -> np.ndarray:
    """Derivatives (N, m, L) by the amplitudes."""
    engine = found.evidence.engine
    carried = {e.label for e in engine.effects}
    levers = {p.through.label: p.through for p in places if p.through is not None and p.through.label not in carried}
    model = ExtendedModel(engine.replace_effects((*engine.effects, *levers.values())), found.model.discrepancies)
    names = list(dict.fromkeys(n for p in places for n in p.parts))
    J = derivatives(found, names, model)
    column = {n: j for j, n in enumerate(names)}
    return np.stack([sum(w * J[:, :, column[n]] for n, w in p.parts.items()) for p in places], axis=2)


def _map_groups(found: IdentifiedHypothesis, free: np.ndarray, offsets: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """Group of each nuisance column, and the names of the groups: map quantities of machines."""
    own = {m.parameter(q) for m in turbomachines(found.evidence.engine) for q in QUANTITIES}
    sought = {d.name: d.target for d in found.model.discrepancies if d.target in own and d.curve.startswith("map ")}
    machines = tuple(dict.fromkeys(sought.values()))
    number = {t: k + 1 for k, t in enumerate(machines)}
    names = [p.name for p, f in zip(found.problem.parameters, free, strict=True) if f]
    groups = [number[sought[n]] if n in sought else 0 for n in names]
    return np.array([*groups, *([0] * offsets)], int), machines


def _operating_points(found: IdentifiedHypothesis, drivers: Sequence[DriverValues]) -> np.ndarray:
    """Power setting, Mach number, ambient pressure and inlet temperature, in units of their spread, (N, d)."""
    power = found.problem.inputs[found.evidence.engine.power_setting]
    columns = [power, *(d.values for d in drivers if d.driver in (MACH, AMBIENT_PRESSURE, INLET_TEMPERATURE))]
    return standardise(np.column_stack(columns))


def standardise(values: np.ndarray) -> np.ndarray:
    """Columns (N, d) less their mean, over their standard deviation; columns that do not move are dropped."""
    filled = np.where(np.isfinite(values), values, np.nanmean(values, axis=0))
    spread = filled.std(axis=0)
    moves = spread > 1e-6 * np.maximum(np.abs(filled).max(axis=0), 1e-300)
    return np.asarray((filled - filled.mean(axis=0))[:, moves] / spread[moves])


def _further_drivers(found: IdentifiedHypothesis) -> tuple[DriverValues, ...]:
    """Static temperature, and the rate of the power setting where there is a clock."""
    engine, result = found.evidence.engine, []
    if "T0_K" in engine.model_columns:
        at = {n: v for n, v in found.theta.items() if n in engine.parameters}
        own = {c: v for c, v in found.problem.inputs.items() if c in engine.inputs or c in engine.optional_inputs}
        p = engine.predict(own, at, sensors=("T0_K",))
        result.append(DriverValues(STATIC_TEMPERATURE, "static_temperature", p.y[:, 0], "static temperature"))
    time = stack_column(found.evidence, TIME_COLUMN)[found.number]
    if np.isfinite(time).all():
        rate = np.zeros(len(time))
        for r in np.unique(found.problem.recording):
            own = found.problem.recording == r
            if own.sum() > 2 and (np.diff(time[own]) > 0.0).all():
                rate[own] = np.gradient(found.problem.inputs[engine.power_setting][own], time[own])
        result.append(DriverValues(RECORDED_RATE, "power_rate", rate, "rate of the power setting"))
    return tuple(d for d in result if d.moves and d.driver != TIME)


def pool_records(problem: LinearProblem, most: int) -> LinearProblem:
    """Neighbours of one flight as one record each, their means, until at most `most` are left."""
    step = -(-len(problem) // most)
    if step <= 1:
        return problem
    number, first = np.zeros(len(problem), int), 0
    for r in np.unique(problem.flight):
        own = np.flatnonzero(problem.flight == r)
        number[own] = first + np.arange(len(own)) // step
        first += -(-len(own) // step)
    readings = _sums(number, problem.keep.astype(float), first)

    def mean(values: np.ndarray) -> np.ndarray:
        total = _sums(number, values, first)
        n = readings.reshape(*readings.shape, *([1] * (values.ndim - 2)))
        return np.asarray(total / np.maximum(n, 1.0))

    one = np.searchsorted(number, np.arange(first))
    records = _sums(number, np.ones(len(problem)), first)

    def average(values: np.ndarray) -> np.ndarray:
        shape = (first, *([1] * (values.ndim - 1)))
        return np.asarray(_sums(number, values, first) / records.reshape(shape))

    return LinearProblem(
        problem.sensors,
        mean(problem.y),
        readings > 0,
        mean(problem.X),
        mean(problem.G),
        problem.places,
        problem.groups,
        problem.machines,
        _sums(number, problem.count, first),
        average(problem.time_s),
        problem.flight[one],
        problem.engine[one],
        problem.aircraft[one],
        average(problem.points),
        tuple(DriverValues(d.driver, d.name, average(d.values), d.short) for d in problem.drivers),
        problem.expected,
        problem.labels,
        problem.map_accuracy,
        number[problem.pooled] if len(problem.pooled) else number,
    )


def _sums(number: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """Sums of values (M, …) of equal number, (size, …)."""
    total = np.zeros((size, *values.shape[1:]))
    np.add.at(total, number, values)
    return total
