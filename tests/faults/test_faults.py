from __future__ import annotations

import numpy as np
import pytest
from simulation_toy import CONFIGS

from enginediag_cli.errors import ConfigError
from enginediag_cli.faults.catalogue import (
    STEP,
    ComponentFault,
    check_faults,
    clocks_from_columns,
    load_faults,
    parameter_values,
)
from enginediag_cli.physics.engine_file import load_engine

FAULT_FILES = sorted((CONFIGS / "faults").glob("*.yaml"))
CLOCKS = clocks_from_columns({"flight": np.repeat(np.arange(1, 11), 20), "time_s": 60.0 * np.arange(200)}, 200)


@pytest.mark.parametrize("path", FAULT_FILES, ids=lambda p: p.stem)
def test_every_catalogue_file_fits_the_default_turbofan_and_says_where_it_comes_from(path):
    faults, engine = load_faults(path), load_engine(CONFIGS / "turbofan.yaml")
    check_faults(faults, engine)
    values = parameter_values(faults.components, engine.parameters, CLOCKS)
    assert faults.names and all(fault.reference for fault in (*faults.components, *faults.sensors))
    assert all(np.ptp(value) > 0.0 for value in values.values())
    head = path.read_text(encoding="utf-8")
    assert head.startswith("# ")


def test_catalogue_directions_are_those_of_wear():
    for path in FAULT_FILES:
        for fault in load_faults(path).components:
            for name, change in fault.changes.items():
                component, quantity = name.rsplit(".", 1)
                if quantity == "efficiency":
                    assert change < 0, (fault.name, name)
                elif quantity == "flow_capacity":
                    assert (change > 0) == (component in ("hpt", "lpt")), (fault.name, name)


def test_published_fouling_ratio_lies_between_one_and_three():
    changes = load_faults(CONFIGS / "faults" / "hpc_fouling.yaml").components[0].changes
    assert 1.0 <= changes["hpc.flow_capacity"] / changes["hpc.efficiency"] <= 3.0


def test_faults_on_one_scale_factor_multiply(engine):
    values = parameter_values(
        [ComponentFault("a", {"hpc.efficiency": -0.02}), ComponentFault("b", {"hpc.efficiency": -0.03})],
        engine.parameters,
        CLOCKS,
    )
    np.testing.assert_allclose(values["hpc.efficiency"], 0.98 * 0.97)


def test_faults_on_one_bias_add_in_its_unit(engine):
    one = ComponentFault("a", {"sensor.T3.bias": 2.0})
    other = ComponentFault("b", {"sensor.T3.bias": 3.0}, severity=2.0)
    values = parameter_values([one, other], engine.parameters, CLOCKS)
    np.testing.assert_allclose(values["sensor.T3.bias"], 8.0)


def test_severity_scales_the_change(engine):
    fault = ComponentFault("a", {"hpc.efficiency": -0.02}, severity=0.5)
    assert parameter_values([fault], engine.parameters, CLOCKS)["hpc.efficiency"][0] == pytest.approx(0.99)


def test_a_drift_beyond_the_bounds_is_refused_with_the_record(engine):
    law = {**STEP, "type": "drift", "rate": 1.0, "onset": 1.0}
    fault = ComponentFault("runaway", {"hpc.efficiency": -0.01}, law=law)
    with pytest.raises(ConfigError, match=r"hpc\.efficiency to 0\.79 at record 22, beyond its bound 0\.8"):
        parameter_values([fault], engine.parameters, CLOCKS)


def test_a_misspelt_parameter_is_found_at_its_place_with_the_near_name(tmp_path, engine):
    path = tmp_path / "fault.yaml"
    path.write_text("kind: faults\nfaults:\n  - name: x\n    changes:\n      hpc.eficiency: -0.01\n")
    with pytest.raises(ConfigError) as error:
        check_faults(load_faults(path), engine)
    assert f"{path}:5:7: error: " in str(error.value)
    assert "did you mean 'hpc.efficiency'?" in str(error.value)


def test_a_misspelt_sensor_is_found_with_the_near_name(tmp_path, engine):
    path = tmp_path / "fault.yaml"
    text = "kind: faults\nsensor_faults:\n  - name: x\n    column: T3_C\n    effect: {type: stuck}\n"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"4:13: error: engine 'toy turbofan' has no sensor 'T3_C'.*T3_K"):
        check_faults(load_faults(path), engine)


def test_a_file_without_faults_is_refused(tmp_path):
    path = tmp_path / "fault.yaml"
    path.write_text("kind: faults\ndescription: nothing\n")
    with pytest.raises(ConfigError, match="describes no fault"):
        load_faults(path)
