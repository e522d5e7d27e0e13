"""Flights outside a share in which something switches that no column shows.

With the nuisance G = CᵀPC = T − BᵀB ⪯ T, so that a likelihood ratio with T in its place is never above the right one:

    LR₀ = ½ [gᵀ S⁻¹ g − ln |I + τ²KT|] ≤ LR

It needs nothing but a flight's own records and what the fit to all of them has left, costs two passes over these, and
what stands out by it stands out. What it does not show may be there: it is blunter where much is identified.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.believable import switching
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.projection import Projection, runs
from enginediag_cli.mismatch.unrecorded.amplitude import likelihood
from enginediag_cli.mismatch.unrecorded.refit import believed_of, location_columns
from enginediag_cli.mismatch.unrecorded.whitened_rows import direction_alone

MOST = 4
"""Flights that are told, the plainest first: what switches in more of them is seen in these."""


def flights_that_switch(projection: Projection, gate: float) -> list[int]:
    """Of the flights of a fit, by position, those of which a commanded place exceeds the `gate` on LR of one search,
    raised for their number."""
    found = projection.found
    parameters = found.evidence.engine.parameters
    places = [p for p in locations(found) if switching(p, parameters)]
    if not places or not np.isfinite(gate):
        return []
    believed = believed_of(found, places)
    recordings = list(runs(found.problem.recording, slice(0, len(found.problem.recording))))
    ratios = {r: _largest(projection, places, believed, rows) for r, rows in recordings}
    enough = gate + float(np.log(len(recordings)))
    return sorted((r for r, lr in ratios.items() if lr > enough), key=lambda r: -ratios[r])[:MOST]


def _largest(projection: Projection, places: Sequence[Location], believed: Sequence[float], rows: slice) -> float:
    """LR₀ of the likeliest place in the records of one flight."""
    frame, columns = projection.frame, location_columns(projection.found, list(places), rows)
    gap, left, best = frame.neighbours.gap[rows], projection.residual[rows], 0.0
    for j, scale in enumerate(believed):
        along = direction_alone(frame, columns[:, :, j], rows)
        if along.diagonal.any():
            best = max(best, float(likelihood(along, gap, along.gathered(left)[:, None], scale).best[0]))
    return best
