"""Engines flown along time: closed forms, balances, steady ends, batches, limits."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation, Hooks, Shaft
from enginediag_cli.engine.gas import Gas
from enginediag_cli.engine.transient import integrate as dense
from enginediag_cli.engine.transient import integrate as tableau
from enginediag_cli.engine.transient import moving_engine as collocation
from enginediag_cli.engine.transient.integrate import integrate, interpolate
from enginediag_cli.engine.transient.moving_engine import FlightSolution, MovingEngine
from enginediag_cli.engine.transient.states import (
    MovingNetwork,
    RotorState,
    TransientInputs,
    make_course,
    transient_states,
)
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[3] / "configs"
INERTIA = 6.0
BODIE = {"time": (0.0, 1.0, 1.5, 5.0, 5.5, 18.0), "power": (1.0, 1.0, 0.0, 0.0, 1.0, 1.0)}


@lru_cache
def turbojet(folder: Path, inertia: float = INERTIA) -> Engine:
    text = (CONFIGS / "turbojet.yaml").read_text(encoding="utf-8")
    old = "design_speed_rpm: 16500,"
    assert old in text
    place = folder / f"turbojet_{inertia:g}.yaml"
    place.write_text(text.replace(old, f"{old} inertia_kg_m2: {inertia},"), encoding="utf-8")
    return load_engine(place)


@lru_cache
def governed() -> MovingEngine:
    return MovingEngine(load_engine(CONFIGS / "turbofan_governed.yaml"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("engines")


def flight(engine: Engine, time, power, records=None, dT: float = 0.0, **more: float) -> TransientInputs:
    t = np.asarray(time, dtype=float)
    still = np.zeros(len(t))
    inputs = {"altitude_m": still, "mach": still, "dT_isa_K": still + dT}
    inputs[engine.power_setting] = engine.power_from_fraction(np.asarray(power, dtype=float), inputs)
    columns = {**inputs, **{name: still + v for name, v in more.items()}}
    return TransientInputs(t, columns, t if records is None else np.asarray(records, dtype=float))


def read(m: MovingEngine, f: TransientInputs, flown, also):
    """Columns (N, k) at a flight's records."""
    inputs = {c: np.interp(f.records, f.time, v) for c, v in f.columns.items()}
    return m.predict(inputs, {}, flown, sensors=tuple(also))


class ConstantPower:
    """A rotor to which a constant power is left over: I ω dω/dt = P."""

    hooks: Hooks
    derived: ClassVar[dict] = {}
    gas = Gas()
    power_W, supply_W, inertia, design_rpm = 2.0e4, 1.0e6, 3.0, 10_000.0

    def __init__(self):
        self.states = (RotorState("spool", self.inertia),)
        self.hooks = Hooks()
        self.rotors = {"spool": self.states[0]}
        self.states[0].install(self.hooks, self)

    def unknowns(self):
        from enginediag_cli.engine.components.base import Unknown

        return (Unknown("spool.corrected_speed", lower=0.05, upper=5.0),)

    def leaves(self, inputs, parameters, x):
        return {**parameters, **x, **inputs, "spool.power_offtake_W": 0.0}

    def evaluate(self, e: Evaluation) -> None:
        e.make_shaft = lambda e, name: Shaft(e["spool.corrected_speed"] * self.design_rpm)
        taken = e["spool.power_offtake_W"]
        e.balances["spool power"] = (self.power_W - taken) / self.supply_W

    power = MovingNetwork.power


def test_under_constant_power_the_square_of_the_speed_grows_in_proportion_to_time():
    n, t = ConstantPower(), np.array([0.0, 60.0])
    course = make_course([(t, {"nothing": np.zeros(2)})])
    omega = np.array([[0.5 * n.design_rpm * np.pi / 30.0]])
    track = integrate(n, course, {}, np.array([[0.5]]), omega, 1e-9)[0]
    records = np.linspace(0.0, 60.0, 31)
    found = interpolate(track, records, np.array([False]))[0][0] ** 2
    # the start is taken for steady, with no acceleration: one short step finds it
    since = found[1]
    assert found[1:] == pytest.approx(since + 2.0 * n.power_W / n.inertia * (records[1:] - records[1]), rel=1e-7)


