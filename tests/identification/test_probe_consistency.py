"""A probe that the heat balances contradict is named; probes that agree, and engines that differ, are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.identification.probes import balances, drop_probes, model_columns_needed, wrong_probes
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
HOT = ("T3_K", "T4_K", "T5_K", "T7_K")


@pytest.fixture(scope="module")
def engine():
    """A bench engine with a probe at every station of its hot gas path."""
    return load_engine(CONFIGS / "amt_olympus.yaml")


def flown(engine, seed=0, truth=None, noisy=True):
    """One recording of 120 records from idle to full power, by an engine with these parameters."""
    rng = np.random.default_rng(seed)
    inputs = {
        "ambient_pressure_Pa": 1e5 + 500 * rng.standard_normal(120),
        "ambient_temperature_K": 288 + 3 * rng.standard_normal(120),
        "N1_rpm": np.linspace(36000, 107000, 120),
    }
    found = engine.predict(inputs, truth or {})
    assert found.ok.all()
    read = {c: found.y[:, j].copy() for j, c in enumerate(engine.sensors)}
    if noisy:
        read = {c: v + engine.sensors[c].noise_sigma * rng.standard_normal(120) for c, v in read.items()}
    return {**inputs, **read}


def asked(engine, columns):
    return wrong_probes(engine, [TrainingRecording("bench", columns)])


def test_the_balances_close_on_the_model_itself(engine):
    columns = flown(engine, noisy=False)
    needed = model_columns_needed(engine)
    inputs = {c: columns[c] for c in engine.inputs}
    also = engine.predict(inputs, sensors=(), also=needed).also
    found = balances(engine, frozenset(columns), {c: also[:, j] for j, c in enumerate(needed)})
    assert len(found) == 4
    for balance in found[:3]:  # the fourth knows the efficiency only roughly
        assert np.abs(balance.difference(columns)).max() < 0.02, balance.name


@pytest.mark.parametrize("seed", range(8))
def test_an_engine_that_is_not_the_one_of_the_file_is_no_wrong_probe(engine, seed):
    rng = np.random.default_rng(100 + seed)
    truth = {
        n: p.nominal + p.prior_sigma * np.clip(rng.standard_normal(), -2, 2)
        for n, p in engine.parameters.items()
        if p.family == "health"
    }
    truth["sensor.Wf.scale"] = float(rng.uniform(0.8, 1.25))
    assert asked(engine, flown(engine, seed, truth)) == ()


def test_combustion_that_gets_worse_towards_idle_is_no_wrong_probe(engine):
    worse = flown(engine, truth={"burner.efficiency": np.linspace(0.8, 1.05, 120)})
    assert asked(engine, worse) == ()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("column", ["T4_K", "T5_K"])
def test_a_probe_whose_error_grows_with_power_is_named_alone_and_its_error_is_found(engine, column, seed):
    columns = flown(engine, seed)
    error = np.linspace(100, -80, 120)
    columns[column] = columns[column] + error
    (found,) = asked(engine, columns)
    assert found.columns == (column,) and found.is_unique
    low, middle, high = found.error
    assert np.allclose((high, middle, low), (82, 10, -62), atol=4 * found.expected)


def test_the_cold_probe_and_the_last_one_are_named_too(engine):
    for column, error in (("T3_K", np.linspace(0, 120, 120)), ("T7_K", np.linspace(-90, 90, 120))):
        columns = flown(engine)
        columns[column] = columns[column] + error
        (found,) = asked(engine, columns)
        assert column in found.columns


def test_one_balance_alone_says_that_a_probe_is_wrong_and_not_which(engine):
    columns = flown(engine)
    columns["T4_K"] = columns["T4_K"] - 100
    for lost in ("T7_K", "Wf_kg_s", "P3_Pa"):
        del columns[lost]
    (found,) = asked(engine, columns)
    assert set(found.columns) >= {"T4_K", "T5_K"} and not found.is_unique


@pytest.mark.parametrize(
    "name", ["turbofan", "turbojet", "turboshaft", "power_plant", "citation_jt15d", "cmapss_turbofan"]
)
def test_engines_without_a_closed_balance_are_asked_nothing(name):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    columns = frozenset((*engine.sensors, *engine.inputs))
    assert balances(engine, columns, {c: np.full(1, np.nan) for c in model_columns_needed(engine)}) == []


def test_a_probe_of_few_or_broken_records_is_not_judged(engine):
    columns = flown(engine)
    columns["T4_K"] = np.where(np.arange(120) < 4, columns["T4_K"] + 300, np.nan)
    assert asked(engine, columns) == ()
    assert wrong_probes(engine, []) == ()


def test_what_is_left_out_is_the_column_and_nothing_else():
    recordings = [TrainingRecording("a", {"T4_K": np.ones(3), "T5_K": np.ones(3)})]
    (left,) = drop_probes(recordings, ["T4_K"])
    assert set(left.columns) == {"T5_K"} and set(recordings[0].columns) == {"T4_K", "T5_K"}
