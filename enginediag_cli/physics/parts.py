"""Parts of an engine that several terms look for, and their states relative to the design point.

What the effects on nozzles share: how far the pressure ratio lies below choking.

Which stations a sensor shows, and how fast the gas passes its probe.

What is demanded of an engine by its power setting, and how much that is at the design point: where effects act that
stand between a command and what the engine gets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.passages import Ambient, Bleed, Duct, Splitter
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import Value, exp, sqrt
from enginediag_cli.engine.evaluation import Evaluation, corrected_flow
from enginediag_cli.engine.network import STATION_COLUMN
from enginediag_cli.engine.term import Coefficient, Place, Site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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


NPR_STATED = 1.2  # where the coefficients of the literature are given
NPR_SCALE = 0.4
"""Pressure ratio over which the effect falls to 1/e: of it a fifth is left at choking (1.85). Judgement: discharge
coefficients of the literature level off there."""


def unchoked(e: Evaluation, station: str) -> Value:
    """g = exp(−(NPR − 1.2)/0.4) with NPR = P/p₀: 1 at a pressure ratio of 1.2, 0.2 at choking, smooth throughout."""
    return exp((NPR_STATED - e.flows[station].P / e.outputs["P0_Pa"]) * (1.0 / NPR_SCALE))


def unchoked_at_design(design: Evaluation, station: str) -> float:
    return scalar(unchoked(design, station))


@dataclass(frozen=True)
class Reading:
    """A sensor that shows the total temperature or pressure of `stations`, by their weight in the mean."""

    column: str
    quantity: str
    stations: Mapping[str, float]

    @property
    def site(self) -> Site:
        return Site(self.quantity, f"sensor.{self.quantity}", (f"reading {self.column}",))


def readings(network: Network, what: str) -> Iterator[Reading]:
    """Sensors of temperature ("T") or pressure ("P"): of one station or the mean of several, not a difference, a
    ratio or a share of them."""
    assert network.design_point is not None
    for sensor in network.sensors.values():
        if sensor.over:
            continue
        stations: dict[str, float] = {}
        for column, weight in sensor.reads.items():
            match = STATION_COLUMN.fullmatch(column)
            if match and match["what"] == what and match["station"] in network.design_point.flows and weight > 0.0:
                stations[match["station"]] = weight
        if len(stations) == len(sensor.reads) and abs(sum(stations.values()) - 1.0) < 1e-9:
            yield Reading(sensor.column, sensor.quantity, stations)


def hot_readings(network: Network) -> Iterator[Reading]:
    """Temperature sensors in burnt gas."""
    return (r for r in readings(network, "T") if all(is_hot(network, s) for s in r.stations))


def is_hot(network: Network, station: str) -> bool:
    """Whether the station's gas holds fuel."""
    assert network.design_point is not None
    return network.design_point.flows[station].mixture.far is not None


def reading_at(at: Place, what: str) -> Reading:
    """The reading of a site that `readings` gave."""
    return next(r for r in readings(at.network, what) if r.quantity == at.site.name)


def flies(network: Network) -> bool:
    """Whether altitude and Mach number are recorded, rather than the air beside the machine."""
    return any(isinstance(c, Ambient) and c.values["conditions"] == "flight" for c in network.components)


def burner(network: Network) -> Burner:
    return next(c for c in network.components if isinstance(c, Burner))


def relative_flow(at: Place, station: str) -> Callable[[Evaluation], Value]:
    """x = (W√T/P)/(W√T/P)_design of a station."""
    reference = scalar(corrected_flow(at.design.flows[station]))
    return lambda e: corrected_flow(e.flows[station]) * (1.0 / reference)


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
