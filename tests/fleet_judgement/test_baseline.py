"""An engine that changes while its baseline is taken is not called healthy, and one that stands still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from turbofan_fleet import BASELINE, engine_history, judged, lost

from enginediag_cli.fleet_judgement.finding import CHANGED, HEALTHY, NO_VERDICT


def test_what_fouls_during_its_baseline_and_then_no_more_is_no_healthy_engine():
    flights = 60
    course = 1.0 - np.exp(-np.maximum(np.arange(flights) - 4, 0) / 4.0)
    for seed in range(5):
        change = lost(flights, {"hpc.flow_capacity": -1.5, "hpc.efficiency": -0.75}, course)
        found = judged(engine_history(np.random.default_rng(900 + seed), "A", flights, change))
        assert found.verdict == CHANGED or (found.verdict == NO_VERDICT and "during its baseline" in found.reason)
        assert f"first {BASELINE} flights" in found.reason or found.verdict == CHANGED


def test_healthy_engines_seldom_lose_their_verdict_to_their_baseline():
    findings = [judged(engine_history(np.random.default_rng(2000 + k), str(k), 60)) for k in range(60)]
    # 1 % of sixty: more than four by chance once in three thousand times
    assert sum(f.verdict != HEALTHY for f in findings) <= 4


def test_a_few_flights_more_than_readings_show_nothing_and_are_no_verdict():
    change = lost(22, {"hpc.flow_capacity": -1.5}, np.arange(22) >= 6)
    found = judged(replace(engine_history(np.random.default_rng(7), "B", 12, change[:12]), baseline=6))
    assert found.verdict == NO_VERDICT
