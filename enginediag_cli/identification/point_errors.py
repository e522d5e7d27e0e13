"""What the model misses at a few operating points flown again and again, among the parameters of an identification.

Where every record is at one of a few points, with many records each, the mean residual of a point is known to a small
part of the noise, and is no noise: see `error_model.points`. How large it is, is found with the sizes of map errors.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.error_model.points import POINT_FAMILY, OperatingPoints, PointErrorModel
from enginediag_cli.identification.envelope import MARGIN_RANGE, MINIMUM_SPREAD, RELATIVE_SPREAD
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import Model, Problem
from enginediag_cli.identification.repeated_points import LEAST_WORTH, cells_of, follows_no_clock

MOST_POINTS = 12
"""Operating points that have errors of their own: a fleet is recorded at a handful of conditions. Where records lie at
more, what is missed changes smoothly from one to the next, and curves describe it."""
LEAST_MISS, LARGEST_MISS = 0.1, 30.0
"""Limits of the size of what is missed, in standard deviations of the sensor's stated noise: less is lost in the
noise, more is no longer a model of this engine."""


def with_point_errors(problem: Problem, accuracy: float) -> Problem:
    """The problem with what the model misses at operating points among its parameters, or as it is: where the maps are
    right (accuracy 0), records follow a clock, or are not at a few points with many records each.

    At a single point what is missed is what the parameters themselves say.
    """
    if accuracy <= 0.0 or not follows_no_clock(problem.gap):
        return problem
    points = _points(problem)
    if points is None:
        return problem
    # at first as large as the noise
    sizes = dict(zip(problem.sensors, (float(s) for s in problem.sigma), strict=True))
    model = PointErrorModel(problem.model, points, sizes)
    return problem.with_errors(model, POINT_FAMILY)


def usual_misses(model: Model, missed: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Sizes that are expected before the data, of the columns in `missed`: the noise that the engine file states."""
    return np.array([model.sensors[s].noise_sigma for s in missed], float)


def _points(problem: Problem) -> OperatingPoints | None:
    """The operating points at which the records are; None where these are one or many, few records are at one, or one
    runs into the next: parts of a range are no points, and curves describe what is missed along it."""
    zeros = np.zeros(len(problem.parameters)), np.zeros((len(problem.labels), len(problem.offsets)))
    predicted, status = predict(problem, *zeros)
    there = status <= 1
    if not there.any():
        return None
    cell = cells_of(predicted[there])
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
