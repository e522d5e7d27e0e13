"""Actuators that an engine may have and nothing moves yet."""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.engine import Engine
from enginediag_cli.parameters import spelled
from enginediag_cli.physics.parts import core_compressor

WIDEST_DEG = 70.0
"""How far guide vanes that nobody describes may close: half of the flow at 1 %/deg. Judgement."""


@dataclass(frozen=True)
class Free:
    """An actuator of `component`; `added`: the engine file has no such yet."""

    actuator: Actuator
    component: str
    added: bool = False


def free_actuators(engine: Engine) -> list[Free]:
    """What the components have and no control moves, and the guide vanes of a core compressor that tells of none."""
    network = engine.network
    moved = {leaf for control in network.controls for leaf in control.position()}
    found = [Free(a, c.name) for c in network.components for a in c.actuators() if a.name not in moved]
    for c in core_compressor(network):
        if not c.values["vanes"]:
            words = f"{spelled(c.name)} guide vanes"
            vanes = Actuator(f"{c.name}.vane_closing_deg", "deg", 0.0, 0.0, WIDEST_DEG, words)
            found.append(Free(vanes, c.name, added=True))
    return found
