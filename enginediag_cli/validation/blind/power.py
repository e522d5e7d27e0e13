"""Detectable size of every effect (λ = 25), with the model-error floor and without: what the floor costs."""

from __future__ import annotations

from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.floor_cost import floor_cost
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import Trial
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.flights import draw_flights
from enginediag_cli.validation.blind.sealed import SIZE_STREAM, stream
from enginediag_cli.validation.blind.visible import drawable, noise_free_fit

SETS_OF_FLIGHTS = 5
"""Flights are drawn anew so many times, so that no effect's weight is that of one set of flights."""


def detectable_sizes(engine: Engine, seed: int) -> dict[str, dict[str, Any]]:
    """Per effect, the median over a few sets of flights: in the coefficient's unit and over its typical size; None
    where identification absorbs it."""
    library = drawable(engine)
    found: dict[str, list[tuple[float, float]]] = {e.label: [] for e in library}
    for k in range(SETS_OF_FLIGHTS):
        flights, training = draw_flights(engine, stream(seed, k, SIZE_STREAM))
        base = noise_free_fit(engine, flights[:training], kinds.MODEL_ERROR[kinds.MAP_ERROR] or 0.0)
        for cost in floor_cost(Trial((), base, Projection(base)), [effect_option(e) for e in library]):
            found[cost.label].append((cost.visible_without, cost.visible))
    result = {}
    for e in library:
        first = e.term.amplitudes()[0]
        without, with_floor = np.median(np.array(found[e.label] or [(np.inf, np.inf)]), axis=0)
        typical = abs(first.typical - first.absent)
        result[e.label] = {
            "coefficient": first.name,
            "unit": first.unit,
            "without_floor": _short(without),
            "with_floor": _short(with_floor),
            "without_floor_over_typical": _short(without / typical),
            "with_floor_over_typical": _short(with_floor / typical),
        }
    return result


def _short(x: float) -> float | None:
    return float(f"{x:.4g}") if np.isfinite(x) else None
