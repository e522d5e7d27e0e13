"""Every engine that comes with the project runs, closes its balances and answers in the right direction."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine import solver
from enginediag_cli.engine.controls import SetPointControl
from enginediag_cli.engine.dual import value
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
NAMES = [path.stem for path in CONFIGS]
POINTS = 400

every_engine = pytest.mark.parametrize("path", CONFIGS, ids=NAMES)


@cache
def engine_of(path, power_setting=None):
    return load_engine(path, power_setting=power_setting)


def random_points(engine, n, seed, power=(0.3, 1.0)):
    """Inputs (n,) uniform over the envelope of the engine file, power setting over its corrected range."""
    rng = np.random.default_rng(seed)
    U = {c: rng.uniform(*engine.envelope[c], n) for c in engine.inputs if c != engine.power_setting}
    U[engine.power_setting] = engine.power_from_fraction(rng.uniform(*power, n), U)
    return U


def design_inputs(engine):
    """Conditions of the design point (1,), given speeds included, the power setting left out."""
    design, shafts = engine.declared["design"], engine.network.shafts
    U = {c: np.array([design[c]]) for c in (*engine.inputs, *engine.optional_inputs) if c in design}
    U |= {
        c: np.array([shafts[name]["design_speed_rpm"]])
        for c, name in engine.network.speed_columns.items()
        if shafts[name]["speed"] == "input"
    }
    # what else is recorded (an afterburner's fuel) stands at nothing there
    return {**{c: np.array([0.0]) for c in engine.inputs if c != engine.power_setting}, **U}


def middle(engine):
    """One point (1,) at the middle of the envelope and 80 % of the power range."""
    U = {c: np.array([np.mean(r)]) for c, r in engine.envelope.items() if c in engine.inputs}
    U[engine.power_setting] = engine.power_from_fraction(np.array([0.8]), U)
    return U


def evaluated(engine, U):
    """The whole network at solved points, for sums over all flows."""
    p = engine.predict(U)
    points = {**{c: np.asarray(d) for c, d in engine.optional_inputs.items()}, **U}
    points = {c: np.broadcast_to(v, p.status.shape) for c, v in points.items()}
    nominal = {n: q.nominal for n, q in engine.parameters.items()}
    demand = engine.network.demand
    if demand is not None:
        points[engine.network.power_setting] = demand(points[demand.column], nominal)[0]
    return p, solver.evaluate(engine.network, points, nominal, p.x, frozenset())


def exits_of(engine, e):
    """All flows that leave the engine: nozzles, exhaust, and bleeds that no component receives."""
    ends = [c for c in engine.network.components if c.TYPE in ("nozzle", "condi_nozzle", "exhaust")]
    return [*(e.flows[c.values["from"]] for c in ends), *e.bleeds.values()]


def inlet_flow(engine, e):
    return e.flows[next(c for c in engine.network.components if c.TYPE == "inlet").values["to"]]


def burner_of(engine):
    return next(c for c in engine.network.components if c.TYPE == "burner")


def fuels_of(engine):
    """Columns of fuel flow and the keys of what burns it."""
    burner = burner_of(engine)
    lit = [c for c in engine.network.components if c.TYPE == "afterburner"]
    return [("Wf_kg_s", burner.values), *((f"{c.name}_fuel_kg_s", c.values) for c in lit)]


def compressor_before_burner(engine):
    return [c for c in engine.network.components if c.TYPE == "compressor"][-1].name


def test_the_five_engines_of_the_project_are_there():
    assert {"turbofan", "turbojet", "citation_jt15d", "naval_gas_generator", "power_plant"} <= set(NAMES)


@every_engine
def test_the_file_opens_with_what_engine_it_is_and_with_its_sources(path):
    engine = engine_of(path)
    assert engine.description and engine.declared["sources"]
    assert path.read_text(encoding="utf-8").startswith("# ")


@every_engine
def test_the_design_point_is_reproduced_exactly(path):
    """Given the design point's T4, every unknown comes out as what the components were sized with."""
    engine = engine_of(path, "T4_K")
    if engine.network.governor is not None:
        pytest.skip("its fuel control holds something else than T4")
    U = design_inputs(engine)
    U["T4_K"] = np.array([burner_of(engine).values["exit_temperature_K"]])
    p = engine.predict(U, start=np.full((len(engine.unknowns), 1), 1.02))
    sized = {u.name: u.start for c in engine.network.components for u in c.unknowns()}
    for stops in (c.stops for c in engine.network.controls if isinstance(c, SetPointControl)):
        at = engine.network.neutral[stops.actuator.name]
        sized[stops.unknown] = 1.0 + (at - stops.low) / (stops.high - stops.low)
    assert p.status[0] == 0
    for k, unknown in enumerate(engine.unknowns):
        assert p.x[k, 0] == pytest.approx(sized.get(unknown.name, 1.0), abs=1e-8), unknown.name


