"""An engine that changes while its baseline is taken is not called healthy, and one that stands still is."""

from __future__ import annotations

import numpy as np
import pytest
from turbofan_fleet import BASELINE, engine_history, judged, lost

from enginediag_cli.fleets.findings import CHANGED, HEALTHY, NO_VERDICT


def test_what_fouls_during_its_baseline_and_then_no_more_is_no_healthy_engine():
    flights = 60
    course = 1.0 - np.exp(-np.maximum(np.arange(flights) - 4, 0) / 4.0)
    for seed in range(5):
        change = lost(flights, {"hpc.flow_capacity": -1.5, "hpc.efficiency": -0.75}, course)
        found = judged(engine_history(np.random.default_rng(900 + seed), "A", flights, change))
        assert found.verdict == CHANGED and found.since < BASELINE


def test_healthy_engines_seldom_lose_their_verdict_to_their_baseline():
    findings = [judged(engine_history(np.random.default_rng(2000 + k), str(k), 40)) for k in range(12)]
    # 2 % of twelve: more than two by chance once in six hundred times
    assert sum(f.verdict != HEALTHY for f in findings) <= 2


def test_readings_that_show_no_plausible_change_call_no_engine_healthy():
    history = engine_history(np.random.default_rng(2), "C", 24, scatter=60.0)
    found = judged(history)
    assert found.verdict == NO_VERDICT and "4 flights beside a baseline of 20 cannot show" in found.reason
    assert all(row.verdict in ("baseline", NO_VERDICT) for row in found.by_flight)


def test_an_engine_whose_flights_show_a_change_is_never_healthy():
    """Of all sizes from none to plain, each as probable as the one before at least."""
    verdicts, chances = [], []
    for size in (0.0, 0.5, 1.0, 1.5, 2.0, 3.0):
        change = lost(40, {"hpc.flow_capacity": -size, "hpc.efficiency": -size / 2}, np.arange(40) >= 28)
        found = judged(engine_history(np.random.default_rng(11), "D", 40, change))
        verdicts.append(found.verdict)
        chances.append(found.probability)
    assert verdicts == [HEALTHY] + [CHANGED] * 5 and chances == pytest.approx(sorted(chances), abs=1e-6)
