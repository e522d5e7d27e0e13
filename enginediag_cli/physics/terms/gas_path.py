"""Effects on the burner, and on ducts, nozzles and exhausts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from math import log as log_of_number
from typing import TYPE_CHECKING

from enginediag_cli.drivers import (
    BURNER_TEMPERATURE,
    COMPRESSOR_PRESSURE,
    CONSTANT,
    CORRECTED_SPEED,
    NOZZLE_PRESSURE_RATIO,
    POWER,
)
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.nozzles import Exhaust, Nozzle, throat
from enginediag_cli.engine.components.passages import Duct
from enginediag_cli.engine.dual import Value, exp, log
from enginediag_cli.engine.evaluation import Evaluation, Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import (
    Quantity,
    burners,
    component_sites,
    flies,
    is_hot,
    outlet_sites,
    relative_flow,
)

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

# -- burner


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
            "unburnt", "1", "unburnt share a of the fuel at design loading", upper=0.003, sigma=0.0007, typical=0.0007
        ),
        shape_coefficient("exponent", "1", "exponent b of the loading", value=1.0, lower=0.3, upper=1.6, sigma=0.3),
    )
    REFERENCE = (
        "Loading as in Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, and Lefebvre, Gas Turbine "
        "Combustion; trend: NACA RM E50H31; 0.97 to 0.98 at idle"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(burners(network), "efficiency")

    def install(self, at: Place) -> None:
        values = at.component.values
        station = values["from"]
        reference = scalar(log_loading(at.design.flows[station]))
        per_design = 1.0 / values["combustion_efficiency"]

        def efficiency(e: Evaluation, factor: Value) -> Value:
            grown = exp(at.c(e, "exponent") * (log_loading(e.flows[station]) - reference))
            return factor - at.c(e, "unburnt") * (grown - 1.0) * per_design

        at.change_leaf(f"{at.site.name}.efficiency", efficiency)


PRESSURE_EXPONENT = 1.8
"""Of pressure in the loading parameter of burners: the textbooks' Ω (P. P. Walsh and P. Fletcher, Gas Turbine
Performance, 2nd ed. 2004, ch. 5)."""
PER_KELVIN = 0.00145 * log_of_number(10.0)  # 10^(0.00145 T) = e^(PER_KELVIN T)


def log_loading(flow: Flow) -> Value:
    """ln Ω but for a constant."""
    return log(flow.W) - PRESSURE_EXPONENT * log(flow.P) - PER_KELVIN * flow.T


class FuelHeatingValue(Term):
    """LHV = LHV_declared (1 + d), constant for a batch of fuel."""

    NAME = "fuel_heating_value"
    TITLE = "Heating value of the fuel"
    STATEMENT = (
        "Another batch of fuel holds more or less heat per kilogram than assumed; within one recording this "
        "looks like a change of combustion efficiency or of the fuel meter."
    )
    EQUATION = "LHV = LHV_declared (1 + d)"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient(
            "deviation",
            "1",
            "deviation d of the batch",
            lower=-0.02,
            upper=0.02,
            sigma=0.005,
            typical=0.005,
            cited=True,
        ),
    )
    REFERENCE = "Jet fuel 42.8 to 43.6 MJ/kg, ± 1 %; NASA AGTF30 reckons with 42.8 MJ/kg"

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(burners(network), "lower_heating_value_J_kg")

    def install(self, at: Place) -> None:
        at.change_leaf(at.site.targets[0], lambda e, declared: declared * (1.0 + at.c(e, "deviation")))


class FlowPressureLoss(Term):
    """ΔP/P = λ [1 + s (x² − 1)], x the corrected flow that enters the component over its design value."""

    EQUATION = "ΔP/P = λ [1 + s (x² − 1)],  x = (W√T/P)/(W√T/P)_design at its inlet"

    def install(self, at: Place) -> None:
        relative = relative_flow(at, at.component.values["from"])

        def loss(e: Evaluation, constant: Value) -> Value:
            x = relative(e)
            return constant * (1.0 + at.c(e, "share") * (x * x - 1.0))

        at.change_leaf(at.site.targets[0], loss)


class BurnerPressureLoss(FlowPressureLoss):
    """Cold loss of a burner, where the engine file states it as a constant."""

    NAME = "burner_pressure_loss"
    TITLE = "Burner pressure loss with flow"
    STATEMENT = (
        "The swirlers and holes of the burner take pressure with the square of the corrected flow, not the "
        "same share at every power."
    )
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient("share", "1", "share s of the loss that follows the flow", upper=1.5, sigma=0.5, typical=0.9),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (cold loss); NASA AGTF30 and T-MATS carry a "
        "constant 0.04"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites([c for c in burners(network) if c.values["pressure_loss"] > 0.0], "pressure_loss")


class DuctPressureLoss(FlowPressureLoss):
    """Friction loss of a duct, where the engine file states it as a constant."""

    NAME = "duct_pressure_loss"
    TITLE = "Duct pressure loss with flow"
    STATEMENT = (
        "Friction in a duct takes pressure with the square of the corrected flow, not the same share at every power."
    )
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient(
            "share", "1", "share s of the loss that follows the flow", upper=1.5, sigma=0.5, typical=0.9, cited=True
        ),
    )
    REFERENCE = "NASA AGTF30 (setup_Duct: loss ∝ M², 0.005 to 0.015 at design); pyCycle duct element (s_dPqP M^n)"

    def sites(self, network: Network) -> Iterable[Site]:
        ducts = [c for c in network.components if isinstance(c, Duct) and c.values["law"] == "constant"]
        return component_sites([c for c in ducts if c.values["pressure_loss"] > 0.0], "pressure_loss")


class BurnerHeatingLoss(Term):
    """P₄ is lower by k [(T₄/T₃ − 1) x² − (T₄/T₃ − 1)_design]: gas that is heated as it flows must be accelerated."""

    NAME = "burner_heating_loss"
    TITLE = "Burner pressure loss by heating"
    STATEMENT = (
        "Heating the gas in the burner speeds it up and costs total pressure: the more, the higher the ratio "
        "of temperatures across it."
    )
    EQUATION = "P_4 = P_4,cold {1 − k [(T_4/T_3 − 1) x² − (T_4/T_3 − 1)_design]},  x = (W√T/P)/(W√T/P)_design at 3"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient("loss", "1", "ΔP/P for T4/T3 = 2 at design flow", upper=0.01, sigma=0.002, typical=0.002),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (fundamental loss); 0.0005 to 0.003 assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        return outlet_sites(burners(network))

    def install(self, at: Place) -> None:
        cold, hot = at.component.values["from"], at.component.values["to"]
        relative = relative_flow(at, cold)
        reference = scalar(at.design.flows[hot].T / at.design.flows[cold].T) - 1.0

        def heated(e: Evaluation, flow: Flow) -> Flow:
            x = relative(e)
            heating = (flow.T / e.flows[cold].T - 1.0) * (x * x)
            return flow.replace(P=flow.P * (1.0 - at.c(e, "loss") * (heating - reference)))

        at.change_flow(hot, heated)


# -- nozzles and exhausts

NPR_STATED = 1.2  # where the coefficients of the literature are given
NPR_SCALE = 0.4
"""Pressure ratio over which the effect falls to 1/e: of it a fifth is left at choking (1.85). Judgement: discharge
coefficients of the literature level off there."""


def unchoked(e: Evaluation, station: str) -> Value:
    """g = exp(−(NPR − 1.2)/0.4) with NPR = P/p₀: 1 at a pressure ratio of 1.2, 0.2 at choking, smooth throughout."""
    return exp((NPR_STATED - e.flows[station].P / e.outputs["P0_Pa"]) * (1.0 / NPR_SCALE))


def nozzles(network: Network) -> list[Nozzle]:
    return [c for c in network.components if isinstance(c, Nozzle)]


class NozzleTerm(Term):
    """A coefficient or the area of a nozzle, times 1 + `change`."""

    @abstractmethod
    def change(self, at: Place, station: str) -> Quantity:
        """The relative change, 0 at the design point, of a nozzle that expands the gas of this station."""

    def install(self, at: Place) -> None:
        change = self.change(at, at.component.values["from"])
        at.change_leaf(at.site.targets[0], lambda e, x: x * (1.0 + change(e)))


class UnchokedNozzle(NozzleTerm):
    """C = C_design {1 − k [g(NPR) − g(NPR_design)]}, g falling from 1 at a pressure ratio of 1.2 to 0 far above
    choking."""

    DRIVER = NOZZLE_PRESSURE_RATIO

    def change(self, at: Place, station: str) -> Quantity:
        reference = scalar(unchoked(at.design, station))
        return lambda e: -(at.c(e, "fall") * (unchoked(e, station) - reference))


class NozzleDischarge(UnchokedNozzle):
    """C_d, stated as a factor on the area."""

    NAME = "nozzle_discharge"
    TITLE = "Nozzle discharge coefficient with pressure ratio"
    STATEMENT = (
        "A nozzle that does not choke passes less than its area promises: its discharge coefficient falls "
        "with the pressure ratio, at idle and on the ground most."
    )
    EQUATION = "C_d = C_d,design {1 − k [g(NPR) − g(NPR_design)]},  g = exp(−(NPR − 1.2)/0.4)"
    COEFFICIENTS = (
        Coefficient(
            "fall",
            "1",
            "fall k of C_d at a pressure ratio of 1.2, against a choked nozzle",
            upper=0.1,
            sigma=0.03,
            typical=0.03,
            cited=True,
        ),
    )
    REFERENCE = (
        "NASA T-MATS, nozzle tables CdTh(PR): 0.93 to 0.99, 0.02 to 0.06 lower at 1.2 than choked; "
        "the exponential is assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(nozzles(network), "area")


class NozzleVelocity(UnchokedNozzle):
    """C_v, on which the thrust alone depends."""

    NAME = "nozzle_velocity"
    TITLE = "Nozzle velocity coefficient with pressure ratio"
    STATEMENT = (
        "At low pressure ratio friction costs the jet a larger share of its velocity: there is less thrust, "
        "and nothing else in the engine notices."
    )
    EQUATION = "C_v = C_v,design {1 − k [g(NPR) − g(NPR_design)]},  g = exp(−(NPR − 1.2)/0.4)"
    COEFFICIENTS = (
        Coefficient(
            "fall",
            "1",
            "fall k of C_v at a pressure ratio of 1.2, against a choked nozzle",
            upper=0.05,
            sigma=0.01,
            typical=0.01,
        ),
    )
    REFERENCE = "NASA T-MATS and AGTF30, nozzle tables Cv and Cfg: 0.97 to 0.9999; the exponential is assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(nozzles(network), "velocity_coefficient")


class NozzleThermalGrowth(NozzleTerm):
    """A = A_design [1 + 2 a (T − T_design)], T the total temperature of the gas in a nozzle of burnt gas."""

    NAME = "nozzle_thermal_growth"
    TITLE = "Nozzle thermal growth"
    STATEMENT = "Hot exhaust gas makes the metal of the nozzle grow: its area opens with power and closes at idle."
    EQUATION = "A = A_design [1 + 2 a (T − T_design)]"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (
        Coefficient(
            "expansion_1_K",
            "1/K",
            "linear expansion a of the nozzle per kelvin of the gas",
            upper=3e-5,
            sigma=1e-5,
            typical=1.2e-5,
            cited=True,
        ),
    )
    REFERENCE = "NASA T-MATS, nozzle block (Therm_growth); a up to 1.2e-5 per K, 0 to 1.5 % of area"

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites([c for c in nozzles(network) if is_hot(network, c.values["from"])], "area")

    def change(self, at: Place, station: str) -> Quantity:
        reference = scalar(at.design.flows[station].T)
        return lambda e: 2.0 * at.c(e, "expansion_1_K") * (e.flows[station].T - reference)


class ExhaustBackPressure(Term):
    """Δp = b p₀,design (W²T/p₀)/(W²T/p₀)_design is added to the ambient pressure against which the gas leaves."""

    NAME = "exhaust_back_pressure"
    TITLE = "Exhaust back pressure"
    STATEMENT = (
        "Stack, silencer or boiler behind the engine hold the exhaust gas back, with the square of its flow: "
        "the last turbine expands to a higher pressure and gives less power."
    )
    EQUATION = "p_exit = p_0 + b p_0,design y,  y = (W²T/p_0)/(W²T/p_0)_design at the exit"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient(
            "rise", "1", "back pressure over ambient pressure at the design point", upper=0.06, sigma=0.02, typical=0.01
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (installation losses); 0 to 3 % assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            return
        for c in network.components:
            if isinstance(c, Exhaust) and c.design_loss > 0.0 and not c.values["measured_back_pressure"]:
                yield from component_sites([c], "loss_factor")
            if isinstance(c, Nozzle) and c.converges:
                yield from component_sites([c], "area")

    def install(self, at: Place) -> None:
        c = at.component
        station = c.values["from"]
        ambient_design = scalar(at.design.outputs["P0_Pa"])
        reference = scalar(_dynamic_head(at.design, at.design.flows[station]))

        def rise(e: Evaluation, flow: Flow) -> Value:
            return at.c(e, "rise") * (_dynamic_head(e, flow) * (ambient_design / reference))

        def loss_factor(e: Evaluation, factor: Value) -> Value:
            """P (1 − f L x²) = p₀ + Δp is met by f + Δp/(P L x²), x and L as in the exhaust component."""
            assert isinstance(c, Exhaust)
            flow = e.flows[station]
            own = flow.W * flow.W * flow.T / flow.P * (c.design_loss / c.flow_parameter**2)
            return factor + rise(e, flow) / own

        def area(e: Evaluation, factor: Value) -> Value:
            """The throat's flow against the raised pressure, as a factor on the area."""
            flow, p0 = e.flows[station], e.outputs["P0_Pa"]
            raised = p0 + rise(e, flow)
            return factor * throat(flow, log(flow.P / raised), raised)[0] / throat(flow, log(flow.P / p0), p0)[0]

        at.change_leaf(at.site.targets[0], loss_factor if isinstance(c, Exhaust) else area)


def _dynamic_head(e: Evaluation, flow: Flow) -> Value:
    """W²T/p₀, to which the dynamic pressure of a slow exhaust is proportional."""
    return flow.W * flow.W * flow.T / e.outputs["P0_Pa"]
