"""Noise of recordings in which something may switch: that of the readings with the switch taken out.

What identification of the searched recordings leaves unpredicted is their noise when nothing is missing. Where a state
switches, left-out blocks are predicted in the wrong state, and what is sought drowns in its own steps. So the search
begins with noise that steps hardly touch: the spread within runs that are too short for a change of state to fall into
most of them, fit and noise in turn and a step at a time, since a fit that trusts no reading leaves errors of its own,

    w = median |e_k − e_{k−1}|/(0.6745 √2)     v = median of the standard deviations of RUN records in a row
    σ = max(stated, v, w)                      ρ = 1 − w²/σ²

Where it then finds something that is commanded switching, readings are freed of it, a C ŝ, and identified again. If
that predicts left-out blocks better, noise, priors and errors of maps are those of the better account. Where nothing
switches, or only what nobody can command, which is how an error of the model looks at so small a noise, or where
left-out blocks are as far off without the switch as with it, they stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.mismatch.fit.believable import switching
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.load import searched_again
from enginediag_cli.mismatch.fit.noise import larger_noise
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.self_identified import DEVIATION, LARGEST_RHO
from enginediag_cli.mismatch.unrecorded.finding import HiddenFinding
from enginediag_cli.mismatch.unrecorded.hidden import Scan
from enginediag_cli.mismatch.unrecorded.refit import location_columns
from enginediag_cli.progress import stage

WORTH = 1.2
"""Noise that is smaller by less than this factor is not worth another identification. Judgement."""
RUN = 10
"""Records of a run whose spread is taken: a state that changes every twenty records leaves half of the runs alone.
Judgement."""
ROUNDS = 6
"""Of fit and noise at most; two or three settle it."""
QUIETER = 3.0
"""Factor by which noise falls in a round at most: a fit that is at once to believe every reading walks after what
switches, and ends nowhere."""


@stage("weighing what may switch against the noise")
def freed_of_switches(evidence: Dataset, *, level: float, rng: np.random.Generator) -> Dataset:
    """The evidence with noise, and priors that are its own, from readings without what switches in them; as it is where
    nothing does, or where they come from elsewhere. Weighed once: it owes nothing afterwards. `level` as of
    `hidden_amplitudes`."""
    if evidence.owed is None:
        return evidence
    as_it_is = replace(evidence, owed=None)
    along = nuisance(evidence)
    for found in _quieter(evidence, along):
        scan = Scan(found, Projection(found), level, rng)
        if not scan.may_be_commanded(along, at_most=1):
            continue
        first = scan.refitted(along, at_most=1)[0]
        if not (first.significant and first.is_switch and first.states is not None):
            continue
        if switching(first.location, evidence.engine.parameters):
            freed = searched_again(evidence, _without(first, found))
            fall = [np.log(evidence.noise.sigma[s] / freed.noise.sigma[s]) for s in freed.noise.sigma]
            return replace(freed, owed=None) if np.mean(fall) > np.log(WORTH) else as_it_is
    return as_it_is


def _quieter(evidence: Dataset, along: Nuisance) -> Iterator[IdentifiedHypothesis]:
    """Fits with less and less noise, down to what steps hardly touch: a switch that is seen at one of them is. Each
    begins at the prior means: the one before is bent by what switches, and walks from there."""
    assert evidence.owed is not None
    noise, found = evidence.noise, identify_with(evidence, NULL_HYPOTHESIS, along)
    for _ in range(ROUNDS):
        if not found.converged:
            return
        quiet = _quiet(found, evidence.owed.least)
        if not any(noise.sigma[s] > WORTH * quiet.sigma[s] for s in quiet.sigma):
            return
        noise = replace(quiet, sigma={s: max(v, noise.sigma[s] / QUIETER) for s, v in quiet.sigma.items()})
        found = identify_with(replace(evidence, noise=noise), NULL_HYPOTHESIS, along)
        if found.converged:
            yield found


def _quiet(found: IdentifiedHypothesis, least: Noise) -> Noise:
    """Noise that steps hardly touch, no smaller than what is known without these recordings."""
    e, recording = found.fit.equations.residual, found.problem.recording
    sigma, rho = {}, {}
    for j, s in enumerate(found.problem.sensors):
        there = np.isfinite(e[:, j])
        of = [e[there & (recording == r), j] for r in np.unique(recording)]
        steps = np.abs(np.concatenate([np.diff(own) for own in of]))
        w = float(np.median(steps)) / (DEVIATION * np.sqrt(2.0)) if steps.size else 0.0
        runs = np.concatenate([_spreads(own) for own in of])
        sigma[s] = max(least.sigma[s], w, float(np.median(runs)) if runs.size else 0.0)
        rho[s] = float(np.clip(1.0 - (w / sigma[s]) ** 2, 0.0, LARGEST_RHO)) if steps.size else 0.0
    return larger_noise(least, replace(least, sigma=sigma, rho=rho, estimated=True))


def _spreads(e: np.ndarray) -> np.ndarray:
    """Standard deviation of every RUN readings in a row of e (n,), (n // RUN,)."""
    return np.asarray(e[: len(e) // RUN * RUN].reshape(-1, RUN).std(axis=1, ddof=1))


def _without(finding: HiddenFinding, found: IdentifiedHypothesis) -> Sequence[Flight]:
    """The flights with readings freed of what switches, to first order."""
    assert finding.states is not None
    column = location_columns(found, [finding.location])[:, :, 0]
    effect = finding.coefficient * finding.states[:, None] * column
    sizes = [len(f) for f in found.evidence.flights]
    whole = np.zeros((sum(sizes), column.shape[1]))
    whole[found.number] = effect
    freed = []
    for f, own in zip(found.evidence.flights, np.split(whole, np.cumsum(sizes)[:-1]), strict=True):
        readings = {s: f.columns[s] - own[:, j] for j, s in enumerate(found.problem.sensors) if s in f.columns}
        freed.append(replace(f, columns={**f.columns, **readings}))
    return freed
