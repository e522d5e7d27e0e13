"""Where the offsets of recordings begin: at what each recording differs by from the model before any fit.

Begun at zero, with offsets of several times the noise, a fit of many recordings would see gross outliers everywhere,
weigh them down, and bend the engine for what is each recording's own.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.problem import Problem


def first_offsets(problem: Problem, predicted: np.ndarray) -> np.ndarray:
    """Offsets (R, q) in prior standard deviations by the medians of each recording; `predicted` (N, m) without them.

    Of a sensor with a bias and a scale the first has it all; offsets of inputs, and those whose size is yet to be
    estimated, begin at zero.
    """
    z = np.zeros((len(problem.labels), len(problem.offsets)))
    starts = np.flatnonzero(np.diff(problem.recording, prepend=-1) != 0)
    taken: set[str] = set()
    for j, o in enumerate(problem.offsets):
        if o.sensor in taken or o.recordings or o.sensor not in problem.sensors:
            continue
        taken.add(o.sensor)
        s = problem.sensors.index(o.sensor)
        off = problem.measured[:, s] - predicted[:, s]
        if o.kind == "scale":
            off = off / np.where(predicted[:, s] != 0, predicted[:, s], np.nan)
        for first, stop in zip(starts, [*starts[1:], len(off)], strict=True):
            part = off[first:stop][np.isfinite(off[first:stop])]
            if len(part):
                z[problem.recording[first], j] = np.median(part) / o.prior_sigma
    # what all recordings have in common is the model's, not theirs
    return z - z.mean(axis=0)
