"""Recording tables become training recordings of single engines and flights."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.identification.problem import TrainingRecording, first_records, hold_out_end, training_recordings
from enginediag_cli.recordings.table import Recording


def table(engines, flights, phase=None):
    text = {"engine": engines, "flight": flights} | ({"phase": phase} if phase else {})
    return Recording({"T3_K": np.arange(float(len(engines)))}, text, source="a.csv")


def test_each_flight_of_each_engine_is_a_recording_of_its_own():
    found = training_recordings(table(list("llrrll"), list("112222")), "a.csv")
    assert [r.label for r in found] == [
        "a.csv engine l flight 1",
        "a.csv engine r flight 2",
        "a.csv engine l flight 2",
    ]
    assert [r.columns["T3_K"].tolist() for r in found] == [[0, 1], [2, 3], [4, 5]]


def test_snapshots_of_one_engine_are_one_recording():
    found = training_recordings(table(list("aaabbb"), list("123123")), "c")
    assert [r.label for r in found] == ["c engine a", "c engine b"]


def test_one_engine_can_be_chosen_and_a_wrong_name_is_refused():
    found = training_recordings(table(list("llrr"), list("1111")), "a", engine="r")
    assert [r.columns["T3_K"].tolist() for r in found] == [[2, 3]]
    with pytest.raises(DataError, match="no record of engine 'x'; it has l, r"):
        training_recordings(table(list("llrr"), list("1111")), "a", engine="x")


def test_a_table_without_engine_and_flight_is_one_recording_and_phase_is_its_regime():
    found = training_recordings(Recording({"T3_K": np.zeros(3)}, {"phase": ["taxi", "climb", "climb"]}), "a")
    assert [(r.label, r.regimes.tolist()) for r in found] == [("a", ["taxi", "climb", "climb"])]


def test_the_end_of_each_recording_is_held_out():
    recordings = [
        TrainingRecording("a", {"x": np.arange(10)}, np.array(list("ssssssssee"))),
        TrainingRecording("b", {"x": np.arange(5)}),
    ]
    train, test = hold_out_end(recordings, 0.2)
    assert [r.columns["x"].tolist() for r in train] == [list(range(8)), [0, 1, 2, 3]]
    assert [r.columns["x"].tolist() for r in test] == [[8, 9], [4]]
    assert test[0].regimes.tolist() == ["e", "e"]
    assert [r.label for r in test] == ["a", "b"]


def test_the_first_records_of_each_recording_can_be_taken():
    found = first_records(
        [TrainingRecording("a", {"x": np.arange(10)}), TrainingRecording("b", {"x": np.arange(2)})], 3
    )
    assert [r.columns["x"].tolist() for r in found] == [[0, 1, 2], [0, 1]]
