"""Windage of the rotors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import COMPRESSOR_PRESSURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import compressors, relative_speed, turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class WindageLoss(Term):
    """P_loss = f P_turbine,design (ρ/ρ_design)(N/N_design)³, from P = k ρ N³ D⁵ of discs that turn in gas.

    ρ is that of the gas that fills the cavities: behind the shaft's last compressor, or behind its turbine where it
    drives none. The loss is close to a constant share of the shaft's power; only its departures from that can be
    told from mechanical efficiency.
    """

    NAME = "windage_loss"
    TITLE = "Windage"
    STATEMENT = (
        "Discs and drums stir the gas in which they turn: the shaft loses power with the gas's density and "
        "the cube of its speed."
    )
    EQUATION = "P_loss = f P_turbine,design (ρ/ρ_design)(N/N_design)³"
    DRIVER = COMPRESSOR_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "f, loss over the shaft's turbine power at the design point",
            0.0,
            0.0,
            0.03,
            0.006,
            0.005,
            assumed=True,
        ),
    )
    REFERENCE = "NASA AGTF30 (shaft efficiency 0.99); law of discs ρ N³ D⁵; 0.2 to 1 % of shaft power assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for shaft in network.shafts:
            if any(t.values["shaft"] == shaft for t in turbines(network)):
                yield Site(shaft, shaft, (f"{shaft}.power_offtake_W",))

    def install(self, at: Place) -> None:
        shaft = at.site.name
        full = scalar(at.design.shafts[shaft].supply_W)
        on_it = [c for c in (*turbines(at.network), *compressors(at.network)) if c.values["shaft"] == shaft]
        station = on_it[-1].values["to"]
        reference, speed = scalar(density(at.design.flows[station])), relative_speed(at, shaft)

        def offtake(e: Evaluation, load_W: Value) -> Value:
            n = speed(e)
            return load_W + at.c(e, "fraction") * (full / reference) * density(e.flows[station]) * (n * n * n)

        at.on_leaf(f"{shaft}.power_offtake_W", offtake)


def density(flow: Flow) -> Value:
    """Total density P/(R T) [kg/m³]."""
    return flow.P / (flow.R * flow.T)
