"""Identification of a toy engine whose truth is known: estimates, standard errors, noise, statuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification_toy import PARAMETERS, SENSORS, TRUTH, ToyEngine, fly
from scipy.stats import binom

from enginediag_cli.errors import DataError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import IdentificationSettings, TrainingRecording, settings_from_mapping

REPETITIONS = 60


def run(engine, recordings, offsets=True, **settings):
    result = identify(
        engine, recordings, settings=IdentificationSettings(**settings), cross_validation=False, offsets=offsets
    )
    assert result.converged, result.reason
    return result


def draw_truth(rng):
    """Parameters from their priors, for which a posterior interval is exact."""
    return {p.name: rng.normal(p.nominal, p.prior_sigma) for p in PARAMETERS}


def standard_scores(rho: float, seed: int, n: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """(estimate − truth)/standard error, (REPETITIONS, p), and the estimated rho, (REPETITIONS, m)."""
    engine, rng = ToyEngine(), np.random.default_rng(seed)
    scores, rhos = [], []
    for _ in range(REPETITIONS):
        truth = draw_truth(rng)
        result = run(engine, [fly(engine, rng, n, rho=rho, truth=truth)])
        scores.append([(e.value - truth[e.name]) / e.standard_error for e in result.estimates])
        rhos.append(result.noise.rho1)
    return np.array(scores), np.array(rhos)


def assert_honest(scores: np.ndarray) -> None:
    """Each parameter is inside ±2 standard errors as often as 95.4 %, down to the 0.1 % binomial tail."""
    inside = (np.abs(scores) < 2).sum(axis=0)
    low = binom.ppf(0.001, len(scores), 0.954)
    assert np.all(inside >= low), (inside, low)
    assert np.sum(np.abs(scores) > 4) == 0
    assert np.all(scores.std(axis=0) > 0.7), scores.std(axis=0)  # nor are the errors merely large


def test_truth_lies_within_its_standard_errors_as_often_as_stated_for_white_noise():
    assert_honest(standard_scores(rho=0.0, seed=11)[0])


def test_standard_errors_are_honest_when_consecutive_records_are_correlated_and_rho_is_found():
    scores, rhos = standard_scores(rho=0.7, seed=12, n=300)
    assert_honest(scores)
    # s.d. of a lag-1 estimate from 300 records: √((1 − ρ²)/300) = 0.041; of the mean of 60: 0.0053
    assert rhos.mean(axis=0) == pytest.approx(np.full(4, 0.7), abs=0.03)
    assert np.all(np.abs(rhos - 0.7) < 5 * 0.041)


def test_white_noise_is_found_with_its_size():
    engine, rng = ToyEngine(), np.random.default_rng(5)
    noise = run(engine, [fly(engine, rng, 2000)]).noise
    stated = [s.noise_sigma for s in SENSORS.values()]
    assert noise.sigma == pytest.approx(stated, rel=4 / np.sqrt(2 * 2000))
    assert np.all(noise.rho1 < 4 / np.sqrt(2000))
    assert np.all(np.abs(noise.correlation - np.eye(4)) < 4.5 / np.sqrt(2000))


def test_five_per_cent_of_gross_outliers_hardly_move_the_estimates():
    engine, rng = ToyEngine(), np.random.default_rng(6)
    clean = fly(engine, rng, 400)
    columns = dict(clean.columns)
    for s, sensor in SENSORS.items():
        hit = rng.random(400) < 0.05
        columns[s] = np.where(hit, columns[s] + 30 * sensor.noise_sigma, columns[s])
    result = run(engine, [TrainingRecording("dirty", columns)])
    for e in result.estimates:
        assert abs(e.value - TRUTH[e.name]) < 4 * e.standard_error, e
    # each outlier counts as 2.5 standard deviations, which makes the noise larger, never smaller
    stated = np.array([s.noise_sigma for s in SENSORS.values()])
    assert np.all((result.noise.sigma > 0.9 * stated) & (result.noise.sigma < 1.35 * stated))
    assert np.all((result.noise.outliers > 8) & (result.noise.outliers < 35))
    plain = run(engine, [TrainingRecording("dirty", columns)], loss="none")
    worst = max(
        abs(e.value - TRUTH[e.name]) / r.standard_error for e, r in zip(plain.estimates, result.estimates, strict=True)
    )
    assert worst > 5  # without the loss the same outliers do ruin it


def test_what_only_a_product_shows_stays_at_its_prior_and_is_named():
    """Without T3 the compressor's and the turbine's efficiency are seen only through their product."""
    engine = ToyEngine(sensors={s: v for s, v in SENSORS.items() if s != "T3_K"})
    result = run(engine, [fly(engine, np.random.default_rng(7), 400)])
    estimate = {e.name: e for e in result.estimates}
    assert len(result.unidentified) == 1
    combination = result.unidentified[0]
    assert set(combination.parameters[:2]) == {"hpc.efficiency", "hpt.efficiency"}
    assert combination.coefficients[1] == pytest.approx(-1.0, abs=0.05)
    assert combination.from_data < 0.05
    text = str(combination)
    assert "− " in text and "data give" in text
    # the product is 1.0047; the prior splits it evenly, and says so: half of the variance stays
    both = [estimate[n] for n in ("hpc.efficiency", "hpt.efficiency")]
    assert both[0].value - 1 == pytest.approx(both[1].value - 1, rel=0.2)
    assert all(e.status == "weak" and 0.4 < e.from_data < 0.6 for e in both)


def test_a_parameter_that_no_sensor_sees_is_at_its_prior_and_its_error_is_the_prior_s():
    engine = ToyEngine(sensors={s: v for s, v in SENSORS.items() if s != "T45_K"})
    result = run(engine, [fly(engine, np.random.default_rng(7))], parameters=("*",))
    bias = next(e for e in result.estimates if e.name == "sensor.T45.bias")
    assert (bias.value, bias.standard_error, bias.status) == (0.0, pytest.approx(5.0), "at prior")
    assert [c.parameters for c in result.unidentified] == [("sensor.T45.bias",)]


def test_errors_of_a_sensor_that_is_not_recorded_are_not_sought():
    engine = ToyEngine(sensors={s: v for s, v in SENSORS.items() if s != "T45_K"})
    result = run(engine, [fly(engine, np.random.default_rng(7))])
    assert "sensor.T45.bias" not in [e.name for e in result.estimates]


def test_offsets_of_each_recording_are_told_apart_from_the_engine():
    engine, rng = ToyEngine(), np.random.default_rng(8)
    biases = [8.0, -6.0, 3.0, -5.0]
    flights = [fly(engine, rng, 200, f"f{i}", bias={"T3_K": b}) for i, b in enumerate(biases)]
    result = run(engine, flights, recording_bias_sigma={"T3_K": 6.0})
    nominal = result.nominal("e.yaml", "0", {})
    found = [nominal.recording_offsets[f"f{i}"]["T3_K bias"] for i in range(4)]
    # the mean of the four is shared with the engine's parameters; the differences are sharp (1 K/√200 each)
    assert np.diff(found) == pytest.approx(np.diff(biases), abs=0.5)
    for e in result.estimates:
        assert abs(e.value - TRUTH[e.name]) < 4 * e.standard_error, e
    without = run(engine, flights, offsets=False)
    assert without.noise.sigma[0] > 4 * result.noise.sigma[0]


def test_the_order_of_recordings_does_not_matter():
    engine, rng = ToyEngine(), np.random.default_rng(9)
    flights = [fly(engine, rng, 60, f"f{i}", bias={"T45_K": float(i)}) for i in range(3)]
    a = run(engine, flights, recording_bias_sigma={"T45_K": 2.0})
    b = run(engine, flights[::-1], recording_bias_sigma={"T45_K": 2.0})
    assert b.fit.x == pytest.approx(a.fit.x, abs=1e-6)
    assert b.fit.z[::-1] == pytest.approx(a.fit.z, abs=1e-6)
    assert b.uncertainty.covariance == pytest.approx(a.uncertainty.covariance, rel=1e-4, abs=1e-9)


def test_the_unit_of_a_parameter_does_not_matter():
    class PerCent(ToyEngine):
        """The map slope in per cent."""

        def predict(self, inputs, parameters=None, *, sensors=None, wrt=()):
            theta = dict(parameters or {})
            theta["hpc.map.slope"] = theta.get("hpc.map.slope", 0.0) / 100
            p = super().predict(inputs, theta, sensors=sensors, wrt=wrt)
            J = p.jacobian.copy()
            if "hpc.map.slope" in wrt:
                J[:, :, list(wrt).index("hpc.map.slope")] /= 100
            return replace(p, jacobian=J)

    slope = PARAMETERS[3]
    scaled = replace(slope, lower=-100.0, upper=100.0, prior_sigma=20.0)
    recording = fly(ToyEngine(), np.random.default_rng(10))
    a = run(ToyEngine(), [recording])
    b = run(PerCent(parameter_list=(*PARAMETERS[:3], scaled, PARAMETERS[4])), [recording])
    assert b.fit.x == pytest.approx(a.fit.x, abs=1e-8)
    assert b.estimates[3].value == pytest.approx(100 * a.estimates[3].value)
    assert b.estimates[3].standard_error == pytest.approx(100 * a.estimates[3].standard_error)


def test_missing_readings_and_missing_sensors_are_left_out():
    engine, rng = ToyEngine(), np.random.default_rng(13)
    full, part = fly(engine, rng, 300, "full"), fly(engine, rng, 300, "part")
    columns = {c: v.copy() for c, v in part.columns.items() if c != "P3_Pa"}
    columns["Wf_kg_s"][::3] = np.nan
    columns["N1_pct"][:7] = np.nan
    result = run(engine, [full, TrainingRecording("part", columns)])
    assert result.problem.dropped == {"no N1_pct": 7}
    assert result.noise.n.tolist() == [593, 300, 300 + int(np.isfinite(columns["Wf_kg_s"][7:]).sum()), 593]
    for e in result.estimates:
        assert abs(e.value - TRUTH[e.name]) < 4 * e.standard_error, e


def test_a_failing_engine_gives_no_verdict_and_no_nominal():
    engine = ToyEngine(fails=lambda u, p: u["N1_pct"] > 70)
    result = identify(engine, [fly(ToyEngine(), np.random.default_rng(1))])
    assert not result.converged
    assert "no prediction" in result.reason
    assert result.records["hpc: flow balance did not converge"] > 100
    with pytest.raises(ValueError, match="did not converge"):
        result.nominal("e.yaml", "0", {})


def test_a_bound_that_the_data_push_against_is_a_status_of_its_own():
    tight = (replace(PARAMETERS[0], lower=0.995), *PARAMETERS[1:])
    engine = ToyEngine(parameter_list=tight)
    result = run(engine, [fly(engine, np.random.default_rng(1))])
    assert result.estimates[0].status == "at bound"
    assert result.estimates[0].value == 0.995


def test_settings_choose_parameters_by_pattern_and_priors_by_name():
    engine = ToyEngine()
    settings = settings_from_mapping(
        {
            "parameters": ["hp?.efficiency", "sensor.*"],
            "fixed": ["hpt.*"],
            "prior_sigma": {"hpc.efficiency": 0.001},
            "prior_mean": {"sensor.T45.bias": 3.0},
        }
    )
    result = identify(engine, [fly(engine, np.random.default_rng(1))], settings=settings, cross_validation=False)
    assert [e.name for e in result.estimates] == ["hpc.efficiency", "sensor.T45.bias"]
    assert result.estimates[0].prior_sigma == 0.001
    assert result.estimates[1].prior_mean == 3.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"parameters": ("hpc.eficiency",)}, "did you mean 'hpc.efficiency'"),
        ({"recording_bias_sigma": {"T45_C": 1.0}}, "did you mean 'T45_K'"),
        ({"prior_sigma": {"hpc.efficiency": 0.0}}, "must be a positive number"),
        ({"fixed": ("*",)}, "no parameter"),
    ],
)
def test_settings_that_make_no_problem_are_refused_with_a_way_out(settings, words):
    engine = ToyEngine()
    with pytest.raises(DataError, match=words):
        identify(engine, [fly(engine, np.random.default_rng(1))], settings=IdentificationSettings(**settings))


def test_a_recording_without_an_input_is_refused_by_name():
    engine = ToyEngine()
    columns = dict(fly(engine, np.random.default_rng(1)).columns)
    del columns["altitude_m"]
    with pytest.raises(DataError, match=r"day1: lacks the input column altitude_m"):
        identify(engine, [TrainingRecording("day1", columns)])


def test_held_out_records_are_judged_with_the_offsets_of_their_own_recording():
    engine, rng = ToyEngine(), np.random.default_rng(14)
    whole = fly(engine, rng, 400, "f", bias={"T3_K": 7.0})
    first = TrainingRecording("f", {c: v[:300] for c, v in whole.columns.items()})
    rest = TrainingRecording("f", {c: v[300:] for c, v in whole.columns.items()})
    settings = IdentificationSettings(recording_bias_sigma={"T3_K": 5.0})
    result = identify(
        engine,
        [first, fly(engine, rng, 300, "g")],
        settings=settings,
        held_out=[rest],
        cross_validation=False,
    )
    rms = {q.sensor: q.rms for q in result.held_out if q.regime == "all"}
    assert rms["T3_K"] == pytest.approx(1.0, rel=0.3)
    assert all(q.n == 100 for q in result.held_out if q.regime == "all")


def spoilt(recording: TrainingRecording, cells: dict[str, tuple[np.ndarray, float]]) -> TrainingRecording:
    """The recording with a value in some rows of columns."""
    columns = {c: v.copy() for c, v in recording.columns.items()}
    for column, (rows, value) in cells.items():
        columns[column][rows] = value
    return recording._replace(columns=columns)


def test_records_with_a_wrong_input_bend_nothing_and_are_no_place_that_was_flown():
    engine, rng = ToyEngine(), np.random.default_rng(21)
    clean = [fly(engine, rng, 150, f"flight {k}") for k in range(4)]
    wrong = spoilt(clean[1], {"altitude_m": (np.array([20, 21, 90]), -9999.0), "N1_pct": (np.array([50]), 9.0)})
    result = run(engine, [clean[0], wrong, *clean[2:]])
    gone = np.flatnonzero(np.isnan(result.problem.measured).all(axis=1))
    assert (gone - 150).tolist() == [20, 21, 50, 90]
    low = dict(zip(result.envelope.inputs, result.envelope.low, strict=True))
    assert low["altitude_m"] > 900.0 and low["N1_pct"] > 59.0
    for e in result.estimates:
        assert abs(e.value - TRUTH[e.name]) < 4 * e.standard_error, e


def test_readings_that_depart_for_hours_are_no_gross_errors_and_single_ones_are():
    """Hourly records: what lasts for two of them is the engine's or the sensor's own."""
    engine, rng = ToyEngine(), np.random.default_rng(22)
    hourly = fly(engine, rng, 400)
    hourly.columns["time_s"] = 3600.0 * np.arange(400)
    pairs, single = np.sort(np.r_[40:400:40, 41:400:40]), np.arange(60, 400, 80)
    hourly.columns["T3_K"][pairs] += 30.0 * SENSORS["T3_K"].noise_sigma
    hourly.columns["P3_Pa"][single] += 30.0 * SENSORS["P3_Pa"].noise_sigma
    measured = run(engine, [hourly]).problem.measured
    assert np.isfinite(measured[:, list(SENSORS).index("T3_K")]).all()
    assert np.flatnonzero(np.isnan(measured[:, list(SENSORS).index("P3_Pa")])).tolist() == single.tolist()


def test_nothing_is_excluded_where_nothing_is_wrong():
    engine, rng = ToyEngine(), np.random.default_rng(23)
    result = run(engine, [fly(engine, rng, 250, f"flight {k}", rho=0.5) for k in range(4)])
    assert np.isfinite(result.problem.measured).all()
