"""Actuators that an engine may have and nothing moves yet."""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.components.nozzles import CondiNozzle, Nozzle
from enginediag_cli.engine.engine import Engine
from enginediag_cli.parameters import spelled
from enginediag_cli.physics.registry import core_compressor

FLOW_PER_DEG = 0.01
"""Fall of a compressor's flow per degree of closing where nobody states it: 0.5 to 1.5 %/deg (NLR GSP and GasTurb
variable-geometry inputs). Position and this number are only known together; readings know what they give."""
WIDEST_DEG = 70.0
"""How far guide vanes that nobody describes may close: half of the flow at 1 %/deg. Judgement."""
OPENINGS = (0.5, 2.0)
"""Between which the area of a nozzle that nobody describes as variable may vary, of its design's. Judgement."""


@dataclass(frozen=True)
class Free:
    """An actuator of `component`. `key`: what the component's entry in the engine file must say for it, "" where it has
    it; `assumed`: what of that is only known together with the position."""

    actuator: Actuator
    component: str
    key: str = ""
    assumed: str = ""


def free_actuators(engine: Engine) -> list[Free]:
    """What the components have and no control moves; the guide vanes of a core compressor, and the area of a nozzle,
    that tell of none."""
    network = engine.network
    moved = {leaf for control in network.controls for leaf in control.position()}
    found = [Free(a, c.name) for c in network.components for a in c.actuators() if a.name not in moved]
    for c in core_compressor(network):
        if not c.values["vanes"]:
            words = f"{spelled(c.name)} guide vanes"
            vanes = Actuator(f"{c.name}.vane_closing_deg", "deg", 0.0, 0.0, WIDEST_DEG, words)
            key = f"vanes: {{flow_per_deg: {FLOW_PER_DEG:g}, loss_per_deg2: 0, closed_stop_deg: {WIDEST_DEG:g}}}"
            found.append(Free(vanes, c.name, key, f"{100.0 * FLOW_PER_DEG:g} % of flow per degree"))
    for nozzle in (c for c in network.components if isinstance(c, (Nozzle, CondiNozzle))):
        if not nozzle.values["opening_range"]:
            area = Actuator(f"{nozzle.name}.opening", "1", 1.0, *OPENINGS, f"{spelled(nozzle.name)} opening")
            found.append(Free(area, nozzle.name, f"opening_range: [{OPENINGS[0]:g}, {OPENINGS[1]:g}]"))
    return found