def test_the_method_meets_its_conditions_of_order():
    A, b, c, d = tableau.STAGES, tableau.STAGES[-1], tableau.NODES, tableau.EMBEDDED
    assert np.allclose(A.sum(axis=1), c, atol=1e-15)
    assert np.allclose([b.sum(), b @ c, b @ c**2, b @ A @ c], [1, 1 / 2, 1 / 3, 1 / 6], atol=1e-14)
    assert np.allclose([d.sum(), d @ c], [1, 1 / 2], atol=1e-14)
    # L-stable: of dx/dt = z x nothing is left behind a step where z is large and negative
    for z, left in ((-1e3, 1e-2), (-1e8, 1e-7)):
        x = np.linalg.solve(np.eye(4) - z * A, np.ones(4))
        assert abs(x[-1]) < left


def test_an_engine_that_is_left_alone_ends_on_its_steady_solution(folder):
    engine = turbojet(folder)
    m, f = MovingEngine(engine), flight(engine, (0, 2, 3, 120), (0.1, 0.1, 0.9, 0.9))
    flown = m.fly([f])[0]
    steady = engine.predict({c: v[-1:] for c, v in f.columns.items()}, sensors=("N1_rpm", "T5_K", "P3_Pa"))
    end = read(m, f, flown, ("N1_rpm", "T5_K", "P3_Pa"))
    assert np.allclose(end.y[-1], steady.y[0], rtol=1e-6)
    assert np.allclose(end.y[0], engine.predict({c: v[:1] for c, v in f.columns.items()}, sensors=end.columns).y[0])


@pytest.mark.parametrize("name", ["turbojet", "governed turbofan"])
def test_energy_and_angular_momentum_balance_over_a_bodie_manoeuvre_at_default_options(folder, name):
    m = MovingEngine(turbojet(folder)) if name == "turbojet" else governed()
    f = flight(m.engine, **BODIE)
    track = m.tracks([f])[0]
    follows = np.array([s.follows for s in m.states])
    # from outside: powers of an engine whose speeds are given, by Gauss's quadrature between the ends of steps
    nodes, weights = np.polynomial.legendre.leggauss(5)
    h = np.diff(track.time)
    at = TransientInputs(
        f.time, f.columns, (np.array(track.time)[:-1, None] + h[:, None] * (1.0 + nodes) / 2.0).ravel()
    )
    states, x = interpolate(track, at.records, follows)
    flown = FlightSolution(np.vstack([states, np.full(states.shape[1], -1.0)]), x)
    for k, rotor in enumerate(m.network.rotors.values()):
        surplus = read(m, at, flown, (f"{rotor.shaft}_surplus_W",)).y[:, 0]
        omega, work = np.array(track.states)[:, k], np.array(track.work)[:, k]
        energy, momentum = 0.5 * rotor.inertia_kg_m2 * omega**2, rotor.inertia_kg_m2 * omega
        given = np.cumsum(surplus.reshape(-1, 5) @ weights * h / 2.0)
        torque = np.cumsum((surplus / states[k]).reshape(-1, 5) @ weights * h / 2.0)
        assert np.abs(given - (energy[1:] - energy[0])).max() < 1e-8 * np.ptp(energy)
        assert np.abs(torque - (momentum[1:] - momentum[0])).max() < 1e-8 * np.ptp(momentum)
        # and what the run itself has added up
        assert np.abs(work - (energy - energy[0])).max() < 2e-9 * np.ptp(energy)


@pytest.mark.slow
def test_the_tolerance_of_the_steps_is_not_that_of_the_run(folder):
    engine = turbojet(folder)
    f = flight(engine, **BODIE, records=np.linspace(0.0, 18.0, 101))
    follows, found, left = np.array([False]), [], []
    for tolerance in (1e-5, 1e-6, 1e-7):
        m = MovingEngine(engine, tolerance)
        found.append(m.fly([f])[0].states[0])
        left.append(interpolate(m.integrated([f])[0][0], f.records, follows)[0][0])
    exact = found[-1]
    # steps alone come nearer in proportion to their tolerance, and the run is made right whatever it was
    off = [np.abs(one / exact - 1.0).max() for one in left]
    assert off[0] < 3e-4 and off[1] < off[0] / 3.0 and off[2] < off[1] / 3.0
    assert max(np.abs(one / exact - 1.0).max() for one in found) < 1e-7


