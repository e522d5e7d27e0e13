"""Errors of probes, meters and clocks: how a recording differs from the state of the gas."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from enginediag_cli.drivers import AMBIENT_PRESSURE, BURNER_TEMPERATURE, CONSTANT, CORRECTED_SPEED, POWER, RATE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value, exp, log, sqrt
from enginediag_cli.engine.evaluation import Evaluation, Flow, ValueHook
from enginediag_cli.engine.filters import Delay, Lag
from enginediag_cli.engine.network import STATION_COLUMN
from enginediag_cli.engine.recall import UNKNOWN_PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import burners, flies, is_hot, relative_flow

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

# -- recorded inputs


class InputScale(Term):
    """A recorded input of the engine is recorded/(1 + s); of an output, the scale of its sensor is this error."""

    DRIVER = CONSTANT

    def install(self, at: Place) -> None:
        at.change_leaf(at.site.targets[0], lambda e, recorded: recorded / (1.0 + at.c(e, "error")))


def scale_coefficient(largest: float, sigma: float) -> Coefficient:
    """s, of either sign."""
    words = "scale error s of the reading"
    return Coefficient("error", "1", words, lower=-largest, upper=largest, sigma=sigma, typical=sigma)


class AmbientPressureScale(InputScale):
    """p₀ of a barometer beside a ground engine."""

    NAME = "ambient_pressure_scale"
    TITLE = "Scale error of the ambient pressure"
    STATEMENT = (
        "The barometer beside the machine reads a constant share too high or too low, for instance because it "
        "is at another height than the inlet."
    )
    EQUATION = "p_0 = p_0,recorded/(1 + s)"
    COEFFICIENTS = (scale_coefficient(0.02, sigma=0.005),)
    REFERENCE = "Engineering judgement: ± 0.5 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if not flies(network):
            yield Site("ambient", "ambient", ("ambient_pressure_Pa",), everywhere=True)


class FuelMeterScale(InputScale):
    """W_f, where fuel flow sets the power."""

    NAME = "fuel_meter_scale"
    TITLE = "Scale error of the fuel meter"
    STATEMENT = (
        "The fuel meter shows a constant share more or less than flows; within one recording this looks like "
        "another heating value of the fuel."
    )
    EQUATION = "W_f = W_f,recorded/(1 + s)"
    COEFFICIENTS = (scale_coefficient(0.03, sigma=0.01),)
    REFERENCE = "Engineering judgement: ± 1 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "Wf_kg_s" and network.power_leaf:
            yield Site("Wf", "sensor.Wf", (network.power_leaf,))


class SpeedScale(InputScale):
    """N of a shaft whose speed sets the power or is an input."""

    NAME = "speed_scale"
    TITLE = "Scale error of a speed reading"
    STATEMENT = (
        "The speed that sets the model's power is recorded a constant share too high or too low, for instance "
        "by another 100 % speed than assumed."
    )
    EQUATION = "N = N_recorded/(1 + s)"
    COEFFICIENTS = (scale_coefficient(0.02, sigma=0.005),)
    REFERENCE = "Engineering judgement: ± 1 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for column, shaft in network.speed_columns.items():
            if column == network.power_setting or network.shafts[shaft]["speed"] == "input":
                label = network.shafts[shaft]["speed_label"]
                yield Site(label, f"sensor.{label}", (f"{shaft}.speed_rpm",))


# -- probes in the gas path


@dataclass(frozen=True)
class ProbeReading:
    """A sensor that shows the total temperature or pressure of `stations`, by their weight in the mean."""

    column: str
    quantity: str
    stations: Mapping[str, float]

    @property
    def site(self) -> Site:
        return Site(self.quantity, f"sensor.{self.quantity}", (f"reading {self.column}",))


def readings(network: Network, what: str) -> Iterator[ProbeReading]:
    """Sensors of temperature ("T") or pressure ("P"): of one station or the mean of several, not a difference, a
    ratio or a share of them."""
    assert network.design_point is not None
    for sensor in network.sensors.values():
        if sensor.denominator:
            continue
        stations: dict[str, float] = {}
        for column, weight in sensor.reads.items():
            match = STATION_COLUMN.fullmatch(column)
            if match and match["what"] == what and match["station"] in network.design_point.flows and weight > 0.0:
                stations[match["station"]] = weight
        if len(stations) == len(sensor.reads) and abs(sum(stations.values()) - 1.0) < 1e-9:
            yield ProbeReading(sensor.column, sensor.quantity, stations)


def hot_readings(network: Network) -> Iterator[ProbeReading]:
    """Temperature sensors in burnt gas."""
    return (r for r in readings(network, "T") if all(is_hot(network, s) for s in r.stations))


class ProbeTerm(Term):
    """What a probe of temperature ("T") or pressure ("P") reads instead of the mean of its stations."""

    QUANTITY: ClassVar[str] = "T"

    def probes(self, network: Network) -> Iterable[ProbeReading]:
        return readings(network, self.QUANTITY)

    def sites(self, network: Network) -> Iterable[Site]:
        return (r.site for r in self.probes(network))

    @abstractmethod
    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        """What the probe reads, by what it should read."""

    def install(self, at: Place) -> None:
        probe = next(r for r in readings(at.network, self.QUANTITY) if r.quantity == at.site.name)
        at.change_reading(probe.column, self.reading(at, probe))


DESIGN_MACH = shape_coefficient(
    "design_mach", "1", "Mach number at the probe at the design point", value=0.35, lower=0.05, upper=0.8, sigma=0.1
)


class PressureProbeRecovery(ProbeTerm):
    """Reading P (1 − k M²), M = M_design x at the probe's station."""

    NAME = "pressure_probe_recovery"
    TITLE = "Recovery error of a pressure probe"
    STATEMENT = (
        "A pressure probe at an angle to the flow or behind a wake catches only part of the dynamic pressure "
        "and reads low, the more the faster the gas passes it."
    )
    EQUATION = "reading = P (1 − k M²),  M = M_design (W√T/P)/(W√T/P)_design"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (Coefficient("loss", "1", "loss k per M²", upper=0.1, sigma=0.02, typical=0.02), DESIGN_MACH)
    REFERENCE = "Engineering judgement: k 0.005 to 0.03, assumed"
    QUANTITY = "P"

    def probes(self, network: Network) -> Iterable[ProbeReading]:
        return (r for r in readings(network, "P") if len(r.stations) == 1)

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        relative = relative_flow(at, next(iter(probe.stations)))

        def reading(e: Evaluation, P_read: Value) -> Value:
            mach = at.c(e, "design_mach") * relative(e)
            return P_read * (1.0 - at.c(e, "loss") * (mach * mach))

        return reading


