"""Parametric maps: the design point, monotony from windmilling to full power, and exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import fourth_order, gradient, seeds

from enginediag_cli.engine import maps

LOSS = 0.13
COMPRESSOR = {f.name: f.default for f in maps.COMPRESSOR_FIELDS}
STEEP = {
    **COMPRESSOR,
    "work_slope": 6.0,
    "choking_exponent": 12.0,
    "loss_incidence": 30.0,
    "loss_speed": 5.0,
    "loss_speed_slope": 0.5,
    "work_speed_exponent": 1.7,
    "flow_speed_exponent": 2.5,
}
TURBINE = {f.name: f.default for f in maps.TURBINE_FIELDS}


@pytest.mark.parametrize("shape", [COMPRESSOR, STEEP], ids=["default", "steep"])
def test_the_compressor_map_is_unity_at_design(shape):
    work, loss = maps.work_and_loss(np.ones(1), np.ones(1), LOSS, shape)
    assert work[0] == pytest.approx(1.0, abs=1e-15)
    assert loss[0] == pytest.approx(LOSS, abs=1e-15)


@pytest.mark.parametrize("shape", [COMPRESSOR, STEEP], ids=["default", "steep"])
def test_work_falls_with_flow_along_every_speed_line(shape):
    for n in (0.1, 0.3, 0.6, 0.9, 1.0, 1.1):
        w = np.linspace(0.2, 1.5, 200) * n ** shape["flow_speed_exponent"]
        work, _ = maps.work_and_loss(np.full(200, n), w, LOSS, shape)
        assert (np.diff(work) < 0.0).all()


def test_work_rises_with_speed_at_constant_flow():
    n = np.linspace(0.3, 1.15, 100)
    for w in (0.1, 0.4, 0.8, 1.0):
        work, _ = maps.work_and_loss(n, np.full(100, w), LOSS, COMPRESSOR)
        assert (np.diff(work) > 0.0).all()


@pytest.mark.parametrize("shape", [COMPRESSOR, STEEP], ids=["default", "steep"])
def test_the_windmilling_region_is_finite_and_takes_work_from_the_air(shape):
    n, w = np.full(50, 0.15), np.linspace(0.2, 0.6, 50)
    work, loss = maps.work_and_loss(n, w, LOSS, shape)
    assert np.isfinite(work).all()
    assert np.isfinite(loss).all()
    assert work[-1] < 0.0


def test_loss_is_least_at_the_design_flow_coefficient():
    w = np.linspace(0.7, 1.3, 601)
    _, loss = maps.work_and_loss(np.ones(601), w, LOSS, COMPRESSOR)
    assert w[loss.argmin()] == pytest.approx(1.0, abs=1e-3)


def test_the_compressor_map_has_exact_derivatives_in_speed_flow_and_every_coefficient():
    n = np.array([0.3, 0.8, 1.0, 1.08])
    w = np.array([1.1, 0.9, 1.0, 0.97]) * n ** STEEP["flow_speed_exponent"]
    duals = seeds(n, w, *(np.full(4, STEEP[k]) for k in maps.COMPRESSOR_COEFFICIENTS))
    found = maps.work_and_loss(
        duals[0], duals[1], LOSS, dict(zip(maps.COMPRESSOR_COEFFICIENTS, duals[2:], strict=True))
    )

    def at(k, t, which):
        moved = [n, w, *(np.full(4, STEEP[c]) for c in maps.COMPRESSOR_COEFFICIENTS)]
        moved[k] = moved[k] + t
        return maps.work_and_loss(
            moved[0], moved[1], LOSS, dict(zip(maps.COMPRESSOR_COEFFICIENTS, moved[2:], strict=True))
        )[which]

    for which, y in enumerate(found):
        for k in range(len(duals)):
            numeric = fourth_order(lambda t, k=k, which=which: at(k, t, which), 1e-4)
            assert np.allclose(gradient(y, len(duals))[k], numeric, rtol=1e-7, atol=1e-8)


def test_coefficients_may_differ_from_point_to_point():
    n, w = np.array([0.7, 0.95]), np.array([0.65, 0.9])
    each = {k: np.array([v, 1.05 * v + 0.01]) for k, v in COMPRESSOR.items()}
    together = maps.work_and_loss(n, w, LOSS, each)
    for k in range(2):
        alone = maps.work_and_loss(n[k : k + 1], w[k : k + 1], LOSS, {c: float(v[k]) for c, v in each.items()})
        assert np.allclose([y[k] for y in together], [y[0] for y in alone], rtol=1e-14)


def test_the_turbine_map_is_unity_at_design():
    design = np.log(3.2)
    assert maps.relative_capacity(np.full(1, design), np.ones(1), design, TURBINE)[0] == pytest.approx(1.0)
    assert maps.relative_efficiency(np.ones(1), TURBINE)[0] == 1.0


def test_turbine_capacity_rises_with_pressure_ratio_and_saturates():
    log_ratio = np.linspace(1e-4, np.log(12.0), 400)
    capacity = maps.relative_capacity(log_ratio, np.ones(400), np.log(3.0), TURBINE)
    assert (np.diff(capacity) > 0.0).all()
    assert capacity[-1] < 1.02
    assert capacity[0] < 0.05


def test_turbine_capacity_is_that_of_stodolas_ellipse_for_exponent_two():
    ratio = np.array([1.2, 1.8, 3.0])
    found = maps.relative_capacity(np.log(ratio), np.ones(3), np.log(4.0), {**TURBINE, "choking_exponent": 2.0})
    assert np.allclose(found, np.sqrt(1.0 - ratio**-2.0) / np.sqrt(1.0 - 4.0**-2.0))


def test_turbine_capacity_falls_with_speed_by_the_slope():
    shape = {**TURBINE, "capacity_speed_slope": 0.2}
    found = maps.relative_capacity(np.full(2, np.log(3.0)), np.array([0.9, 1.1]), np.log(3.0), shape)
    assert np.allclose(found, [1.02, 0.98])


def test_turbine_efficiency_is_best_at_the_design_blade_speed_ratio():
    ratio = np.linspace(0.6, 1.4, 81)
    found = maps.relative_efficiency(ratio, TURBINE)
    assert ratio[found.argmax()] == pytest.approx(1.0)
    assert found[0] == pytest.approx(1.0 - 0.5 * 0.16)
