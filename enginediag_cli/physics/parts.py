"""Parts of an engine that several terms look for, and their states relative to the design point."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.bleed import Bleed
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.duct import Duct
from enginediag_cli.engine.components.splitter import Splitter
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network
    from enginediag_cli.engine.term import Place

Ratio = Callable[[Evaluation], Value]


def compressors(network: Network) -> list[Compressor]:
    return [c for c in network.components if isinstance(c, Compressor)]


def turbines(network: Network) -> list[Turbine]:
    return [c for c in network.components if isinstance(c, Turbine)]


def core_compressor(network: Network) -> list[Compressor]:
    """The last compressor of the gas path, the high-pressure compressor or the only one; empty without any."""
    return compressors(network)[-1:]


def upstream(network: Network, station: str) -> Component | None:
    """The component that delivers a station's gas; ducts and bleeds are looked through."""
    for c in network.components:
        delivers = ("core", "bypass") if isinstance(c, Splitter) else ("to",)
        if station in (c.values.get(k) for k in delivers):
            return upstream(network, c.values["from"]) if isinstance(c, (Duct, Bleed)) else c
    return None


def fan_of(network: Network, splitter: Splitter) -> Compressor | None:
    """The fan whose flow the splitter divides."""
    c = upstream(network, splitter.values["from"])
    return c if isinstance(c, Compressor) else None


def fans(network: Network) -> set[str]:
    """Names of the compressors that feed a splitter."""
    found = (fan_of(network, s) for s in network.components if isinstance(s, Splitter))
    return {c.name for c in found if c is not None}


def relative_speed(at: Place, shaft: str) -> Ratio:
    """N/N_design of a shaft."""
    reference = scalar(at.design.shafts[shaft].speed_rpm)
    return lambda e: e.shaft(shaft).speed_rpm * (1.0 / reference)


def relative_corrected_speed(at: Place, compressor: Compressor) -> Ratio:
    """(N/√T)/(N/√T)_design with T at the compressor's inlet."""
    station, shaft = compressor.values["from"], compressor.values["shaft"]
    inlet = at.design.flows[station]
    reference = scalar(at.design.shafts[shaft].speed_rpm) / scalar(inlet.T) ** 0.5
    return lambda e: e.shaft(shaft).speed_rpm / sqrt(e.flows[station].T) * (1.0 / reference)
