"""An engine that changes while its baseline is taken is not called healthy, and one that stands still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from turbofan_fleet import BASELINE, engine_history, judged, lost

from enginediag_cli.fleets.findings import CHANGED, HEALTHY, NO_VERDICT


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


def test_a_baseline_that_is_short_beside_the_readings_calls_no_engine_healthy_not_even_a_healthy_one():
    change = lost(14, {"hpc.flow_capacity": -3.0, "hpc.efficiency": -1.5}, np.arange(14) >= 8)
    for seed, moved in ((1, change), (2, None)):
        history = engine_history(np.random.default_rng(seed), "C", 14, moved)
        found = judged(replace(history, baseline=6))
        assert found.verdict == NO_VERDICT
        assert "a baseline of 6 flights and 8 after it cannot show a change" in found.reason
        assert all(row.verdict in ("baseline", NO_VERDICT) for row in found.by_flight)


def test_an_engine_whose_flights_show_a_change_is_never_healthy():
    """Of all sizes from none to plain: what the E-value is not yet certain of is no verdict once the estimate is."""
    verdicts = []
    for size in (0.0, 0.5, 1.0, 1.5, 2.0, 3.0):
        change = lost(40, {"hpc.flow_capacity": -size, "hpc.efficiency": -size / 2}, np.arange(40) >= 28)
        found = judged(engine_history(np.random.default_rng(11), "D", 40, change))
        hpc = [r for r in found.health if r.component == "hpc"]
        far = any(abs(r.change.value) > 3 * (r.change.high - r.change.low) / 2 for r in hpc)  # six standard errors
        assert not (far and found.verdict == HEALTHY)
        verdicts.append(found.verdict)
    assert verdicts[0] == HEALTHY and verdicts[-1] != HEALTHY
