"""Which stations a sensor shows, and how fast the gas passes its probe."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.engine.components.ambient import Ambient
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import STATION_COLUMN
from enginediag_cli.engine.similarity import corrected_flow
from enginediag_cli.engine.term import Place, Site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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
