"""Identification of an engine whose maps are wrong: a turbojet whose records come from distorted maps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from enginediag_cli.error_model.maps import FAMILY, QUANTITIES, MapErrorModel, learn_curves, turbomachines
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.map_error import EXCITED
from enginediag_cli.identification.nominal_checks import NONE, set_map_accuracy
from enginediag_cli.identification.nominal_file import read_nominal, write_nominal
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

STATED = 0.003
HEALTH = {"compressor.efficiency": 0.985}


@cache
def engine():
    return load_engine(str(shipped("turbojet.yaml")))


@cache
def flown(seed, n=80):
    """Operating points (n,) of one flight."""
    e, rng = engine(), np.random.default_rng(seed)
    h = rng.uniform(0, 10_000, n)
    u = {"altitude_m": h, "mach": 0.3 + 0.5 * h / 11_000, "dT_isa_K": np.full(n, rng.normal(0, 8))}
    u[e.power_setting] = e.power_from_fraction(rng.uniform(0.3, 1, n), u)
    return u


@cache
def truth():
    """The engine with map errors whose curves cover the flights."""
    e, flights = engine(), [flown(k) for k in range(3)]
    machines = turbomachines(e)
    columns = tuple(dict.fromkeys(c for m in machines for c in m.columns))
    u = {c: np.concatenate([f[c] for f in flights]) for c in e.inputs}
    values = dict(zip(columns, e.predict(u, sensors=columns).y.T, strict=True))
    curves = [learn_curves(m.name, m.coordinates(values)) for m in machines]
    return MapErrorModel(e, curves, {m.parameter(q): STATED for m in machines for q in QUANTITIES})


def amounts(size):
    rng = np.random.default_rng(5)
    return {n: size * rng.standard_normal() for names in truth().groups.values() for n in names}


def recorded(k, size, seed=0):
    e, rng, u = engine(), np.random.default_rng([seed, k]), flown(k)
    p = truth().predict(u, {**HEALTH, **amounts(size)}, sensors=tuple(e.sensors))
    assert p.ok.all()
    sigma = np.array([s.noise_sigma for s in e.sensors.values()])
    y = p.y + sigma * rng.standard_normal(p.y.shape)
    return TrainingRecording(f"flight {k}", {**u, **dict(zip(p.columns, y.T, strict=True))})


@cache
def found(size, accuracy=None):
    """Identification from three flights of an engine whose maps are wrong by `size`; a fourth judges it."""
    flights = [recorded(k, size) for k in range(3)]
    result = identify(engine(), flights, held_out=[recorded(9, size)], cross_validation=False, map_accuracy=accuracy)
    assert result.converged, result.reason
    return result


def unseen(result):
    """RMS of each sensor on the flight that the fit has not seen."""
    return {s: np.sqrt(np.average([q.rms**2 for q in result.held_out if q.sensor == s])) for s in engine().sensors}


def test_wrong_maps_are_found_to_be_wrong_and_predictions_get_better():
    wrong, trusted = found(0.015), found(0.015, 0.0)
    sizes = {m.target: m.estimated / m.stated for m in wrong.map_errors}
    assert set(sizes) == {
        "compressor.efficiency",
        "compressor.flow_capacity",
        "turbine.efficiency",
        "turbine.flow_capacity",
    }
    assert all(v >= 1.0 - 1e-9 for v in sizes.values()) and sorted(sizes.values())[-2] > 2
    better = [unseen(wrong)[c] / unseen(trusted)[c] for c in engine().sensors]
    assert max(better) < 1.0 and np.mean(better) < 0.9, better
    # what the maps are wrong by no longer passes for noise
    stated = np.array([engine().sensors[c].noise_sigma for c in wrong.problem.sensors])
    assert np.all(wrong.noise.sigma < 1.2 * stated) and np.max(trusted.noise.sigma / stated) > 2


def test_sizes_and_amounts_are_of_the_truth():
    """Over four quantities with five amounts each the rms of what was drawn is known to a fifth."""
    result = found(0.015)
    rms = np.sqrt(np.mean([(m.estimated) ** 2 for m in result.map_errors]))
    drawn = np.sqrt(np.mean(np.square(list(amounts(0.015).values()))))
    assert 0.4 * drawn < rms < 1.5 * drawn


def test_maps_that_are_right_stay_at_what_is_stated():
    result = found(0.0)
    assert all(m.estimated < 1.2 * m.stated for m in result.map_errors) and len(result.map_errors) == 4
    estimate = {e.name: e for e in result.estimates}
    own = estimate["compressor.efficiency"]
    assert abs(own.value - HEALTH["compressor.efficiency"]) < 3 * own.standard_error


def test_a_health_parameter_is_known_less_well_where_the_maps_may_be_wrong():
    errors = [
        next(e.standard_error for e in found(0.0, a).estimates if e.name == "compressor.efficiency")
        for a in (0.0, None)
    ]
    assert errors[0] < errors[1] < engine().parameters["compressor.efficiency"].prior_sigma


def test_maps_that_are_trusted_or_absent_have_no_error_model():
    assert found(0.0, 0.0).nominal("", "", {}).error_model is None
    assert not any(e.family == FAMILY for e in found(0.0, 0.0).estimates)


def test_a_nominal_file_carries_the_error_model(tmp_path):
    nominal = found(0.015).nominal("configs/turbojet.yaml", "00ff", {})
    write_nominal(nominal, tmp_path / "nominal.yaml")
    again = read_nominal(tmp_path / "nominal.yaml")
    assert again.error_model == nominal.error_model
    assert again.error_model.stated == STATED
    assert dict(again.error_model.sizes) == {m.target: m.estimated for m in found(0.015).map_errors}
    u, theta = flown(9), nominal.theta0
    one, two = (n.error_model.wrap(engine()).predict(u, theta).y for n in (nominal, again))
    np.testing.assert_array_equal(one, two)
    # and what it predicts is what the fit predicts: near the readings of a flight that it has not seen
    columns = recorded(9, 0.015).columns
    sigma = np.array([s.noise_sigma for s in engine().sensors.values()])
    y = np.column_stack([columns[c] for c in engine().sensors])
    plain = engine().predict(u, nominal.engine_values).y
    assert np.mean(((y - one) / sigma) ** 2) < 0.5 * np.mean(((y - plain) / sigma) ** 2)


def test_the_accuracy_that_was_found_gives_the_nominal_state_back():
    """Where all sizes stayed at what is stated, that accuracy is the one that they have."""
    nominal = found(0.0).nominal("", "", {})
    scale = {e.name: STATED if e.family == FAMILY else e.prior_sigma for e in nominal.estimates}
    level = replace(nominal, estimates=tuple(replace(e, prior_sigma=scale[e.name]) for e in nominal.estimates))
    same = set_map_accuracy(level, STATED)
    np.testing.assert_allclose([e.value for e in same.estimates], [e.value for e in level.estimates], atol=1e-6)
    np.testing.assert_allclose(
        [e.standard_error for e in same.estimates], np.sqrt(np.diag(level.covariance)), rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(same.covariance, level.covariance, atol=1e-9)


def test_an_accuracy_of_none_gives_nearly_what_identification_without_map_errors_gives():
    """Exact up to the noise, which each fit estimates for itself, and the point at which each is linear."""
    none = set_map_accuracy(found(0.0).nominal("", "", {}), 0.0)
    trusted = {e.name: e for e in found(0.0, 0.0).estimates}
    for e in none.estimates:
        if e.family == FAMILY:
            assert abs(e.value) < 1e-6 and e.standard_error <= 1.001 * NONE * STATED * 2
            continue
        assert abs(e.value - trusted[e.name].value) < 0.3 * trusted[e.name].standard_error, e.name
        assert e.standard_error == pytest.approx(trusted[e.name].standard_error, rel=0.1), e.name


def test_there_and_back_is_where_it_began():
    nominal = set_map_accuracy(found(0.0).nominal("", "", {}), STATED)
    back = set_map_accuracy(set_map_accuracy(nominal, 0.01), STATED)
    np.testing.assert_allclose([e.value for e in back.estimates], [e.value for e in nominal.estimates], atol=1e-6)
    np.testing.assert_allclose(back.covariance, nominal.covariance, rtol=1e-5, atol=1e-10)
    assert back.error_model == nominal.error_model


def test_the_poorer_the_maps_the_wider_every_answer():
    nominal = found(0.0).nominal("", "", {})
    errors = [[e.standard_error for e in set_map_accuracy(nominal, a).estimates] for a in (0.0, 0.003, 0.01, 0.05)]
    assert np.all(np.diff(errors, axis=0) >= -1e-12)


def test_sizes_that_several_machines_could_have_settle():
    """A turbofan: ten map quantities, of which nine sensors tell some only together."""
    e = load_engine(str(shipped("turbofan.yaml")))
    machines = turbomachines(e)
    columns = tuple(dict.fromkeys(c for m in machines for c in m.columns))
    flights = []
    for k in range(3):
        rng = np.random.default_rng(k)
        h = rng.uniform(0, 10_000, 80)
        u = {"altitude_m": h, "mach": 0.3 + 0.5 * h / 11_000, "dT_isa_K": np.full(80, rng.normal(0, 8))}
        flights.append(u | {e.power_setting: e.power_from_fraction(rng.uniform(0.3, 1, 80), u)})
    every = {c: np.concatenate([u[c] for u in flights]) for c in e.inputs}
    values = dict(zip(columns, e.predict(every, sensors=columns).y.T, strict=True))
    curves = [learn_curves(m.name, m.coordinates(values)) for m in machines]
    wrong = MapErrorModel(e, curves, {m.parameter(q): STATED for m in machines for q in QUANTITIES})
    rng = np.random.default_rng(5)
    drawn = {n: 0.005 * rng.standard_normal() for names in wrong.groups.values() for n in names}
    recordings = []
    for k, u in enumerate(flights):
        noise = np.random.default_rng(100 + k)
        p = wrong.predict(u, {"hpc.efficiency": 0.985, **drawn}, sensors=tuple(e.sensors))
        read = {c: p.y[:, j] + e.sensors[c].noise_sigma * noise.standard_normal(80) for j, c in enumerate(p.columns)}
        recordings.append(TrainingRecording(f"flight {k}", {**u, **read}))
    result = identify(e, recordings, cross_validation=False)
    assert result.converged, result.reason
    ratio = np.array([m.estimated / m.stated for m in result.map_errors])
    assert len(ratio) == 10 and np.all((ratio >= 1 - 1e-9) & (ratio < 4))
    own = next(x for x in result.estimates if x.name == "hpc.efficiency")
    assert abs(own.value - 0.985) < 3 * own.standard_error


def test_amounts_that_hardly_act_do_not_say_how_large_errors_are():
    """One operating point, but for a thousandth of power: a curve across next to nothing could follow anything, and had
    compressor maps found five times as wrong as stated."""
    e, n = engine(), 200
    beside = np.random.default_rng(7).uniform(-1, 1, n)
    u = {c: np.full(n, v[0]) for c, v in flown(0).items()}
    u[e.power_setting] = u[e.power_setting] * (1 + 0.001 * beside)
    p = e.predict(u, {}, sensors=tuple(e.sensors))
    sigma = np.array([s.noise_sigma for s in e.sensors.values()])
    y = p.y + sigma * np.random.default_rng(0).standard_normal(p.y.shape) + sigma * beside[:, None]
    columns = {**u, "time_s": np.arange(n) * 1.0, **dict(zip(p.columns, y.T, strict=True))}
    result = identify(e, [TrainingRecording("a", columns)], cross_validation=False)
    excitation = result.problem.model.excitation(result.problem.inputs)
    assert excitation["map_error.compressor.flow_capacity.1"] < EXCITED
    assert all(m.estimated < 1.1 * STATED for m in result.map_errors)
