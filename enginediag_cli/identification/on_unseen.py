"""What a fit says of recordings that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import Model, Problem, TrainingRecording, build_problem
from enginediag_cli.identification.regimes import assign_regimes
from enginediag_cli.identification.settings import IdentificationSettings


def on_unseen(
    problem: Problem, fit: Fit, held_out: Sequence[TrainingRecording], settings: IdentificationSettings
) -> tuple[Problem, np.ndarray]:
    """The problem of the held-out recordings, and its readings as predicted (N, m) at the fit of another one. Offsets
    of a recording are those of the fitted one of its label, else zero."""
    other = build_problem(problem.model, with_regimes(problem.model, held_out), settings)
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


def with_regimes(engine: Model, recordings: Sequence[TrainingRecording]) -> list[TrainingRecording]:
    """The recordings with a regime for each record; regimes that are given stay."""
    recordings = [TrainingRecording(*r) for r in recordings]
    found = assign_regimes([r.columns for r in recordings], engine.inputs) if recordings else []
    return [
        r if r.regimes is not None else r._replace(regimes=label) for r, label in zip(recordings, found, strict=True)
    ]
