"""Scores from sums over chunks of records are those of all rows at once; the sums do not depend on how they are cut."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from concealed import WholeRows, carried, evidence, flights, turbofan

from enginediag_cli.drivers import drivers
from enginediag_cli.identification import normal_equations
from enginediag_cli.mismatch.fit import columns as columns_module
from enginediag_cli.mismatch.fit import families
from enginediag_cli.mismatch.fit import projection as projection_module
from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Sums, correlations, first_products, grid
from enginediag_cli.mismatch.fit.freeform import free_form
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, input_values, nuisance
from enginediag_cli.mismatch.fit.options import effect_option, fault_options, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.unexplained import unexplained
from enginediag_cli.physics.registry import candidate_effects

RHO = 0.6
OFFSETS = {"T3_K": 1.5, "N1_rpm": 5.0}


def fitted(rho=0.0, **settings):
    recorded = flights(
        carried(("reynolds_efficiency", "hpc", {"exponent": 0.05})),
        np.random.default_rng(4),
        count=4,
        records=45,
        rho=rho,
    )
    # a gap in one sensor, in the middle of a flight
    recorded[1].columns["T3_K"][10:14] = np.nan
    e = evidence(recorded, rho=rho, map_accuracy=0.003, **settings)
    found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
    assert found.converged
    return found


@pytest.fixture(scope="module", params=["white", "correlated", "offsets", "correlated with offsets"])
def found(request):
    rho = RHO if "correlated" in request.param else 0.0
    return fitted(rho, **({"offsets": OFFSETS} if "offsets" in request.param else {}))


def along(found):
    theta = {n: v for n, v in found.theta.items() if n in found.evidence.engine.parameters}
    return drivers(found.evidence.engine, input_values(found.evidence), theta)[:3]


def rows_of(projection, J, curves, chosen):
    """Projected rows of candidates, and their lengths before, by the QR of all rows at once."""
    dense = WholeRows(projection)
    wide = np.stack([J[name] * curve[:, None] for name, curve in ((n, curves[:, c]) for n, c in chosen)], axis=2)
    C = np.concatenate([projection.frame.rows(wide), np.zeros((dense.Q.shape[1], len(chosen)))])
    return C - dense.Q @ (dense.Q.T @ C), np.linalg.norm(C, axis=0)


def test_nuisance_reduced_by_chunks_is_that_of_all_rows(found):
    projection = Projection(found)
    dense, p = WholeRows(projection), len(projection.R)
    left = dense.e - dense.Q @ (dense.Q.T @ dense.e)
    assert projection.objective == pytest.approx(left @ left, rel=1e-11)
    np.testing.assert_allclose(projection.left, left[: projection.dof], atol=1e-9)
    inverse = np.linalg.inv(dense.R)
    np.testing.assert_allclose(projection.covariance(), (inverse @ inverse.T)[:p, :p], rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(projection.step, np.linalg.solve(dense.R, dense.Q.T @ dense.e)[:p], atol=1e-9)


def test_scores_from_sums_are_those_of_all_rows(found):
    projection = Projection(found)
    dense = WholeRows(projection)
    left = dense.e - dense.Q @ (dense.Q.T @ dense.e)
    cells = free_form(found, projection, along(found))
    family, J = cells[0].sums.family, cells[0].sums.columns
    assert any(not c.score.absorbed for c in cells)
    for c in cells:
        chosen = [(family.names[n], k) for n, k in c.candidates]
        C, full = rows_of(projection, J, family.curves, chosen)
        u, s, vt = np.linalg.svd(C, full_matrices=False)
        keep = s > projection_module.NEGLIGIBLE * full[0]
        w = u[:, keep].T @ left
        assert c.score.length == pytest.approx(np.linalg.norm(C[:, 0]), rel=1e-6, abs=1e-6 * full[0])
        if c.score.absorbed or (s[-1] < 1e-4 * full[0] and keep.all()):
            continue
        assert c.score.dof == keep.sum()
        assert c.score.statistic == pytest.approx(w @ w, rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(c.score.coefficients, vt[keep].T @ (w / s[keep]), rtol=1e-5, atol=1e-9)


def test_products_of_all_candidates_are_those_of_their_rows(found):
    projection = Projection(found)
    options = [*map(effect_option, list(candidate_effects(turbofan()))[:12]), *fault_options(found)[:40]]
    scores = [s for s in option_scores(found, projection, options) if not s.score.absorbed]
    curves = np.column_stack(
        [next(iter(s.option.hypothesis.curves.values()), np.ones(len(found.number)))[found.number] for s in scores]
    )
    chosen = [(s.sums.family.names[s.candidates[0, 0]], k) for k, s in enumerate(scores)]
    C, full = rows_of(projection, scores[0].sums.columns, curves, chosen)
    G = first_products(scores)
    np.testing.assert_allclose(G, C.T @ C, atol=1e-9 * full.max() ** 2)
    faults = [s for s in scores if s.option.hypothesis.discrepancies]
    R, dofs = correlations(faults)
    U = C[:, [k for k, s in enumerate(scores) if s.option.hypothesis.discrepancies]]
    U = U / np.linalg.norm(U, axis=0)
    assert dofs == [1] * len(faults)
    np.testing.assert_allclose(np.abs(R), np.abs(U.T @ U), atol=1e-6)


def test_a_name_with_each_curve_alone_has_the_products_of_its_blocks(found):
    projection, names = Projection(found), ["hpc.efficiency", "lpt.flow_capacity"]
    curves = np.random.default_rng(5).standard_normal((len(found.number), 4))
    sums = Sums(projection, Columns(found, names, ()), grid(names, curves, [[k] for k in range(4)]))
    for name in range(2):
        each = [sums.gram(np.array([[name, k]]))[0, 0] for k in range(4)]
        assert np.allclose(sums.alone(name), each, rtol=1e-12)


def test_rows_of_a_fitted_block_are_those_of_the_projection(found):
    projection = Projection(found)
    cell = next(c for c in free_form(found, projection, along(found)) if not c.score.absorbed and c.score.dof > 1)
    family = cell.sums.family
    C, _ = rows_of(projection, cell.sums.columns, family.curves, [(family.names[n], k) for n, k in cell.candidates])
    made = cell.sums.rows_along(cell.candidates, cell.score.coefficients)[projection.frame.keep]
    np.testing.assert_allclose(made, (C @ cell.score.coefficients)[: projection.dof], atol=1e-8)


def test_what_is_left_off_the_space_of_all_candidates_is_that_of_all_rows(found):
    projection = Projection(found)
    cells = [c for c in free_form(found, projection, along(found)[:1]) if not c.score.absorbed][:15]
    family, n = cells[0].sums.family, projection.dof
    chosen = [(family.names[i], k) for c in cells for i, k in c.candidates]
    C, _ = rows_of(projection, cells[0].sums.columns, family.curves, chosen)
    A = np.concatenate([WholeRows(projection).Q[:n], C[:n]], axis=1)
    U, s, _ = np.linalg.svd(A / np.linalg.norm(A, axis=0), full_matrices=False)
    U = U[:, s**2 > 1e-8 * s[0] ** 2]
    got = unexplained(projection, cells, 1.0)
    free, sensor = 1.0 - (U**2).sum(axis=1), projection.frame.sensor
    # the trace is drawn: to some per cent of what the space takes
    belongs_to_sensor = [free[sensor == s].mean() for s in range(len(got.free))]
    np.testing.assert_allclose(got.free, belongs_to_sensor, atol=0.02)
    unit, taken = A / np.linalg.norm(A, axis=0), projection.left - got.left
    np.testing.assert_allclose(unit.T @ got.left, 0.0, atol=1e-3 * np.linalg.norm(got.left))
    np.testing.assert_allclose(unit @ np.linalg.lstsq(unit, taken, rcond=None)[0], taken, atol=1e-5)


def test_chunks_of_any_length_give_the_same(found, monkeypatch):
    whole = Projection(found)
    cells = free_form(found, whole, along(found))
    monkeypatch.setattr(normal_equations, "CHUNK_RECORDS", 17)
    monkeypatch.setattr(families, "AT_ONCE", 5)
    for kept in (0, projection_module.KEPT_BYTES):
        monkeypatch.setattr(projection_module, "KEPT_BYTES", kept)
        monkeypatch.setattr(columns_module, "KEPT_BYTES", kept)
        cut = Projection(found)
        assert cut.objective == pytest.approx(whole.objective, rel=1e-9)
        again = {(c.location.name, c.driver.name): c for c in free_form(found, cut, along(found))}
        for c in cells:
            other = again[c.location.name, c.driver.name]
            assert other.score.statistic == pytest.approx(c.score.statistic, rel=1e-6, abs=1e-9)


def test_a_small_problem_by_hand():
    found = fitted()
    projection = Projection(found)
    name = "hpc.efficiency"
    J = Columns(found, [name], [])
    ramp = np.linspace(-1.0, 1.0, len(found.number))[:, None]
    sums = Sums(projection, J, grid([name], ramp, [[0]]))
    c = (np.where(projection.frame.keep, J[name] * ramp, 0.0) / found.problem.sigma)[projection.frame.keep]
    dense = WholeRows(projection)
    A = dense.Q[: len(c)] @ dense.R
    inside = np.linalg.solve(A.T @ A + np.eye(A.shape[1]), A.T @ c)
    assert sums.gram(np.array([[0, 0]]))[0, 0] == pytest.approx(c @ c - (A.T @ c) @ inside, rel=1e-8)


@pytest.mark.slow
def test_memory_of_the_map_does_not_grow_with_the_columns_of_every_record(monkeypatch):
    monkeypatch.setattr(projection_module, "KEPT_BYTES", 0)
    monkeypatch.setattr(columns_module, "KEPT_BYTES", 0)
    monkeypatch.setattr(normal_equations, "CHUNK_RECORDS", 100)
    monkeypatch.setattr(families, "AT_ONCE", 50)
    peaks, records = [], (400, 1600)
    for n in records:
        e = evidence(flights([], np.random.default_rng(8), count=4, records=n // 4))
        found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
        drivers_there = along(found)
        tracemalloc.start()
        projection = Projection(found)
        assert free_form(found, projection, drivers_there)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # columns of fifty places along three drivers, nine sensors, would be 9 · 50 · 7 numbers of 8 bytes a record
    held = (peaks[1] - peaks[0]) / (records[1] - records[0])
    assert held < 9 * 50 * 7 * 8 / 5


def test_any_curve_at_a_place_has_the_products_of_its_columns(found):
    projection, rng = Projection(found), np.random.default_rng(11)
    columns = Columns(found, ["hpc.efficiency", "hpc.flow_capacity"], [])
    N = len(found.problem.recording)
    curves = rng.normal(size=(N, 6)) + rng.normal(size=6)
    family = grid(["hpc.flow_capacity"], curves, [[0, 1, 2], [3, 4, 5]])
    sums, any_curve = Sums(projection, columns, family), AnyCurve.at(projection, columns, "hpc.flow_capacity")
    of = np.column_stack([np.zeros(6, int), np.arange(6)])
    np.testing.assert_allclose(any_curve.pulls(curves), sums.pulls(of), rtol=1e-8, atol=1e-8)
    blocks = any_curve.grams(curves.reshape(N, 2, 3))
    for k in range(2):
        np.testing.assert_allclose(blocks[k], sums.gram(of[3 * k : 3 * k + 3]), rtol=1e-7, atol=1e-7)
