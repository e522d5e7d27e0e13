"""Instruments that differ from recording to recording: which offsets an identification allows for, and how large.

Every reading is zeroed and calibrated a little differently each time, that of an output and that of an input of the
model. From LEAST recordings of one engine on the sizes are estimated with the fit (`offset_sizes`); with fewer there is
no scatter to see, and only offsets that the engine file states are allowed for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from enginediag_cli.engine.input_errors import suspected
from enginediag_cli.identification.normal_equations import NormalEquations
from enginediag_cli.identification.offset_prior import OffsetPrior
from enginediag_cli.identification.offset_sizes import ArrowData, likeliest_offsets, spread_of_sizes
from enginediag_cli.identification.problem import Problem, TrainingRecording

LEAST = 3
"""Recordings from which scatter between them is told from what the fit took."""
USUAL_OUTPUT = 0.3
"""What a sensor's zero, or its span, usually changes by between recordings, over its noise. Judgement, as the others:
sixty records tell an offset of a tenth, and what a check of the reading itself would find is far larger."""
USUAL_INPUT = 0.1
"""The same of an input, over what such an instrument is plausibly wrong by."""
SETTLED = 0.1
"""Largest relative change of a size that matters, from one pass to the next, that ends the passes."""
NEGLIGIBLE = 0.1
"""Information of all recordings about an offset of the present size below which its size does not matter."""


def with_offsets(problem: Problem, recordings: Sequence[TrainingRecording]) -> Problem:
    """The problem with offsets of all instruments whose offsets are not stated, of usual sizes; as it is where there
    are too few recordings, where they are of several engines, or for a model without an engine file."""
    several = {r.engine for r in recordings}
    used = len(np.unique(problem.recording))
    if used < LEAST or len(several) > 1 or not hasattr(problem.model, "declared"):
        return problem
    stated = {o.sensor for o in problem.offsets}
    added = [o for o in _usual(problem, used) if o.sensor not in stated]
    offsets = sorted((*problem.offsets, *added), key=lambda o: o.sensor not in problem.sensors)  # of inputs last
    return replace(problem, offsets=tuple(offsets))


def _usual(problem: Problem, used: int) -> Iterator[OffsetPrior]:
    engine: Any = problem.model  # which has an engine file
    for s, column in enumerate(problem.sensors):
        size = float(np.nanmedian(np.abs(problem.measured[:, s])))
        usual = USUAL_OUTPUT * engine.sensors[column].noise_sigma
        yield OffsetPrior(column, "bias", usual, used)
        if size > usual:
            yield OffsetPrior(column, "scale", usual / size, used)
    for column in engine.inputs:
        error = suspected(engine, column)
        if error is not None:
            kind = "scale" if error.multiplies else "bias"
            yield OffsetPrior(column, kind, USUAL_INPUT * error.parameter.prior_sigma, used)


def resized_offsets(
    problem: Problem, usual: Sequence[OffsetPrior], n: NormalEquations, x: np.ndarray, z: np.ndarray, share: float
) -> tuple[Problem, np.ndarray, float]:
    """The problem with the likeliest sizes of its estimated offsets, z (R, q) in their units, and the largest relative
    change of one that matters. usual: the offsets at first; share: by which share of the way to the likeliest."""
    free = np.array([o.recordings > 0 for o in problem.offsets], bool)
    if not free.any():
        return problem, z, 0.0
    data = _data(n, x, z)
    present = np.array([o.prior_sigma for o in problem.offsets])
    factors = likeliest_offsets(data, present, np.array([o.prior_sigma for o in usual]), free) ** share
    offsets = tuple(
        replace(o, prior_sigma=float(o.prior_sigma * t)) for o, t in zip(problem.offsets, factors, strict=True)
    )
    seen = np.einsum("rqq->q", n.H_zz) * np.maximum(factors, 1.0) ** 2 > NEGLIGIBLE
    change = float(np.max(np.abs(np.log(factors[seen & free])), initial=0.0))
    return replace(problem, offsets=offsets), z / factors, change


def with_spreads(problem: Problem, n: NormalEquations, x: np.ndarray, z: np.ndarray) -> Problem:
    """The problem, at its likeliest sizes, with how far each estimated one may be from them."""
    free = np.array([o.recordings > 0 for o in problem.offsets], bool)
    if not free.any():
        return problem
    spreads = spread_of_sizes(_data(n, x, z), free)
    return replace(
        problem, offsets=tuple(replace(o, spread=float(v)) for o, v in zip(problem.offsets, spreads, strict=True))
    )


def _data(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> ArrowData:
    """Information and pull about parameters x and offsets z (R, q) by the equations at that point."""
    b_x = n.H_xx @ x + np.einsum("rpq,rq->p", n.H_xz, z) - n.g_x
    b_z = np.einsum("rpq,p->rq", n.H_xz, x) + np.einsum("rqk,rk->rq", n.H_zz, z) - n.g_z
    return ArrowData(n.H_xx, n.H_xz, n.H_zz, b_x, b_z)
