"""The parts of a map: order of residuals, steps in time, resampling."""

from __future__ import annotations

import numpy as np
import pytest
from concealed import carried, evidence, flights

from enginediag_cli.drivers import drivers
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Settings
from enginediag_cli.mismatch.fit.freeform import free_form, machine_cells
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, input_values, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.locate.presence import von_neumann
from enginediag_cli.mismatch.locate.stability import resampled_surprise, units
from enginediag_cli.mismatch.locate.time_steps import LEAST_RECORDS, ONSETS, step_drivers


def blank(*lengths, engines=None):
    recorded = tuple(
        Flight(f"f{k}", (engines or [""] * len(lengths))[k], {"x": np.zeros(n)}) for k, n in enumerate(lengths)
    )
    return Dataset(None, recorded, Noise({}), Settings({}))  # type: ignore[arg-type]


def test_von_neumanns_ratio_is_calibrated_for_white_residuals():
    rng = np.random.default_rng(3)
    p = np.array([von_neumann(rng.standard_normal(60))[1] for _ in range(2000)])
    # binomial: 2000 draws at 5 % have a standard deviation of 9.7; 4 of them
    assert abs((p < 0.05).sum() - 100) < 39


def test_residuals_that_follow_a_driver_are_in_order():
    x = np.linspace(-1, 1, 200)
    ratio, p = von_neumann(x**2 + 0.3 * np.random.default_rng(1).standard_normal(200))
    assert ratio < 1.5 and p < 1e-3


def test_steps_prefer_the_beginnings_of_flights():
    steps = step_drivers(blank(*[20] * 12))
    assert 1 <= len(steps) <= ONSETS
    assert all(s.name.startswith("since f") for s in steps)


def test_steps_leave_enough_records_on_either_side_and_stay_with_their_engine():
    steps = step_drivers(blank(30, 30, 30, engines=["A", "B", "A"]))
    for s in steps:
        mine = s.values > 0
        own = np.r_[np.ones(30), np.zeros(30), np.ones(30)] if mine[:30].any() or mine[60:].any() else None
        if own is not None:
            assert not mine[30:60].any()
        assert LEAST_RECORDS <= mine.sum()
    assert any(s.values[30:60].any() for s in steps) and any(s.values[60:].any() for s in steps)


def test_a_recording_too_short_for_a_change_has_no_steps():
    assert step_drivers(blank(2 * LEAST_RECORDS - 1)) == []


@pytest.fixture(scope="module")
def mapped():
    recorded = flights(
        carried(("reynolds_efficiency", "hpc", {"exponent": 0.08})), np.random.default_rng(2), count=7, records=30
    )
    e = evidence(recorded)
    found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
    projection = Projection(found)
    theta = {n: v for n, v in found.theta.items() if n in e.engine.parameters}
    return projection, free_form(found, projection, drivers(e.engine, input_values(e), theta)[:3])


def test_drawing_every_flight_once_gives_the_score_itself(mapped):
    projection, single = mapped
    cells = [*single, *machine_cells(single)]

    class Once:
        def multinomial(self, count, p, size):
            return np.ones((size, count))

    drawn, what = resampled_surprise(projection, cells, Once())  # type: ignore[arg-type]
    assert what == "flights"
    expected = [c.score.surprise if not c.score.absorbed else 0.0 for c in cells]
    assert drawn[0] == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_efficiency_and_flow_moved_together_explain_more_than_either_and_pay_for_it(mapped):
    _, single = mapped
    machines = machine_cells(single)
    assert {c.location.component for c in machines} == {"fan", "booster", "hpc", "hpt", "lpt"}
    for c in machines:
        parts = {p.parameter: p for p in c.location.parts}
        own = [s for s in single if s.location.parameter in parts and s.driver.name == c.driver.name]
        assert len(own) == 2 and c.score.dof == sum(s.score.dof for s in own)
        assert c.score.statistic >= max(s.score.statistic for s in own) - 1e-6
        assert c.price > 0.0
        assert c.scales.tolist() == [p.scale for p in parts.values() for _ in range(len(c.scales) // 2)]


def test_what_is_not_identified_has_its_constant_along_every_driver(mapped):
    _, cells = mapped
    own = {c.driver.name: c for c in cells if c.location.name == "power_offtake@hp"}
    constant = own.pop("constant")
    assert constant.score.dof == 1 and len(own) == 3
    for c in own.values():
        assert c.score.dof == 3 and c.score.statistic >= constant.score.statistic * (1 - 1e-9)
    # what is identified has none: its constant is absorbed
    assert all(c.score.dof == 2 for c in cells if c.location.name == "hpc.efficiency")


def test_resampling_counts_whole_flights(mapped):
    projection, _ = mapped
    unit, count, what = units(projection)
    assert (count, what) == (7, "flights")
    recording = projection.found.problem.recording
    assert all(len(set(unit[recording == r])) == 1 for r in range(7))
