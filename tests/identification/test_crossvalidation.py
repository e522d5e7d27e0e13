"""Contiguous blocks, and what refitting without them shows."""

from __future__ import annotations

import numpy as np
from identification_toy import TRUTH, ToyEngine, fly, outputs

from enginediag_cli.identification.identify import FOLDS, block_folds, identify
from enginediag_cli.identification.problem import IdentificationSettings, TrainingRecording


def test_without_a_length_the_records_fall_into_equal_runs():
    folds = block_folds(np.zeros(80, int), 0)
    assert np.all(np.diff(folds) >= 0)
    assert np.bincount(folds).tolist() == [10] * FOLDS


def test_a_block_never_spans_two_recordings():
    recording = np.repeat([0, 1], [25, 17])
    folds = block_folds(recording, 10)
    assert folds.tolist() == [0] * 10 + [1] * 10 + [2] * 5 + [3] * 10 + [4] * 7


def test_many_blocks_are_dealt_to_a_bounded_number_of_folds():
    folds = block_folds(np.zeros(1000, int), 10)
    assert folds.max() == FOLDS - 1
    assert np.bincount(folds).max() - np.bincount(folds).min() <= 10


def test_a_right_model_predicts_left_out_blocks_about_as_well_as_it_fits():
    engine = ToyEngine()
    result = identify(engine, [fly(engine, np.random.default_rng(3), 400)])
    assert (result.cross_validation.folds, result.cross_validation.failed_folds) == (FOLDS, 0)
    inside = {q.sensor: q.rms for q in result.in_sample if q.regime == "all"}
    outside = {q.sensor: q.rms for q in result.cross_validated if q.regime == "all"}
    assert all(inside[s] < outside[s] < 1.1 * inside[s] for s in inside)


def test_a_wrong_model_is_shown_up_by_blocks_at_the_edge():
    """P3 bends with power in a way that the model lacks, and power rises through the recording: each block is
    the only one of its power, and a line that fits a parabola within misses it by more beyond."""
    engine, rng = ToyEngine(), np.random.default_rng(3)
    columns = dict(fly(engine, rng, 400).columns)
    columns["N1_pct"] = np.linspace(60, 100, 400)
    value = outputs(columns, TRUTH)
    for s, sensor in engine.sensors.items():
        columns[s] = value[s] + sensor.noise_sigma * rng.standard_normal(400)
    columns["P3_Pa"] = columns["P3_Pa"] * (1 + 0.1 * ((columns["N1_pct"] - 80) / 20) ** 2)
    settings = IdentificationSettings(
        sensors=("P3_Pa",),
        parameters=("hpc.map.slope", "hpc.flow_capacity"),
        prior_sigma={"hpc.flow_capacity": 0.3},
    )
    result = identify(engine, [TrainingRecording("bent", columns)], settings=settings)
    inside = {q.sensor: q.rms for q in result.in_sample if q.regime == "all"}
    outside = {q.sensor: q.rms for q in result.cross_validated if q.regime == "all"}
    assert outside["P3_Pa"] > 1.1 * inside["P3_Pa"]
