"""Errors of the model in an identification: of its maps, and at operating points that are flown again and again.

**Map errors.** Their amounts are estimated beside the parameters, and their sizes from the records.

A fit alternates three things: the parameters and amounts given their priors, the noise that they leave, and the sizes
of the map errors under which the records are likeliest. Map coordinates are columns of each record
(see `error_model.maps`).

**Operating points share an error.** Records at one operating point share the model's error there, whatever their
number: a thousand flights at one point say where the model's error lies, not that there is none. With the records of
the fit dealt to cells of their operating points, n_c in cell c, the residuals of each sensor are an error σ_m of the
cell and a scatter σ_w of its records,

    E (mean of cell c)² = σ_m² + σ_w²/n_c,        κ = 1 + n̄ σ_m²/σ²,    n̄ = Σ n_c²/N,

and the fit weighs the readings by 1/(κσ²), as many as they are worth. Where the model fits, σ_m vanishes and κ is 1, so
that records count in full. Only snapshots are so dealt: along a recording with a clock the model's error changes with
time and is seen as correlation (`noise.py`). Estimation: one-way analysis of variance, lack of fit against pure error
(N. R. Draper and H. Smith, Applied Regression Analysis, §2.1).

**Few operating points.** Where every record is at one of a few points, with many records each, the mean residual of a
point is known to a small part of the noise, and is no noise: see `error_model.maps`. How large it is, is found with the
sizes of map errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.error_model.maps import (
    EDGE_CURVES,
    FAMILY,
    POINT_FAMILY,
    QUANTITIES,
    MapErrorModel,
    OperatingPoints,
    PointErrorModel,
    learn_curves,
    map_coordinates,
    resize_point_errors,
    turbomachines,
)
from enginediag_cli.error_model.sizes import LARGEST, expected_factors, likeliest_factors
from enginediag_cli.identification.nominal import MARGIN_RANGE, MINIMUM_SPREAD, RELATIVE_SPREAD
from enginediag_cli.identification.normal_equations import NormalEquations, eliminate, predict
from enginediag_cli.identification.problem import IdentificationProblem, Model

CELL = 0.1
"""Side of a cell, as a share of the range of what is predicted: the error of a generic map changes over about that."""
SAME = 0.01
"""Relative change of the readings below which operating points are one: less is the scatter of a control."""
DIRECTIONS = 3
"""Directions in which operating points are distinguished: power, and two of flight and weather."""
EMPTY = 0.25
"""Part of a cell without any value that ends a cell, so that none ends within a condition that is flown again and
again: judgement."""
LEAST_WORTH = 8.0
"""Readings that a cell is worth at least. Judgement: with as few as 2 a fit of three to six conditions gives up what it
could learn of the maps, with 20 map shapes go to where no compressor is."""
BY_CHANCE = 2.0
"""Standard deviations of chance by which cells must differ more than their records do, before they count as misfit."""
LEAST_LEFT = 0.25
"""Share of the cells of which the fit has left the error at least: where it used up more, the rest says too little."""


def is_without_clock(gap: np.ndarray) -> bool:
    """Whether the records (N,) of every recording merely follow each other, as snapshots do."""
    return bool(np.all(gap[np.isfinite(gap)] == 1.0))


def assign_cells(predicted: np.ndarray) -> np.ndarray:
    """Cell of each record, (N,) int from 0, by the predicted readings (N, m), NaN where there is none."""
    return np.unique(OperatingPointCells(predicted).places(predicted), axis=0, return_inverse=True)[1].reshape(-1)


class OperatingPointCells:
    """Cells of operating points, laid by the predicted readings (N, m) of some records, NaN where there is none.

    Inputs have no common scale (an hour of weather, a metre of altitude): what they do to the readings has. A direction
    is cut where there are no values, and between such cuts into intervals of one length.
    """

    def __init__(self, predicted: np.ndarray):
        size = np.nanmean(np.abs(predicted), axis=0)
        self._size = np.where(size > 0, size, 1.0)
        y = self._scaled(predicted)
        self._centre = y.mean(axis=0)
        values, ways = np.linalg.eigh((y - self._centre).T @ (y - self._centre))
        self._ways = ways[:, np.argsort(values)[::-1][:DIRECTIONS]]
        scores = (y - self._centre) @ self._ways
        self._side = max(CELL * float(np.ptp(scores[:, 0])), SAME * np.sqrt(y.shape[1]))
        self._first = []  # of each direction, the lowest value of each stretch without a gap
        for score in np.sort(scores, axis=0).T:
            self._first.append(score[np.diff(score, prepend=-np.inf) > EMPTY * self._side])

    def places(self, predicted: np.ndarray) -> np.ndarray:
        """Place of the cell of each record, (N, 2 WAYS) int: stretch and interval of each direction."""
        scores = (self._scaled(predicted) - self._centre) @ self._ways
        found = np.empty((len(scores), 2 * scores.shape[1]), int)
        for i, (u, first) in enumerate(zip(scores.T, self._first, strict=True)):
            stretch = np.maximum(np.searchsorted(first, u, side="right") - 1, 0)
            found[:, 2 * i], found[:, 2 * i + 1] = stretch, np.floor((u - first[stretch]) / self._side)
        return found

    def _scaled(self, predicted: np.ndarray) -> np.ndarray:
        return np.asarray(np.nan_to_num(predicted / self._size, nan=1.0))


def misfit_inflation(
    predicted: np.ndarray, residual: np.ndarray, sigma: np.ndarray, correlated: np.ndarray, used: np.ndarray
) -> np.ndarray:
    """κ (m,), at least 1, from predictions and residuals (N, m), NaN where missing, of readings of noise `sigma` (m,).

    `correlated` (m,): readings per independent one by the correlation in time, which also makes records of one cell
    alike; `used` (m,): readings of each sensor that the fit has used up.
    """
    cell = assign_cells(predicted)
    there = np.isfinite(residual)
    e = np.where(there, residual, 0.0)
    count = int(cell.max()) + 1
    n = np.stack([np.bincount(cell, t, count) for t in there.T.astype(float)], axis=1)  # (cells, m)
    mean = np.stack([np.bincount(cell, column, count) for column in e.T], axis=1) / np.maximum(n, 1)
    N, filled = np.maximum(n.sum(axis=0), 1), np.maximum((n > 0).sum(axis=0), 1)
    within = np.sum(np.where(there, (e - mean[cell]) ** 2, 0.0), axis=0) / np.maximum(N - filled, 1)
    # what chance makes of as many means, and as much again twice as it scatters
    chance = filled * within * np.maximum(correlated, 1.0) * (1 + BY_CHANCE * np.sqrt(2 / filled))
    between = np.maximum(np.sum(n * mean**2, axis=0) - chance, 0.0) / N
    between *= filled / np.maximum(filled - used, LEAST_LEFT * filled)
    crowd = np.sum(n**2, axis=0) / N
    kappa = 1.0 + crowd * between / sigma**2
    return np.clip(kappa, 1.0, np.maximum(crowd / LEAST_WORTH, 1.0))


MOST_POINTS = 12
"""Operating points that have errors of their own: a fleet is recorded at a handful of conditions. Where records lie at
more, what is missed changes smoothly from one to the next, and curves describe it."""
LEAST_MISS, LARGEST_MISS = 0.1, 30.0
"""Limits of the size of what is missed, in standard deviations of the sensor's stated noise: less is lost in the
noise, more is no longer a model of this engine."""


def add_point_errors(problem: IdentificationProblem, accuracy: float) -> IdentificationProblem:
    """The problem with what the model misses at operating points among its parameters, or as it is: where the maps are
    right (accuracy 0), records follow a clock, or are not at a few points with many records each.

    At a single point what is missed is what the parameters themselves say.
    """
    if accuracy <= 0.0 or not is_without_clock(problem.gap):
        return problem
    points = _points(problem)
    if points is None:
        return problem
    # at first as large as the noise
    sizes = dict(zip(problem.sensors, (float(s) for s in problem.sigma), strict=True))
    model = PointErrorModel(problem.model, points, sizes)
    return problem.add_error_parameters(model, POINT_FAMILY)


def expected_misses(model: Model, missed: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Sizes that are expected before the data, of the columns in `missed`: the noise that the engine file states."""
    return np.array([model.sensors[s].noise_sigma for s in missed], float)


