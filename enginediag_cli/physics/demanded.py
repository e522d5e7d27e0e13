"""What is demanded of an engine by its power setting, and how much that is at the design point: where effects act that
stand between a command and what the engine gets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.term import Coefficient, Site
from enginediag_cli.physics.readings import burner

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

ONE_SIDED = 0.1
"""Of the time in one direction, that of the other in trials of one direction: at 0 nothing would show whether it is."""
LONGEST_S = 1e5
"""Bound of the time for a full scale: about a day."""


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


def rate_limits(what: str, of: str, sigma: float, typical: float) -> tuple[Coefficient, ...]:
    """Times [s] in which what is demanded, `what`, may rise and fall by `of`."""
    return tuple(
        Coefficient(
            name,
            "s",
            f"{sign}, time in which the {what} may {name} by {of}; 0: at once",
            0.0,
            0.0,
            LONGEST_S,
            sigma,
            typical,
            assumed=True,
            per_full=True,
        )
        for name, sign in (("rise", "t_up"), ("fall", "t_down"))
    )


def rate_trials(*times: float) -> tuple[dict[str, float], ...]:
    """Sizes of rate limits at which a search tries them: either way alike, and one way much faster."""
    ways = ((1.0, 1.0), (1.0, ONE_SIDED), (ONE_SIDED, 1.0))
    return tuple({"rise": rise * t, "fall": fall * t} for t in times for rise, fall in ways)


def full(network: Network) -> float:
    """The power setting at the design point."""
    assert network.design_point is not None
    return scalar(network.read(network.design_point, network.power_setting))
