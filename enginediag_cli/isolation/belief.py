"""What an answer of the posterior rests on, for questions that are asked of it later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from enginediag_cli.isolation.posterior import SetPosterior
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