def _points(problem: IdentificationProblem) -> OperatingPoints | None:
    """The operating points at which the records are; None where these are one or many, few records are at one, or one
    runs into the next: parts of a range are no points, and curves describe what is missed along it."""
    zeros = np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets)))
    predicted, status = predict(problem, *zeros)
    there = status <= 1
    if not there.any():
        return None
    cell = assign_cells(predicted[there])
    count = np.bincount(cell)
    if not 1 < len(count) <= MOST_POINTS or count.min() < LEAST_WORTH:
        return None
    names = tuple(problem.model.inputs)
    low, high = np.empty((2, len(count), len(names)))
    for j, name in enumerate(names):
        values = problem.inputs[name][there]
        least = MINIMUM_SPREAD.get(name, RELATIVE_SPREAD * max(float(np.max(np.abs(values))), 1e-12))
        for c in range(len(count)):
            at = values[cell == c]
            low[c, j], high[c, j] = at.min() - MARGIN_RANGE[0] * least, at.max() + MARGIN_RANGE[0] * least
    shared = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=2)
    return None if np.count_nonzero(shared) > len(count) else OperatingPoints(names, low, high)


SETTLED = 0.1
"""Largest relative change of a size from one pass to the next that ends the passes: the answer hardly knows it
better."""

EXCITED = 0.1
"""Root mean square of a curve over the training records, of 1 where they span its range, from which its amount has a
say in how large errors are. Where next to nothing varies a large amount does next to nothing, and takes up whatever
happens to follow it: judgement."""


