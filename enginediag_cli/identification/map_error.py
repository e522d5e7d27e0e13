"""The error of the engine's maps in an identification: its amounts beside the parameters, and how large it is.

A fit alternates three things: the parameters and amounts given their priors, the noise that they leave, and the sizes
of the map errors under which the records are likeliest. Map coordinates stand in columns of each record
(see `error_model.modelled`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.error_model.curves import BEYOND, learn_curves
from enginediag_cli.error_model.machines import QUANTITIES, machines_of, map_coordinates
from enginediag_cli.error_model.modelled import FAMILY, MapErrorModel
from enginediag_cli.error_model.points import POINT_FAMILY, PointErrorModel, sized
from enginediag_cli.error_model.sizes import LARGEST, expected_factors, likeliest_factors
from enginediag_cli.identification.normal_equations import NormalEquations, eliminate
from enginediag_cli.identification.point_errors import LARGEST_MISS, LEAST_MISS, usual_misses
from enginediag_cli.identification.problem import Problem

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
    found: float


def with_map_error(problem: Problem, accuracy: float) -> Problem:
    """The problem with amounts of map error among its parameters, of standard deviation `accuracy`.

    Nothing changes where the accuracy is 0, or the model has no maps, or computes no record at the prior mean.
    """
    machines = machines_of(problem.model)
    if accuracy <= 0.0 or not machines:
        return problem
    at = map_coordinates(problem.model, problem.inputs, problem.physical(np.zeros(len(problem.parameters))))
    curves = [c for name, coordinates in at.items() if (c := learn_curves(name, coordinates)) is not None]
    if not curves:
        return problem
    sizes = {
        m.parameter(q): accuracy for m in machines for q in QUANTITIES if m.parameter(q) in problem.model.parameters
    }
    model = MapErrorModel(problem.model, curves, sizes)
    extended = problem.with_errors(model, FAMILY)
    return replace(extended, inputs={**problem.inputs, **model.frozen(problem.inputs, problem.sensors)})


def with_range_of(problem: Problem, records: np.ndarray) -> Problem:
    """The problem with errors of maps that know no other range than that of some of its records (N,) bool, as if it had
    been built of these alone."""
    model = problem.model
    if not isinstance(model, MapErrorModel):
        return problem
    at = model.coordinates(problem.inputs)
    learnt = [learn_curves(c.machine, at[c.machine][records]) or c for c in model.curves]
    return replace(problem, model=MapErrorModel(model.model, learnt, model.sizes))


def map_error_sizes(problem: Problem, stated: float) -> tuple[MapErrorSize, ...]:
    """Sizes of the map errors as the problem has them."""
    if not isinstance(problem.model, MapErrorModel):
        return ()
    sigma = dict(zip(problem.names, problem.prior_sigma, strict=True))
    return tuple(MapErrorSize(t, stated, float(sigma[names[0]])) for t, names in problem.model.groups.items())


def resized(
    problem: Problem, equations: NormalEquations, x: np.ndarray, z: np.ndarray, stated: float, damping: float = 1.0
) -> tuple[Problem, np.ndarray, float]:
    """The problem with the likeliest sizes of map errors, and of what is missed at operating points, x (p,) in its
    units, and the largest relative change. damping: by which share of the way to them."""
    if not isinstance(problem.model, MapErrorModel):
        return problem, x, 0.0
    maps, inner = problem.model.groups, problem.model.model
    missed = inner.groups if isinstance(inner, PointErrorModel) else {}
    groups = {**maps, **missed}
    group, present = _grouped(problem, groups)
    information, pull = _telling(problem, *_of_data(equations, x, z))
    usual = np.append(np.full(len(maps), stated), usual_misses(problem.model.model, missed))
    between = tuple(
        np.repeat(limits, [len(maps), len(missed)]) for limits in ((1.0, LEAST_MISS), (LARGEST, LARGEST_MISS))
    )
    factors = likeliest_factors(information, pull, group, present, usual, (between[0], between[1]), len(maps))
    factors = factors**damping
    scale = np.where(group >= 0, factors[group], 1.0)
    sigma = problem.prior_sigma * scale
    sizes = dict(zip(groups, present * factors, strict=True))
    if missed:
        inner = sized(inner, {s: sizes[s] for s in missed})
    model = MapErrorModel(inner, problem.model.curves, {target: sizes[target] for target in maps})
    parameters = tuple(
        model.parameters[p.name] if p.family in (FAMILY, POINT_FAMILY) else p for p in problem.parameters
    )
    # a size that is next to nothing wanders, and no matter
    told = np.append(np.ones(len(maps), bool), np.array([sizes[s] for s in missed]) > usual[len(maps) :])
    change = float(np.max(np.abs(np.log(factors[told])))) if told.any() else 0.0
    return replace(problem, model=model, parameters=parameters, prior_sigma=sigma), x / scale, change


def widths_beyond(
    problem: Problem, equations: NormalEquations, x: np.ndarray, z: np.ndarray, stated: float
) -> np.ndarray:
    """By which factor the errors of maps beyond what training covered are less certain than their likeliest size makes
    them, (p,); 1 for everything else. The estimates stay: it is no reason to believe in larger ones."""
    widths = np.ones(len(x))
    if not isinstance(problem.model, MapErrorModel):
        return widths
    groups = problem.model.groups
    group, present = _grouped(problem, groups)
    information, pull = _telling(problem, *_of_data(equations, x, z))
    factors = expected_factors(information, pull, group, present, np.full(len(groups), stated))
    beyond = {names[j] for names in groups.values() for j in BEYOND}
    edge = np.array([n in beyond for n in problem.names])
    widths[edge] = np.maximum(factors, 1.0)[group[edge]]
    return widths


def _grouped(problem: Problem, groups: Mapping[str, tuple[str, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """Number of the group of each parameter (p,), −1 for those of none, and the present size of each group (G,)."""
    position = {n: i for i, n in enumerate(problem.names)}
    group = np.full(len(problem.names), -1)
    present = np.empty(len(groups))
    for g, names in enumerate(groups.values()):
        at = [position[n] for n in names]
        group[at] = g
        present[g] = problem.prior_sigma[at[0]]
    return group, present


def _of_data(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and pull (p,) of the records alone, offsets eliminated."""
    arrow = eliminate(n.H_xx, n.H_xz, n.H_zz, n.g_x, n.g_z, x, z)
    information = arrow.S - np.eye(len(x))
    return information, information @ x - (arrow.g - x)


def _telling(problem: Problem, information: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and pull (p,) without what is said by amounts whose curves training hardly excites."""
    assert isinstance(problem.model, MapErrorModel)
    hardly = {n for n, excited in problem.model.excitation(problem.inputs).items() if excited < EXCITED}
    told = np.array([n not in hardly for n in problem.names])
    return information * np.outer(told, told), pull * told
