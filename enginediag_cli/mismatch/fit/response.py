"""What errors of the maps do to the response to what moves.

A map that is wrong by a share a, in shapes that turn over a third of the range (the floor's), has slopes that are wrong
by up to STEEPER a. A step of power is a difference along such slopes: what an effect with memory delays, or takes up,
is wrong by as much of itself. Recordings of transients tell such effects by hundreds of standard errors, far beyond
what the model can be held to: of the χ² that they explain (STEEPER a)² may be left, and their coefficients are no
better known than that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.mismatch.fit.families import Scored
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Score
from enginediag_cli.mismatch.fit.scores import surprise

STEEPER = 3.0
"""Slope of a cubic's error over the range, in units of the error. Judgement."""


def response_error(found: IdentifiedHypothesis) -> float:
    """Relative error of the response to what moves, by the accuracy of the maps that is stated; 0 where a fit carries
    no effect that remembers."""
    remembers = any(MOMENT in e.term.INPUTS for e in found.hypothesis.effects)
    return STEEPER * found.evidence.settings.map_accuracy if remembers else 0.0


def tolerated(block: Scored, share: float) -> Score:
    """The score of a block of which a non-centrality of `share` needs no explanation."""
    score = block.score
    T = max(np.sqrt(score.statistic) - np.sqrt(share), 0.0) ** 2
    return replace(score, statistic=T, surprise=float(surprise(T, score.dof)) if score.dof else 0.0)
