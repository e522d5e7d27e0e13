"""What restoring a module brings, and what maintenance did bring, at equal power."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known
from scipy.optimize import brentq
from score_makers import linear_score, sensitivities

from enginediag_cli.__main__ import main
from enginediag_cli.detection.series import build_series
from enginediag_cli.fleets.maintenance import maintenance_effects
from enginediag_cli.fleets.work_scope import (
    ChangeMoments,
    PowerNotHeldError,
    WorkScope,
    WorkScopeEstimator,
    change_gain,
    choose_reference,
    gains,
    solve_equal_power,
)
from enginediag_cli.history.engines import HistoryWindows, judge_engines
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.isolation.posterior import SetInference, average_sizes, set_posterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.report.tables.answers import maintenance_sentence, work_scope_sentences
from enginediag_cli.residuals.files import WindowReader, WindowSettings
from enginediag_cli.residuals.monitor import build_monitor
from enginediag_cli.residuals.windows import WindowPlan

CONFIGS = Path(__file__).parents[2] / "configs"
WORN = ChangeMoments(("hpc.efficiency", "hpt.flow_capacity"), np.array([-0.012, 0.01]), np.diag([1e-3, 2e-3]) ** 2)


@pytest.fixture(scope="module")
def engine():
    return load_engine(CONFIGS / "turbofan.yaml")


def test_a_gain_is_the_difference_of_two_simulations_at_the_thrust_of_the_healthy_engine(engine) -> None:
    reference = choose_reference(engine, {}, {})
    assert reference is not None and reference.columns == ("Fn_N", "T45_K", "Wf_kg_s")

    def run(fuel: float, health: dict[str, float]) -> np.ndarray:
        return engine.predict({**reference.inputs, "Wf_kg_s": fuel}, health, sensors=("Fn_N", "T45_K", "Wf_kg_s")).y[0]

    def at_thrust(health: dict[str, float]) -> np.ndarray:
        design = reference.inputs["Wf_kg_s"]
        wanted = run(design, {})[0]
        return run(brentq(lambda w: run(w, health)[0] - wanted, 0.9 * design, 1.1 * design, xtol=1e-12), health)

    now = at_thrust({"hpc.efficiency": 0.988, "hpt.flow_capacity": 1.01})
    restored = at_thrust({"hpt.flow_capacity": 1.01})
    (found,) = gains(engine, reference, {}, WORN, {"hpc": ["hpc.efficiency"]})
    assert found.temperature.value == pytest.approx(now[1] - restored[1], rel=1e-5)
    assert found.fuel.value == pytest.approx(now[2] - restored[2], rel=1e-5)
    assert found.fuel.share == pytest.approx((now[2] - restored[2]) / now[2], rel=1e-5)
    both = change_gain(engine, reference, {}, WORN.mean, ChangeMoments(WORN.names, -WORN.mean, WORN.covariance))
    assert both.temperature.value == pytest.approx(now[1] - at_thrust({})[1], rel=1e-5)


def test_derivatives_at_equal_power_agree_with_differences_and_intervals_follow_them(engine) -> None:
    reference, h = choose_reference(engine, {}, {}), 1e-4
    steps = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], float)
    found = solve_equal_power(engine, reference, {}, WORN.names, WORN.mean + steps)
    slopes = np.stack([(found.y[1] - found.y[2]) / (2 * h), (found.y[3] - found.y[4]) / (2 * h)], axis=1)
    assert found.slopes[0] == pytest.approx(slopes, rel=1e-4)
    (hpc,) = gains(engine, reference, {}, WORN, {"hpc": ["hpc.efficiency"]})
    assert hpc.temperature.deviation == pytest.approx(1e-3 * abs(slopes[0, 0]), rel=0.02)


@pytest.mark.parametrize(
    "name", ["turbofan_governed", "power_plant", "turboshaft", "micro_gas_turbine", "cmapss_turbofan"]
)
def test_restoring_an_efficiency_lowers_temperature_and_fuel(name: str) -> None:
    """Engines set by a governed speed, a gas temperature, a spool speed with another held, and a demand."""
    engine = load_engine(CONFIGS / f"{name}.yaml")
    reference = choose_reference(engine, {}, {})
    names = tuple(n for n in engine.monitored if engine.parameters[n].quantity == "efficiency")
    worn = ChangeMoments(names, np.full(len(names), -0.01), 1e-6 * np.eye(len(names)))
    found = gains(engine, reference, {}, worn, {engine.parameters[n].component: [n] for n in names})
    assert len(found) == len(names) >= 2
    assert all(g.temperature.value > 0.3 and 0.0005 < g.fuel.share < 0.03 for g in found)


def test_where_a_limit_holds_the_engine_back_nothing_is_told_at_equal_thrust() -> None:
    engine = load_engine(CONFIGS / "turbofan_governed.yaml")
    rating = choose_reference(engine, {}, {})
    hot = replace(rating, inputs={**rating.inputs, "N1_demand_rpm": 4200.0, "dT_isa_K": 30.0})
    worn = ChangeMoments(("hpc.efficiency",), np.array([-0.02]), 1e-6 * np.eye(1))
    with pytest.raises(PowerNotHeldError, match="Fn_N does not follow N1_demand_rpm there"):
        gains(engine, hot, {}, worn, {"hpc": ["hpc.efficiency"]})
    told = list(work_scope_sentences(WorkScope(reason="Fn_N does not follow N1_demand_rpm there")))
    assert told == ["the gain of restoring is unknown: Fn_N does not follow N1_demand_rpm there"]


def test_moments_of_all_changes_hold_those_of_each() -> None:
    rng = np.random.default_rng(4)
    score = linear_score(rng, sensitivities(rng), [0.01, 0, 0, -0.004, 0, 0])
    prior = SetPrior()
    posterior = set_posterior(score, prior)
    mean, covariance = SetInference(score, posterior, prior).moments()
    for size in average_sizes(score, posterior, score.parameters, prior):
        i = score.parameters.index(size.parameter)
        q = posterior.inclusion[i]
        assert mean[i] == pytest.approx(q * size.change, rel=2e-3, abs=2e-6)
        second = q * (size.standard_error**2 + size.change**2) - (q * size.change) ** 2
        assert covariance[i, i] == pytest.approx(second, rel=0.02, abs=1e-10)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def followed(engine, folder: Path, states, rng):
    """Series and scoping of flights with these values of HPC flow capacity and efficiency."""
    path = CONFIGS / "turbofan.yaml"
    inputs = climb(engine, 40)
    write_known(engine, path, inputs, folder / "nominal.yaml")
    flights = []
    for k, (flow, efficiency) in enumerate(states, start=1):
        table = recorded(engine, inputs, {"hpc.flow_capacity": flow, "hpc.efficiency": efficiency}, rng)
        flights.append({**table, "flight": np.full(40, str(k))})
    table = {c: np.concatenate([f[c] for f in flights]) for c in flights[0]}
    labels = table.pop("flight")
    write_csv(folder / "series.csv", [Recording(table, {"flight": labels.tolist()})])
    monitor = build_monitor(open_baseline(str(folder / "nominal.yaml")), sensors=True)
    files = WindowReader(
        RecordingLoader(
            RecordingSource((str(folder / "series.csv"),)), required_columns(monitor.engine, monitor.sensors)
        ),
        monitor,
        WindowSettings(WindowPlan().series_plan),
        summed=True,
        series=True,
    )
    files.additive = True
    windows = HistoryWindows(files)
    return build_series(windows, "covariance"), windows, WorkScopeEstimator(monitor)


def brought(series, windows, scoping, flight: int):
    """What maintenance before a flight brought."""
    ((_, story),) = judge_engines(windows.engines, series, maintenance={"": [flight]}, health=True)
    (found,) = maintenance_effects(scoping, story, series, "", [str(flight)])
    return found


@pytest.mark.parametrize("restored", [0.0, 0.01])
def test_what_flights_wore_before_and_after_a_wash_is_not_laid_to_it(engine, tmp_path: Path, restored) -> None:
    """A hundredth of efficiency in ten flights, on either side."""
    worn = [0.0012 * k - restored * (k > 10) for k in range(1, 21)]
    series, windows, scoping = followed(engine, tmp_path, [(1.0, 1.0 - w) for w in worn], np.random.default_rng(8))
    found = brought(series, windows, scoping, 11)
    assert (found.flights_before, found.flights_after) == (10, 10)
    if not restored:
        # named from 95 % on: one of twenty is by chance
        assert found.probability < 0.99 and abs(found.gain.temperature.value) < 3 * found.gain.temperature.deviation
        return
    assert found.names == ("hpc.efficiency",)
    assert abs(found.change[0] - restored) < 2.5 * found.deviation[0] < 0.5 * restored
    y = solve_equal_power(engine, scoping.reference({}), {}, ("hpc.efficiency",), np.array([[-worn[9]], [-worn[10]]])).y
    true = y[0, 0] - y[1, 0]
    # flight 11 has worn a little again
    assert abs(found.gain.temperature.value - true) < 3 * found.gain.temperature.deviation + 0.15 * true


def test_what_a_wash_did_bring_is_told_by_the_flights_next_to_it(engine, tmp_path: Path, capsys) -> None:
    """Healthy flights, fouled ones, washed ones: the healthy ones are no level before the wash."""
    states = [(1, 1)] * 2 + [(0.97, 0.985)] * 3 + [(0.99, 0.995)] * 3
    series, windows, scoping = followed(engine, tmp_path, states, np.random.default_rng(6))
    found = brought(series, windows, scoping, 6)
    assert (found.flights_before, found.flights_after) == (5, 3)
    assert set(found.names) == {"hpc.flow_capacity", "hpc.efficiency"}
    reference = scoping.reference({})
    states = np.array([[-0.03, -0.015], [-0.01, -0.005]])
    y = solve_equal_power(engine, reference, {}, ("hpc.flow_capacity", "hpc.efficiency"), states).y
    for gain, true in zip((found.gain.temperature, found.gain.fuel), y[0] - y[1], strict=True):
        assert abs(gain.value - true) < 3 * gain.deviation < 0.9 * true  # six flights, and the model's own error
    told = maintenance_sentence(found, series.parameters, reference)
    assert told.startswith("it lowered T45 by") and "5 flights before against 3 after" in told

    words = ["trend", "-n", str(tmp_path / "nominal.yaml"), str(tmp_path / "series.csv"), "-f", "json"]
    assert main([*words, "--event", "6"]) == 0
    out, err = capsys.readouterr()
    *others, last = json.loads(out)
    assert last["kind"] == "maintenance" and last.keys() == others[0].keys() and last["onset"] == 6
    assert last["work_scope"]["temperature_gain"] == pytest.approx(found.gain.temperature.value)
    assert f"maintenance before flight 6: {told}" in err
    assert main([*words, "--event", "nine"]) == 2 and "has no flight 'nine'" in capsys.readouterr().err
    assert main(["trend", str(tmp_path / "series.csv"), "--event", "6"]) == 2
