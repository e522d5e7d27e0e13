"""Parts of an engine that several terms look for, their sites, and their state relative to the design point."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.passages import Ambient, Bleed, Duct, Splitter
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation, corrected_flow
from enginediag_cli.engine.term import Place, Site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


Quantity = Callable[[Evaluation], Value]
"""A number of a point of the engine (N,): a relative corrected speed, a share of the flow, an angle."""


def component_sites(components: Iterable[Component], *quantities: str) -> Iterator[Site]:
    """A site at each component, where these of its leaves change."""
    for c in components:
        yield Site(c.name, c.name, tuple(f"{c.name}.{quantity}" for quantity in quantities))


def outlet_sites(components: Iterable[Component]) -> Iterator[Site]:
    """A site at each component, where the flow that it delivers changes."""
    for c in components:
        yield Site(c.name, c.name, (f"station {c.values['to']}",))


def compressors(network: Network) -> list[Compressor]:
    return [c for c in network.components if isinstance(c, Compressor)]


def turbines(network: Network) -> list[Turbine]:
    return [c for c in network.components if isinstance(c, Turbine)]


def burners(network: Network) -> list[Burner]:
    """Burners in the order of the gas path; every engine has one."""
    return [c for c in network.components if isinstance(c, Burner)]


def core_compressor(network: Network) -> list[Compressor]:
    """The last compressor of the gas path, the high-pressure compressor or the only one; empty without any."""
    return compressors(network)[-1:]


def has_variable_speed(network: Network, component: Component) -> bool:
    """Whether the component's shaft may turn at any speed, and not at one only."""
    return bool(network.shafts[component.values["shaft"]]["speed"] != "constant")


def upstream(network: Network, station: str) -> Component | None:
    """The component that delivers a station's gas; ducts and bleeds are looked through."""
    for c in network.components:
        delivers = ("core", "bypass") if isinstance(c, Splitter) else ("to",)
        if station in (c.values.get(k) for k in delivers):
            return upstream(network, c.values["from"]) if isinstance(c, (Duct, Bleed)) else c
    return None


def is_hot(network: Network, station: str) -> bool:
    """Whether the station's gas holds fuel."""
    assert network.design_point is not None
    return network.design_point.flows[station].mixture.far is not None


def flies(network: Network) -> bool:
    """Whether altitude and Mach number are recorded, rather than the air beside the machine."""
    return any(isinstance(c, Ambient) and c.values["conditions"] == "flight" for c in network.components)


def relative_speed(at: Place, shaft: str) -> Quantity:
    """N/N_design of a shaft."""
    reference = scalar(at.design.shafts[shaft].speed_rpm)
    return lambda e: e.shaft(shaft).speed_rpm * (1.0 / reference)


def relative_corrected_speed(at: Place) -> Quantity:
    """(N/√T)/(N/√T)_design of the site's compressor with T at its inlet."""
    station, shaft = at.component.values["from"], at.component.values["shaft"]
    inlet = at.design.flows[station]
    reference = scalar(at.design.shafts[shaft].speed_rpm) / scalar(inlet.T) ** 0.5
    return lambda e: e.shaft(shaft).speed_rpm / sqrt(e.flows[station].T) * (1.0 / reference)


def relative_flow(at: Place, station: str) -> Quantity:
    """x = (W√T/P)/(W√T/P)_design of a station."""
    reference = scalar(corrected_flow(at.design.flows[station]))
    return lambda e: corrected_flow(e.flows[station]) * (1.0 / reference)
