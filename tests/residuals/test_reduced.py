"""Unit normals, whose effect the engine computes, in place of the uncertain parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_compact import seen_everywhere
from toy_engine import toy_monitor, toy_recording

from enginediag_cli.detection.verdict import judge
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import MANY, MonitorCache, ReducedMonitor, compact_monitor, reduce_monitor
from enginediag_cli.residuals.windows import WindowPlan


@pytest.fixture
def uncertain():
    return seen_everywhere(toy_monitor(uncertain=5.0, offset=2.0, rho=0.3))


def judged(monitor, recording, linearise="estimate"):
    (window,) = window_statistics(monitor, [recording], WindowPlan(), linearise=linearise)
    return judge(window)


def test_statistics_at_nominal_are_those_of_the_monitor_that_it_comes_from(uncertain):
    few = reduce_monitor(uncertain)
    assert isinstance(few, ReducedMonitor)
    recording = toy_recording(np.random.default_rng(2), 300, change={"hpc.efficiency": -0.01})
    one, two = (judged(m, recording, "nominal") for m in (uncertain, few))
    assert two.test.statistic == pytest.approx(one.test.statistic, rel=1e-6)
    assert two.fit.ratio == pytest.approx(one.fit.ratio, rel=1e-6)


@pytest.mark.parametrize("change", [0.0, -0.004, -0.02])
def test_statistics_are_those_of_the_fit_within_what_it_leaves_out(uncertain, change):
    few = reduce_monitor(uncertain)
    many = compact_monitor(uncertain, few)
    assert many is not few
    recording = toy_recording(np.random.default_rng(3), 100, change={"hpc.efficiency": change})
    one, two = judged(few, recording), judged(many, recording)
    assert one.verdict == two.verdict
    assert two.test.statistic == pytest.approx(one.test.statistic, rel=2e-3)
    assert two.fit.ratio == pytest.approx(one.fit.ratio, rel=2e-3)


def parts(recording, *sizes):
    stops = np.cumsum(sizes)
    return [recording.select(slice(stop - size, stop)) for size, stop in zip(sizes, stops, strict=True)]


@pytest.mark.parametrize("count", [MANY - 1, MANY])
def test_the_form_depends_on_how_many_records_a_file_has_and_not_on_its_chunks(uncertain, count):
    recording = toy_recording(np.random.default_rng(4), count)
    found = []
    for sizes in ((count,), (500, count - 500), (count - 1, 1), (1, 0, count - 1)):
        monitor, every = MonitorCache(replace(uncertain, smooth=True)).choose(parts(recording, *sizes))
        assert [len(r) for r in every] == list(sizes)
        found.append(type(monitor).__name__)
    assert set(found) == {"CompactMonitor" if count >= MANY else "ReducedMonitor"}


def test_a_fit_that_short_files_have_paid_for_together_serves_the_files_that_follow(uncertain):
    economy = MonitorCache(replace(uncertain, smooth=True))
    recording = toy_recording(np.random.default_rng(5), MANY // 2)
    forms = [economy.choose([recording])[0] for _ in range(4)]
    assert type(forms[0]) is ReducedMonitor
    assert forms[1] is forms[2] is forms[3] is not forms[0]


def test_no_more_is_read_ahead_than_the_choice_needs(uncertain):
    recording = toy_recording(np.random.default_rng(6), MANY)
    taken = []

    def chunks():
        for k in range(3):
            taken.append(k)
            yield recording

    _, every = MonitorCache(replace(uncertain, smooth=True)).choose(chunks())
    assert taken == [0]
    assert sum(len(r) for r in every) == 3 * MANY


def test_a_certain_nominal_is_left_as_it_is():
    certain = seen_everywhere(toy_monitor())
    assert reduce_monitor(certain) is certain
    assert MonitorCache(certain).choose([toy_recording(np.random.default_rng(7), MANY)])[0] is certain


def test_where_no_fit_would_do_few_and_many_records_are_judged_by_the_engine(uncertain):
    rough = MonitorCache(replace(uncertain, smooth=False))
    found = []
    for count in (1, MANY + 1):
        monitor, every = rough.choose([toy_recording(np.random.default_rng(8), count)])
        found.append(monitor)
        (recording,) = every
        ours, plain = (judged(m, recording, "nominal") for m in (monitor, uncertain))
        assert ours.test.statistic == pytest.approx(plain.test.statistic, rel=1e-6)
    assert type(found[0]) is ReducedMonitor and found[0] is found[1]
