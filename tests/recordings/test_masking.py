"""Masks in a stream: the same whatever the chunks, inputs may stand still, frozen recorders and copies are found."""

from __future__ import annotations

import numpy as np
import pytest
from shared_recordings import flight, shared_data

from enginediag_cli.recordings.masking import LiveMasker, MaskingRules, RecordMasker, mask_chunks, mask_recording
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.repeated import DuplicateRows
from enginediag_cli.recordings.table import Recording, concat

SENSORS = ("N1_rpm", "T3_K", "P3_Pa", "ITT_K")
JUDGED = MaskingRules(SENSORS, ("Wf_kg_s",))


def recording(n: int = 7000, **columns) -> Recording:
    made = flight(20_000, seed=3)
    return Recording({"time_s": np.arange(float(n))} | {c: v[:n].copy() for c, v in made.items()} | columns)


def pieces(source: Recording, size: int) -> list[Recording]:
    return [source.select(slice(i, i + size)) for i in range(0, len(source), size)]


def same(a: Recording, b: Recording) -> bool:
    return np.array_equal(a.line, b.line) and all(np.array_equal(a[c], b[c], equal_nan=True) for c in a.columns)


def with_errors() -> Recording:
    """Stuck, frozen, spiked, missing and repeated records across the borders of blocks and of chunks of 3000."""
    r = recording(9000)
    r["T3_K"][2986:3016] = r["T3_K"][2986]
    r["P3_Pa"][3900:7500] = r["P3_Pa"][3900]
    r["ITT_K"][[1999, 2000, 6001]] = 3000.0
    r["N1_rpm"][5995:6008] = np.nan
    for c in (*SENSORS, "Wf_kg_s"):
        r[c][1990:2020] = r[c][1990]
    r = Recording(dict(r.columns), line=np.arange(9000))
    return concat([r.select(slice(0, 4100)), r.select(slice(4000, 9000))])


@pytest.mark.parametrize("size", [97, 2000, 3000, 20_000])
def test_rows_and_counts_do_not_depend_on_the_size_of_chunks(size):
    source = with_errors()
    one, other = RecordMasker(JUDGED), RecordMasker(JUDGED)
    whole = concat(list(mask_chunks([source], one)))
    parts = concat(list(mask_chunks(pieces(source, size), other)))
    assert same(whole, parts) and one.counts == other.counts
    counts = one.counts
    assert counts.repeated == 100 and counts.frozen == 30 and counts.records == 9000 == len(whole)
    assert counts.columns["T3_K"]["stuck"] == 30 and counts.columns["P3_Pa"]["stuck"] == 3600
    assert counts.columns["ITT_K"]["outlier"] == 1  # the other two lie in the frozen stretch
    assert counts.columns["N1_rpm"]["dropped"] == 13 and counts.readings["N1_rpm"] == 9000


def test_a_file_of_up_to_three_thousand_records_is_judged_as_one():
    r = recording(3000)
    r["T3_K"][1985:2015] = r["T3_K"][1985]
    r["ITT_K"][2500] = 2000.0
    masker = RecordMasker(MaskingRules(tuple(c for c in r.columns if c != "time_s")))
    assert len(list(mask_chunks(pieces(r, 300), masker))) == 1
    report = masker.counts
    assert report.columns["T3_K"]["stuck"] == 30 and report.columns["ITT_K"]["outlier"] == 1


def test_no_more_than_a_block_and_its_halo_waits():
    masker, r = RecordMasker(JUDGED), recording(20_000)
    for piece in pieces(r, 500):
        masker.add(piece)
        assert sum(map(len, masker._waiting)) <= 4000 + 500


def test_an_input_may_stand_still_for_hours_and_a_sensor_may_not():
    r = recording(2000)
    r["Wf_kg_s"][500:560] = r["Wf_kg_s"][500]
    r["T3_K"][1000:1060] = r["T3_K"][1000]
    clean, report = mask_recording(r, JUDGED)
    assert report.columns["Wf_kg_s"].get("stuck", 0) == 0 and np.isfinite(clean["Wf_kg_s"]).all()
    assert np.isnan(clean["T3_K"][1000:1060]).all() and report.columns["T3_K"]["stuck"] == 60


