"""Water vapour in the air."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import HUMIDITY
from enginediag_cli.engine.atmosphere import saturated_water, standard_atmosphere
from enginediag_cli.engine.components.passages import Ambient
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class Humidity(Term):
    """w = w_recorded + φ w_sat(T_0, p_0), with w_recorded = 0 where no column of humidity was recorded."""

    NAME = "humidity"
    TITLE = "Humidity"
    STATEMENT = (
        "Warm air carries water that was not recorded: the gas is lighter and of greater heat capacity, which "
        "changes speeds, flows and the fuel that is needed."
    )
    EQUATION = "w = w_recorded + φ w_sat(T_0, p_0),  w_sat = 0.622 e_s(T_0)/(p_0 − e_s)"
    DRIVER = HUMIDITY
    COEFFICIENTS = (
        Coefficient("relative_humidity", "1", "φ, relative humidity beyond what is recorded", 0.0, 0.0, 1.0, 0.4, 0.6),
    )
    REFERENCE = (
        "Bird & Grabe, ASME 91-GT-329 (corrections of 0.1 to 0.8 %); saturation: Buck 1981, "
        "J. Appl. Meteorol. 20, 1527, constants of 1996"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        if any(isinstance(c, Ambient) for c in network.components):
            yield Site("ambient", "ambient", ("humidity_kg_kg",), everywhere=True)

    def install(self, at: Place) -> None:
        air = next(c for c in at.network.components if isinstance(c, Ambient))
        ground = air.values["conditions"] == "ground"

        def humidity(e: Evaluation, recorded: Value) -> Value:
            if ground:
                T0, p0 = e["ambient_temperature_K"], e["ambient_pressure_Pa"]
            else:
                T0, p0 = standard_atmosphere(e["altitude_m"])
                T0 = T0 + e["dT_isa_K"]
            return recorded + at.c(e, "relative_humidity") * saturated_water(T0, p0)

        at.on_leaf("humidity_kg_kg", humidity)
