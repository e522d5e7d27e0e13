"""What wrong slopes of the maps do to a score, and their way through files of statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from parameter_makers import meaning_of
from toy_engine import HEALTH, toy_monitor, toy_recording
from white_statistics import local_statistics, white_noise

from enginediag_cli.error_model.sizes import MapSlopes
from enginediag_cli.errors import DataError
from enginediag_cli.report.output import cell
from enginediag_cli.residuals.flat import flat_columns, flat_row, read_flat
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame
from enginediag_cli.residuals.windows import WindowPlan


def statistics_of(J, change, rng, sigma=0.02):
    """Statistics of readings of unit noise with sensitivities J (N, m, p)."""
    p = J.shape[2]
    e = J @ np.asarray(change) + rng.standard_normal(J.shape[:2])
    frame = ParameterFrame(tuple(f"p{i}" for i in range(p)), np.ones(p), np.full(p, sigma))
    return local_statistics(e, J, white_noise(np.ones(J.shape[1])), frame)


def slopes_of(monitor, sigma=0.2):
    """Of the toy's two HPC quantities, on whose map the other changes move it, too."""
    moved = np.random.default_rng(7).normal(size=(2, 2, len(monitor.monitored)))
    position = np.array([HEALTH.index("hpc.efficiency"), HEALTH.index("hpc.flow_capacity")])
    return replace(monitor, slopes=MapSlopes(position, moved, np.array([sigma, 2.5 * sigma])))


def test_one_parameter_has_a_closed_form():
    """b' = b/(1 + I c), I' = I/(1 + I c): the estimate b/I stays, its variance grows from 1/I to 1/I + c."""
    rng = np.random.default_rng(1)
    statistics, c = statistics_of(10 * rng.normal(size=(50, 2, 1)), [0.03], rng), 0.01**2
    score, wide = fisher_score(statistics), fisher_score(statistics, uncertainty=np.array([[c]]))
    information = score.information[0, 0]
    assert wide.b[0] == pytest.approx(score.b[0] / (1 + information * c))
    assert wide.information[0, 0] == pytest.approx(information / (1 + information * c))
    assert wide.b[0] / wide.information[0, 0] == pytest.approx(score.b[0] / information)
    assert 1 / wide.information[0, 0] == pytest.approx(1 / information + c)
    assert wide.glr == pytest.approx(wide.b[0] ** 2 / wide.information[0, 0])


def test_several_parameters_keep_their_estimate_and_their_covariance_grows_by_theirs():
    rng = np.random.default_rng(2)
    statistics = statistics_of(10 * rng.normal(size=(50, 4, 3)), [0.02, 0.0, -0.01], rng)
    C = np.diag([1e-4, 0.0, 4e-4])
    score, wide = fisher_score(statistics), fisher_score(statistics, uncertainty=C)
    estimate = np.linalg.solve(score.information, score.b)
    np.testing.assert_allclose(np.linalg.solve(wide.information, wide.b), estimate)
    np.testing.assert_allclose(np.linalg.inv(wide.information), np.linalg.inv(score.information) + C)
    np.testing.assert_allclose(wide.information, wide.information.T)
    assert wide.glr == pytest.approx(wide.b @ np.linalg.solve(wide.information, wide.b))
    assert wide.glr < score.glr


def test_a_parameter_that_is_no_suspect_goes_on_making_up_for_another():
    """What wrong slopes do may be no more than what two parameters together do: of two that cancel in a sensor, the one
    that is not asked for goes on cancelling the other there, and the score of the other is that of its other sensor."""
    rng = np.random.default_rng(3)
    J = np.zeros((200, 2, 2))
    J[:, 0, 0], J[:, 1, 0], J[:, 1, 1] = 1.0, 10.0, 10.0  # the second sensor shows their sum
    statistics = statistics_of(J, [0.0, 0.0], rng, sigma=1.0)
    C = 100.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    score = fisher_score(statistics, monitored=["p0"], uncertainty=C)
    weight = 1 / (1 / 200 + 100.0)  # the first sensor's mean has the variance 1/200 + 100, the second's has 1/200
    assert score.information[0, 0] == pytest.approx(200 * 10.0**2 + weight)


def test_a_healthy_window_has_little_of_it_and_a_worn_one_in_proportion_to_its_wear():
    monitor = slopes_of(toy_monitor())
    found = {}
    for change in (0.0, -0.01, -0.02):
        recording = toy_recording(np.random.default_rng(4), 400, change={"hpc.efficiency": change})
        (window,) = window_statistics(monitor, [recording], WindowPlan())
        found[change] = np.sqrt(np.diag(window.statistics.slopes))
    at = HEALTH.index("hpc.efficiency")
    assert found[-0.02][at] == pytest.approx(2 * found[-0.01][at], rel=0.2)
    assert found[0.0][at] < 0.2 * found[-0.01][at]


def test_slopes_do_not_touch_the_statistics_that_a_test_reads():
    plain = toy_monitor()
    recording = toy_recording(np.random.default_rng(5), 200, change={"hpc.efficiency": -0.01})
    one, two = (next(window_statistics(m, [recording], WindowPlan())).statistics for m in (plain, slopes_of(plain)))
    for name in ("s", "F", "V", "chi2"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert one.slopes is None and two.slopes is not None


@pytest.fixture
def texts():
    """A row of statistics with slopes, and one without, as texts."""
    recording = toy_recording(np.random.default_rng(6), 60, change={"hpc.efficiency": -0.01})
    rows, windows = [], []
    for monitor in (slopes_of(toy_monitor()), toy_monitor()):
        (window,) = window_statistics(monitor, [recording], WindowPlan())
        flat = flat_row(window)
        rows.append({c: cell(flat.get(c)) for c in flat_columns(monitor.monitored)})
        windows.append(window)
    return rows, windows


def test_slopes_survive_the_way_through_a_file_of_statistics(texts):
    rows, windows = texts
    (wide, _), (plain, _) = read_flat(rows, "x.csv", [2, 3])
    np.testing.assert_array_equal(wide.statistics.slopes, windows[0].statistics.slopes)
    assert plain.statistics.slopes is None
    assert set(wide.statistics.meaning) == set(meaning_of(HEALTH))


def test_a_file_without_these_columns_has_no_slopes_and_a_negative_variance_is_refused(texts):
    row = texts[0][0]
    old = {c: v for c, v in row.items() if not c.startswith("slopes:")}
    assert len(old) == len(row) - len(HEALTH) * (len(HEALTH) + 1) // 2
    ((window, _),) = read_flat([old], "x.csv", [2])
    assert window.statistics.slopes is None
    with pytest.raises(DataError, match=r"x\.csv:2:slopes:hpc\.efficiency\|hpc\.efficiency"):
        list(read_flat([row | {"slopes:hpc.efficiency|hpc.efficiency": "-1"}], "x.csv", [2]))
