"""Combustion efficiency and burner loading."""

from __future__ import annotations

from collections.abc import Iterable
from math import log as log_of_number
from typing import TYPE_CHECKING

from enginediag_cli.drivers import COMPRESSOR_PRESSURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.dual import Value, exp, log
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


PRESSURE_EXPONENT = 1.8
"""Of pressure in the loading parameter of burners: the textbooks' Ω (P. P. Walsh and P. Fletcher, Gas Turbine
Performance, 2nd ed. 2004, ch. 5)."""
PER_KELVIN = 0.00145 * log_of_number(10.0)  # 10^(0.00145 T) = e^(PER_KELVIN T)


class CombustionEfficiency(Term):
    """1 − η = (1 − η_design) + a [(Ω/Ω_design)^b − 1]: ln of the unburnt share that follows the loading is a straight
    line in ln Ω, Ω = W/(V P^1.8 10^(0.00145 (T − 400 K))) of the air entering the burner."""

    NAME = "combustion_efficiency"
    TITLE = "Combustion efficiency with burner loading"
    STATEMENT = (
        "In thin cold air the flame has less time: at altitude and at idle a growing share of the fuel leaves "
        "the burner unburnt."
    )
    EQUATION = "η = η_design − a [(Ω/Ω_design)^b − 1],  Ω = W_3/(P_3^1.8 10^(0.00145 (T_3 − 400 K)))"
    DRIVER = COMPRESSOR_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "unburnt",
            "1",
            "unburnt share a of the fuel at design loading",
            0.0,
            0.0,
            0.003,
            0.0007,
            0.0007,
            assumed=True,
        ),
        Coefficient("exponent", "1", "exponent b of the loading", 1.0, 0.3, 1.6, 0.3, 1.0, assumed=True, shape=True),
    )
    REFERENCE = (
        "Loading as in Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, and Lefebvre, Gas Turbine "
        "Combustion; trend: NACA RM E50H31; 0.97 to 0.98 at idle"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Burner):
                yield Site(c.name, c.name, (f"{c.name}.efficiency",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Burner)
        station = c.values["from"]
        reference = scalar(_log_loading(at.design.flows[station]))
        per_design = 1.0 / c.values["combustion_efficiency"]

        def efficiency(e: Evaluation, factor: Value) -> Value:
            grown = exp(at.c(e, "exponent") * (_log_loading(e.flows[station]) - reference))
            return factor - at.c(e, "unburnt") * (grown - 1.0) * per_design

        at.on_leaf(f"{c.name}.efficiency", efficiency)


def _log_loading(flow: Flow) -> Value:
    """ln Ω but for a constant."""
    return log(flow.W) - PRESSURE_EXPONENT * log(flow.P) - PER_KELVIN * flow.T