class ThermocoupleRecovery(ProbeTerm):
    """Reading T − (1 − r)(T − T_s); T − T_s = T m/(1 + m), m = (γ − 1)/2 M², M = M_design x at the probe's station."""

    NAME = "thermocouple_recovery"
    TITLE = "Recovery error of a temperature probe"
    STATEMENT = (
        "A probe in fast gas does not bring it fully to rest and reads below the total temperature, by a "
        "share of the gas's dynamic temperature."
    )
    EQUATION = "reading = T − d T m/(1 + m),  m = (γ − 1)/2 M²,  M = M_design (W√T/P)/(W√T/P)_design"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient(
            "deficit",
            "1",
            "d = 1 − r, share of the dynamic temperature that is lost",
            upper=0.25,
            sigma=0.05,
            typical=0.05,
        ),
        DESIGN_MACH,
    )
    REFERENCE = "SAE AIR46 (r 0.80 to 0.98); J. Eng. Power 75 (1) 7, ASME"

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        relative = {s: relative_flow(at, s) for s in probe.stations}

        def reading(e: Evaluation, T_read: Value) -> Value:
            lost: Value = 0.0
            for station, weight in probe.stations.items():
                flow = e.flows[station]
                mach = at.c(e, "design_mach") * relative[station](e)
                cp, R = flow.gas.heat_capacity(flow.T, flow.mixture), flow.R
                m = 0.5 * R / (cp - R) * (mach * mach)
                lost = lost + weight * flow.T * m / (1.0 + m)
            return T_read - at.c(e, "deficit") * lost

        return reading


