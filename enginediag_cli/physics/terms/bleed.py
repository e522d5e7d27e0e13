"""Air that leaves a compressor: customer, anti-ice, interstage and handling bleeds, and the turbines' cooling air."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

from enginediag_cli.drivers import COMPRESSOR_PRESSURE, CORRECTED_SPEED, RATE, SWITCH
from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.passages import Bleed
from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.dual import Value, exp, power
from enginediag_cli.engine.evaluation import Evaluation, Flow
from enginediag_cli.engine.filters import Hysteresis, ScaledFilter
from enginediag_cli.engine.recall import UNKNOWN_PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import (
    Quantity,
    core_compressor,
    has_variable_speed,
    outlet_sites,
    relative_corrected_speed,
    turbines,
    upstream,
)

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ExitBleed(Term):
    """W_out = W (1 − share) behind a compressor: the work on the air that leaves has been done."""

    def compressors(self, network: Network) -> Sequence[Compressor]:
        # air of an outer fan or a booster is a matter of the handling bleed
        return core_compressor(network)

    def sites(self, network: Network) -> Iterable[Site]:
        return outlet_sites(self.compressors(network))

    @abstractmethod
    def share(self, at: Place) -> Quantity:
        """The share of the flow that leaves."""

    def install(self, at: Place) -> None:
        share = self.share(at)
        at.change_flow(at.component.values["to"], lambda e, flow: flow.replace(W=flow.W * (1.0 - share(e))))


class CustomerBleed(ExitBleed):
    """W_out = W (1 − b) at the exit of a compressor whose air can leave for the cabin."""

    NAME = "customer_bleed"
    TITLE = "Customer bleed"
    STATEMENT = (
        "Air for the cabin is taken behind the compressor: the turbines get less gas, and the burner must "
        "heat it more for the same power."
    )
    EQUATION = "W = W_exit (1 − b)"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient("fraction", "1", "bleed over compressor exit flow", upper=0.12, sigma=0.03, typical=0.03),
    )
    REFERENCE = "SAE AIR1168; range 0 to 8 % of core flow assumed"
    SWITCHES = True

    def share(self, at: Place) -> Quantity:
        return lambda e: at.c(e, "fraction")


class AntiIceBleed(ExitBleed):
    """W_out = W (1 − b N_c,design/N_c): the heat that ice protection needs does not fall with the engine's speed."""

    NAME = "anti_ice_bleed"
    TITLE = "Anti-ice bleed"
    STATEMENT = (
        "Hot air for wing and inlet is taken behind the compressor on command; it is a larger share of the "
        "flow at low speed."
    )
    EQUATION = "W = W_exit (1 − b N_c,design/N_c),  N_c = N/√T at the compressor's inlet"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "b, bleed over compressor exit flow at design corrected speed",
            upper=0.08,
            sigma=0.02,
            typical=0.02,
        ),
    )
    REFERENCE = "SAE AIR1168; 1 to 5 % of core flow and the law of speed assumed"
    SWITCHES = True

    def share(self, at: Place) -> Quantity:
        speed = relative_corrected_speed(at)
        return lambda e: at.c(e, "fraction") / speed(e)


class InterstageBleed(Term):
    """W_out = W − b W_in; the air leaves with a part w of the work, and the shaft gives (1 − w) Δh less for it."""

    NAME = "interstage_bleed"
    TITLE = "Interstage bleed"
    STATEMENT = (
        "Air is taken between the compressor's stages: the turbines get less gas, but only a part of the "
        "compressor's work is spent on the air that leaves."
    )
    EQUATION = "W_exit = W_exit,0 − b W_in,  P_shaft = W_in Δh − b W_in (1 − w) Δh"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient("fraction", "1", "b, bleed over compressor inlet flow", upper=0.12, sigma=0.03, typical=0.03),
        shape_coefficient(
            "work_fraction",
            "1",
            "w, share of the enthalpy rise done on the bleed",
            value=0.5,
            upper=1.0,
            sigma=0.15,
            cited=True,
        ),
    )
    REFERENCE = "NASA AGTF30 setup_HPC (interstage port: enthalpy fraction 0.50); SAE AIR1168; 0 to 8 % assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        return outlet_sites(core_compressor(network))

    def install(self, at: Place) -> None:
        values = at.component.values

        def exit_flow(e: Evaluation, flow: Flow) -> Flow:
            inlet = e.flows[values["from"]]
            taken = inlet.W * at.c(e, "fraction")
            # the compressor has charged its shaft with the full rise just before it delivers its flow
            shaft = e.shaft(values["shaft"])
            shaft.demand_W = shaft.demand_W - taken * (1.0 - at.c(e, "work_fraction")) * (flow.h - inlet.h)
            return flow.replace(W=flow.W - taken)

        at.change_flow(values["to"], exit_flow)


OPEN_BELOW = shape_coefficient(
    "open_below",
    "1",
    "n_open, relative corrected speed at which the valve is half open",
    value=0.85,
    lower=0.4,
    upper=1.1,
    sigma=0.05,
)


class HandlingValve(ExitBleed):
    """A valve behind a compressor that lets a share of its air out, by the compressor's relative corrected speed."""

    def compressors(self, network: Network) -> Sequence[Compressor]:
        """The compressor behind which the valve lies: the booster, or else the core compressor itself; none at
        constant speed, where the valve is a matter of starting."""
        return [_behind(network, c) for c in core_compressor(network) if has_variable_speed(network, c)]


def _behind(network: Network, core: Compressor) -> Compressor:
    before = upstream(network, core.values["from"])
    return before if isinstance(before, Compressor) else core


