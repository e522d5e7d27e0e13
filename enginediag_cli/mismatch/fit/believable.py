"""How much, and how fast, something may change before nobody believes it.

| what | along a recorded driver, or from hour to hour | within seconds and back, seen by no column |
|---|---|---|
| bleeds and loads that are commanded (`switches`) | `Location.scale`, or their prior | the same |
| what a term brings that nobody commands (humidity) | `Location.scale` | a tenth of it |
| instruments | `Location.scale` | a fortieth of it: they step once, for good |
| efficiencies, flows, areas, losses, cooling orifices | `Location.scale` | the accuracy of the maps |

A place whose free amplitude would have to be BELIEVED times what its row says is no place. Where no column tells the
time, records are not known to be seconds apart and the first column holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.mismatch.fit.scores import surprise
from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.mismatch.fit.freeform import Location
    from enginediag_cli.mismatch.fit.projection import Score

FAST_S = 120.0
"""Usual step of time, s, up to which two records in a row are of one state of the weather and of wear. Judgement."""
SLOW_SHARE, INSTRUMENT_SHARE = 0.1, 0.025
"""Shares of the range along a driver that may come and go within seconds: air masses have edges; a reading returns to
within 0.05 % after a disturbance. Judgement."""
LEAST = 0.001
"""A part is believed to breathe by so much even where the maps are said to be exact."""
BELIEVED = 4.0
"""Standard deviations of belief from which a size is excluded: 1 in 16,000."""


def along_driver(place: Location, parameters: Mapping[str, Parameter]) -> float:
    """Standard deviation of an amplitude at the place that follows a recorded driver, or the hours."""
    own = parameters.get(place.parameter)
    if place.through is None and own is not None and own.switches:
        return max(place.scale, own.prior_sigma)
    return place.scale


def switching(place: Location, parameters: Mapping[str, Parameter]) -> bool:
    """Whether somebody commands what acts at the place, so that it may be on or off within seconds."""
    if place.through is not None:
        return place.through.term.SWITCHES
    own = parameters.get(place.parameter)
    return own is not None and own.switches


def hidden(place: Location, parameters: Mapping[str, Parameter], accuracy: float, step_s: float) -> float:
    """Standard deviation of an amplitude at the place that no column shows, of records `step_s` apart (NaN: unknown),
    with maps of relative `accuracy`; infinite where nothing limits it but what `along_driver` says."""
    if not step_s <= FAST_S:
        return np.inf
    scale = along_driver(place, parameters)
    if switching(place, parameters):
        return scale
    if place.through is not None:
        return SLOW_SHARE * scale
    if place.belongs_to_sensor:
        return INSTRUMENT_SHARE * scale
    return min(scale, max(accuracy, LEAST))


def with_belief(score: Score, gram: np.ndarray, pull: np.ndarray, scale: float) -> Score:
    """The score of a block with C⊥ᵀC⊥ = V S² Vᵀ (k, k) and C⊥ᵀe (k,), whose coefficients are N(0, scale²) beforehand:

        T = Σ w²/(S² + scale⁻²),   c = V w/(S² + scale⁻²),   w = VᵀC⊥ᵀe

    Its surprise is that of χ² with as many degrees of freedom, which T does not exceed when nothing is missing."""
    if not score.dof:
        return score
    values, vectors = np.linalg.eigh(gram)
    values, vectors = values[-score.dof :], vectors[:, -score.dof :]
    w = vectors.T @ pull
    held = values + scale**-2
    T = float(np.sum(w**2 / held))
    return replace(score, statistic=T, surprise=float(surprise(T, score.dof)), coefficients=vectors @ (w / held))
