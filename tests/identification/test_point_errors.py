"""Errors of the model at operating points flown again and again, in an identification."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.error_model.maps import POINT_FAMILY, PointErrorModel
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.map_error import add_point_errors
from enginediag_cli.identification.nominal_file import read_nominal, write_nominal
from enginediag_cli.identification.problem import TrainingRecording, build_problem, settings_from_mapping
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
CONDITIONS = np.array([[0.0, 0.001, 2388.0], [6100.0, 0.7, 2324.0], [10670.0, 0.84, 2223.0]])
ENGINES, RECORDS = 12, 12
MISSED = {"N2_rpm": (30.0, -20.0, -10.0), "T25_K": (1.0, 0.0, -1.0)}
"""What the model misses of two readings at the three conditions: five to seven times their noise."""


@pytest.fixture(scope="module")
def engine():
    return load_engine(CONFIGS / "cmapss_turbofan.yaml")


def fleet(engine, conditions=CONDITIONS, missed=MISSED, seed=0):
    """Engines that differ by 0.2 % of each reading, twelve records of each, dealt to the conditions."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(ENGINES):
        at = np.arange(RECORDS) % len(conditions)
        columns = {
            "altitude_m": conditions[at, 0],
            "mach": conditions[at, 1],
            "dT_isa_K": rng.normal(0.0, 0.01, RECORDS),
            "N1_rpm": conditions[at, 2] + rng.normal(0.0, 0.05, RECORDS),
        }
        y = engine.predict(columns, {"hpc.efficiency": 0.99}).y
        for s, (column, sensor) in enumerate(engine.sensors.items()):
            off = 1 + 0.002 * rng.standard_normal()
            columns[column] = y[:, s] * off + sensor.noise_sigma * rng.standard_normal(RECORDS)
            columns[column] += np.array(missed.get(column, np.zeros(len(conditions))))[at]
        found.append(TrainingRecording(f"engine {number + 1}", columns))
    return found


def problem_of(engine, recordings):
    return build_problem(engine, recordings, settings_from_mapping(engine.declared["identification"]))


@pytest.fixture(scope="module")
def identified(engine):
    return identify(engine, fleet(engine), cross_validation=False)


def test_points_are_the_conditions_and_every_reading_has_an_error_at_each_and_elsewhere(engine):
    problem = add_point_errors(problem_of(engine, fleet(engine)), 0.01)
    assert len(problem.model.points) == len(CONDITIONS)
    errors = [p for p in problem.parameters if p.family == POINT_FAMILY]
    assert len(errors) == len(problem.sensors) * (len(CONDITIONS) + 1)


@pytest.mark.parametrize("accuracy, count, end", [(0.0, 3, 1.0), (0.01, 1, 1.0), (0.01, RECORDS, 0.3)])
def test_there_are_none_where_maps_are_right_or_points_are_one_or_run_into_each_other(engine, accuracy, count, end):
    share = np.linspace(0.0, end, count)[:, None]
    problem = problem_of(engine, fleet(engine, CONDITIONS[0] + share * (CONDITIONS[2] - CONDITIONS[0]), {}))
    assert add_point_errors(problem, accuracy) is problem


def test_there_are_none_along_a_clock(engine):
    recordings = [
        r._replace(columns={**r.columns, "time_s": np.arange(RECORDS) * (1.0 + 0.5 * (np.arange(RECORDS) % 2))})
        for r in fleet(engine)
    ]
    problem = problem_of(engine, recordings)
    moved = replace(problem, position=np.cumsum(np.where(np.arange(len(problem.recording)) % 2, 1.0, 3.0)))
    assert add_point_errors(moved, 0.01) is moved


def test_what_is_missed_at_a_condition_is_no_noise(engine, identified):
    assert identified.converged
    stated = np.array([engine.sensors[s].noise_sigma for s in identified.problem.sensors])
    assert np.all(np.abs(identified.noise.sigma / stated - 1) < 0.3)
    assert np.all(identified.problem.inflation < 1.3)


def test_the_mean_residual_of_a_condition_vanishes(engine, identified):
    problem = identified.problem
    at = problem.model.points.assign(problem.inputs)
    stated = np.array([engine.sensors[s].noise_sigma for s in problem.sensors])
    for c in range(len(CONDITIONS)):
        mean = np.nanmean(identified.fit.equations.residual[at == c], axis=0) / stated
        assert np.all(np.abs(mean) < 0.3)


def test_a_nominal_file_holds_points_and_what_is_missed_there(engine, identified, tmp_path):
    nominal = identified.nominal(str(CONFIGS / "cmapss_turbofan.yaml"), "0" * 64, {})
    write_nominal(nominal, tmp_path / "n.yaml")
    found = read_nominal(tmp_path / "n.yaml").error_model
    assert np.array_equal(found.points.low, nominal.error_model.points.low)
    assert np.array_equal(found.points.high, nominal.error_model.points.high)
    assert found.misses == nominal.error_model.misses
    model = found.wrap(engine)
    assert isinstance(model.model, PointErrorModel)
    assert set(nominal.theta0) <= set(model.parameters)
    assert not any(name.startswith(POINT_FAMILY) for name in nominal.engine_values)


def test_engines_that_differ_by_their_instruments_are_no_operating_points(engine):
    recordings, rng = fleet(engine, CONDITIONS[:1], {}), np.random.default_rng(3)
    for r in recordings:
        for column in engine.sensors:
            r.columns[column][:] *= 1 + 0.004 * rng.standard_normal()
    found = identify(engine, recordings, cross_validation=False)
    stated = np.array([engine.sensors[s].noise_sigma for s in found.problem.sensors])
    assert found.converged
    assert np.all(found.problem.inflation < 1.3)
    assert np.all(found.noise.sigma / stated < 1.3)
