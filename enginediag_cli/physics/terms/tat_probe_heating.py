"""Anti-ice heating of the air-temperature probe."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import MACH
from enginediag_cli.engine.atmosphere import P_ISA, standard_atmosphere
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class TatProbeHeating(Term):
    """Recorded air temperature above the true one by a (p_ISA/p) M_s/√(M² + M_s²), told for total temperature and
    taken off the static one: ∝ 1/(M p) in flight, finite standing still."""

    NAME = "tat_probe_heating"
    TITLE = "Heating of the air-temperature probe"
    STATEMENT = (
        "The anti-ice heater warms the probe of the air temperature, most in slow and thin air: the engine "
        "breathes colder air than was recorded."
    )
    EQUATION = "ΔT_ISA = recorded − a (p_ISA/p) (M_s/√(M² + M_s²))/(1 + 0.2 M²)"
    DRIVER = MACH
    COEFFICIENTS = (
        Coefficient("error_K", "K", "error a standing still at sea level", 0.0, 0.0, 6.0, 1.5, 1.5, assumed=True),
        Coefficient(
            "mach_scale",
            "1",
            "Mach number M_s below which ventilation keeps the error finite",
            0.1,
            0.02,
            0.4,
            0.05,
            0.1,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = "Engineering judgement: + k/(M p), 0 to 3 K on the ground, assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            yield Site("ambient", "ambient", ("dT_isa_K",), everywhere=True)

    def install(self, at: Place) -> None:
        def deviation(e: Evaluation, recorded: Value) -> Value:
            mach, scale = e["mach"], at.c(e, "mach_scale")
            _, p = standard_atmosphere(e["altitude_m"])
            square = mach * mach
            slow = scale / sqrt(square + scale * scale) / (1.0 + 0.2 * square)
            return recorded - at.c(e, "error_K") * (slow * (P_ISA / p))

        at.on_leaf("dT_isa_K", deviation)
