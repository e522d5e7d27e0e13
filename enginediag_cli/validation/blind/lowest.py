"""The lower of two fits, where the truth of a trial is held against what was said.

A large effect that the model lacks may take what is identified into another valley, in which a fit that goes on from
there stays when the effect is put in. A fit that begins at the priors, which lie near the true state or at it, finds
the valley of the truth.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.mismatch.fit.evidence import Evidence
from enginediag_cli.mismatch.fit.identified import Hypothesis, Identified, Nuisance, identify_with
from enginediag_cli.mismatch.fit.projection import Projection


def lowest(evidence: Evidence, sought: Hypothesis, along: Nuisance, start: Identified, enough: float) -> Identified:
    """The lower of the fits from `start` and from the priors; the first alone where it is below `enough`."""
    found = identify_with(evidence, sought, along, start)
    least = left_by(found)
    if least < enough:
        return found
    anew = identify_with(evidence, sought, along)
    return anew if left_by(anew) < least else found


def left_by(fit: Identified) -> float:
    """χ² that a fit leaves, priors included; infinite where it did not converge."""
    return Projection(fit).objective if fit.converged else float(np.inf)
