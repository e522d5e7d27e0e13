"""Operating points that stand for all that an engine may meet, from which its fitted start is learnt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.engine.dual import Array

ANCHORS = 150
"""Points that are solved first for a fitted start to be learnt from: twice its terms."""


def over(ranges: Mapping[str, tuple[float, float]], columns: Sequence[str]) -> dict[str, Array]:
    """ANCHORS values of every column within its range, evenly spread together, denser towards the ends, as a polynomial
    needs them. The same ones always.

    Additive recurrence on the powers of the root φ of φ^(d+1) = φ + 1 (M. Roberts, 2018, after H. Weyl).
    """
    d = len(columns)
    phi = 2.0
    for _ in range(60):
        phi = (1.0 + phi) ** (1.0 / (d + 1))
    share = (0.5 + np.arange(1, ANCHORS + 1) * phi ** -np.arange(1.0, d + 1)[:, None]) % 1.0
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    return {c: ranges[c][0] + (ranges[c][1] - ranges[c][0]) * u for c, u in zip(columns, share, strict=True)}