@every_engine
def test_nearly_every_point_of_the_envelope_converges_from_30_percent_power(path):
    engine = engine_of(path)
    p = engine.predict(random_points(engine, 2000, seed=1))
    assert p.ok.mean() >= 0.995, {p.reason(k) for k in np.flatnonzero(~p.ok)}
    assert np.isfinite(p.y[p.ok]).all()


@every_engine
def test_mass_is_conserved(path):
    engine = engine_of(path)
    p, e = evaluated(engine, random_points(engine, POINTS, seed=2))
    leaving = sum(x.W for x in exits_of(engine, e))
    fuel = e.outputs.get("Wf_total_kg_s", e.outputs["Wf_kg_s"])
    balance = value(inlet_flow(engine, e).W + fuel) / value(leaving) - 1.0
    assert np.abs(balance[p.ok]).max() < 1e-9


@every_engine
def test_energy_is_conserved_between_inlet_fuel_exits_and_shafts(path):
    """W h + W_f η LHV = Σ W h of all exits + power that leaves the shafts."""
    engine = engine_of(path)
    p, e = evaluated(engine, random_points(engine, POINTS, seed=3))
    entering = inlet_flow(engine, e)
    heat = sum(
        e.outputs[column] * (v["lower_heating_value_J_kg"] * v["combustion_efficiency"])
        for column, v in fuels_of(engine)
    )
    leaving = sum(x.W * x.h for x in exits_of(engine, e))
    shafts = sum(s.supply_W - s.demand_W for s in e.shafts.values())
    balance = value(entering.W * entering.h + heat - leaving - shafts) / value(heat)
    assert np.abs(balance[p.ok]).max() < 1e-9


@every_engine
def test_shaft_power_balances_close(path):
    engine = engine_of(path)
    p, e = evaluated(engine, random_points(engine, POINTS, seed=4))
    for name, shaft in e.shafts.items():
        if name not in engine.network.coupling.balanced:  # a load takes what is left, or a gearbox what is needed
            continue
        wanted = value(shaft.demand_W + shaft.load_W + engine.parameters[f"{name}.power_offtake_W"].nominal)
        given = value(shaft.supply_W) * engine.parameters[f"{name}.mechanical_efficiency"].nominal
        assert np.abs(given / wanted - 1.0)[p.ok].max() < 1e-8, name


@every_engine
def test_more_fuel_makes_the_engine_hotter_faster_and_stronger(path):
    given = engine_of(path)
    if given.network.governor is not None:
        pytest.skip("its fuel control holds something else than fuel")
    fuel = given.predict(middle(given), sensors=["Wf_kg_s"]).y[0, 0]
    engine = engine_of(path, "Wf_kg_s")
    shafts = engine.network.shafts
    # a propeller's governor holds its speed; shafts with a compressor run up
    turned = {c.values["shaft"] for c in engine.network.components if c.TYPE == "compressor"}
    following = [c for c, name in engine.network.speed_columns.items() if shafts[name]["speed"] == "balance"]
    speeds = [c for c in following if engine.network.speed_columns[c] in turned]
    outputs = ["T4_K", "T5_K", "P3_Pa", *speeds]
    e = evaluated(engine, {**middle(given), "Wf_kg_s": np.array([fuel])})[1]
    outputs += [c for c in ("Fn_N", "power_W") if c in e.outputs]
    y = engine.predict({**middle(given), "Wf_kg_s": np.array([fuel, 1.02 * fuel])}, sensors=outputs).y
    assert (y[1] > y[0]).all(), dict(zip(outputs, y[1] - y[0], strict=True))


@every_engine
def test_a_worse_compressor_makes_the_exhaust_hotter_at_the_same_fuel_flow(path):
    given = engine_of(path)
    fuel = given.predict(middle(given), sensors=["Wf_kg_s"]).y[0, 0]
    engine = engine_of(path, "Wf_kg_s")
    U = {**middle(given), "Wf_kg_s": np.array([fuel])}
    parameter = f"{compressor_before_burner(engine)}.efficiency"
    y = engine.predict(U, {parameter: np.array([1.0, 0.99])}, sensors=["T4_K", "T5_K"]).y
    assert (y[1] > y[0]).all()


