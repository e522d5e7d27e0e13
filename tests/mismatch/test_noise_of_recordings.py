"""Noise of recordings along time, told from what nothing explains: it is what was flown, of every sensor."""

from __future__ import annotations

from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.answer import NO_DISCREPANCY
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.physics.registry import candidate_effects

CONFIGS = Path(__file__).parents[2] / "configs"
WITHIN = 0.12
"""Of 360 records three standard deviations."""


@pytest.mark.slow
def test_noise_of_a_speed_is_not_explained_by_metal_that_follows_the_speed_as_it_was_measured(tmp_path):
    profile = (CONFIGS / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    (tmp_path / "flights.yaml").write_text(profile.replace("interval_s: 10", "interval_s: 60"), encoding="utf-8")
    engine, recorded = str(CONFIGS / "turbofan.yaml"), str(tmp_path / "recorded.csv")
    flown = ["simulate", engine, "--flight", str(tmp_path / "flights.yaml"), "--flights", "3", "--seed", "5", "-q"]
    assert main([*flown, "-o", recorded]) == 0
    evidence = load_case(RecordedCase(engine, RecordingSource((recorded,))), identified=True).evidence
    search = Search(evidence, list(candidate_effects(evidence.engine)), hidden_search(evidence))
    assert search.run().status == NO_DISCREPANCY
    for column, sensor in evidence.engine.sensors.items():
        share = search.evidence.noise.sigma[column] / sensor.noise_sigma
        assert abs(share - 1.0) < WITHIN, f"{column}: {share:.2f} of its noise"
