"""Step-down multiple comparison of single parameters by their min-max statistics.

Holm, S. (1979) Scandinavian Journal of Statistics 6, 65–70: the chance of naming any unchanged parameter
is at most α, whatever else changed. Cautious: parameters that others can imitate are rarely named.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.isolation.minmax import single_minmax
from enginediag_cli.residuals.score import Score


def holm_minmax(score: Score, false_alarm: float = 0.01) -> tuple[tuple[str, ...], np.ndarray]:
    """Parameters that changed whatever the others did, and the adjusted p value of each parameter (p,)."""
    from scipy.special import chdtrc

    t, testable = single_minmax(score)
    p_values = np.where(testable, chdtrc(1, t), 1.0)
    order = np.argsort(p_values, kind="stable")
    steps = (len(order) - np.arange(len(order))) * p_values[order]
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    named = tuple(name for name, value in zip(score.parameters, adjusted, strict=True) if value <= false_alarm)
    return named, adjusted
