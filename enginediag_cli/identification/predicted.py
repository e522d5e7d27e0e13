"""Readings that the model predicts at one point of a fit, and derivatives that were taken there or near by.

Derivatives cost several times what the readings do, and change slowly: near where they were taken a fit goes on with
the same ones and asks for readings alone (the chord method; C. T. Kelley, Iterative Methods for Linear and Nonlinear
Equations, SIAM 1995, §5.4.1). What is kept is in the units of the parameters and without offsets of outputs, so that
other noise, other sizes of map errors and records left out need no new ones; the derivatives by amounts of map error
follow from columns of the records.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.identification.problem import Problem

SUMMED_RECORDS = 512
"""Records of which products are summed at once where the predictions are there: few enough that their sensitivities
stay in the processor's cache between the products, enough that each product is worth its call."""


@dataclass(frozen=True)
class Answer:
    """What the model says of n records: readings (n, m), status (n,) and derivatives (n, m, k)."""

    y: np.ndarray
    status: np.ndarray
    derivatives: np.ndarray


@dataclass(frozen=True)
class Tangent:
    """Derivatives of all readings, as products of few numbers where they are; 0 where the model had none.

    names: the k parameters that the model is asked for, all that are sought but amounts of map error, and inputs with
    offsets; own (N, m, k): derivatives by them, to seven digits, more than they are known to; of_maps (N, m, G) and
    curves (N, G, c): those by amounts are their products.
    """

    names: tuple[str, ...]
    own: np.ndarray
    of_maps: np.ndarray
    curves: np.ndarray
    known: np.ndarray  # (N,) bool

    @property
    def amounts(self) -> int:
        """How many amounts of map error there are."""
        return self.curves.shape[1] * self.curves.shape[2]


@dataclass(frozen=True)
class Predicted:
    """Readings (N, m) at a point, without offsets of outputs, NaN where there are none; status (N,); and derivatives,
    `taken` at this very point or near by."""

    y: np.ndarray
    status: np.ndarray
    tangent: Tangent
    taken: bool

    def fits(self, problem: Problem) -> bool:
        """Whether the derivatives are those that this problem asks for."""
        t = self.tangent
        return t.names == directions(problem) and t.amounts == amounts_of(problem) and self._records(problem)

    def _records(self, problem: Problem) -> bool:
        return len(self.y) == len(problem.recording)

    def select(self, keep: np.ndarray) -> Predicted:
        """The same of the records where `keep` (N,) is true."""
        t = self.tangent
        tangent = Tangent(t.names, t.own[keep], t.of_maps[keep], t.curves[keep], t.known[keep])
        return Predicted(self.y[keep], self.status[keep], tangent, self.taken)

    def with_curves(self, problem: Problem, x: np.ndarray) -> Predicted:
        """The same at x (p,) where errors of maps follow the curves of another problem, which readings follow linearly;
        itself where there are none."""
        t, model = self.tangent, problem.model
        if not t.amounts or not isinstance(model, MapErrorModel):
            return self
        curves = model.factors(problem.inputs, problem.sensors)[1]
        amounts = (problem.prior_sigma * x + problem.prior_mean)[-t.amounts :].reshape(t.curves.shape[1:])
        moved = np.einsum("ngc,gc->ng", curves - t.curves, amounts)
        y = self.y + np.matmul(t.of_maps, moved[:, :, None])[:, :, 0]
        return Predicted(y, self.status, replace(t, curves=curves), self.taken)

    def by_parameters(self, problem: Problem, rows: slice) -> np.ndarray:
        """Derivatives (n, m, p) by all parameters that are sought; a new array."""
        t = self.tangent
        own = len(problem.names) - t.amounts
        n, m = self.y[rows].shape
        J = np.empty((n, m, own + t.amounts))
        J[:, :, :own] = t.own[rows, :, :own]
        if t.amounts:
            amounts = J[:, :, own:].reshape(n, m, *t.curves.shape[1:])  # one axis as two: a view, whatever the strides
            np.multiply(t.of_maps[rows, :, :, None], t.curves[rows, None], out=amounts)
        return J

    def by_inputs(self, problem: Problem, rows: slice) -> np.ndarray:
        """Derivatives (n, m, a) by the inputs that have offsets."""
        return self.tangent.own[rows, :, len(problem.names) - self.tangent.amounts :].astype(float)

    def pulled(self, problem: Problem, pull: np.ndarray) -> np.ndarray:
        """Σ pull ∂y/∂θ over all records and sensors, (p,), for pull (N, m)."""
        t = self.tangent
        own = np.zeros(t.own.shape[2])
        for first in range(0, len(pull), SUMMED_RECORDS):
            rows = slice(first, first + SUMMED_RECORDS)
            own += pull[rows].reshape(-1) @ t.own[rows].reshape(pull[rows].size, -1).astype(float)
        of_maps = np.matmul(pull[:, None, :], t.of_maps)[:, 0]  # (N, G)
        amounts = np.einsum("ng,ngc->gc", of_maps, t.curves).reshape(-1)
        return np.concatenate([own[: len(problem.names) - t.amounts], amounts])