class ThermocoupleRadiation(ProbeTerm):
    """Reading T − εσ(T⁴ − T_w⁴)/h with walls at a fixed share of the gas temperature and h ∝ W^0.5, by the error
    at the design point: a (T/T_design)⁴ (W/W_design)^(−0.5)."""

    NAME = "thermocouple_radiation"
    TITLE = "Radiation error of a thermocouple"
    STATEMENT = (
        "A thermocouple in hot gas radiates to the cooler walls and reads low: with the fourth power of "
        "temperature, and more where little gas flows past it."
    )
    EQUATION = "reading = T − a (T/T_design)^4 (W/W_design)^(−0.5),  from ε σ (T^4 − T_w^4)/h, T_w ∝ T, h ∝ W^0.5"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (Coefficient("error_K", "K", "error a at the design point", upper=30.0, sigma=5.0, typical=5.0),)
    REFERENCE = (
        "SAE AIR46; 2 to 15 K at 900 to 1000 K computed for ε 0.3 to 0.8 and h 1000 to 2000 W/(m² K); "
        "wall temperature assumed"
    )

    def probes(self, network: Network) -> Iterable[ProbeReading]:
        return hot_readings(network)

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        reference = {s: scalar(_radiation(at.design.flows[s])) for s in probe.stations}

        def reading(e: Evaluation, T_read: Value) -> Value:
            lost: Value = 0.0
            for station, weight in probe.stations.items():
                lost = lost + _radiation(e.flows[station]) * (weight / reference[station])
            return T_read - at.c(e, "error_K") * lost

        return reading


def _radiation(flow: Flow) -> Value:
    """T⁴/√W."""
    square = flow.T * flow.T
    return square * square / sqrt(flow.W)


class EgtProfile(ProbeTerm):
    """Reading T + k [(T₄ − T₃) − (T₄ − T₃)_design]: the probes are in a hot or cold streak of the burner's rise."""

    NAME = "egt_profile"
    TITLE = "Temperature profile at the exhaust-gas probes"
    STATEMENT = (
        "The probes of the exhaust-gas temperature do not read the mean of the gas: hot and cold streaks "
        "behind the burner shift the reading in proportion to its temperature rise."
    )
    EQUATION = "reading = T + k [(T_4 − T_3) − (T_4 − T_3)_design]"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (
        Coefficient(
            "factor",
            "1",
            "shift k over the burner's temperature rise",
            lower=-0.04,
            upper=0.04,
            sigma=0.01,
            typical=0.01,
        ),
    )
    REFERENCE = "Engineering judgement: ± 0.005 to 0.03 of T4 − T3, assumed"

    def probes(self, network: Network) -> Iterable[ProbeReading]:
        exit_station = burners(network)[0].values["to"]
        return (r for r in hot_readings(network) if exit_station not in r.stations)

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        values = burners(at.network)[0].values
        before, behind = values["from"], values["to"]
        reference = scalar(at.design.flows[behind].T - at.design.flows[before].T)

        def reading(e: Evaluation, T_read: Value) -> Value:
            return T_read + at.c(e, "factor") * (e.flows[behind].T - e.flows[before].T - reference)

        return reading


EXPONENT = 0.22  # T/T_exhaust = (P/p₀)^n, n = η_p (γ − 1)/γ of burnt gas
SETTING = "T4_K"


