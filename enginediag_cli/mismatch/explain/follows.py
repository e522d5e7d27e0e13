"""What a switch that no column records follows after all: thresholds of something recorded, with hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.laws.scan import KnownVariable
from enginediag_cli.mismatch.unrecorded.latched import Latched, States, latched
from enginediag_cli.mismatch.unrecorded.recorded_driver import Hidden

AS_WELL = 3.0
"""Nats by which another variable may give the states back less well and be told beside the best."""


@dataclass(frozen=True)
class HysteresisFit:
    """Thresholds of a variable that give the states of a switch back, and of so many `changes` in all."""

    of: KnownVariable
    latch: Latched
    changes: int


def followed(finding: Hidden, found: IdentifiedHypothesis, known: Sequence[KnownVariable]) -> tuple[HysteresisFit, ...]:
    """Those of the variables `known` in a fit whose thresholds give the states of a finding back, best first; none
    where records are not the course of anything."""
    clock = known[0].clock if known else None
    if clock is None or not finding.is_switch or finding.states is None:
        return ()
    probability = dict(zip(finding.number.tolist(), finding.states.tolist(), strict=True))
    states = States.of(np.array([probability.get(n, 0.5) for n in found.number.tolist()]), clock)
    latches = latched(states, [k.values for k in known])
    return tuple(
        HysteresisFit(known[x.variable], x, len(states.changes)) for x in latches if x.gain > latches[0].gain - AS_WELL
    )
