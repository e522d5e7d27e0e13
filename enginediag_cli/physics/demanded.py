"""What is demanded of an engine by its power setting, and how much that is at the design point: where effects act that
stand between a command and what the engine gets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.term import Site
from enginediag_cli.physics.readings import burner

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


def load_site(network: Network) -> Iterator[Site]:
    """The machine that is told how much power to take, where that is what sets the power."""
    if network.power_setting == "power_W":
        for name in (c.name for c in network.components if c.TYPE == "load"):
            yield Site(name, name, ("power_W",), full=(full(network), "W"))
            return


def fuel_site(network: Network) -> Iterator[Site]:
    """The burner, where a commanded fuel flow sets the power."""
    if network.power_setting == "Wf_kg_s":
        name = burner(network).name
        yield Site(name, name, ("Wf_kg_s",), full=(full(network), "kg/s"))


def full(network: Network) -> float:
    """The power setting at the design point."""
    assert network.design_point is not None
    return scalar(network.read(network.design_point, network.power_setting))
