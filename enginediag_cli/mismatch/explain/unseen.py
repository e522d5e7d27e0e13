"""What these flights cannot show, by the kind of effect that was looked for.

An effect that is there in every record, or that varies with what identification follows anyway, may be absorbed, and
yet stand out where it is switched on and off. The smallest size that would then be seen is of an effect that is on in
every other quarter of each flight: a² ŝᵀGŝ = VISIBLE, as of the effects along a driver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.term import Driver
from enginediag_cli.mismatch.explain.floor_cost import VISIBLE
from enginediag_cli.mismatch.fit.freeform import of_effect
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.refit import location_columns
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, basis, direction

PARTS = 4
"""Of a flight, of which every other one is on: a switch that is moved twice. Judgement."""


@dataclass(frozen=True)
class Unseen:
    """An effect that is absorbed along its `driver`; `switching`: the size, in `unit`, from which it would be seen if
    it were switched within flights, infinite for what nobody switches or what is not seen so either."""

    label: str
    driver: Driver
    unit: str
    switching: float = np.inf


def unseen_effects(base: HypothesisFit, library: Sequence[Option], labels: Sequence[str]) -> list[Unseen]:
    """Of options by label, at a fit that carries none of them."""
    # an effect that is tried at several sizes is several options
    chosen = list({o.label: o for o in library if o.label in set(labels) and o.hypothesis.effects}.values())
    switched = [o for o in chosen if o.hypothesis.effects[0].term.SWITCHES]
    visible: dict[str, float] = {}
    if switched and base.found.converged:
        of = basis(base.projection)
        on = _alternating(of)
        columns = location_columns(base.found, [of_effect(o.hypothesis.effects[0]) for o in switched])
        for j, o in enumerate(switched):
            d = direction(of, columns[:, :, j])
            length = float((d.applied(on) ** 2).sum() - ((on @ d.B) ** 2).sum())
            visible[o.label] = float(np.sqrt(VISIBLE / length)) if length > 0.0 else np.inf
    return [
        Unseen(
            o.label,
            o.driver,
            o.hypothesis.effects[0].term.amplitudes()[0].unit,
            visible.get(o.label, np.inf),
        )
        for o in chosen
    ]


def _alternating(of: Basis) -> np.ndarray:
    """(N,) on in every other part of each flight."""
    flight = np.cumsum(of.gap == 0)
    _, first, size = np.unique(flight, return_index=True, return_counts=True)
    place = np.arange(len(flight)) - np.repeat(first, size)
    return np.asarray((place * PARTS // np.repeat(size, size)) % 2, float)
