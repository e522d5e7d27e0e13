"""Times of a hidden switch by records that the gate has left out, on simulated flights with unsteady manoeuvres."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from unsteady_flights import Truth, flown

from enginediag_cli.mismatch.unrecorded.timed import timed


@cache
def case(seed: int) -> Truth:
    return flown(np.random.default_rng(seed))


@pytest.mark.slow
def test_intervals_hold_the_times_of_a_switch_and_most_lie_within_10_s():
    held, near, total = 0, 0, 0
    for seed in (51, 52):
        truth = case(seed)
        found = timed(truth.finding, truth.refitted, truth.evidence, truth.raw)
        for s in found.switches:
            at = next(x for x in truth.times[s.flight] if s.before_s - 6.0 < x < s.time_s + 6.0)
            low, high = s.between
            assert s.before_s <= low < high <= s.time_s
            total += 1
            held += low <= at <= high
            near += max(at - low, high - at) <= 10.0
    assert total >= 30
    assert held >= 0.9 * total
    assert near >= 0.85 * total


def test_nothing_but_the_times_is_changed():
    truth = case(51)
    found = timed(truth.finding, truth.refitted, truth.evidence, truth.raw)
    plain = tuple(replace(s, earliest_s=np.nan, latest_s=np.nan) for s in found.switches)
    assert [repr(s) for s in plain] == [repr(s) for s in truth.finding.switches]
    assert found.states is truth.finding.states and found.amplitude is truth.finding.amplitude


def test_without_records_between_the_steady_ones_the_interval_stands():
    truth = case(51)
    steady = {(f.label, f.engine): dict(f.columns) for f in truth.evidence.flights}
    for raw in ({}, steady):
        found = timed(truth.finding, truth.refitted, truth.evidence, raw)
        assert not any(s.narrowed for s in found.switches)
        assert found.switches[0].between == (truth.finding.switches[0].before_s, truth.finding.switches[0].time_s)


def test_a_flight_without_an_input_there_keeps_its_interval():
    truth = case(51)
    gone = {k: {**v, "mach": np.full(len(v["time_s"]), np.nan)} for k, v in truth.raw.items()}
    assert not any(s.narrowed for s in timed(truth.finding, truth.refitted, truth.evidence, gone).switches)