def test_radaus_method_meets_its_conditions_of_order():
    A, b, c = collocation.WEIGHTS, collocation.WEIGHTS[-1], dense.RADAU
    assert np.allclose([b @ c**k for k in range(5)], [1.0 / (k + 1) for k in range(5)], atol=1e-15)
    assert np.allclose([A @ c**k for k in range(3)], [c ** (k + 1) / (k + 1) for k in range(3)], atol=1e-15)
    # halving its steps leaves 1/32 of the error of dx/dt = -x
    off = []
    for n in (4, 8):
        x = np.linalg.solve(np.eye(3) + A / n, np.ones(3))[-1] ** n
        off.append(abs(x - np.exp(-1.0)))
    assert off[0] / off[1] == pytest.approx(32.0, rel=0.1)


def test_records_do_not_bend_the_course(folder):
    engine = turbojet(folder)
    m = MovingEngine(engine)
    few, many = (flight(engine, **BODIE, records=r) for r in (BODIE["time"], np.linspace(0.0, 18.0, 1801)))
    at = np.searchsorted(many.records, BODIE["time"])
    assert np.array_equal(m.fly([few])[0][0], m.fly([many])[0][0][:, at])


def test_each_engine_of_a_batch_flies_as_it_does_alone(folder):
    engine = turbojet(folder)
    m, rng = MovingEngine(engine), np.random.default_rng(4)
    records = np.linspace(0.0, 18.0, 51)
    flights = [
        flight(
            engine,
            BODIE["time"],
            np.array(BODIE["power"]) * rng.uniform(0.6, 1.0),
            records,
            dT=rng.uniform(-15, 15),
            **{"compressor.efficiency": rng.uniform(0.96, 1.0)},
        )
        for _ in range(60)
    ]
    together = m.fly(flights)
    for k in (0, 29, 59):
        alone = m.fly([flights[k]])[0][0]
        assert np.allclose(together[k][0][0], alone[0], rtol=1e-7), k


def test_a_heavier_rotor_moves_more_slowly_in_proportion(folder):
    light, heavy = turbojet(folder), turbojet(folder, 2.0 * INERTIA)
    t = np.linspace(0.0, 4.0, 41)
    step = ((0.0, 1e-3, 40.0), (0.5, 0.6, 0.6))
    a = MovingEngine(light, 1e-8).fly([flight(light, *step, records=t)])[0][0]
    b = MovingEngine(heavy, 1e-8).fly([flight(heavy, *step, records=2.0 * t)])[0][0]
    assert np.allclose(a[0], b[0], rtol=1e-5)  # but for the millisecond of the step itself


def test_without_inertia_an_engine_has_no_states():
    assert transient_states(load_engine(CONFIGS / "turbojet.yaml")) == ()


def test_the_fuel_control_respects_its_limits_at_every_record_of_a_bodie_manoeuvre():
    m = governed()
    f = flight(m.engine, **BODIE, records=np.linspace(0.0, 18.0, 361))
    flown = m.fly([f])[0]
    p = read(m, f, flown, ("T4_K", "FAR4", "Wf_kg_s", "N1_rpm"))
    T4, far, fuel, N1 = p.y.T
    assert p.ok.all()
    assert T4.max() < 1600.0 * (1 + 1e-6) and far.min() > 0.008 * (1 - 1e-6)
    assert np.abs(np.diff(fuel) / np.diff(f.records)).max() < 2.0 * 1.01  # kg/s per second
    assert {str(name) for name in p.active_limit} == {"", "fuel_control.lean", "fuel_control.hot", "fuel_control.rate"}
    assert N1[-1] == pytest.approx(f.columns["N1_demand_rpm"][-1], rel=1e-5)


def test_a_valve_that_follows_at_once_takes_one_step_from_corner_to_corner():
    m, t = governed(), np.arange(25.0)
    track = m.integrated([flight(m.engine, t, 0.5 + 0.002 * np.sin(t / 3.0))])[0][0]
    assert len(track.time) - 1 < 1.25 * 24


