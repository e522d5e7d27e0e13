"""What a recorder leaves out as unsteady can be read again; what cannot be read twice is not."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.intake.loader import RecordingLoader, load_flights, load_ungated_flights
from enginediag_cli.intake.selection import RecordingSource, RequiredColumns

RECORDER = """
kind: recorder
description: a test rig
columns:
  time_s: {from: t_s}
  power_W: {from: power_W}
  T3_K: {from: T3_K}
"""
GATE = "steady: {window_s: 5, spread: {power_W: 1}}\n"
WANTED = RequiredColumns(("power_W",), ("T3_K",))


@pytest.fixture
def intake(tmp_path):
    def of(gate: str, files=("flight.csv",)) -> RecordingLoader:
        t = np.arange(60)
        power = np.where(t < 30, 100.0, 100.0 + 10.0 * (t - 30))
        rows = [f"{a},{b},{600 + 0.01 * a}" for a, b in zip(t, power, strict=True)]
        for name in files:
            (tmp_path / name).write_text("\n".join(["t_s,power_W,T3_K", *rows]), encoding="utf-8")
        (tmp_path / "recorder.yaml").write_text(RECORDER + gate, encoding="utf-8")
        return RecordingLoader(
            RecordingSource(tuple(str(tmp_path / f) for f in files), str(tmp_path / "recorder.yaml")), WANTED
        )

    return of


def test_all_records_of_a_flight_are_read_by_the_label_that_its_steady_ones_have(intake):
    gated = intake(GATE)
    (steady,) = load_flights(gated)
    (every,) = load_ungated_flights(gated, [gated.source.files[0]])
    assert (every.recording.label, every.engine, every.file) == (steady.recording.label, steady.engine, steady.file)
    assert len(every.recording.columns["time_s"]) == 60
    assert len(steady.recording.columns["time_s"]) < 40


def test_averages_are_undone_as_well(intake):
    averaged = intake("average_s: 10\n")
    (every,) = load_ungated_flights(averaged, [averaged.source.files[0]])
    assert len(every.recording.columns["time_s"]) == 60


def test_only_files_that_are_asked_for_are_read_again(intake):
    assert load_ungated_flights(intake(GATE), []) == []


def test_without_a_gate_or_from_a_pipe_there_is_nothing_more_to_read(intake, tmp_path):
    plain = intake("")
    assert plain.make_ungated() is None
    assert load_ungated_flights(plain, plain.source.files) == []
    assert RecordingLoader(RecordingSource(("-",), str(tmp_path / "recorder.yaml")), WANTED).make_ungated() is None
    assert RecordingLoader(RecordingSource(("flight.csv",)), WANTED).make_ungated() is None