class HandlingBleed(HandlingValve):
    """W_out = W [1 − b s(n)], s = 1/(1 + exp[(n − n_open)/Δn]), n = N_c/N_c,design of the site's compressor.

    The air leaves the engine; what it would add to a bypass stream is neglected. An engine without booster blows
    off behind its compressor.
    """

    NAME = "handling_bleed"
    TITLE = "Handling bleed"
    STATEMENT = (
        "Below a certain speed a valve lets compressed air out to keep the compressor from surge; what "
        "lies behind it gets less flow there."
    )
    EQUATION = "W = W_exit (1 − b/(1 + exp[(N_c/N_c,design − n_open)/Δn]))"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient(
            "fraction", "1", "b, bleed over flow with the valve open", upper=0.25, sigma=0.05, typical=0.08, cited=True
        ),
        OPEN_BELOW,
        shape_coefficient(
            "width",
            "1",
            "Δn, relative corrected speed over which it moves",
            value=0.03,
            lower=0.01,
            upper=0.2,
            sigma=0.02,
        ),
    )
    REFERENCE = "NASA AGTF30 variable bleed valve (0 to 15 % of booster flow); speed and width of opening assumed"

    def share(self, at: Place) -> Quantity:
        speed = relative_corrected_speed(at)

        def open_share(e: Evaluation) -> Value:
            closed = exp((speed(e) - at.c(e, "open_below")) / at.c(e, "width"))
            return at.c(e, "fraction") / (1.0 + closed)

        return open_share


class BleedValveHysteresis(HandlingValve):
    """W = W_exit (1 − b) while n_open ≤ n < n_open + Δn after n < n_open, n = N_c/N_c,design of the site's compressor.

    What a valve bleeds below n_open is another effect (`handling_bleed`), which needs no memory. No search tries it: it
    jumps where nobody knows its thresholds. What it does in a recording is found as a switch that no column records,
    whose states show what it follows and between which thresholds.
    """

    NAME = "bleed_valve_hysteresis"
    TITLE = "Bleed valve that closes later than it opens"
    STATEMENT = (
        "A valve that was open at low speed stays open until a higher speed than that at which it opens: in between "
        "the engine bleeds after an acceleration, and does not after a deceleration."
    )
    EQUATION = "W = W_exit (1 − b)  while n_open ≤ N_c/N_c,design < n_open + Δn, having come from below"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "b, bleed over flow while the valve is still open",
            upper=0.25,
            sigma=0.05,
            typical=0.05,
            cited=True,
        ),
        replace(OPEN_BELOW, description="n_open, relative corrected speed below which the valve opens"),
        shape_coefficient("band", "1", "Δn, by how much higher it closes", value=0.05, upper=0.3, sigma=0.03),
    )
    REFERENCE = (
        "bleed valve schedules with hysteresis: Walsh and Fletcher, Gas Turbine Performance, ch. 5 and 8; assumed"
    )
    INPUTS = UNKNOWN_PAST
    SOUGHT = False
    TRIALS = tuple({"fraction": 0.05, "open_below": n, "band": b} for n, b in product((0.7, 0.8, 0.9), (0.05, 0.1)))

    def share(self, at: Place) -> Quantity:
        speed = relative_corrected_speed(at)
        share = at.add_memory(ScaledFilter(Hysteresis()), ("fraction", "open_below", "band"))
        return lambda e: share(e, speed(e))


class CoolingFlowVariation(Term):
    """f = f_model (P_s/P_s,design)^m with P_s the total pressure where the cooling air is taken.

    Orifices between fixed pressure ratios pass a constant share; what remains is what the pressure level does:
    cooling that is throttled at part load (m > 0), or seals that open there (m < 0). All the ports that feed the
    site's turbine vary together. For a port between a compressor's stages P_s is taken at the compressor's inlet,
    to which the pressure at the port is roughly proportional.
    """

    NAME = "cooling_flow_variation"
    TITLE = "Turbine cooling flow with pressure level"
    STATEMENT = (
        "The turbine's cooling air is not the same share of the core flow everywhere: seals and throttled "
        "cooling change it with the pressure that drives it."
    )
    EQUATION = "f = f_model (P_s/P_s,design)^m,  P_s = total pressure at the bleed (a compressor port: at its inlet)"
    DRIVER = COMPRESSOR_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "exponent",
            "1",
            "m, growth of the cooling share with pressure",
            lower=-0.3,
            upper=0.5,
            sigma=0.1,
            typical=0.1,
        ),
    )
    REFERENCE = "NASA AGTF30 (cooling shares 0.0625 and 0.0693); variation of 10 % of the cooling flow assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for turbine in turbines(network):
            leaves = tuple(leaf for _, leaf in ports(network, turbine))
            if leaves:
                yield Site(turbine.name, turbine.name, leaves)

    def install(self, at: Place) -> None:
        for station, leaf in ports(at.network, at.component):
            self._vary(at, station, leaf)

    def _vary(self, at: Place, station: str, leaf: str) -> None:
        reference = scalar(at.design.flows[station].P)

        def fraction(e: Evaluation, f: Value) -> Value:
            return f * power(e.flows[station].P * (1.0 / reference), at.c(e, "exponent"))

        at.change_leaf(leaf, fraction)


def ports(network: Network, turbine: Component) -> list[tuple[str, str]]:
    """Station whose pressure drives it and leaf of the share, for every bleed that cools the turbine."""
    cools = (*turbine.values["cooling_before_rotor"], *turbine.values["cooling_after_rotor"])
    return [
        (c.values["from"], f"{c.name}.{port['name']}.fraction")
        for c in network.components
        if isinstance(c, (Bleed, Compressor))
        for port in c.values["ports"]
        if port["name"] in cools
    ]
