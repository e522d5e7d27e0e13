"""What holds for every family, on the toy engine and on the turbofan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from family_windows import toy_windows
from toy_engine import toy_monitor

from enginediag_cli.methods.families.base import Windows
from enginediag_cli.methods.families.registry import FAMILIES
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.noise import white_noise

TURBOFAN = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"


@pytest.fixture(scope="module")
def healthy():
    return toy_windows(np.random.default_rng(1), 100, 40)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_change_is_seen_and_nothing_is_named_without_an_alarm(name, healthy):
    rng = np.random.default_rng(2)
    mixed = toy_windows(rng, 20, 40, {1: -0.03})
    calm = toy_windows(rng, 20, 40)
    windows = Windows(
        {c: np.concatenate([mixed.inputs[c], calm.inputs[c]]) for c in calm.inputs}, np.concatenate([mixed.y, calm.y])
    )
    result = FAMILIES[name]().train(toy_monitor(), healthy).diagnose(windows, 0.01)
    assert result.family == name
    assert result.alarm[:20].all() and result.alarm[20:].mean() < 0.2
    assert result.evidence.shape == (40, len(result.names))
    if result.isolated is not None:
        assert not result.isolated[~result.alarm].any()
        assert result.isolated[:20].any(axis=1).all()


@pytest.mark.parametrize("name", [n for n in FAMILIES if n not in ("extended_kalman", "unscented_kalman")])
def test_filling_a_window_up_with_empty_records_changes_nothing(name, healthy):
    windows = toy_windows(np.random.default_rng(3), 5, 40, {1: -0.01})
    fill = np.full((5, 7), np.nan)
    longer = Windows(
        {c: np.concatenate([v, fill], axis=1) for c, v in windows.inputs.items()},
        np.concatenate([windows.y, np.full((5, 7, 5), np.nan)], axis=1),
    )
    fitted = FAMILIES[name]().train(toy_monitor(), healthy)
    short, long = fitted.diagnose(windows), fitted.diagnose(longer)
    for a, b in zip(short.tests, long.tests, strict=True):
        np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-6)
        np.testing.assert_allclose(a.threshold, b.threshold)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_window_without_readings_has_no_verdict(name, healthy):
    windows = toy_windows(np.random.default_rng(4), 3, 40)
    windows.y[1] = np.nan
    result = FAMILIES[name]().train(toy_monitor(), healthy).diagnose(windows)
    assert result.judged.tolist() == [True, False, True]
    assert not result.alarm[1]


def test_windows_of_other_shapes_are_refused():
    with pytest.raises(ValueError, match="windows, records, sensors"):
        Windows({}, np.zeros((3, 4)))
    with pytest.raises(ValueError, match="input u must have shape"):
        Windows({"u": np.zeros(4)}, np.zeros((3, 4, 2)))


@pytest.fixture(scope="module")
def turbofan():
    """Monitor of the turbofan with the paper's noise, 80 healthy windows and 12 faulty ones."""
    engine = load_engine(TURBOFAN)
    parameters = [engine.parameters[name] for name in engine.monitored]
    p, sensors = len(parameters), tuple(engine.sensors)
    theta0, sigma, lower, upper = (
        np.array([getattr(x, what) for x in parameters]) for what in ("nominal", "prior_sigma", "lower", "upper")
    )
    full = np.array([0.01 * sensor.maximum for sensor in engine.sensors.values()])
    names = engine.monitored
    meaning, noise = {p.name: p for p in parameters}, white_noise(full / np.sqrt(12))
    monitor = Monitor(
        engine, sensors, {}, names, names, meaning, (), theta0, sigma, lower, upper, np.zeros((p, p)), noise
    )
    rng = np.random.default_rng(5)

    def windows(W, n, fault):
        u = {"altitude_m": rng.uniform(0, 11e3, W * n), "dT_isa_K": rng.uniform(-15, 15, W * n)}
        u["mach"] = 0.3 + 0.5 * u["altitude_m"] / 11e3
        u[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.6, 1.0, W * n), u)
        values = dict(zip(names, theta0, strict=True)) | fault
        y = engine.predict(u, values, sensors=sensors).y + full * rng.uniform(-0.5, 0.5, (W * n, len(sensors)))
        return Windows({c: v.reshape(W, n) for c, v in u.items()}, y.reshape(W, n, -1))

    return monitor, windows(80, 30, {}), windows(12, 30, {names[2]: theta0[2] * 0.97})


@pytest.mark.parametrize("name", [n for n in FAMILIES if n != "pca_raw"])
def test_every_family_that_uses_the_model_sees_a_booster_losing_three_per_cent_efficiency(name, turbofan):
    monitor, healthy, faulty = turbofan
    result = FAMILIES[name]().train(monitor, healthy).diagnose(faulty)
    assert result.alarm.all() and result.converged.all()
    if name in ("local", "parity_filtered"):
        assert np.mean([result.isolated_names(w) == ("booster.efficiency",) for w in range(12)]) > 0.6
