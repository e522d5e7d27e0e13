"""Controls and actuators that follow what is commanded with a lag, a delay or at a limited rate."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.controls import RecordedPosition
from enginediag_cli.engine.filters import Delay, Filter, Lag, PerFull, RateLimit, SecondOrder
from enginediag_cli.engine.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import burners

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

ONE_SIDED = 0.1
"""Of the time in one direction, that of the other in trials of one direction: at 0 nothing would show whether it is."""
LONGEST_S = 1e5
"""Bound of the time for a full scale: about a day."""


class FilteredCommand(Term):
    """The engine gets what `FILTER` makes of a command, with the term's coefficients; a rate limit by the full scale of
    the site."""

    DRIVER = RATE
    INPUTS = PAST
    FILTER: ClassVar[Filter]

    def install(self, at: Place) -> None:
        filter = self.FILTER
        if isinstance(filter, RateLimit):
            assert at.site.full is not None
            filter = PerFull(filter, at.site.full[0])
        at.filter_input(at.site.targets[0], filter, [c.name for c in self.COEFFICIENTS])


class LoadCommand(FilteredCommand):
    """At the machine that gets a demand of power, where that is what sets the power."""

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "power_W":
            for name in [c.name for c in network.components if c.TYPE == "load"][:1]:
                yield Site(name, name, ("power_W",), full=(full_setting(network), "W"))


class FuelCommand(FilteredCommand):
    """At the burner, where a commanded fuel flow sets the power."""

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "Wf_kg_s":
            name = burners(network)[0].name
            yield Site(name, name, ("Wf_kg_s",), full=(full_setting(network), "kg/s"))


def full_setting(network: Network) -> float:
    """The power setting at the design point."""
    assert network.design_point is not None
    return scalar(network.read(network.design_point, network.power_setting))


def rate_limits(what: str, full: str, sigma: float, typical: float) -> tuple[Coefficient, ...]:
    """Times [s] in which what is demanded, `what`, may rise and fall by `full`."""
    return tuple(
        Coefficient(
            name,
            "s",
            f"{sign}, time in which the {what} may {name} by {full}; 0: at once",
            upper=LONGEST_S,
            sigma=sigma,
            typical=typical,
            per_full=True,
        )
        for name, sign in (("rise", "t_up"), ("fall", "t_down"))
    )


def rate_trials(*times: float) -> tuple[dict[str, float], ...]:
    """Sizes of rate limits at which a search tries them: either way alike, and one way much faster."""
    ways = ((1.0, 1.0), (1.0, ONE_SIDED), (ONE_SIDED, 1.0))
    return tuple({"rise": rise * t, "fall": fall * t} for t in times for rise, fall in ways)


class LoadControlLag(LoadCommand):
    """τ dP/dt = P_demanded − P."""

    NAME = "load_control_lag"
    TITLE = "Lag of the load controller"
    STATEMENT = (
        "The load approaches what is demanded the faster the farther it is from it: steps of all sizes take "
        "the same time."
    )
    EQUATION = "τ dP/dt = P_demanded − P"
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", upper=5000.0, sigma=500.0, typical=30.0),)
    REFERENCE = "first-order governor models: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    TRIALS = tuple({"time_constant": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))
    FILTER = Lag()


class LoadControlDelay(LoadCommand):
    """P(t) = P_demanded(t − d)."""

    NAME = "load_control_delay"
    TITLE = "Delay of the load controller"
    STATEMENT = (
        "What is demanded reaches the load some time later, unchanged: signal ways, sampling, a column that was "
        "recorded late."
    )
    EQUATION = "P(t) = P_demanded(t − d)"
    COEFFICIENTS = (Coefficient("delay", "s", "d; 0: at once", upper=3600.0, sigma=100.0, typical=10.0),)
    REFERENCE = "transport and sampling delays of control loops; the range is assumed"
    TRIALS = tuple({"delay": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))
    FILTER = Delay()


class LoadSecondOrderLag(LoadCommand):
    """τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded."""

    NAME = "load_second_order_lag"
    TITLE = "Second-order lag of the load controller"
    STATEMENT = (
        "The load begins to follow slowly and then approaches what is demanded: two lags in a row, of actuator "
        "and machine."
    )
    EQUATION = "τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded"
    COEFFICIENTS = (
        Coefficient(
            "time_constant", "s", "τ = τ₁ + τ₂, of both together; 0: at once", upper=5000.0, sigma=500.0, typical=40.0
        ),
        Coefficient(
            "second_share",
            "1",
            "τ₂/τ, share of the quicker one; 0: a lag of first order",
            absent=0.5,
            upper=0.5,
            sigma=0.5,
            typical=0.4,
            free=True,
            closed=True,
        ),
    )
    REFERENCE = "governor and actuator in series: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    TRIALS = tuple({"time_constant": t, "second_share": 0.4} for t in (2.0, 5.0, 12.0, 30.0, 75.0, 190.0, 480.0))
    FILTER = SecondOrder()


class LoadRateLimit(LoadCommand):
    """−P_full/t_down ≤ dP/dt ≤ P_full/t_up: the load follows what is demanded, but not faster."""

    NAME = "load_rate_limit"
    TITLE = "Rate limit of the load controller"
    STATEMENT = (
        "The controller of the load takes up and gives away power at a limited rate, whatever the size of the step "
        "that is demanded: a larger step takes longer, in proportion."
    )
    EQUATION = "dP/dt = min(max(dP_demanded/dt, −P_full/t_down), P_full/t_up) until P = P_demanded"
    COEFFICIENTS = rate_limits("load", "the design power", 1000.0, 100.0)
    REFERENCE = "IEEE Std 421.5 and IEEE Task Force on turbine-governor modelling: ramp limiters; ranges assumed"
    TRIALS = rate_trials(4.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0)
    FILTER = RateLimit()


class FuelControlLag(FuelCommand):
    """τ dW_f/dt = W_f,commanded − W_f."""

    NAME = "fuel_control_lag"
    TITLE = "Lag of the fuel control"
    STATEMENT = "Fuel valve and manifold let the burner have a change of the commanded fuel flow a little later."
    EQUATION = "τ dW_f/dt = W_f,commanded − W_f"
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", upper=60.0, sigma=2.0, typical=0.5),)
    REFERENCE = "Rowen, J. Eng. Power 105 (1983) 865: valve 0.05 s, fuel system 0.4 s; the range is assumed"
    TRIALS = tuple({"time_constant": t} for t in (0.5, 2.0, 8.0))
    FILTER = Lag()


class FuelRateLimit(FuelCommand):
    """−W_full/t_down ≤ dW_f/dt ≤ W_full/t_up: the fuel follows what is commanded, but not faster."""

    NAME = "fuel_rate_limit"
    TITLE = "Rate limit of the fuel actuator"
    STATEMENT = (
        "The fuel valve or its schedule opens and closes at a limited rate: a larger step takes longer, in proportion."
    )
    EQUATION = "dW_f/dt = min(max(dW_f,commanded/dt, −W_full/t_down), W_full/t_up) until W_f = W_f,commanded"
    COEFFICIENTS = rate_limits("fuel", "the design flow", 100.0, 10.0)
    REFERENCE = (
        "acceleration and deceleration limiters of fuel controls: Walsh and Fletcher, Gas Turbine "
        "Performance, ch. 8; ranges assumed"
    )
    TRIALS = rate_trials(2.0, 5.0, 12.0, 30.0)
    FILTER = RateLimit()


class ActuatorRateLimit(FilteredCommand):
    """−way/t_down ≤ dx/dt ≤ way/t_up: the position follows what is recorded of it, a command, but not faster."""

    NAME = "actuator_rate_limit"
    TITLE = "Rate limit of an actuator"
    STATEMENT = (
        "What is recorded is where vanes, a nozzle or a valve are to stand; they get there at a limited rate: a longer "
        "way takes longer, in proportion."
    )
    EQUATION = "dx/dt = min(max(dx_recorded/dt, −way/t_down), way/t_up) until x = x_recorded"
    COEFFICIENTS = rate_limits("position", "all its way between the stops", 20.0, 5.0)
    REFERENCE = "actuator slew limits: Walsh and Fletcher, Gas Turbine Performance, ch. 8; ranges assumed"
    TRIALS = rate_trials(1.0, 3.0, 10.0, 30.0)
    FILTER = RateLimit()

    def sites(self, network: Network) -> Iterable[Site]:
        for control in network.controls:
            if isinstance(control, RecordedPosition):
                a = control.actuator
                yield Site(control.name, control.name, (control.column,), full=(a.upper - a.lower, a.unit))
