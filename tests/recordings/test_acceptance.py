"""What an acceptance report is made of, and switches that are none."""

from __future__ import annotations

import io

import numpy as np
import pytest
from shared_recordings import flight, shared_data

from enginediag_cli.errors import DataError
from enginediag_cli.intake.acceptance import SwitchFault, TimeStretch, check_recording, switch_faults
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.table import MissingColumn, Recording, concat
from enginediag_cli.recordings.unit_inference import unit_doubt

SENSORS = ("N1_rpm", "T3_K", "P3_Pa", "ITT_K")


def recording(n: int = 400) -> Recording:
    made = {c: v[:n].copy() for c, v in flight(20_000).items()}
    made["T3_K"] += 200.0  # of a compressor exit
    return Recording({"time_s": np.arange(float(n))} | made, line=np.arange(n) + 2)


def test_a_good_recording_is_accepted_without_a_remark():
    report = check_recording(recording(), ["Wf_kg_s"], SENSORS)
    assert report.usable and report.found == ("Wf_kg_s", *SENSORS) and report.numeric == 5
    assert report.absent == report.empty == report.units == report.frozen == report.switches == ()
    assert (report.timing.step_s, report.timing.gap_count, report.timing.backward_count) == (1.0, 0, 0)


def test_missing_misspelt_and_empty_sensors_are_named():
    r = recording()
    columns = {("T3_k" if c == "T3_K" else c): v for c, v in r.columns.items() if c != "P3_Pa"}
    columns["ITT_K"] = np.full(400, np.nan)
    report = check_recording(Recording(columns), ["Wf_kg_s"], SENSORS)
    assert report.absent == (MissingColumn("T3_K", "T3_k"), MissingColumn("P3_Pa", ""))
    assert report.empty == ("ITT_K",) and report.found == ("Wf_kg_s", "N1_rpm", "ITT_K")


def test_a_temperature_in_celsius_that_is_called_kelvin_is_doubted_and_the_unit_that_can_be_is_named():
    r = recording()
    r["T3_K"][:] = r["T3_K"] - np.median(r["T3_K"]) + 310.0  # 583 K
    (doubt,) = check_recording(r, sensors=SENSORS).units
    assert doubt.column == "T3_K" and doubt.unit == "K" and "degC" in doubt.plausible and "K" not in doubt.plausible
    assert unit_doubt("P3_psi", np.full(9, 1200.0)).plausible[:2] == ("kPa", "hPa")
    assert unit_doubt("lh_N1_rpm", np.full(9, 98.0)) is not None and unit_doubt("x_rpm", np.full(9, 9.0)) is None


def test_frozen_stretches_gaps_and_steps_back_carry_their_lines():
    r = recording()
    for c in (*SENSORS, "Wf_kg_s"):
        r[c][100:150] = r[c][100]
    r["time_s"][300:] += 60.0
    r["time_s"][390:] -= 200.0
    r["time_s"][5] = np.nan
    report = check_recording(r, ["Wf_kg_s"], SENSORS)
    assert report.frozen == (TimeStretch(102, 151, 50.0),) and report.masks.frozen == 50
    assert report.timing.gaps == (TimeStretch(301, 302, 61.0),) and report.timing.missing == 1
    assert report.timing.backward == (TimeStretch(391, 392, 199.0),)


def test_time_that_begins_again_with_the_next_flight_is_no_step_back_and_copies_are_counted():
    r = recording(100)
    two = concat([Recording(r.columns, {"flight": [name] * 100}) for name in "ab"])
    assert check_recording(two, ["Wf_kg_s"], SENSORS).timing.backward_count == 0
    assert check_recording(concat([r, r]), ["Wf_kg_s"], SENSORS).timing.repeated == 100


@pytest.mark.parametrize("text", ["name,note\na,b\n", "T3_K\n"])
def test_without_a_column_of_numbers_or_a_record_nothing_can_be_used(text):
    assert not check_recording(read_all(io.StringIO(text))).usable


@pytest.mark.parametrize(("text", "mark"), [("time_s\tT3_K\n1\t500\n", "tab"), ("time_s;T3_K\n1;500\n", "semicolon")])
def test_a_file_with_another_delimiter_is_refused_with_the_way_to_state_it(text, mark):
    with pytest.raises(DataError, match=f"<stream>:1: one column.*file: {{delimiter: {mark}}}.*enginediag recorder"):
        read_all(io.StringIO(text))


@pytest.mark.shared_data
@pytest.mark.parametrize("file", ["flight_ref.csv", "flight_b22.csv"])
def test_the_citation_is_accepted_with_its_time_stamps_and_units(file):
    r = read_all(shared_data(f"c550_jt15d/{file}"))
    report = check_recording(r)
    assert report.usable and report.frozen == () and report.timing.repeated == 0
    assert report.timing.step_s == 1.0 and report.units == ()


def test_a_switch_holds_0_or_1_or_nothing_and_the_first_offenders_are_shown():
    r = Recording(
        {"bleed": np.array([0, 1, np.nan, 0.5, 2, 1, 7.0])},
        {"ice": ["0", "1", "", "on", "1.0", "na", "2"]},
        line=np.arange(7) + 2,
    )
    assert switch_faults(r, ["bleed", "ice", "not there"]) == (
        SwitchFault("bleed", 3, (5, 6, 8), ("0.5", "2", "7")),
        SwitchFault("ice", 2, (5, 8), ("on", "2")),
    )
