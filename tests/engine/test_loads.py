"""What shafts drive: each load's power by name, power_W their sum, and the energy balance closes."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import CONFIGS

from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

ONE = (CONFIGS / "turboshaft.yaml").read_text(encoding="utf-8")
PUMP = "  - {type: load, name: pump, shaft: gas_generator, law: cube, efficiency: 0.9}\n"
TWO = (
    ONE.replace("\nshafts:\n", PUMP + "\nshafts:\n")
    .replace("    isentropic_efficiency: 0.86\n", "    isentropic_efficiency: 0.86\n    pressure_ratio: 4.6\n")
    .replace("    pressure_ratio: 3.3\n", "    pressure_ratio: 2.7\n")
)
POINT = {"altitude_m": 500.0, "mach": 0.1, "dT_isa_K": 5.0, "N2_rpm": 20900.0}
FUEL = np.array([0.06, 0.08, 0.09])


def engine(tmp_path, text, power_setting=None):
    path = tmp_path / "engine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path, power_setting=power_setting)


def test_each_load_has_its_own_power_and_power_W_is_their_sum(tmp_path):
    p = engine(tmp_path, TWO, "Wf_kg_s").predict(
        {**POINT, "Wf_kg_s": FUEL}, sensors=["gearbox_power_W", "pump_power_W", "power_W"]
    )
    assert p.ok.all()
    assert (p.y > 1e4).all()
    assert p.y[:, 2] == pytest.approx(p.y[:, 0] + p.y[:, 1], rel=1e-14)


def test_the_energy_of_an_engine_with_two_loads_is_conserved(tmp_path):
    """Fuel's heat = exhaust's enthalpy rise + what loads take + what bearings lose, each shaft for itself as well."""
    sensors = ["gas_generator_turbine_power_W", "compressor_power_W", "pump_power_W", "power_turbine_power_W"]
    p = engine(tmp_path, TWO, "Wf_kg_s").predict({**POINT, "Wf_kg_s": FUEL}, sensors=[*sensors, "gearbox_power_W"])
    turbine, compressor, pump, power_turbine, gearbox = p.y.T
    assert 0.99 * turbine == pytest.approx(compressor + pump / 0.9, rel=1e-9)
    assert 0.99 * power_turbine == pytest.approx(gearbox / 0.98, rel=1e-9)


def test_with_one_load_power_W_is_that_loads_power(tmp_path):
    p = engine(tmp_path, ONE, "Wf_kg_s").predict({**POINT, "Wf_kg_s": FUEL}, sensors=["power_W", "gearbox_power_W"])
    assert (p.y[:, 0] == p.y[:, 1]).all()


@pytest.mark.parametrize("text", [ONE, TWO], ids=["one load", "two loads"])
def test_power_W_as_power_setting_is_the_power_of_all_loads(tmp_path, text):
    given = engine(tmp_path, text, "Wf_kg_s").predict({**POINT, "Wf_kg_s": FUEL}, sensors=["power_W"]).y[:, 0]
    p = engine(tmp_path, text, "power_W").predict({**POINT, "power_W": given}, sensors=["Wf_kg_s"])
    assert p.y[:, 0] == pytest.approx(FUEL, rel=1e-8)


def test_a_second_load_on_one_shaft_is_refused_at_its_place_with_what_to_do(tmp_path):
    with pytest.raises(ConfigError) as caught:
        engine(tmp_path, ONE.replace("\nshafts:\n", "  - {type: load, name: alternator, shaft: rotor}\n\nshafts:\n"))
    [problem] = caught.value.problems
    assert "alternator: shaft 'rotor' drives gearbox already" in problem.message
    assert "power_offtake_W" in problem.hint
    assert problem.mark.line > 1 and problem.mark.column > 1


def test_another_shafts_speed_that_cannot_set_the_power_is_refused_with_those_that_can(tmp_path):
    with pytest.raises(ConfigError) as caught:
        engine(tmp_path, ONE.replace("power_setting: N1_rpm", "power_setting: compressor_power_W"))
    [problem] = caught.value.problems
    assert "cannot be the power setting" in problem.message and "power_W" in problem.hint
