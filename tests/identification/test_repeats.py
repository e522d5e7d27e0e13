"""The same recording given twice to identification counts once, under whatever name it comes."""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.problem import Repeat, TrainingRecording, drop_repeats

COLUMNS = ("Wf_kg_s", "T3_K")


def flight(label, seed, n=40, start=0.0):
    rng = np.random.default_rng(seed)
    columns = {"time_s": start + np.arange(n), "Wf_kg_s": rng.uniform(0.1, 0.5, n), "T3_K": rng.normal(600, 2, n)}
    return TrainingRecording(label, columns, np.array(["climb"] * n))


def part(recording, label, rows):
    return TrainingRecording(label, {c: v[rows] for c, v in recording.columns.items()}, recording.regimes[rows])


def test_different_recordings_are_all_kept():
    given = [flight("a", 1), flight("b", 2)]
    kept, repeats = drop_repeats(given, COLUMNS)
    assert kept == given and repeats == ()


def test_the_same_recording_under_another_name_and_clock_counts_once():
    kept, repeats = drop_repeats([flight("a", 1), flight("copy", 1, start=900.0), flight("b", 2)], COLUMNS)
    assert [r.label for r in kept] == ["a", "b"]
    assert repeats == (Repeat("copy", "a", 40, True),)


def test_of_a_longer_file_that_holds_an_earlier_flight_only_the_rest_is_kept():
    long = flight("long", 1)
    kept, repeats = drop_repeats([part(long, "early", slice(0, 10)), long], COLUMNS)
    assert [len(r.regimes) for r in kept] == [10, 30]
    assert repeats == (Repeat("long", "early", 10, False),)
    np.testing.assert_array_equal(kept[1].columns["T3_K"], long.columns["T3_K"][10:])


def test_a_flight_in_two_parts_of_earlier_recordings_is_left_out_whole():
    long = flight("long", 1)
    parts = [part(long, "first", slice(0, 20)), part(long, "second", slice(20, 40))]
    kept, repeats = drop_repeats([*parts, long], COLUMNS)
    assert [r.label for r in kept] == ["first", "second"]
    assert sum(r.records for r in repeats) == 40


def test_a_few_records_that_agree_by_chance_are_kept():
    a, b = flight("a", 1), flight("b", 2)
    for column in COLUMNS:
        b.columns[column][:4] = a.columns[column][:4]
    assert drop_repeats([a, b], COLUMNS)[1] == ()


def test_records_without_any_reading_repeat_nothing():
    empty = [TrainingRecording(x, {c: np.full(20, np.nan) for c in COLUMNS}) for x in "ab"]
    assert drop_repeats(empty, COLUMNS) == (empty, ())
