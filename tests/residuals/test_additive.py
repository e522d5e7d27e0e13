"""What a file of statistics holds adds: over windows, flights and files, in any order and grouping."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.isolation.methods import IsolationOptions, best_set, sensitivity_test
from enginediag_cli.report.output import cell
from enginediag_cli.residuals.files import count_nuisance, keep_nuisance
from enginediag_cli.residuals.flat import flat_columns, flat_row, read_flat
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import drop_nuisance, fisher_score, marginalise, marginalise_nuisance
from enginediag_cli.residuals.windows import plan_windows

SUMS = ("s", "F", "V", "n", "chi2", "dof")


def monitor_and_recording(rho=0.0, seed=1, n=120, source="toy.csv"):
    monitor = toy_monitor(offset=5.0, uncertain=4.0, rho=rho)
    return monitor, toy_recording(np.random.default_rng(seed), n, change={"hpc.efficiency": -0.01}, source=source)


def windows(monitor, recording, length=None, linearise="nominal"):
    plan = plan_windows(length)
    return list(window_statistics(monitor, [recording], plan, linearise=linearise, condense=keep_nuisance(monitor)))


def through_a_file(monitor, found):
    """The windows as a file of statistics gives them back."""
    columns = flat_columns(monitor.monitored, count_nuisance(monitor))
    rows = [{c: cell(flat_row(window).get(c)) for c in columns} for window in found]
    assert all(set(flat_row(window)) <= set(columns) for window in found)
    assert all(row["nuisance:1"].startswith("f8:") for row in rows)  # no cell may begin as a formula
    return [window for window, _ in read_flat(rows, "x.csv", range(2, len(rows) + 2))]


def alike(one, other, names=SUMS, rtol=1e-9):
    for name in names:
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * np.max(np.abs(b)), err_msg=name)


def added(windows):
    """The sum of windows, each with its recording: windows of one recording first, then recordings without what is
    their own."""
    recordings = {}
    for recording, statistics in windows:
        recordings.setdefault(recording, []).append(statistics)
    return reduce(add, [without_own(reduce(add, mine)) for mine in recordings.values()])


def without_own(statistics):
    own = np.isin(statistics.parameters, statistics.own)
    kept = [name for name, gone in zip(statistics.parameters, own, strict=True) if not gone]
    covariance = np.diag(np.where(own, statistics.prior_sigma**2, 0.0))
    return replace(marginalise(statistics, kept, covariance), additive=True)


@settings(max_examples=15, deadline=None)
@given(st.integers(5, 120), st.randoms(use_true_random=False))
def test_windows_of_a_file_add_to_the_whole_in_any_order_and_grouping(length, random):
    monitor, recording = monitor_and_recording()
    (whole,) = windows(monitor, recording)
    parts = [w.statistics for w in through_a_file(monitor, windows(monitor, recording, str(length)))]
    random.shuffle(parts)
    k = random.randint(1, len(parts))
    groups = [reduce(add, some) for some in (parts[:k], parts[k:]) if some]
    alike(reduce(add, groups), whole.statistics)


def test_what_is_marginalised_window_by_window_counts_what_they_share_once_for_each():
    monitor, recording = monitor_and_recording()
    (whole,) = windows(monitor, recording)
    parts = [w.statistics for w in windows(monitor, recording, "30")]
    right = marginalise_nuisance(added([("toy", p) for p in parts]))
    alike(right, marginalise_nuisance(whole.statistics))
    alone = sum((marginalise_nuisance(p).F for p in parts[1:]), marginalise_nuisance(parts[0]).F)
    assert not np.allclose(alone, right.F, rtol=1e-4)


def test_recordings_have_offsets_of_their_own_and_share_what_is_uncertain_about_nominal():
    """s of both ~ N(F Δθ, V + F C F) with a common nominal and an offset of each: by the joint covariance."""
    monitor, one = monitor_and_recording()
    other = monitor_and_recording(seed=2, n=80, source="other.csv")[1]
    a, b = (windows(monitor, r)[0].statistics for r in (one, other))
    found = fisher_score(marginalise_nuisance(added([("one", a), ("other", b)])))
    h, p = len(monitor.monitored), len(a.parameters)
    assert a.common == ("nominal.1",) and a.own == ("offset.T5_K.bias",)
    # all parameters of both: monitored, common, offset of one, offset of the other
    first, second = np.zeros((p, p + 1)), np.zeros((p, p + 1))
    first[range(p), range(p)] = 1
    second[range(p - 1), range(p - 1)] = 1
    second[p - 1, p] = 1
    F = first.T @ a.F @ first + second.T @ b.F @ second
    V = first.T @ a.V @ first + second.T @ b.V @ second
    s = first.T @ a.s + second.T @ b.s
    C = np.diag([*np.zeros(h), 1.0, 5.0**2, 5.0**2])
    inverse = np.linalg.inv(V + F @ C @ F)
    np.testing.assert_allclose(found.b, (F @ inverse @ s)[:h], rtol=1e-6)
    np.testing.assert_allclose(found.information, (F @ inverse @ F)[:h, :h], rtol=1e-6)


def test_in_correlated_noise_everything_but_V_adds_and_V_lacks_the_borders():
    monitor, recording = monitor_and_recording(rho=0.6)
    (whole,) = windows(monitor, recording)
    together = reduce(add, [w.statistics for w in windows(monitor, recording, "30")])
    alike(together, whole.statistics, [name for name in SUMS if name != "V"])
    assert np.max(np.abs(np.diag(together.V) / np.diag(whole.statistics.V) - 1)) < 0.1


def test_the_sensitivity_test_is_equation_13_of_what_the_file_holds():
    """t̃_a = (rᵀ Σ⁻¹ M_a)² / M_aᵀ Σ⁻¹ M_a with M = F_a, Σ = V + F C F + F_a S F_aᵀ: C what is uncertain beside the
    monitored parameters, S what wrong slopes of the maps may make of a change, columns `slopes` of the file."""
    monitor, recording = monitor_and_recording(rho=0.3)
    (found,) = windows(monitor, recording)
    S = np.zeros((6, 6))
    S[:4, :4] = np.diag([0.004, 0.006, 0.01, 0.003]) ** 2
    (window,) = through_a_file(monitor, [replace(found, statistics=replace(found.statistics, slopes=S))])
    x = window.statistics
    row = flat_row(window)
    F_a, C = x.F[:, :4], np.diag([0.0, 0.0, 0.0, 0.0, 1.0, 25.0])
    S = np.diag([row[f"slopes:{name}|{name}"] for name in monitor.monitored])
    inverse = np.linalg.inv(x.V + x.F @ C @ x.F + F_a @ S @ F_a.T)
    by_hand = (x.s @ inverse @ F_a) ** 2 / np.sum(F_a * (inverse @ F_a), axis=0)
    statistics = marginalise_nuisance(x)
    score = fisher_score(statistics, uncertainty=statistics.slopes)
    np.testing.assert_allclose([sensitivity_test(score, [name])[0] for name in monitor.monitored], by_hand, rtol=1e-6)
    assert best_set(score, IsolationOptions())[0] == (monitor.monitored[int(np.argmax(by_hand))],)


def test_a_series_compares_windows_at_nominal_as_it_is():
    monitor, recording = monitor_and_recording()
    (window,) = windows(monitor, recording)
    plain = drop_nuisance(window.statistics)
    assert plain.parameters == monitor.monitored
    np.testing.assert_array_equal(plain.F, window.statistics.F[:4, :4])


@pytest.mark.parametrize("linearise", ["nominal", "estimate"])
def test_a_row_is_judged_as_its_window(linearise):
    monitor, recording = monitor_and_recording(rho=0.3)
    (direct,) = window_statistics(monitor, [recording], plan_windows(None), linearise=linearise)
    (row,) = through_a_file(monitor, windows(monitor, recording, linearise=linearise))
    alike(marginalise_nuisance(row.statistics), direct.statistics, rtol=1e-8)


def test_a_damaged_cell_is_named():
    from enginediag_cli.errors import DataError

    monitor, recording = monitor_and_recording()
    columns = flat_columns(monitor.monitored, count_nuisance(monitor))
    row = {c: cell(flat_row(windows(monitor, recording)[0]).get(c)) for c in columns}
    for column, text, message in (
        ("nuisance", "{}", "not a JSON mapping of `common` and `own`"),
        ("nuisance:1", row["nuisance:1"][:-4], "finite numbers in base 64"),
        ("nuisance:1", "°", "finite numbers in base 64"),
    ):
        with pytest.raises(DataError, match=rf"x\.csv:2:{column}: .*{message}"):
            list(read_flat([{**row, column: text}], "x.csv", [2]))