@dataclass(frozen=True)
class MapErrorSize:
    """Standard deviation of each amount of the map error of `target`, as stated, and as these records have it."""

    target: str
    stated: float
    estimated: float


def add_map_errors(problem: IdentificationProblem, accuracy: float) -> IdentificationProblem:
    """The problem with amounts of map error among its parameters, of standard deviation `accuracy`.

    Nothing changes where the accuracy is 0, or the model has no maps, or computes no record at the prior mean.
    """
    machines = turbomachines(problem.model)
    if accuracy <= 0.0 or not machines:
        return problem
    at = map_coordinates(problem.model, problem.inputs, problem.to_physical(np.zeros(len(problem.parameters))))
    curves = [c for name, coordinates in at.items() if (c := learn_curves(name, coordinates)) is not None]
    if not curves:
        return problem
    sizes = {
        m.parameter(q): accuracy for m in machines for q in QUANTITIES if m.parameter(q) in problem.model.parameters
    }
    model = MapErrorModel(problem.model, curves, sizes)
    extended = problem.add_error_parameters(model, FAMILY)
    return replace(extended, inputs={**problem.inputs, **model.frozen(problem.inputs, problem.sensors)})


def restrict_map_range(problem: IdentificationProblem, records: np.ndarray) -> IdentificationProblem:
    """The problem with errors of maps that know no other range than that of some of its records (N,) bool, as if it had
    been built of these alone."""
    model = problem.model
    if not isinstance(model, MapErrorModel):
        return problem
    at = model.coordinates(problem.inputs)
    learnt = [learn_curves(c.machine, at[c.machine][records]) or c for c in model.curves]
    return replace(problem, model=MapErrorModel(model.model, learnt, model.sizes))


def map_error_sizes(problem: IdentificationProblem, stated: float) -> tuple[MapErrorSize, ...]:
    """Sizes of the map errors as the problem has them."""
    if not isinstance(problem.model, MapErrorModel):
        return ()
    sigma = dict(zip(problem.names, problem.prior_sigma, strict=True))
    return tuple(MapErrorSize(t, stated, float(sigma[names[0]])) for t, names in problem.model.groups.items())