def test_a_valve_at_its_rate_moves_straight_and_reaches_the_law_exactly():
    m = governed()
    records = np.linspace(4.95, 6.5, 156)
    f = flight(m.engine, (0.0, 5.0, 5.01, 8.0), (0.4, 0.4, 0.6, 0.6), records=records)
    flown = m.fly([f])[0]
    p = read(m, f, flown, ("Wf_kg_s", "N1_rpm"))
    fuel, hurried = p.y[:, 0], p.active_limit == "fuel_control.rate"
    step = np.diff(fuel)[hurried[1:] & hurried[:-1]] / np.diff(records)[hurried[1:] & hurried[:-1]]
    assert len(step) > 5 and np.allclose(np.abs(step), 2.0, rtol=1e-8)
    N1, asked = p.y[:, 1], np.interp(records, f.time, f.columns["N1_demand_rpm"])
    rate = np.gradient(N1, records)
    free = (p.active_limit == "") & (records > 5.02)
    assert np.abs(N1 + 0.5 * rate - asked)[free][3:-1].max() < 0.1  # the law, but for the differences here


def test_the_named_limit_is_the_one_that_is_met():
    m = governed()
    f = flight(m.engine, **BODIE, records=np.linspace(0.0, 18.0, 361))
    flown = m.fly([f])[0]
    p = read(m, f, flown, ("T4_K", "FAR4"))
    for name, column, limit in (("hot", 0, 1600.0), ("lean", 1, 0.008)):
        named = np.char.find(p.active_limit, name) >= 0
        assert named.sum() > 20
        assert np.abs(p.y[named, column] / limit - 1.0).max() < 1e-5


@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_a_fuel_valve_with_a_time_constant_follows_its_closed_form(tmp_path, rate):
    text = (CONFIGS / "turbojet.yaml").read_text(encoding="utf-8").replace("16500,", "16500, inertia_kg_m2: 6,")
    for old in ("power_setting: Wf_kg_s", "  Wf_kg_s: {low"):
        assert old in text
        text = text.replace(old, old.replace("Wf_kg_s", "asked_kg_s"))
    pace = "time_constant_s: 0.5" + (f", rate_per_s: {rate}" if rate else "")
    law = "set_point_schedule: {input: asked_kg_s, polynomial: [0, 1]}"
    text += f"\ncontrols:\n  - {{name: valve, actuator: fuel, hold: Wf_kg_s, {pace}, {law}}}\n"
    (tmp_path / "e.yaml").write_text(text, encoding="utf-8")
    m = MovingEngine(load_engine(tmp_path / "e.yaml"))
    time, still = np.array([0.0, 1.0, 1.0 + 1e-6, 5.0]), np.zeros(4)
    asked = np.array([0.2, 0.2, 0.3, 0.3])
    columns = {"altitude_m": still, "mach": still, "dT_isa_K": still, "asked_kg_s": asked}
    f = TransientInputs(time, columns, np.linspace(1.0, 5.0, 81))
    fuel = read(m, f, m.fly([f])[0], ("Wf_kg_s",)).y[:, 0]
    # tau d ln x/dt = 1 - x/x_asked: a logistic curve; at a rate, straight until that is slower
    t, x0 = f.records - 1.0, 0.2
    if rate:
        x0 = 0.15 + np.sqrt(0.15**2 - 0.3 * 0.5 * rate)
        met = (x0 - 0.2) / rate
        assert met > 0.3 and fuel[t < met] == pytest.approx(0.2 + rate * t[t < met], rel=1e-5)
        t, fuel = t[t > met] - met, fuel[t > met]
    assert fuel == pytest.approx(0.3 / (1.0 + (0.3 / x0 - 1.0) * np.exp(-t / 0.5)), rel=1e-5)


def test_a_governor_of_speed_needs_a_lead(tmp_path):
    text = (CONFIGS / "turbofan_governed.yaml").read_text(encoding="utf-8")
    (tmp_path / "engine.yaml").write_text(text.replace("    lead_s: 0.5\n", ""), encoding="utf-8")
    with pytest.raises(ValueError, match="give it lead_s"):
        MovingEngine(load_engine(tmp_path / "engine.yaml"))


def test_a_speed_that_is_given_leaves_its_inertia_nothing_to_move(folder):
    engine = load_engine(turbojet(folder).path, "N1_rpm")
    with pytest.raises(ValueError, match="its inertia has nothing to move"):
        MovingEngine(engine)
