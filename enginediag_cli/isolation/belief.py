"""What an answer of the posterior rests on, for questions that are asked of it later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.isolation.components import component_posterior
from enginediag_cli.isolation.posterior import SetPosterior, moments
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class Belief:
    """The posterior over sets with the score and the prior of which it was made; about: scores of single sets about
    their own estimates, by the bytes of their masks, where the full model was fitted."""

    score: Score
    posterior: SetPosterior
    prior: SetPrior
    about: Mapping[bytes, Score] = field(default_factory=dict)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (p,) and covariance (p, p) of the changes of the score's parameters, in their units."""
        return moments(self.score, self.posterior, self.prior, self.about)


def belief_of_components(score: Score, prior: SetPrior, largest: int | None = None) -> Belief:
    """The posterior over sets of components, each with all its parameters, as one over sets of parameters."""
    components, sets, probabilities, _ = component_posterior(score, prior, largest=largest)
    held = np.array([[p.component == c for p in score.described] for c in components], bool)
    masks = (sets[:, :, None] & held).any(axis=1)
    posterior = SetPosterior(
        score.parameters, masks, probabilities, probabilities @ masks, 0.0, int(masks.sum(axis=1).max())
    )
    return Belief(score, posterior, prior)
