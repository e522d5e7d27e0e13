"""Every physics term that remembers the past: what it does after a step, by one fact each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from term_makers import shipped

from enginediag_cli.engine.controls import RecordedPosition
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.registry import effect, term, term_names

BEFORE, AFTER, RECORDS = 20, 3, 400  # records of 1 s before a step of power, behind it, and in all
LOW, HIGH = 0.5, 0.8  # fractions of the power range


ON_A_RAMP = {"rotor_inertia": 1, "bleed_valve_hysteresis": 3}
"""What shows on the way only, records before its end: a speed cannot step, and a valve closes once it is passed."""


@dataclass(frozen=True)
class Fact:
    """AFTER records behind a step up of power the term moves `column` by `sign` from where it is in the steady state;
    in the end it is there."""

    statement: str
    engine: str
    site: str
    column: str
    sign: int
    values: dict[str, float]


TERMS = {
    "load_rate_limit": Fact(
        "the load rises on a ramp", "micro_gas_turbine", "generator", "power_W", -1, {"rise": 100.0, "fall": 100.0}
    ),
    "load_control_lag": Fact(
        "the load is behind", "micro_gas_turbine", "generator", "power_W", -1, {"time_constant": 20.0}
    ),
    "load_second_order_lag": Fact(
        "the load is behind",
        "micro_gas_turbine",
        "generator",
        "power_W",
        -1,
        {"time_constant": 15.0, "second_share": 0.3},
    ),
    "load_control_delay": Fact("the load is late", "micro_gas_turbine", "generator", "power_W", -1, {"delay": 7.0}),
    "fuel_control_lag": Fact("less fuel as yet: cooler", "turbojet", "burner", "T5_K", -1, {"time_constant": 5.0}),
    "fuel_rate_limit": Fact(
        "less fuel as yet: slower", "turbojet", "burner", "N1_rpm", -1, {"rise": 60.0, "fall": 60.0}
    ),
    "probe_lag": Fact("a probe is cooler than the gas", "turbojet", "T5", "T5_K", -1, {"time_constant": 6.0}),
    "heat_soak": Fact(
        "gas that warms the turbine leaves it cooler",
        "turbojet",
        "turbine",
        "T5_K",
        -1,
        {"exchange": 0.02, "time_constant": 40.0},
    ),
    "clock_shift": Fact("a late reading shows what was", "turbojet", "P3", "P3_Pa", -1, {"delay": 8.0}),
    "clearance_transient": Fact(
        "discs that are still cold leave the gap wide: hotter",
        "turbojet",
        "turbine",
        "T5_K",
        +1,
        {"loss": 0.03, "time_constant": 60.0},
    ),
    "bleed_valve_hysteresis": Fact(
        "a valve that is still open leaves less air to the turbine: hotter",
        "turbojet",
        "compressor",
        "T5_K",
        +1,
        {"fraction": 0.01, "open_below": 0.93, "band": 0.03},
    ),
    "actuator_rate_limit": Fact(
        "the afterburner's fuel is behind",
        "afterburning_turbofan",
        "afterburner_fuel",
        "Fn_N",
        -1,
        {"rise": 30.0, "fall": 30.0},
    ),
    "rotor_inertia": Fact("speeding up takes fuel", "citation_jt15d", "hp", "Wf_kg_s", +1, {"inertia": 0.1}),
}


def step(engine, ramp=0.0):
    """Inputs of a recording with a step of power, or a ramp of so many seconds that ends AFTER records behind."""
    time = np.arange(float(RECORDS))
    end = BEFORE + AFTER
    fraction = np.interp(time, [end - max(ramp, AFTER + 1e-3), end - AFTER if not ramp else end], [LOW, HIGH])
    columns = {c: np.full(RECORDS, 0.5 * sum(engine.envelope[c])) for c in engine.inputs if c in engine.envelope}
    if "mach" in columns:
        columns |= {"altitude_m": np.zeros(RECORDS), "mach": np.full(RECORDS, 0.1), "dT_isa_K": np.zeros(RECORDS)}
    for position in (c.column for c in engine.network.controls if isinstance(c, RecordedPosition)):
        low, high = engine.envelope[position]
        columns[position] = low + (high - low) * fraction
    columns[engine.power_setting] = engine.power_from_fraction(fraction, columns)
    return {"time_s": time, **columns}


@pytest.mark.parametrize("name", TERMS)
def test_after_a_step_the_effect_has_the_direction_that_physics_gives_it_and_fades(name):
    fact = TERMS[name]
    plain = shipped(fact.engine)
    engine = plain.replace_effects([*plain.effects, effect(plain, name, fact.site, fact.values)])
    columns = step(engine, ramp=10.0 if name in ON_A_RAMP else 0.0)
    inputs = {c: v for c, v in columns.items() if c in engine.inputs}
    steady = engine.predict(inputs, sensors=(fact.column,)).y[:, 0]
    moved = engine.predict({**inputs, MOMENT: engine.tapes.add(columns)}, sensors=(fact.column,)).y[:, 0]
    change = (moved - steady) / np.ptp(steady)
    at = BEFORE + AFTER - ON_A_RAMP.get(name, 0)
    assert fact.sign * change[at] > 1e-3, f"{fact.statement}: {change[at]}"
    assert abs(change[-1]) < 1e-3


def test_every_term_with_memory_has_a_fact():
    assert set(TERMS) == {n for n in term_names() if MOMENT in term(n).INPUTS}
