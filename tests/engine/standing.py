"""An engine with its actuators elsewhere than in their neutral positions."""

from __future__ import annotations

from copy import copy


def standing(engine, **positions):
    """`__` in a name stands for the dot of the actuator's."""
    other = copy(engine)
    other.network = copy(engine.network)
    other.network.neutral = {**engine.network.neutral, **{k.replace("__", "."): v for k, v in positions.items()}}
    other._strategy = copy(engine._strategy)
    other._strategy.network = other.network
    return other


__all__ = ["standing"]
