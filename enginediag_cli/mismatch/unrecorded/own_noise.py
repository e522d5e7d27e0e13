"""Noise of recordings in which something may switch: that of the readings with the switch taken out.

What identification of the searched recordings leaves unpredicted is their noise when nothing is missing. Where a state
switches, left-out blocks are predicted in the wrong state, and what is sought drowns in its own steps. So the search
begins with noise that steps hardly touch (`robust_noise`); where it then finds something that is commanded switching,
readings are freed of it, a C ŝ, and identified again: noise, priors and errors of maps are those of the better account.
Where nothing switches, or only what nobody can command, which is how an error of the model looks at so small a noise,
they stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.mismatch.fit.believable import switching
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight, Noise
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, Identified, identify_with, nuisance
from enginediag_cli.mismatch.fit.load import searched_again
from enginediag_cli.mismatch.fit.noise import larger_noise
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.self_identified import robust_noise
from enginediag_cli.mismatch.unrecorded.finding import HiddenFinding
from enginediag_cli.mismatch.unrecorded.hidden import hidden_amplitudes
from enginediag_cli.mismatch.unrecorded.refit import location_columns
from enginediag_cli.progress import stage

WORTH = 1.2
"""Noise that is smaller by less than this factor is not worth another identification. Judgement."""


@stage("weighing what may switch against the noise")
def freed_of_switches(evidence: Evidence, *, level: float, rng: np.random.Generator) -> Evidence:
    """The evidence with noise, and priors that are its own, from readings without what switches in them; as it is where
    nothing does, or where they come from elsewhere. `level` as of `hidden_amplitudes`."""
    if evidence.owed is None:
        return evidence
    along = nuisance(evidence)
    found = identify_with(evidence, NO_HYPOTHESIS, along)
    if not found.converged:
        return evidence
    quiet = _quiet(found, evidence.owed.least)
    if not any(evidence.noise.sigma[s] > WORTH * quiet.sigma[s] for s in quiet.sigma):
        return evidence
    # from the prior means: the fit before is bent by what switches, and walks from there
    found = identify_with(replace(evidence, noise=quiet), NO_HYPOTHESIS, along)
    if not found.converged:
        return evidence
    findings = hidden_amplitudes(found, Projection(found), level=level, rng=rng, along=along, refitted=1)
    first = findings[0] if findings else None
    if first is None or not (first.significant and first.is_switch and first.states is not None):
        return evidence
    if not switching(first.location, evidence.engine.parameters):
        return evidence
    return searched_again(evidence, _without(first, found))


def _quiet(found: Identified, least: Noise) -> Noise:
    """Noise that steps hardly touch, no smaller than what is known without these recordings."""
    problem = found.problem
    stated = np.array([least.sigma[s] for s in problem.sensors])
    sigma, rho = robust_noise(problem.with_noise(stated, np.ones(len(stated))), found.fit.equations.residual)
    return larger_noise(least, replace(least, sigma=sigma, rho=rho, estimated=True))


def _without(finding: HiddenFinding, found: Identified) -> Sequence[Flight]:
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