class ComputedReading(ProbeTerm):
    """Reading T (p₀/p₀,design)^(n κ), n = 0.22: a temperature that was computed from another through the turbine's
    expansion, with the design's ambient pressure at its end. κ = 1: it ignores ambient pressure altogether. A power
    setting T₄ that is recorded so is corrected before the model meets it."""

    NAME = "computed_reading"
    TITLE = "Reading computed without ambient pressure"
    STATEMENT = (
        "The temperature is no measurement: the control computes it from exhaust temperature and compressor "
        "pressure and leaves ambient pressure out, so it is wrong when the barometer is high or low."
    )
    EQUATION = "reading = T (p_0/p_0,design)^(0.22 κ)"
    DRIVER = AMBIENT_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "ignored",
            "1",
            "share κ of the ambient pressure's effect that the computation leaves out",
            upper=1.5,
            sigma=0.5,
            typical=0.9,
        ),
    )
    REFERENCE = (
        "Found in the power-plant recordings of UCI repository no. 551: turbine inlet temperature low by "
        "300 K κ ln(p_0/1013 hPa), κ 0.9 to 1.1; polytropic expansion, n assumed"
    )

    def probes(self, network: Network) -> Iterable[ProbeReading]:
        return hot_readings(network)

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            return
        yield from super().sites(network)
        if network.power_setting == SETTING:
            yield Site("T4", "sensor.T4", (SETTING,))

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        return lambda e, T_read: T_read * self._ratio(at, e, 1.0)

    def install(self, at: Place) -> None:
        if at.site.targets == (SETTING,):
            at.change_leaf(SETTING, lambda e, recorded: recorded * self._ratio(at, e, -1.0))
        else:
            super().install(at)

    def _ratio(self, at: Place, e: Evaluation, sign: float) -> Value:
        reference = scalar(at.design.outputs["P0_Pa"])
        return exp(at.c(e, "ignored") * (log(e.outputs["P0_Pa"] * (1.0 / reference)) * (sign * EXPONENT)))


# -- what comes late


class ProbeLag(ProbeTerm):
    """τ dT_read/dt = T − T_read."""

    NAME = "probe_lag"
    TITLE = "Lag of a temperature probe"
    STATEMENT = (
        "A probe warms and cools with its own time constant: what it reads is behind the gas while that changes."
    )
    EQUATION = "τ dT_read/dt = T − T_read"
    DRIVER = RATE
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", upper=300.0, sigma=30.0, typical=4.0),)
    REFERENCE = "SAE AIR46: 0.5 to 10 s for shielded thermocouples in gas streams; the range is assumed"
    INPUTS = UNKNOWN_PAST
    TRIALS = tuple({"time_constant": t} for t in (1.0, 4.0, 16.0))

    def reading(self, at: Place, probe: ProbeReading) -> ValueHook:
        behind = at.add_memory(Lag(), ("time_constant",), sensor=probe.column)
        return lambda e, T_read: T_read + behind(e, T_read)


class ClockShift(Term):
    """reading(t) = value(t − d)."""

    NAME = "clock_shift"
    TITLE = "Clock of a reading"
    STATEMENT = (
        "A reading that is written down later than the others, or that another box stamps by a clock of its own, shows "
        "what was some time ago; a clock that is behind shows what the others have yet to show."
    )
    EQUATION = "reading(t) = value(t − d)"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "delay", "s", "d; negative: it is ahead of the others", lower=-60.0, upper=60.0, sigma=10.0, typical=1.0
        ),
    )
    REFERENCE = "the commonest mismatch of recordings that several boxes make; the range is assumed"
    INPUTS = UNKNOWN_PAST

    def sites(self, network: Network) -> Iterable[Site]:
        for s in network.sensors.values():
            yield Site(s.quantity, f"sensor.{s.quantity}", (f"reading {s.column}",))

    def install(self, at: Place) -> None:
        column = next(s.column for s in at.network.sensors.values() if s.quantity == at.site.name)
        shift = at.add_memory(Delay(), ("delay",), sensor=column)
        at.change_reading(column, lambda e, x: x + shift(e, x))
