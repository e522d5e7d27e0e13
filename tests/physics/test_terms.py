"""Every physics term at every site of the shipped engines: absent, differentiated, of the stated direction, solvable.

A new term needs one row in TERMS: a physical fact that it must show. Terms that remember the past have theirs in
`test_terms_with_memory.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from term_makers import COLUMN_RANGES, drawn, own_inputs, shipped

from enginediag_cli.drivers import DRIVERS
from enginediag_cli.engine import solver
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.physics.registry import candidate_effects, effect, term, term_names

STEADY = tuple(n for n in term_names() if MOMENT not in term(n).INPUTS)
ENGINES = (
    "turbofan",
    "citation_jt15d",
    "turbojet",
    "naval_gas_generator",
    "power_plant",
    "cmapss_turbofan",
    "micro_gas_turbine",
)
DIFFERENTIATED = {  # the last but one of ENGINES has the layout and the power setting of the second
    "absent": ENGINES[:5],
    "typical": ("turbofan", "turbojet", "naval_gas_generator", "power_plant"),
}
RECORDS = 24
STEPS = (0.1, 0.03)  # of an amplitude's typical size: rounding spoils the shorter, curvature the longer
CRITICAL_BAND = (1.79, 1.97)  # nozzle pressure ratios near choking, where Φ has a kink
CRUISE = {"altitude_m": 10500.0, "mach": 0.8}
IDLE = {"power": 0.15}
GROUND_IDLE = {"power": 0.15, "altitude_m": 0.0, "mach": 0.02}
LOW_BAROMETER = {"ambient_pressure_Pa": 98000.0}


@dataclass(frozen=True)
class Fact:
    """At its typical size the term at `site` moves `column` by `sign` at every record of the engine.

    `at`: conditions of all records, input columns or `power` as a fraction of the engine's range; `only`: the
    one coefficient that is not absent, by default all amplitudes; `given`: another power setting than the file's.
    """

    statement: str
    engine: str
    site: str
    column: str
    sign: int
    at: dict[str, float] = field(default_factory=dict)
    only: str | None = None
    given: str | None = None


TERMS = {
    "customer_bleed": Fact("cabin air raises T45 at given fuel", "turbofan", "hpc", "T45_K", +1),
    "power_offtake": Fact("a generator slows the core at given fuel", "turbofan", "hp", "N2_rpm", -1),
    "reynolds_efficiency": Fact("thin air costs HPC efficiency: T45 rises", "turbofan", "hpc", "T45_K", +1, CRUISE),
    # turbomachinery, bleeds and shafts
    "reynolds_turbine_efficiency": Fact(
        "thin gas costs HPT efficiency: T45 rises", "turbofan", "hpt", "T45_K", +1, CRUISE
    ),
    "reynolds_flow_capacity": Fact(
        "blocked passages make the core turn faster", "turbofan", "hpc", "N2_rpm", +1, CRUISE
    ),
    "humidity": Fact("water's heat capacity cools the gas at given fuel", "turbofan", "ambient", "T45_K", -1),
    "anti_ice_bleed": Fact("bleed raises T45 at given fuel", "turbofan", "hpc", "T45_K", +1),
    "handling_bleed": Fact(
        "air let out behind the booster raises T45 at low power", "turbofan", "booster", "T45_K", +1, IDLE
    ),
    "interstage_bleed": Fact("bleed raises T45 at given fuel", "turbofan", "hpc", "T45_K", +1),
    "guide_vanes": Fact("closed vanes make the core turn faster at low power", "turbofan", "hpc", "N2_rpm", +1, IDLE),
    "guide_vanes_load": Fact(
        "closed vanes lower the pressure at part load", "power_plant", "compressor", "P3_Pa", -1, {"power": 0.5}
    ),
    "turbine_tip_clearance": Fact("wide gaps at low speed raise T45", "turbofan", "hpt", "T45_K", +1, IDLE),
    "compressor_tip_clearance": Fact("wide gaps at low speed raise T45", "turbofan", "hpc", "T45_K", +1, IDLE),
    "active_clearance_control": Fact("the tight HPT lowers T45 in cruise", "turbofan", "hpt", "T45_K", -1, CRUISE),
    "cooling_flow_variation": Fact(
        "less cooling air at altitude leaves more to the burner: T4 falls at given fuel",
        "turbofan",
        "hpt",
        "T4_K",
        -1,
        CRUISE,
    ),
    "fan_split": Fact("a worse fan root at high bypass ratio lowers P25", "turbofan", "fan", "P25_Pa", -1, IDLE),
    "windage_loss": Fact("windage slows the core", "turbofan", "hp", "N2_rpm", -1),
    "bearing_loss": Fact("friction slows the core", "turbofan", "hp", "N2_rpm", -1),
    "fouling": Fact("a dirty compressor runs hotter", "turbofan", "hpc", "T45_K", +1, {"hours_since_wash_h": 1000.0}),
    # inlet, nozzles, burner, sensors
    "inlet_ram_recovery": Fact("ram lost in the inlet raises T45", "turbofan", "inlet", "T45_K", +1, CRUISE),
    "inlet_filter_loss": Fact("a dirty filter raises T45", "naval_gas_generator", "inlet", "T45_K", +1),
    "exhaust_back_pressure": Fact("a stack costs power", "power_plant", "exhaust", "power_W", -1),
    "nozzle_discharge": Fact("an unchoked nozzle dams up P5", "turbojet", "nozzle", "P5_Pa", +1, GROUND_IDLE),
    "nozzle_velocity": Fact("an unchoked nozzle gives less thrust", "turbojet", "nozzle", "Fn_N", -1, GROUND_IDLE),
    "nozzle_thermal_growth": Fact("a cool nozzle closes: P5 rises", "turbojet", "nozzle", "P5_Pa", +1, GROUND_IDLE),
    "combustion_efficiency": Fact("unburnt fuel cools T45 at altitude", "turbofan", "burner", "T45_K", -1, CRUISE),
    "burner_pressure_loss": Fact("at idle it loses more: P3 is dammed up", "turbofan", "burner", "P3_Pa", +1, IDLE),
    "burner_heating_loss": Fact("less heating, less loss: P5 rises", "turbofan", "burner", "P5_Pa", +1, GROUND_IDLE),
    "duct_pressure_loss": Fact("less flow, less loss: thrust", "turbofan", "bypass_duct", "Fn_N", +1, GROUND_IDLE),
    "fuel_heating_value": Fact("richer fuel is hotter at given flow", "turbofan", "burner", "T45_K", +1),
    "thermocouple_recovery": Fact("a probe in fast gas reads low", "turbofan", "T45", "T45_K", -1),
    "thermocouple_radiation": Fact("a probe before cool walls reads low", "turbofan", "T45", "T45_K", -1),
    "egt_profile": Fact("probes in a hot streak read low at idle", "turbofan", "T45", "T45_K", -1, IDLE),
    "pressure_probe_recovery": Fact("a probe at an angle reads low", "turbofan", "P3", "P3_Pa", -1),
    "tat_probe_heating": Fact("the air is colder than recorded", "turbofan", "ambient", "T25_K", -1),
    "fuel_meter_scale": Fact("a meter that reads high feeds less", "turbofan", "Wf", "T45_K", -1),
    "speed_scale": Fact("a speed that reads high burns less", "citation_jt15d", "N1", "Wf_kg_s", -1),
    "ambient_pressure_scale": Fact("thinner air than recorded", "power_plant", "ambient", "P3_Pa", -1),
    "static_pressure_error": Fact("a static port that reads high", "turbofan", "ambient", "P0_Pa", -1, CRUISE),
    "computed_reading": Fact("low barometer: T4 is above its reading", "power_plant", "T4", "T5_K", +1, LOW_BAROMETER),
}


@pytest.fixture(autouse=True)
def tightly_solved(monkeypatch):
    """Solves go to rounding, so that differences of them are not differences of their tolerance."""
    monkeypatch.setattr(solver, "TOLERANCE", 3e-13)


def at_site(engine, name, site):
    return engine.replace_effects([effect(engine, name, site)])


@cache
def records(name):
    """Records of a shipped engine that it solves, away from choking nozzles, with their unknowns."""
    engine = shipped(name)
    everything = engine.replace_effects([*engine.effects, *candidate_effects(engine)])
    U = drawn(everything, 5 * RECORDS, seed=7)
    nozzles = [c for c in engine.model_columns if c.endswith("nozzle_pressure_ratio")]
    own = {c: v for c, v in U.items() if c in (*engine.inputs, *engine.optional_inputs)}
    p = engine.predict(own, sensors=nozzles)
    away = ((p.y < CRITICAL_BAND[0]) | (p.y > CRITICAL_BAND[1])).all(axis=1)
    use = np.flatnonzero(p.ok & away)[:RECORDS]
    assert len(use) == RECORDS
    return {c: v[use] for c, v in U.items()}, p.x[:, use]


def effects_of(engine, name):
    return [Effect(term(name), site, {}) for site in term(name).sites(engine.network)]


def columns_of(engine):
    """All sensors and some columns behind which nothing of the gas path hides."""
    more = ("T3_K", "P3_Pa", "T4_K", "T5_K", "P5_Pa", "W2_kg_s", "Wf_kg_s", "BPR", "Fn_N", "power_W")
    return (*engine.sensors, *(c for c in more if c in engine.model_columns and c not in engine.sensors))


def repeated(U, x, times):
    return {c: np.tile(v, times) for c, v in U.items()}, np.tile(x, times)


def stencil(at, c, h):
    """Offsets and weights of df/dt at t = 0, error O(h⁴), on the side where the coefficient may lie."""
    if at - 2 * h < c.lower:
        return np.arange(5) * h, np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12 * h)
    if at + 2 * h > c.upper:
        return np.arange(5) * -h, np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (-12 * h)
    return np.array([-2.0, -1.0, 1.0, 2.0, 0.0]) * h, np.array([1.0, -8.0, 8.0, -1.0, 0.0]) / (12 * h)


# (1) absent


@pytest.mark.parametrize("name", ENGINES)
def test_effects_that_are_absent_leave_the_model_unchanged_to_the_last_digit(name):
    engine = shipped(name)
    U, x = records(name)
    carrying = engine.replace_effects([*engine.effects, *candidate_effects(engine)])
    assert carrying.effects
    plain = engine.predict(own_inputs(engine, U), sensors=columns_of(engine), wrt=engine.monitored, start=x)
    absent = carrying.predict(U, sensors=columns_of(engine), wrt=engine.monitored, start=x)
    assert np.array_equal(plain.y, absent.y) and np.array_equal(plain.jacobian, absent.jacobian)


# (2) derivatives


@pytest.mark.parametrize("size", ["absent", "typical"])
@pytest.mark.parametrize("name", term_names())
def test_derivatives_match_differences_of_full_solves(name, size):
    for engine_name in DIFFERENTIATED[size]:
        effects = effects_of(shipped(engine_name), name)
        if effects:
            derivatives_match(engine_name, effects, size)


def derivatives_match(engine_name, effects, size):
    plain = shipped(engine_name)
    engine = plain.replace_effects([*plain.effects, *effects])
    U, x = records(engine_name)
    U = own_inputs(engine, U)
    columns = columns_of(engine)
    for e in effects:
        start_values = {e.parameter_name(c.name): getattr(c, size) for c in e.term.amplitudes()}
        base = engine.predict(U, start_values, sensors=columns, wrt=e.amplitudes, start=x)
        assert base.ok.all(), f"{engine_name}, {e.label}: {base.reason(int(np.argmin(base.ok)))}"
        away = away_from_choking(engine, U, start_values, base.x)
        for k, c in enumerate(e.term.amplitudes()):
            name_of = e.parameter_name(c.name)
            error = np.inf
            for h in (step * abs(c.typical) for step in STEPS):
                offsets, weights = stencil(start_values[name_of], c, h)
                V, start = repeated(U, base.x, 5)
                moved = {**start_values, name_of: start_values[name_of] + np.repeat(offsets, RECORDS)}
                y = engine.predict(V, moved, sensors=columns, start=start).y.reshape(5, RECORDS, len(columns))
                numeric = np.tensordot(weights, y, axes=1)[away]
                error = np.minimum(error, np.abs(base.jacobian[away][:, :, k] - numeric).max(axis=0))
                # an entry that is zero but for rounding has no scale of its own: its column's value gives it one
                scale = np.maximum(np.abs(numeric).max(axis=0), 1e-4 * np.abs(base.y).max(axis=0) / abs(c.typical))
                if (error <= 1e-6 * scale).all():
                    break
            worst = int(np.argmax(error / scale))
            assert (error <= 1e-6 * scale).all(), (
                f"{engine_name}: {name_of} on {columns[worst]}: {(error / scale)[worst]:.1e}"
            )


def away_from_choking(engine, U, values, x):
    """Records (N,) whose nozzles are not near their critical pressure ratio with the effect either."""
    nozzles = [c for c in engine.model_columns if c.endswith("nozzle_pressure_ratio")]
    ratio = engine.predict(U, values, sensors=nozzles, start=x).y
    away = (np.abs(ratio - 1.88) > 0.04).all(axis=1)
    assert away.sum() > 0.6 * RECORDS
    return away


# (3) direction


@pytest.mark.parametrize("name", STEADY)
def test_the_effect_has_the_direction_that_physics_gives_it(name):
    fact = TERMS[name]
    plain = shipped(fact.engine, fact.given)
    engine = at_site(plain, name, fact.site)
    e = engine.effects[-1]
    if fact.given:  # no range of this power setting: the power that the file's own gives
        by_file = shipped(fact.engine)
        own = drawn(by_file, RECORDS, 11, fact.at)
        U = {**drawn_extra(engine, own), fact.given: by_file.predict(own, sensors=(fact.given,)).y[:, 0]}
    else:
        U = drawn(engine, RECORDS, 11, fact.at)
    values = {e.parameter_name(c.name): c.typical for c in e.term.amplitudes() if fact.only in (None, c.name)}
    without = engine.predict(U, sensors=(fact.column,))
    carried = engine.predict(U, values, sensors=(fact.column,), start=without.x)
    use = without.ok & carried.ok
    assert use.sum() >= 0.9 * RECORDS
    change = (carried.y - without.y)[use, 0]
    assert (fact.sign * change > 0.0).all(), f"{fact.statement}: {change}"


def drawn_extra(engine, own):
    """The inputs of `own` that this engine reads, and columns of its effects drawn beside them."""
    rng = np.random.default_rng(13)
    return {
        c: own[c] if c in own else rng.uniform(*COLUMN_RANGES.get(c, (0.0, 0.0)), RECORDS)
        for c in (*engine.inputs, *engine.optional_inputs)
        if c != engine.power_setting
    }


# (4) solvable


@pytest.mark.parametrize("engine_name", ENGINES)
def test_effects_of_typical_size_solve_over_the_envelope(engine_name):
    plain = shipped(engine_name)
    engine = plain.replace_effects([*plain.effects, *candidate_effects(plain)])
    U = drawn(engine, RECORDS, 17)
    own = plain.predict(own_inputs(plain, U))
    U = {c: v[own.ok] for c, v in U.items()}
    n = int(own.ok.sum())
    assert n >= 0.9 * RECORDS
    effects = [e for e in engine.effects if e not in plain.effects]
    # all effects in one batch, each in records of its own
    V, start = repeated(U, own.x[:, own.ok], len(effects))
    values = {}
    for k, e in enumerate(effects):
        for c in e.term.amplitudes():
            rows = np.full((len(effects), n), c.absent)
            rows[k] = c.typical
            values[e.parameter_name(c.name)] = rows.ravel()
    ok = engine.predict(V, values, start=start).ok.reshape(len(effects), n)
    failed = [f"{e.label} {int((~good).sum())} of {n}" for e, good in zip(effects, ok, strict=True) if not good.all()]
    assert not failed, ", ".join(failed)


# (5) words


@pytest.mark.parametrize("name", term_names())
def test_a_term_says_what_it_is(name):
    found = term(name)
    for words in (found.TITLE, found.STATEMENT, found.EQUATION, found.REFERENCE):
        assert words.strip() and "\n" not in words
    assert found.STATEMENT.rstrip().endswith(".") and len(found.STATEMENT.split()) >= 8
    assert any(ch.isdigit() for ch in found.REFERENCE) or "assumed" in found.REFERENCE
    assert found.DRIVER in DRIVERS
    assert found.amplitudes(), "nothing to search for"
    for c in found.COEFFICIENTS:
        assert c.unit and c.description
        assert c.lower <= c.absent <= c.upper and c.lower <= c.typical <= c.upper
        assert c.sigma > 0.0 and (c.shape or c.typical != c.absent)


@pytest.mark.parametrize("name", term_names())
def test_a_term_acts_where_it_says_it_does(name):
    sites = 0
    for engine_name in (*ENGINES, "afterburning_turbofan"):
        engine = shipped(engine_name)
        for e in effects_of(engine, name):
            sites += 1
            hooks = engine.network.replace_effects([e]).hooks
            unknowns = {u.name for u in engine.unknowns}  # a term may seek one in another scale: no change of the model
            acts_on = {*hooks.leaves} - unknowns | {
                *(f"station {s}" for s in hooks.stations),
                *(f"reading {c}" for c in hooks.readings),
                *(m.column for m in hooks.memories if m.column),
            }
            assert acts_on == set(e.site.targets), e.label
            assert all(leaf in known_leaves(engine) for leaf in hooks.leaves), e.label
    assert sites, f"no shipped engine has a place for {name}"


def known_leaves(engine):
    network = engine.network
    columns = {network.input_leaf(c) for c in (*engine.inputs, *engine.optional_inputs)}
    constant = {f"{s}.speed_rpm" for s, v in network.shafts.items() if v["speed"] == "constant"}
    return columns | constant | set(engine.parameters) | {u.name for u in engine.unknowns}


def test_every_row_names_a_term():
    assert set(TERMS) == set(STEADY)
