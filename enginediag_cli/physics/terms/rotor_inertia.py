"""Inertia of a rotor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.moving.filters import RateOfChange, Scaled
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.units import RAD_S_PER_RPM

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class RotorInertia(Term):
    """P_turbine η_m = P_compressor + P_offtake + d(½ I ω²)/dt, with ω as it was measured where it is recorded."""

    NAME = "rotor_inertia"
    TITLE = "Inertia of the rotor"
    STATEMENT = (
        "While a rotor speeds up, part of its turbine's power goes into it; it comes back while it slows down. Fuel "
        "and temperatures are above those of a steady engine at the same speed, or below."
    )
    EQUATION = "P_turbine η_m = P_compressor + P_offtake + I ω dω/dt"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "inertia",
            "kg m2",
            "I, polar moment of inertia of all that turns with the shaft",
            0.0,
            0.0,
            1e5,
            10.0,
            0.1,
            assumed=True,
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8; ranges from model jets to fans, assumed"
    )
    INPUTS = PAST
    MEASURED = True

    def sites(self, network: Network) -> Iterable[Site]:
        for name, shaft in network.shafts.items():
            if shaft["speed"] != "constant":
                yield Site(name, name, (f"{name}.power_offtake_W",))

    def install(self, at: Place) -> None:
        name = at.site.name

        def energy(speed_rpm: Array) -> Array:
            return 0.5 * (RAD_S_PER_RPM * speed_rpm) ** 2

        column = next(c for c, shaft in at.network.speed_columns.items() if shaft == name)
        power = at.remember(Scaled(RateOfChange()), ("inertia",), recorded=column, measured=energy, turns=name)

        def offtake(e: Evaluation, load_W: Value) -> Value:
            omega = e.shaft(name).speed_rpm * RAD_S_PER_RPM
            return load_W + power(e, omega * omega * 0.5)

        at.on_leaf(f"{name}.power_offtake_W", offtake)
