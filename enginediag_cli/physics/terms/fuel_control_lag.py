"""Lag of a fuel control."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import Lag
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import fuel_site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class FuelControlLag(Term):
    """τ dW_f/dt = W_f,commanded − W_f."""

    NAME = "fuel_control_lag"
    TITLE = "Lag of the fuel control"
    STATEMENT = "Fuel valve and manifold let the burner have a change of the commanded fuel flow a little later."
    EQUATION = "τ dW_f/dt = W_f,commanded − W_f"
    DRIVER = RATE
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", 0.0, 0.0, 60.0, 2.0, 0.5, assumed=True),)
    REFERENCE = "Rowen, J. Eng. Power 105 (1983) 865: valve 0.05 s, fuel system 0.4 s; the range is assumed"
    INPUTS = PAST
    TRIALS = tuple({"time_constant": t} for t in (0.5, 2.0, 8.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return fuel_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, Lag(), ("time_constant",))
