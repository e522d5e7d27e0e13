"""A foreign recording mapped as it comes is the one mapped whole."""

from __future__ import annotations

import io

import numpy as np
import pytest

from enginediag_cli.recordings.read import read
from enginediag_cli.recordings.recorder import EngineMapper
from enginediag_cli.recordings.recorder_file import load_recorder

HEAD = """\
kind: recorder
description: one channel that moves
columns:
  time_s: {from: t, unit: s}
  N1_rpm: {from: "{prefix}n1", unit: rpm}
  T3_K: {from: "{prefix}t3", unit: K, limits: [200, 900]}
engines:
  left: {prefix: L}
  right: {prefix: R}
masks: {stuck_records: 0, outlier_sigma: 0}
"""
SETTINGS = {
    "every record": "",
    "gate": "steady: {window_s: 5, gap_s: 3, spread: {N1_rpm: 40}, slope: {N1_rpm: 12}, minimum: {N1_rpm: 100}}\n",
    "neighbours": "steady: {neighbours: {N1_rpm: 25}}\n",
    "averages": "steady: {window_s: 10, gap_s: 3, spread: {N1_rpm: 60}, dwell_s: 20, dwell: {N1_rpm: 300}}\n"
    "average_s: 10\n",
    "soak and averages": "derived:\n  - {name: N1_soak_rpm, rule: soak, column: N1_rpm, time_constant_s: 4}\n"
    "average_s: 5\n",
}


def recording(seed, n=400):
    """CSV at 1 Hz with steps of speed, a gap and missing values."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) + np.where(np.arange(n) > 250, 30, 0)
    n1 = 5000 + 400 * np.repeat(rng.integers(-2, 3, n // 50), 50) + 8 * rng.standard_normal(n)
    t3 = np.where(rng.random(n) < 0.02, 9999, 600 + rng.standard_normal(n))
    rows = [f"{a},{b:.3f},{b + 1:.3f},{c:.3f},{c + 5:.3f}" for a, b, c in zip(t, n1, t3, strict=True)]
    return "\n".join(["t,Ln1,Rn1,Lt3,Rt3", *rows]) + "\n"


def in_pieces(recorder, text, size):
    live, pieces, last = EngineMapper(recorder, "right"), [], None
    for chunk in read(io.StringIO(text), required=recorder.source_columns, by_suffix=False, chunk_records=size):
        if last is not None:
            pieces.append(live.add(last))
        last = chunk
    return live, [*pieces, live.add(last, end=True)]


@pytest.mark.parametrize("size", [1, 7, 60])
@pytest.mark.parametrize("settings", list(SETTINGS))
def test_in_pieces_of_any_size_the_records_are_those_of_the_whole_file(tmp_path, settings, size):
    path = tmp_path / "r.yaml"
    path.write_text(HEAD + SETTINGS[settings], encoding="utf-8")
    recorder, text = load_recorder(path), recording(1)
    whole = recorder.read(io.StringIO(text))[1].recording
    live, pieces = in_pieces(recorder, text, size)
    assert 10 < len(whole) and live.kept == len(whole) and live.records == 400
    np.testing.assert_array_equal(np.concatenate([p.line for p in pieces]), whole.line)
    for column in whole.columns:
        np.testing.assert_allclose(np.concatenate([p[column] for p in pieces]), whole[column], rtol=1e-5, atol=5e-3)
    assert {cell for p in pieces for cell in p.text["engine"]} == {"right"}


def test_only_what_later_records_look_back_to_is_kept(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(HEAD + SETTINGS["gate"], encoding="utf-8")
    live, _ = in_pieces(load_recorder(path), recording(2, n=2000), 20)
    assert len(live._recent) < 40
    assert sum(live.counts.columns["T3_K"].values()) > 20
    assert live.gate.report_line().startswith(f"kept {live.kept} of 2000 records (excluded: ")
