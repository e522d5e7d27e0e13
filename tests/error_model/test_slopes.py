"""Wrong slopes of the maps: the variance that they add to a change, in proportion to its square."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from engine_makers import operating_points, turbofan

from enginediag_cli.error_model.maps import QUANTITIES, ErrorModel, stated_map_accuracy, turbomachines
from enginediag_cli.error_model.sizes import GENERIC, SLOPES, MapSlopes, map_slopes


@pytest.fixture(scope="module")
def inputs():
    return operating_points(turbofan(), 6, 1, power=(0.3, 1.0))


def error_model(stated=GENERIC):
    engine = turbofan()
    sizes = {m.parameter(q): stated for m in turbomachines(engine) for q in QUANTITIES}
    return ErrorModel(stated, (), sizes)


@pytest.fixture(scope="module")
def slopes(inputs):
    return map_slopes(turbofan(), error_model(), turbofan().monitored, inputs, {})


def test_no_change_has_no_variance_and_that_of_a_change_is_quadratic(slopes):
    a = len(turbofan().monitored)
    assert not slopes.variance(np.zeros(a)).any()
    change = 0.02 * np.random.default_rng(1).normal(size=a)
    np.testing.assert_allclose(slopes.variance(-3 * change), 9 * slopes.variance(change))
    assert np.all(slopes.variance(change)[slopes.position] > 0)


def test_only_what_a_map_gives_is_uncertain(slopes):
    monitored = turbofan().monitored
    uncertain = {monitored[i] for i in slopes.position}
    assert uncertain == {m.parameter(q) for m in turbomachines(turbofan()) for q in QUANTITIES} & set(monitored)
    outside = [i for i, n in enumerate(monitored) if n not in uncertain]
    assert not slopes.variance(np.full(len(monitored), 0.02))[outside].any()


def test_how_far_a_change_moves_a_machine_on_its_map_is_that_of_differences(slopes, inputs):
    engine, monitored = turbofan(), turbofan().monitored
    j, step = monitored.index("hpc.efficiency"), 1e-4
    columns = tuple(dict.fromkeys(c for m in turbomachines(engine) for c in m.columns))
    moved = []
    for sign in (1, -1):
        p = engine.predict(inputs, {"hpc.efficiency": 1 + sign * step}, sensors=columns)
        values = dict(zip(columns, p.y.T, strict=True))
        moved.append([m.coordinates(values) for m in turbomachines(engine)])
    direct = np.mean((np.array(moved[0]) - np.array(moved[1])) / (2 * step), axis=1)  # (machines, 2)
    rows = [monitored[i].rpartition(".")[0] for i in slopes.position]
    for k, m in enumerate(turbomachines(engine)):
        for r in [r for r, name in enumerate(rows) if name == m.name]:
            np.testing.assert_allclose(slopes.displacement[r, :, j], direct[k], rtol=1e-3, atol=1e-4)


def test_a_subset_of_the_monitored_parameters_has_the_same_variances(slopes):
    monitored = turbofan().monitored
    kept = [i for i in range(len(monitored)) if i % 2]
    change = np.zeros(len(monitored))
    change[kept] = 0.01
    np.testing.assert_allclose(slopes.select(kept).variance(change[kept]), slopes.variance(change)[kept])
    no_map = [i for i in range(len(monitored)) if i not in set(slopes.position.tolist())]
    if no_map:
        assert slopes.select(no_map) is None


def test_a_monitor_of_other_parameters_knows_the_slopes_of_those_that_it_has(inputs):
    engine = turbofan()
    few = map_slopes(engine, error_model(), ("hpt.efficiency", "hpc.efficiency"), inputs, {})
    assert few.displacement.shape == (2, 2, 2) and sorted(few.position.tolist()) == [0, 1]
    assert map_slopes(engine, error_model(), ("core_nozzle.area",), inputs, {}) is None


def test_measured_maps_have_slopes_that_are_better_in_proportion_and_exact_ones_none(inputs):
    engine, names = turbofan(), turbofan().monitored
    generic, measured = (map_slopes(engine, error_model(s), names, inputs, {}) for s in (GENERIC, 0.3 * GENERIC))
    np.testing.assert_allclose(measured.sigma, 0.3 * generic.sigma)
    assert set(np.round(generic.sigma, 12)) == set(SLOPES.values())
    # worse than generic is not known to be anything else
    np.testing.assert_allclose(map_slopes(engine, error_model(5 * GENERIC), names, inputs, {}).sigma, generic.sigma)
    assert map_slopes(engine, replace(error_model(), stated=0.0), names, inputs, {}) is None


def test_variances_of_two_coordinates_and_several_changes_add_up_as_written():
    found = MapSlopes(np.array([1]), np.array([[[2.0, 1.0], [0.0, 3.0]]]), np.array([0.5]))
    assert found.variance(np.array([0.1, -0.2])).tolist() == pytest.approx([0.0, 0.25 * (0.0**2 + 0.6**2)])


def test_the_variance_is_that_of_the_change_estimated_with_that_variance():
    """δ = S (1 + I (C + S))⁻¹ b; with right slopes (C = 0) the change, and what it adds, would come out larger."""
    rng = np.random.default_rng(3)
    found = MapSlopes(np.array([0, 1]), rng.normal(size=(2, 2, 3)), np.array([0.2, 0.5]))
    J = rng.normal(size=(40, 3)) / 0.002
    information, pull = J.T @ J, J.T @ J @ np.array([-0.02, 0.0, 0.01])
    spread = np.array([0.01, 0.01, 0.01])
    variance = found.likely_variance(pull, information, spread)

    def change(c):
        return spread**2 * np.linalg.solve(np.eye(3) + information @ np.diag(c + spread**2), pull)

    np.testing.assert_allclose(variance, found.variance(change(variance)), rtol=0.02)
    assert np.all(variance[:2] < found.variance(change(np.zeros(3)))[:2]) and variance[2] == 0.0


def test_a_parameter_that_is_taken_not_to_have_changed_moves_no_machine():
    found = MapSlopes(np.array([0]), np.array([[[0.0, 1.0], [0.0, 0.0]]]), np.array([0.5]))
    pull, information = np.array([0.0, 1e4]), 1e6 * np.eye(2)
    assert found.likely_variance(pull, information, np.array([0.01, 0.01]))[0] > 0.0
    assert not found.likely_variance(pull, information, np.array([0.01, 0.0])).any()


def test_the_accuracy_of_maps_is_what_the_engine_file_states_and_nothing_is_known_of_a_model_without_one():
    assert stated_map_accuracy(turbofan()) == 0.003
    assert stated_map_accuracy(object()) == 0.0
