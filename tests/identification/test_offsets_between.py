"""Offsets of outputs and inputs between recordings: allowed for, found, and told with what they rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification_toy import ToyEngine, fly

from enginediag_cli.errors import DataError
from enginediag_cli.identification.covariance import uncertainty
from enginediag_cli.identification.gauss_newton import solve
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.instruments import (
    COMMON,
    LEAST,
    OWN,
    USUAL_OUTPUT,
    ArrowData,
    add_offsets,
    likeliest_offsets,
    log_likelihood,
    size_uncertainties,
)
from enginediag_cli.identification.noise import NEIGHBOURS
from enginediag_cli.identification.normal_equations import blocks, normal_equations
from enginediag_cli.identification.problem import IdentificationSettings, OffsetPrior, build_problem


def flights(biases, seed=0, n=60, **more):
    rng, engine = np.random.default_rng(seed), ToyEngine()
    return [fly(engine, rng, n, f"f{k}", bias={"T3_K": b}) for k, b in enumerate(biases)]


def offsets_of(recordings, **more):
    result = identify(ToyEngine(), recordings, cross_validation=False, **more)
    assert result.converged, result.reason
    return {(o.sensor, o.kind): o for o in result.problem.offsets}, result


def test_scatter_between_recordings_is_found_and_told_with_how_many_they_are():
    found, result = offsets_of(flights((4.0, -4.0, 2.0, -3.0, 3.0, -2.0)))
    zero, span = found["T3_K", "bias"], found["T3_K", "scale"]
    level = float(np.nanmedian(result.problem.measured[:, 0]))
    # six offsets of 3.1 K root mean square; bias and span are hardly told apart at one level of temperature
    assert np.hypot(zero.prior_sigma, level * span.prior_sigma) == pytest.approx(3.1, rel=0.5)
    assert zero.recordings == 6
    assert found["P3_Pa", "bias"].prior_sigma < USUAL_OUTPUT * 3e3  # where there is none, less than is usual
    nominal = result.nominal("e.yaml", "0", {})
    assert nominal.offsets == result.problem.offsets
    assert set(nominal.recording_offsets) == {f"f{k}" for k in range(6)}


def test_where_there_is_none_little_is_allowed_for():
    found, result = offsets_of(flights((0.0,) * 8, seed=1, n=200))
    for column in result.problem.sensors:
        assert found[column, "bias"].prior_sigma < 0.2 * result.problem.model.sensors[column].noise_sigma


def test_one_engine_and_several_recordings_are_needed():
    few = flights((4.0, -4.0))
    assert len(few) < LEAST
    assert not offsets_of(few)[0]
    fleet = [r._replace(engine=str(k)) for k, r in enumerate(flights((4.0, -4.0, 2.0)))]
    assert not offsets_of(fleet)[0]  # engines differ by themselves
    assert not offsets_of(flights((4.0, -4.0, 2.0)), offsets=False)[0]


def test_what_is_stated_stays():
    settings = IdentificationSettings(recording_bias_sigma={"T3_K": 6.0})
    found, _ = offsets_of(flights((1.0, -1.0, 0.0)), settings=settings)
    assert found["T3_K", "bias"] == OffsetPrior("T3_K", "bias", 6.0)
    assert ("T3_K", "scale") not in found


def test_a_further_recording_differs_by_a_size_that_is_integrated_out():
    assert OffsetPrior("T3_K", "bias", 2.0).next_sigma == 2.0  # stated
    prior = OffsetPrior("T3_K", "bias", 2.0, 4, 0.6)
    sizes = 2.0 * np.exp(0.6 * np.random.default_rng(0).standard_normal(400_000))
    offsets = sizes * np.random.default_rng(1).standard_normal(400_000)
    assert prior.next_sigma == pytest.approx(np.std(offsets), rel=0.01)


def test_sizes_are_known_the_better_the_more_recordings_show_them():
    few, many = (
        offsets_of(flights(5.0 * np.random.default_rng(7).standard_normal(count), seed=4))[0]["T3_K", "bias"]
        for count in (4, 24)
    )
    assert 0.0 < many.spread < few.spread
    # R offsets that are seen exactly tell ln s with a standard error of 1/sqrt(2 R)
    assert many.spread == pytest.approx(1.0 / np.sqrt(2.0 * 24.0), rel=0.2)
    quiet = offsets_of(flights((0.0,) * 5, seed=1))[0]["P3_Pa", "bias"]
    assert quiet.spread > many.spread  # what noise hides is not known to be nothing


def test_spread_is_that_of_the_posterior_of_one_size_seen_directly():
    # one offset of each of R recordings, seen with information h: the integral over ln s is done on a grid
    R, h = 6, 400.0
    z = np.array([1.1, -0.7, 0.4, -1.3, 0.9, -0.2])
    data = ArrowData(np.zeros((1, 1)), np.zeros((R, 1, 1)), np.full((R, 1, 1), h), np.zeros(1), h * z[:, None])
    t = likeliest_offsets(data, np.ones(1), np.ones(1), np.array([True]))
    scaled = ArrowData(data.H_xx, data.H_xz * t, data.H_zz * t * t, data.b_x, data.b_z * t)
    grid = np.linspace(-3.0, 3.0, 4001)
    posterior = np.array([log_likelihood(scaled, np.exp([g]))[0] for g in grid])
    posterior -= 0.5 * (grid + np.log(t[0])) ** 2 / (COMMON**2 + OWN**2)
    w = np.exp(posterior - posterior.max())
    exact = np.sqrt(np.sum(w * grid**2) / w.sum() - (np.sum(w * grid) / w.sum()) ** 2)
    assert size_uncertainties(scaled, np.array([True]))[0] == pytest.approx(exact, rel=0.15)


def test_an_offset_of_an_input_may_be_stated_and_is_what_a_judged_recording_may_differ_by():
    settings = IdentificationSettings(recording_bias_sigma={"altitude_m": 15.0, "T3_K": 2.0})
    found, result = offsets_of(flights((1.0, -1.0, 0.0)), settings=settings)
    assert found["altitude_m", "bias"] == OffsetPrior("altitude_m", "bias", 15.0)
    assert result.problem.offsets[-1].sensor == "altitude_m"  # those of inputs come last
    with pytest.raises(DataError, match="altitude_m"):
        identify(ToyEngine(), flights((0.0,)), settings=IdentificationSettings(recording_bias_sigma={"altitud": 1.0}))


@pytest.fixture
def problem():
    recordings = flights((1.0, -1.0, 0.0), n=20)
    return add_offsets(build_problem(ToyEngine(), recordings, IdentificationSettings()), recordings)


def test_sensitivities_to_offsets_are_those_of_differences(problem):
    x, q = np.zeros(len(problem.parameters)), len(problem.offsets)
    assert problem.input_offsets == 1  # of altitude; a speed in per cent is nobody's instrument here
    z = 0.3 * np.random.default_rng(2).standard_normal((3, q))
    (block,) = blocks(problem, x, z)
    found, step = block.offset_columns(problem), 1e-4
    for j in range(q):
        move = np.where(np.arange(q) == j, step, 0.0)
        (up,), (down,) = blocks(problem, x, z + move), blocks(problem, x, z - move)
        expected = (up.predicted - down.predicted) / (2 * step)
        assert found[:, :, j] == pytest.approx(expected, rel=1e-4, abs=1e-6 * np.abs(expected).max())


def test_normal_equations_are_sums_over_records_and_sensors(problem):
    q, rng = len(problem.offsets), np.random.default_rng(3)
    x, z = 0.1 * rng.standard_normal(len(problem.parameters)), 0.3 * rng.standard_normal((3, q))
    n = normal_equations(problem, x, z)
    (block,) = blocks(problem, x, z)
    G = block.offset_columns(problem)
    e = (problem.measured - block.predicted) / problem.sigma
    w = problem.loss.weight(e) / (problem.sigma**2 * problem.inflation)
    for r in range(3):
        own = problem.recording == r
        H = np.einsum("nmi,nm,nmj->ij", G[own], w[own], G[own])
        assert n.H_zz[r] == pytest.approx(H, rel=1e-9, abs=1e-9 * np.abs(H).max())
        cross = np.einsum("nmi,nm,nmj->ij", block.jacobian[own], w[own], G[own])
        assert n.H_xz[r] == pytest.approx(cross, rel=1e-9, abs=1e-9 * np.abs(cross).max())
        pull = np.einsum("nmi,nm->i", G[own], w[own] * e[own] * problem.sigma)
        assert n.g_z[r] == pytest.approx(-pull, rel=1e-9, abs=1e-9)


def test_offsets_take_of_products_of_neighbours_as_many_as_there_are(problem):
    start = (np.zeros(len(problem.parameters)), np.zeros((3, len(problem.offsets))))
    fit, rho = solve(problem, start, max_iterations=50), np.zeros(len(problem.sensors))
    sparse = replace(problem, position=np.floor(problem.position / 4) * 20 + problem.position % 4)
    every, some = (uncertainty(p, fit, rho).absorbed[1] for p in (problem, sparse))
    share = np.sum(sparse.gap <= NEIGHBOURS) / np.sum(problem.gap <= NEIGHBOURS)
    assert share == pytest.approx(15 / 19)
    assert some == pytest.approx(share * every, rel=0.15)
