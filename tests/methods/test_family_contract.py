"""What holds for every method, on the toy engine and on the turbofan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from family_windows import toy_windows
from toy_engine import toy_monitor
from white_statistics import white_noise

from enginediag_cli.methods.base import NOTHING, PARAMETERS, SENSORS, RecordWindows, pad_windows
from enginediag_cli.methods.registry import FAMILIES, METHODS, SECTIONS, chosen_method
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.monitor import Monitor

TURBOFAN = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"


@pytest.fixture(scope="module")
def healthy():
    return toy_windows(np.random.default_rng(1), 100, 40)


@pytest.mark.parametrize("name", METHODS)
def test_a_change_is_seen_and_nothing_is_named_without_an_alarm(name, healthy):
    rng = np.random.default_rng(2)
    mixed = toy_windows(rng, 20, 40, {1: -0.03})
    calm = toy_windows(rng, 20, 40)
    windows = RecordWindows(
        {c: np.concatenate([mixed.inputs[c], calm.inputs[c]]) for c in calm.inputs}, np.concatenate([mixed.y, calm.y])
    )
    result = METHODS[name].train(toy_monitor(), healthy).diagnose(windows, 0.01)
    assert tuple(test.name for test in result.tests) == METHODS[name].tests
    assert result.method == name and result.kind in (PARAMETERS, SENSORS, NOTHING)
    assert result.alarm[:20].all() and result.alarm[20:].mean() < 0.2
    assert result.evidence.shape == (40, len(result.names))
    if result.isolated is not None:
        assert not result.isolated[~result.alarm].any()
        assert result.isolated[:20].any(axis=1).all()


@pytest.mark.parametrize("name", METHODS)
def test_filling_a_window_up_with_empty_records_changes_nothing(name, healthy):
    windows = toy_windows(np.random.default_rng(3), 5, 40, {1: -0.01})
    fill = np.full((5, 7), np.nan)
    longer = RecordWindows(
        {c: np.concatenate([v, fill], axis=1) for c, v in windows.inputs.items()},
        np.concatenate([windows.y, np.full((5, 7, 5), np.nan)], axis=1),
    )
    fitted = METHODS[name].train(toy_monitor(), healthy)
    short, long = fitted.diagnose(windows), fitted.diagnose(longer)
    for a, b in zip(short.tests, long.tests, strict=True):
        np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-6)
        np.testing.assert_allclose(a.threshold, b.threshold)
    np.testing.assert_allclose(short.evidence, long.evidence, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(short.isolated, long.isolated)


@pytest.mark.parametrize("name", METHODS)
def test_a_window_without_readings_has_no_verdict(name, healthy):
    windows = toy_windows(np.random.default_rng(4), 3, 40)
    windows.y[1] = np.nan
    result = METHODS[name].train(toy_monitor(), healthy).diagnose(windows)
    assert result.judged.tolist() == [True, False, True]
    assert not result.alarm[1]
    assert result.no_verdict_reason(0) == "" and "too few readings" in result.no_verdict_reason(1)


@pytest.mark.parametrize("name", METHODS)
def test_the_verdict_on_a_window_does_not_depend_on_the_windows_beside_it(name, healthy):
    rng = np.random.default_rng(6)
    many, other = toy_windows(rng, 6, 30, {1: -0.01}), toy_windows(rng, 2, 50, {2: 0.02})
    parts = [({c: v[w] for c, v in x.inputs.items()}, x.y[w]) for x in (other, many) for w in range(x.count)]
    fitted = METHODS[name].train(toy_monitor(), healthy)
    alone, among = fitted.diagnose(many), fitted.diagnose(pad_windows(parts))
    for a, b in zip(alone.tests, among.tests, strict=True):
        np.testing.assert_allclose(a.statistic, b.statistic[2:], rtol=1e-6)
    assert [alone.isolated_names(w) for w in range(6)] == [among.isolated_names(w + 2) for w in range(6)]


@pytest.mark.parametrize("name", METHODS)
def test_a_method_answers_to_its_name_and_its_declared_choices_are_its_own_defaults(name):
    method = METHODS[name]
    assert method.name == name == method.section().name and method.help
    assert method.configure({f.name: f.default for f in method.options}) == method


def test_a_study_may_ask_for_every_method_by_its_name_and_for_families_as_it_always_did():
    assert set(SECTIONS) == {*METHODS, "family"}
    assert chosen_method({"type": "family", "family": "estimation"}) is METHODS["reestimation"]
    assert {chosen_method({"type": "family", "family": f}).name for f in FAMILIES} <= set(METHODS)
    chosen = chosen_method({"type": "extended_kalman", "name": "x", "walk": 0.3, "tests": ["nis"]})
    assert (chosen.walk, chosen.tests, chosen.lags) == (0.3, ("nis",), 3)


def test_what_a_method_names_without_an_alarm_is_its_likeliest_and_not_isolated():
    windows = toy_windows(np.random.default_rng(7), 60, 40, {1: -0.0008})
    result = METHODS["posterior"].train(toy_monitor()).diagnose(windows)
    quiet = ~result.alarm
    assert quiet.any() and not result.isolated[quiet].any()
    assert (result.likeliest[result.alarm] == result.isolated[result.alarm]).all()
    assert np.isfinite(result.probability).all()


def test_windows_of_other_shapes_are_refused():
    with pytest.raises(ValueError, match="windows, records, sensors"):
        RecordWindows({}, np.zeros((3, 4)))
    with pytest.raises(ValueError, match="input u must have shape"):
        RecordWindows({"u": np.zeros(4)}, np.zeros((3, 4, 2)))


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
        engine=engine,
        sensors=sensors,
        base={},
        names=names,
        monitored=names,
        meaning=meaning,
        offsets=(),
        theta0=theta0,
        prior_sigma=sigma,
        lower=lower,
        upper=upper,
        uncertainty=np.zeros((p, p)),
        noise=noise,
    )
    rng = np.random.default_rng(5)

    def windows(W, n, fault):
        u = {"altitude_m": rng.uniform(0, 11e3, W * n), "dT_isa_K": rng.uniform(-15, 15, W * n)}
        u["mach"] = 0.3 + 0.5 * u["altitude_m"] / 11e3
        u[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.6, 1.0, W * n), u)
        values = dict(zip(names, theta0, strict=True)) | fault
        y = engine.predict(u, values, sensors=sensors).y + full * rng.uniform(-0.5, 0.5, (W * n, len(sensors)))
        return RecordWindows({c: v.reshape(W, n) for c, v in u.items()}, y.reshape(W, n, -1))

    return monitor, windows(80, 30, {}), windows(12, 30, {names[2]: theta0[2] * 0.97})


@pytest.mark.parametrize("name", [n for n in METHODS if n != "pca_raw"])
def test_every_method_that_uses_the_model_sees_a_booster_losing_three_per_cent_efficiency(name, turbofan):
    monitor, healthy, faulty = turbofan
    result = METHODS[name].train(monitor, healthy).diagnose(faulty)
    assert result.alarm.all() and result.converged.all()
    if name in ("local", "parity_filtered"):
        assert np.mean([result.isolated_names(w) == ("booster.efficiency",) for w in range(12)]) > 0.6