def test_a_stuck_sensor_stays_stuck_for_as_long_as_it_does_not_move_however_many_blocks():
    r = recording(16_000)
    r["T3_K"][3000:14_000] = r["T3_K"][3000]
    clean, _ = mask_recording(r, JUDGED)
    assert np.isnan(clean["T3_K"][3000:14_000]).all() and np.isnan(clean["T3_K"]).sum() == 11_000


def test_a_frozen_recorder_is_counted_by_the_record_and_its_readings_are_not_judged():
    r = recording(60)
    for c in (*SENSORS, "Wf_kg_s"):
        r[c][:] = r[c][0]
    clean, report = mask_recording(r, JUDGED)
    assert report.frozen == 60 and report.total == 0
    assert all(np.isnan(clean[c]).all() for c in SENSORS) and np.isfinite(clean["Wf_kg_s"]).all()
    assert "60 records in which every reading is constant, not used (frozen)" in report.report_lines()


def test_nineteen_equal_records_are_not_frozen_nor_is_a_recorder_that_holds_each_of_them_for_sixteen():
    r = recording(2000)
    for c in (*SENSORS, "Wf_kg_s"):
        r[c][700:719] = r[c][700]
    assert mask_recording(r, JUDGED)[1].frozen == 0
    held = recording(2000).select(np.repeat(np.arange(125), 16))
    held = held.with_columns({"time_s": np.arange(2000.0)})
    assert mask_recording(held, JUDGED)[1].frozen == 0


def test_records_of_different_flights_are_never_compared():
    r = recording(15)
    twice = concat([Recording(r.columns, {"flight": [name] * 15}) for name in ("a", "b")])
    clean, report = mask_recording(twice, JUDGED)
    assert len(clean) == 30 and (report.frozen, report.repeated) == (0, 0)
    for c in (*SENSORS, "Wf_kg_s"):
        twice[c][:] = 1.0
    assert mask_recording(twice, JUDGED)[1].frozen == 0


def test_a_file_behind_itself_is_counted_once_and_time_that_only_goes_back_is_kept():
    r = recording(500)
    clean, report = mask_recording(concat([r, r]), JUDGED)
    assert len(clean) == 500 and report.repeated == 500
    other = recording(500, T3_K=flight(500, seed=9)["T3_K"])
    assert mask_recording(concat([r, other]), JUDGED)[1].repeated == 0


def test_without_time_equal_records_are_no_copies():
    r = recording(40)
    r = Recording({c: v for c, v in r.columns.items() if c != "time_s"})
    assert mask_recording(concat([r, r]), JUDGED)[1].repeated == 0


def test_copies_are_found_across_the_segments_of_the_memory(monkeypatch):
    from enginediag_cli.recordings import repeated

    monkeypatch.setattr(repeated, "SEGMENT", 256)
    r = recording(1500)
    whole, parts, twice = DuplicateRows(), DuplicateRows(), concat([r, r])
    zeros = np.zeros(3000, dtype=np.int64)
    at_once = whole.add(twice, zeros)
    in_parts = np.concatenate([parts.add(p, zeros[: len(p)]) for p in pieces(twice, 70)])
    assert np.array_equal(at_once, in_parts) and at_once.sum() == 1500 and at_once[1500:].all()


@pytest.mark.parametrize("size", [1, 20, 300])
def test_live_a_recorder_is_frozen_from_the_record_on_at_which_it_has_stood_still_long_enough(size):
    r = recording(300)
    for c in (*SENSORS, "Wf_kg_s"):
        r[c][100:200] = r[c][100]
    masker = LiveMasker(JUDGED)
    clean = concat(list(mask_chunks(pieces(r, size), masker)))
    assert np.flatnonzero(np.isnan(clean["T3_K"])).tolist() == list(range(119, 200))
    assert masker.counts.frozen == 81 and masker.watch.run == 1


@pytest.mark.shared_data
@pytest.mark.parametrize(
    "file",
    ["c550_jt15d/flight_ref.csv", "c550_jt15d/flight_b22.csv", "uci_gas_turbine/gt_2011.csv"],
)
def test_steady_quantised_recordings_of_real_engines_are_neither_frozen_nor_repeated(file):
    r = read_all(shared_data(file))
    _, report = mask_recording(r, MaskingRules(tuple(c for c in r.columns if c != "time_s")))
    assert (report.frozen, report.repeated) == (0, 0)
