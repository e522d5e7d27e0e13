"""What a worn engine delivers at a limit: the same as a direct solution of the engine there."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_nominal import noise_of, nominal_of
from small_fleet import SHIPPED

from enginediag_cli import forecast
from enginediag_cli.api.trends import MarginOptions
from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import EngineFinding, IntervalEstimate, PowerAvailable
from enginediag_cli.fleets.margin import check_limits, rated_inputs
from enginediag_cli.fleets.work_scope import solve_at_limits
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.tables.fleet import engine_rows, power_available_words

CONDITION = {"altitude_m": 1200.0, "mach": 0.0, "dT_isa_K": 20.0, "N2_rpm": 20900.0}
NAMES = ("compressor.efficiency", "gas_generator_turbine.efficiency")
WORN = np.array([[0.0, 0.0], [-0.03, 0.0], [-0.02, -0.02]])


@pytest.fixture(scope="module")
def engine() -> Engine:
    return load_engine(SHIPPED / "turboshaft.yaml")


def state(engine: Engine, change: np.ndarray, setting: float, *columns: str) -> np.ndarray:
    """The engine with that wear, computed directly."""
    wear = {name: 1.0 + d for name, d in zip(NAMES, change, strict=True)}
    found = engine.predict({**CONDITION, engine.power_setting: setting}, wear, sensors=columns)
    assert found.ok[0]
    return found.y[0]


def test_the_power_at_a_temperature_is_that_of_the_engine_which_has_it(engine: Engine) -> None:
    inputs = {**CONDITION, "N1_rpm": 43000.0}
    found = solve_at_limits(engine, inputs, {}, NAMES, WORN, {"T45_K": 1120.0})
    for k, change in enumerate(WORN):
        T45, power = state(engine, change, found.setting[k], "T45_K", "power_W")
        assert T45 == pytest.approx(1120.0, rel=1e-8)
        assert found.value[k] == pytest.approx(power, rel=1e-9)
    assert found.column == "power_W" and set(found.limited_by) == {"T45_K"}
    assert found.value[0] > found.value[1] > found.value[2]
    assert found.value[1] < 0.95 * found.value[0]


def test_its_derivative_is_the_difference_of_two_solutions(engine: Engine) -> None:
    step, inputs = 1e-4, {**CONDITION, "N1_rpm": 43000.0}
    near = np.array([[-0.02, -0.01], [-0.02 + step, -0.01], [-0.02, -0.01 + step]])
    found = solve_at_limits(engine, inputs, {}, NAMES, near, {"T45_K": 1120.0})
    for k in (0, 1):
        assert (found.value[k + 1] - found.value[0]) / step == pytest.approx(found.slopes[0, k], rel=1e-2)


def test_the_first_limit_binds_and_no_other_is_exceeded(engine: Engine) -> None:
    limits = {"T45_K": 1120.0, "gearbox_torque_N_m": 480.0, "N1_rpm": 46500.0}
    found = solve_at_limits(engine, {**CONDITION, "N1_rpm": 43000.0}, {}, NAMES, WORN, limits)
    for k, change in enumerate(WORN):
        T45, torque = state(engine, change, found.setting[k], "T45_K", "gearbox_torque_N_m")
        assert T45 <= 1120.0 * (1 + 1e-8) and torque <= 480.0 * (1 + 1e-8) and found.setting[k] <= 46500.0
        reached = {"T45_K": T45 / 1120.0, "gearbox_torque_N_m": torque / 480.0, "N1_rpm": found.setting[k] / 46500.0}
        assert reached[found.limited_by[k]] == pytest.approx(1.0, rel=1e-8)
    assert len(set(found.limited_by)) > 1  # wear makes another one bind


def test_a_limit_beyond_the_model_is_unknown_with_the_reason(engine: Engine) -> None:
    found = solve_at_limits(engine, {**CONDITION, "N1_rpm": 43000.0}, {}, NAMES, WORN, {"T45_K": 3000.0})
    assert np.all(np.isnan(found.value)) and "T45_K does not reach 3000" in found.reason


def test_thrust_is_what_an_engine_without_a_load_delivers() -> None:
    turbofan = load_engine(SHIPPED / "turbofan.yaml")
    inputs = {"altitude_m": 0.0, "mach": 0.2, "dT_isa_K": 15.0, "Wf_kg_s": 2.3}
    worn = np.array([[0.0], [-0.02]])
    found = solve_at_limits(turbofan, inputs, {}, ("hpc.efficiency",), worn, {"T45_K": 1230.0, "N2_rpm": 11000.0})
    assert found.column == "Fn_N" and np.all(np.diff(found.value) < 0)


@pytest.fixture(scope="module")
def snapshots(engine: Engine, tmp_path_factory) -> tuple[Path, dict[str, np.ndarray]]:
    """Nominal file of the turboshaft, and the conditions of flights of one record each."""
    folder, rng, n = tmp_path_factory.mktemp("snapshots"), np.random.default_rng(21), 60
    inputs = {
        "altitude_m": rng.uniform(0.0, 3000.0, n),
        "mach": rng.uniform(0.0, 0.2, n),
        "dT_isa_K": rng.uniform(-10.0, 25.0, n),
        "N2_rpm": np.full(n, 20900.0),
    }
    inputs["N1_rpm"] = engine.power_from_fraction(rng.uniform(0.6, 1.0, n), inputs)
    path = folder / "engine.yaml"
    path.write_text((SHIPPED / "turboshaft.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    noise = noise_of({c: s.noise_sigma for c, s in engine.sensors.items()})
    known = {
        "compressor.efficiency": 0.003,
        "gas_generator_turbine.efficiency": 0.003,
        "power_turbine.efficiency": 0.003,
    }
    write_nominal(nominal_of(engine, path, noise, inputs, known), folder / "nominal.yaml")
    return folder / "nominal.yaml", inputs


def followed(engine: Engine, snapshots: tuple[Path, dict[str, np.ndarray]], wear: np.ndarray, drift_K: float) -> dict:
    """The last row of the margin of an engine with that wear (n, 2), whose T45 drifts by so much."""
    nominal, inputs = snapshots
    rng, n = np.random.default_rng(22), len(wear)
    found = engine.predict(inputs, {name: 1.0 + wear[:, j] for j, name in enumerate(NAMES)})
    assert found.ok.all()
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
    y = found.y + sigma * rng.standard_normal(found.y.shape)
    columns = {**inputs, **{c: y[:, j] for j, c in enumerate(engine.sensors)}}
    columns["T45_K"] = columns["T45_K"] + drift_K * np.arange(n) / n
    options = MarginOptions(limits_K={"T45_K": 1150.0}, limits={"gearbox_torque_N_m": 900.0}, at={"altitude_m": 1500.0})
    return list(forecast(nominal, columns, margin=options))[-1]


def test_snapshots_of_a_worn_turboshaft_have_its_margin_and_its_power(engine: Engine, snapshots) -> None:
    wear = np.linspace(0.0, 1.0, 60)[:, None] * np.array([-0.03, -0.01])
    row = followed(engine, snapshots, wear, 0.0)
    inputs = rated_inputs(engine, {"altitude_m": 1500.0})
    truth = solve_at_limits(engine, inputs, {}, NAMES, np.stack([np.zeros(2), wear[-1]]), {"T45_K": 1150.0})
    wide = 0.75 * (row["power_available_kW_high"] - row["power_available_kW_low"])  # three standard errors
    assert row["power_available_kW"] == pytest.approx(truth.value[1] / 1000.0, abs=wide)
    assert wide < 0.05 * row["power_available_kW"] and row["limited_by"] == "T45_K"
    change = row["power_available_kW"] - row["power_change_kW"]
    assert change == pytest.approx(truth.value[0] / 1000.0, rel=1e-6)
    assert row["thrust_available_N"] is None and row["used_low"] > 15.0


def test_a_drift_of_the_temperature_uses_no_margin_and_no_power(engine: Engine, snapshots) -> None:
    row = followed(engine, snapshots, np.zeros((60, 2)), 40.0)
    assert abs(row["used_K"]) < 3.0 and row["used_high"] - row["used_low"] < 12.0
    assert abs(row["available_change_percent"]) < 1.5


def test_an_engine_of_a_fleet_has_the_power_of_its_last_flight_in_its_rows_and_words() -> None:
    """1,150 kW of 1,200 kW, ± 12 kW: 4.2 % ± 1.0 % below."""
    now = PowerAvailable("power_W", IntervalEstimate(1.15e6, 1.138e6, 1.162e6), 1.2e6, "T45_K", "rating")
    finding = EngineFinding("A", "b", 40, 400, "changed", "", power=now)
    row = next(engine_rows(SimpleNamespace(finding=SimpleNamespace(engines=[finding]))))
    assert row["power_available_kW"] == 1150.0 and row["power_available_kW_low"] == 1138.0
    assert row["available_change_percent"] == pytest.approx(-100 * 0.05 / 1.2) and row["limited_by"] == "T45_K"
    assert np.isnan(row["thrust_available_N"])
    assert (
        power_available_words(now)
        == "power available at the limit of T45: 1150 kW ± 12 kW, 4.2 % ± 1.0 % below nominal"
    )
    assert power_available_words(PowerAvailable()) == ""


def test_a_limit_of_a_column_that_the_engine_does_not_have_is_refused(engine: Engine) -> None:
    with pytest.raises(DataError, match=r"fleet\.yaml: limits_K: the engine has no column 'T46_K'"):
        check_limits(engine, {"T46_K": 1100.0}, "fleet.yaml: limits_K")