def resize_errors(
    problem: IdentificationProblem,
    equations: NormalEquations,
    x: np.ndarray,
    z: np.ndarray,
    stated: float,
    damping: float = 1.0,
) -> tuple[IdentificationProblem, np.ndarray, float]:
    """The problem with the likeliest sizes of map errors, and of what is missed at operating points, x (p,) in its
    units, and the largest relative change. damping: by which share of the way to them."""
    if not isinstance(problem.model, MapErrorModel):
        return problem, x, 0.0
    maps, inner = problem.model.groups, problem.model.model
    missed = inner.groups if isinstance(inner, PointErrorModel) else {}
    groups = {**maps, **missed}
    group, present = _error_groups(problem, groups)
    information, pull = _excited_information(problem, *_data_information(equations, x, z))
    usual = np.append(np.full(len(maps), stated), expected_misses(problem.model.model, missed))
    between = tuple(
        np.repeat(limits, [len(maps), len(missed)]) for limits in ((1.0, LEAST_MISS), (LARGEST, LARGEST_MISS))
    )
    factors = likeliest_factors(information, pull, group, present, usual, (between[0], between[1]), len(maps))
    factors = factors**damping
    scale = np.where(group >= 0, factors[group], 1.0)
    sigma = problem.prior_sigma * scale
    sizes = dict(zip(groups, present * factors, strict=True))
    if missed:
        inner = resize_point_errors(inner, {s: sizes[s] for s in missed})
    model = MapErrorModel(inner, problem.model.curves, {target: sizes[target] for target in maps})
    parameters = tuple(
        model.parameters[p.name] if p.family in (FAMILY, POINT_FAMILY) else p for p in problem.parameters
    )
    # a size that is next to nothing wanders, and no matter
    told = np.append(np.ones(len(maps), bool), np.array([sizes[s] for s in missed]) > usual[len(maps) :])
    change = float(np.max(np.abs(np.log(factors[told])))) if told.any() else 0.0
    return replace(problem, model=model, parameters=parameters, prior_sigma=sigma), x / scale, change


def edge_widths(
    problem: IdentificationProblem, equations: NormalEquations, x: np.ndarray, z: np.ndarray, stated: float
) -> np.ndarray:
    """By which factor the errors of maps beyond what training covered are less certain than their likeliest size makes
    them, (p,); 1 for everything else. The estimates stay: it is no reason to believe in larger ones."""
    widths = np.ones(len(x))
    if not isinstance(problem.model, MapErrorModel):
        return widths
    groups = problem.model.groups
    group, present = _error_groups(problem, groups)
    information, pull = _excited_information(problem, *_data_information(equations, x, z))
    factors = expected_factors(information, pull, group, present, np.full(len(groups), stated))
    beyond = {names[j] for names in groups.values() for j in EDGE_CURVES}
    edge = np.array([n in beyond for n in problem.names])
    widths[edge] = np.maximum(factors, 1.0)[group[edge]]
    return widths


def _error_groups(
    problem: IdentificationProblem, groups: Mapping[str, tuple[str, ...]]
) -> tuple[np.ndarray, np.ndarray]:
    """Number of the group of each parameter (p,), −1 for those of none, and the present size of each group (G,)."""
    position = {n: i for i, n in enumerate(problem.names)}
    group = np.full(len(problem.names), -1)
    present = np.empty(len(groups))
    for g, names in enumerate(groups.values()):
        at = [position[n] for n in names]
        group[at] = g
        present[g] = problem.prior_sigma[at[0]]
    return group, present


def _data_information(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and pull (p,) of the records alone, offsets eliminated."""
    arrow = eliminate(n.H_xx, n.H_xz, n.H_zz, n.g_x, n.g_z, x, z)
    information = arrow.S - np.eye(len(x))
    return information, information @ x - (arrow.g - x)


def _excited_information(
    problem: IdentificationProblem, information: np.ndarray, pull: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and pull (p,) without what is said by amounts whose curves training hardly excites."""
    assert isinstance(problem.model, MapErrorModel)
    hardly = {n for n, excited in problem.model.excitation(problem.inputs).items() if excited < EXCITED}
    told = np.array([n not in hardly for n in problem.names])
    return information * np.outer(told, told), pull * told
