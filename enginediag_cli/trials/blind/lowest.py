"""The lowest of the fits to flights without noise that one truth is held against.

A large effect that the model lacks may take what is identified into another valley, in which a fit that goes on from
there stays when the effect is put in. Priors lie at the true state here, so that a fit that begins at them finds the
valley of the truth.
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