def amounts_of(problem: Problem) -> int:
    """How many of the parameters, the last ones, are amounts of map error whose effects the records bring along."""
    model = problem.model
    if not isinstance(model, MapErrorModel) or problem.names[-len(model.amounts) :] != model.amounts:
        return 0
    return len(model.amounts) if model.brought(problem.inputs, problem.sensors) else 0


def shifted_inputs(problem: Problem) -> tuple[str, ...]:
    """Inputs that have offsets."""
    outputs = len(problem.offsets) - problem.input_offsets
    return tuple(dict.fromkeys(o.sensor for o in problem.offsets[outputs:]))


def directions(problem: Problem) -> tuple[str, ...]:
    """What the model is asked for derivatives by."""
    return (*problem.names[: len(problem.names) - amounts_of(problem)], *shifted_inputs(problem))


def ask(problem: Problem, x: np.ndarray, z: np.ndarray, wrt: tuple[str, ...], chunk: int) -> Iterator[Answer]:
    """What the model says at (x, z), `chunk` records at a time."""
    theta, N, outputs = problem.physical(x), len(problem.recording), len(problem.offsets) - problem.input_offsets
    for start in range(0, N, chunk):
        rows = slice(start, min(start + chunk, N))
        read = {c: v[rows] for c, v in problem.inputs.items()}
        inputs = dict(read)
        for j, o in enumerate(problem.offsets[outputs:], outputs):
            value = o.prior_sigma * z[problem.recording[rows], j]
            if np.any(value):
                inputs[o.sensor] = inputs[o.sensor] - value * (1.0 if o.kind == "bias" else read[o.sensor])
        p = problem.model.predict(inputs, theta, sensors=problem.sensors, wrt=wrt)
        y, derivatives = np.array(p.y, float), np.asarray(p.jacobian, float)
        # a point whose derivatives cannot be had cannot take part in the fit, whatever its value
        known = np.isfinite(derivatives.sum(axis=(1, 2)))
        status = np.where(known, p.status, np.maximum(p.status, 2)).astype(np.int8)
        y[status > 1] = np.nan
        yield Answer(y, status, derivatives)


def predict_records(
    problem: Problem, x: np.ndarray, z: np.ndarray, chunk: int, near: Predicted | None = None
) -> Predicted:
    """Readings at (x, z) with derivatives that are taken there, or with those of a point near by; `chunk`: records of
    one call of the model."""
    wrt = directions(problem)
    N, m = problem.measured.shape
    y, status = np.empty((N, m)), np.empty(N, np.int8)
    tangent = _empty(problem, wrt) if near is None else near.tangent
    first = 0
    for part in ask(problem, x, z, wrt if near is None else (), chunk):
        rows = slice(first, first + len(part.y))
        first = rows.stop
        y[rows], status[rows] = part.y, part.status
        if near is None:
            tangent.known[rows] = part.status <= 1
            tangent.own[rows] = part.derivatives
            tangent.own[rows][part.status > 1] = 0.0
    if near is None:
        tangent.of_maps[~tangent.known] = 0.0
    else:
        unknown = ~tangent.known
        y[unknown], status[unknown] = np.nan, np.maximum(status[unknown], 2)
    return Predicted(y, status, tangent, near is None)


def _empty(problem: Problem, wrt: tuple[str, ...]) -> Tangent:
    """Derivatives of which only those by amounts of map error are there."""
    N, m = problem.measured.shape
    of_maps, curves = np.empty((N, m, 0)), np.empty((N, 0, 0))
    if amounts_of(problem):
        assert isinstance(problem.model, MapErrorModel)
        of_maps, curves = problem.model.factors(problem.inputs, problem.sensors)
    return Tangent(wrt, np.empty((N, m, len(wrt)), np.float32), of_maps, curves, np.ones(N, bool))