@every_engine
def test_a_worse_turbine_makes_the_exhaust_hotter_at_the_same_fuel_flow(path):
    given = engine_of(path)
    fuel = given.predict(middle(given), sensors=["Wf_kg_s"]).y[0, 0]
    engine = engine_of(path, "Wf_kg_s")
    turbine = next(c.name for c in engine.network.components if c.TYPE == "turbine")
    U = {**middle(given), "Wf_kg_s": np.array([fuel])}
    y = engine.predict(U, {f"{turbine}.efficiency": np.array([1.0, 0.99])}, sensors=["T5_K"]).y
    assert y[1, 0] > y[0, 0]


def test_the_turbojet_has_the_published_thrust_and_fuel_consumption_of_its_class():
    """CJ610-4 at take-off: 2,850 lbf = 12.7 kN at 0.99 lb/lbf h = 28.0 mg/(N s), 20 kg/s."""
    engine = engine_of(next(p for p in CONFIGS if p.stem == "turbojet"), "T4_K")
    U = {**design_inputs(engine), "T4_K": burner_of(engine).values["exit_temperature_K"]}
    thrust, fuel = engine.predict(U, sensors=["Fn_N", "Wf_kg_s"]).y[0]
    assert thrust == pytest.approx(12.7e3, rel=0.03)
    assert fuel / thrust == pytest.approx(28.0e-6, rel=0.03)


def test_the_naval_engine_is_of_lm2500_class():
    engine = engine_of(next(p for p in CONFIGS if p.stem == "naval_gas_generator"), "T4_K")
    U = {**design_inputs(engine), "T4_K": burner_of(engine).values["exit_temperature_K"]}
    power, fuel = engine.predict(U, sensors=["power_W", "Wf_kg_s"]).y[0]
    heat = fuel * burner_of(engine).values["lower_heating_value_J_kg"]
    assert 20e6 < power < 25e6
    assert 0.34 < power / heat < 0.39


def test_the_power_plant_keeps_its_speed_and_loses_power_on_a_hot_day():
    engine = engine_of(next(p for p in CONFIGS if p.stem == "power_plant"))
    U = {**design_inputs(engine), "ambient_temperature_K": np.array([283.0, 303.0]), "T4_K": 1373.0}
    y = engine.predict(U, sensors=["N1_rpm", "power_W", "P3_Pa", "T5_K"]).y
    assert (y[:, 0] == 3000.0).all()
    assert y[1, 1] < 0.93 * y[0, 1]
    assert y[1, 2] < y[0, 2] and y[1, 3] > y[0, 3]


def test_humid_air_lowers_the_power_of_the_power_plant_little():
    engine = engine_of(next(p for p in CONFIGS if p.stem == "power_plant"))
    U = {**design_inputs(engine), "T4_K": 1373.0, "humidity_kg_kg": np.array([0.0, 0.02])}
    power = engine.predict(U, sensors=["power_W"]).y[:, 0]
    assert 0.97 < power[1] / power[0] < 1.03


def test_a_propeller_of_cube_law_lets_the_power_turbine_find_its_speed(tmp_path):
    text = next(p for p in CONFIGS if p.stem == "naval_gas_generator").read_text(encoding="utf-8")
    text = text.replace("law: surplus", "law: cube").replace(", speed: input", "")
    path = tmp_path / "propeller.yaml"
    path.write_text("\n".join(line for line in text.splitlines() if "N2_rpm: {low" not in line), encoding="utf-8")
    engine = load_engine(path)
    fuel = np.array([0.6, 1.0, 1.436])
    y = engine.predict({**design_inputs(engine), "Wf_kg_s": fuel}, sensors=["N2_rpm", "power_W"]).y
    assert y[2, 0] == pytest.approx(3332, rel=1e-3)
    assert y[:, 1] / y[2, 1] == pytest.approx((y[:, 0] / y[2, 0]) ** 3, rel=1e-9)


@pytest.mark.parametrize(
    "engine_file, flight",
    [("power_plant", "power_plant"), ("naval_gas_generator", "naval"), ("turbojet", "business_jet")],
)
def test_the_flights_that_come_with_the_project_fly_with_their_engines(engine_file, flight):
    from enginediag_cli.config.validate import load_checked
    from enginediag_cli.simulation.flights import generate_flights

    engine = engine_of(next(p for p in CONFIGS if p.stem == engine_file))
    values = load_checked(CONFIGS[0].parent / "flights" / f"{flight}.yaml", "flight").values
    made = generate_flights(values, engine, np.random.default_rng(1), flights=2, records=500)
    p = engine.predict({c: made.columns[c] for c in engine.inputs})
    assert len(p.status) > 40
    assert p.ok.mean() >= 0.99
