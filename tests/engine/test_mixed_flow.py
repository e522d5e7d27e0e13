"""A mixed-flow turbofan from its file: it solves, conserves, and its derivatives are right."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import operating_points
from mixed_flow import MIXED_FLOW

from enginediag_cli.physics.engine_file import load_engine

WRT = (
    "fan.efficiency",
    "hpc.flow_capacity",
    "lpt.flow_capacity",
    "nozzle.area",
    "hpc.valve.fraction",
    "bypass_duct.pressure_loss",
    "lp.mechanical_efficiency",
    "mach",
    "Wf_kg_s",
)


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    path = tmp_path_factory.mktemp("mixed") / "mixed.yaml"
    path.write_text(MIXED_FLOW, encoding="utf-8")
    return load_engine(path)


@pytest.fixture(scope="module")
def points(engine):
    return operating_points(engine, 60, 3, altitude=(0.0, 10000.0), mach=(0.2, 0.8), power=(0.3, 1.0))


def test_the_design_point_is_a_solution(engine):
    fuel = engine.predict(
        {"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, "Wf_kg_s": engine_fuel(engine)},
        sensors=("T4_K", "N1_rpm", "N2_rpm", "W2_kg_s", "BPR", "OPR"),
    )
    assert fuel.status[0] == 0
    assert np.allclose(fuel.y[0], [1450.0, 9000.0, 15000.0, 80.0, 1.2, 20.0], rtol=1e-6)


def engine_fuel(engine):
    """Design fuel flow, sought so that the exit temperature is the design one."""
    from scipy.optimize import brentq

    def hotter(fuel):
        p = engine.predict({"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, "Wf_kg_s": fuel}, sensors=("T4_K",))
        return p.y[0, 0] - 1450.0

    return brentq(hotter, 0.6, 0.75, xtol=1e-12)


def test_every_point_of_the_envelope_solves(engine, points):
    p = engine.predict(points)
    assert p.status.max() == 0, [p.reason(k) for k in np.flatnonzero(p.status)]
    assert p.residual.max() <= 1e-10


def test_the_unknowns_and_balances_come_from_the_network(engine):
    assert [u.name for u in engine.unknowns] == [
        "inlet.corrected_flow",
        "splitter.bypass_ratio",
        "hpt.pressure_ratio",
        "lpt.pressure_ratio",
        "lp.corrected_speed",
        "hp.corrected_speed",
    ]


def test_mass_is_conserved_through_bleeds_splitter_and_mixer(engine, points):
    columns = ("W2_kg_s", "W25_kg_s", "W13_kg_s", "W3_kg_s", "W4_kg_s", "W45_kg_s", "W15_kg_s", "W6_kg_s")
    W2, W25, W13, W3, W4, W45, W15, W6 = engine.predict(points, sensors=columns).y.T
    fuel = points["Wf_kg_s"]
    assert np.allclose(W25 + W13, W2, rtol=1e-12)
    assert np.allclose(W3, 0.92 * W25, rtol=1e-12)
    assert np.allclose(W4, W3 + fuel, rtol=1e-12)
    assert np.allclose(W45, W4 + 0.05 * W25, rtol=1e-12)
    assert np.allclose(W15, W13 + 0.02 * W25, rtol=1e-12)
    assert np.allclose(W6, W2 + fuel - 0.01 * W25, rtol=1e-12)  # the cabin bleed leaves overboard


def test_shaft_powers_balance(engine, points):
    columns = ("fan_power_W", "lpt_power_W", "hpc_power_W", "hpt_power_W")
    fan, lpt, hpc, hpt = engine.predict(points, sensors=columns).y.T
    assert np.allclose(fan, 0.99 * lpt, rtol=1e-9)
    assert np.allclose(hpc + 50000.0, hpt, rtol=1e-9)


def test_the_whole_engine_conserves_energy(engine, points):
    """Total enthalpy in + fuel heat = out + cabin bleed + offtake + bearing loss; thrust is no energy flow here."""
    from engine_makers import GAS

    from enginediag_cli.engine.gas import DRY_AIR, Mixture

    columns = ("T2_K", "W2_kg_s", "T6_K", "W6_kg_s", "FAR6", "T3_K", "W25_kg_s", "lpt_power_W", "Wf_kg_s")
    T2, W2, T6, W6, far, T3, W25, lpt, fuel = engine.predict(points, sensors=columns).y.T
    entering = W2 * GAS.enthalpy(T2, DRY_AIR) + fuel * 0.995 * 42.8e6
    leaving = W6 * GAS.enthalpy(T6, Mixture(far=far)) + 0.01 * W25 * GAS.enthalpy(T3, DRY_AIR) + 50000.0 + 0.01 * lpt
    assert np.allclose(leaving, entering, rtol=1e-9)


def test_sensitivities_match_differences_of_full_solves(engine, points):
    p = engine.predict(points, wrt=WRT, sensors=(*engine.sensors, "nozzle_pressure_ratio"))
    away = np.abs(p.y[:, -1] - 1.86) > 0.05  # from the choking kink
    assert away.sum() > 40
    for k, name in enumerate(WRT):
        step = 1e-3

        def moved(t, name=name, start=p.x):
            if name in points:
                return engine.predict({**points, name: points[name] * (1.0 + t)}, start=start).y
            return engine.predict(points, {name: engine.parameters[name].nominal * (1.0 + t)}, start=start).y

        numeric = (moved(-2 * step) - 8 * moved(-step) + 8 * moved(step) - moved(2 * step)) / (12 * step)
        scale = points[name][:, None] if name in points else engine.parameters[name].nominal
        error = np.abs(p.jacobian[:, :-1, k] * scale - numeric)[away]
        largest = np.abs(numeric[away]).max(axis=0)
        assert (error.max(axis=0) <= 1e-6 * largest).all(), name


def test_opening_the_bleed_valve_heats_the_turbine_exit(engine, points):
    shut, opened = (engine.predict(points, {"hpc.valve.fraction": f}, sensors=("T5_K",)).y for f in (0.02, 0.05))
    assert (opened > shut + 3.0).all()
