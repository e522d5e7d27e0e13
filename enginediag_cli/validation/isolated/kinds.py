"""What a trial of isolation may be about, and how often."""

from __future__ import annotations

from collections.abc import Mapping

NULL, COMPONENT, OUTPUT_SENSOR = "null", "component", "output_sensor"
INPUT_CHANNEL, SEVERAL, PHYSICS = "input_channel", "several", "physics"

WEIGHTS: Mapping[str, int] = {NULL: 20, COMPONENT: 30, OUTPUT_SENSOR: 14, INPUT_CHANNEL: 10, SEVERAL: 16, PHYSICS: 10}
"""Shares of kinds of trials when nobody chooses: mostly what engines have, and enough nulls to count false names."""
KINDS = tuple(WEIGHTS)
INSTRUMENTS = (OUTPUT_SENSOR, INPUT_CHANNEL)
"""Kinds of which what is wrong is an instrument alone."""

SAME_MODEL, REALISTIC = "same_model", "realistic"
TRUTHS = (SAME_MODEL, REALISTIC)

FIELD = "field"
"""Whole flights of an airliner a minute apart, judged with everything at once that a truth has; never drawn unasked.
What each trial conceals is set by its number, so that shares are the same on every seed."""
FIELD_SHARES: Mapping[str, int] = {NULL: 8, COMPONENT: 11, OUTPUT_SENSOR: 4, INPUT_CHANNEL: 2, SEVERAL: 7}
"""Trials of each kind in a round of 32: a quarter healthy, and of 320 trials 80 healthy and 240 with a fault."""
FIELD_JUDGED = 8
"""Flights in a row that are judged of one engine, each with its own fault or none: an engine is identified once."""
_ROUND = tuple(kind for kind, share in FIELD_SHARES.items() for _ in range(share))
_STRIDE = 13
"""Coprime to the round's length: neighbours in a round differ in kind, so that the first few trials hold all."""


def field_kind(trial: int) -> str:
    """What trial number `trial` of a campaign in the field conceals."""
    return _ROUND[trial * _STRIDE % len(_ROUND)]


CHOICES = (*KINDS, FIELD)
"""What may be chosen."""
