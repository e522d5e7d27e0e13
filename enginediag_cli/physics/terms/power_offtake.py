"""Power off-take of accessories."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class PowerOfftake(Term):
    """P_offtake = f · P_demand,design: a constant load on the shaft, relative to its power at the design point."""

    NAME = "power_offtake"
    TITLE = "Shaft power off-take"
    STATEMENT = (
        "Generators and hydraulic pumps take shaft power, whatever the engine's power: at low power they are "
        "a larger share."
    )
    EQUATION = "P_turbine η_m = P_compressor + f · P_turbine,design"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "load over the shaft's turbine power at the design point",
            0.0,
            0.0,
            0.05,
            0.01,
            0.005,
            assumed=True,
        ),
    )
    REFERENCE = "NLR GSP manual (PTO); Slingerland et al., AIAA 2007-7848; 0.3 to 1.5 % of HPT power on large engines"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        for shaft in network.shafts:
            if shaft not in network.loaded_shafts:
                yield Site(shaft, shaft, (f"{shaft}.power_offtake_W",))

    def install(self, at: Place) -> None:
        full = scalar(at.design.shafts[at.site.name].supply_W)

        def offtake(e: Evaluation, load_W: Value) -> Value:
            return load_W + at.c(e, "fraction") * full

        at.on_leaf(f"{at.site.name}.power_offtake_W", offtake)
