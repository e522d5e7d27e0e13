"""Recorder files: mapping, checks of the file, and the four that come with the project."""

from __future__ import annotations

import gzip
import io

import numpy as np
import pytest
from shared_recordings import RECORDERS, shared_data

from enginediag_cli.errors import ConfigError, DataError, NoVerdictError
from enginediag_cli.recordings.recorder_file import load_recorder

TWO_ENGINES = """\
kind: recorder
description: two engines in one file
columns:
  time_s: {from: t, unit: s}
  T3_K:   {from: "{prefix}_t3_degF", limits: [200, 1200]}
  N1_rpm: {from: "{prefix}_n1", unit: pct, full_scale: 10000}
  Wf_kg_s: {from: "{prefix}_wf_lb_h", scale: 2, offset: 1}
engines:
  left:  {prefix: L, constants: {altitude_m: 5}}
  right: {prefix: R, constants: {altitude_m: 6}, full_scale: {N1_rpm: 20000}}
text: {flight: leg}
keep: [comment]
"""

FILE = """\
# from somewhere
t,leg,L_t3_degF,R_t3_degF,L_n1,R_n1,L_wf_lb_h,R_wf_lb_h,comment,unused
0,007,440.33,80.33,50,50,100,200,"a, b",x
1,007,440.33,9999,50,50,100,200,c,x
"""


def recorder(tmp_path, content: str):
    path = tmp_path / "r.yaml"
    path.write_text(content, encoding="utf-8")
    return load_recorder(path)


def test_each_engine_becomes_its_own_recording_in_si_units(tmp_path):
    left, right = recorder(tmp_path, TWO_ENGINES).read(io.StringIO(FILE))
    assert (left.engine, right.engine) == ("left", "right")
    np.testing.assert_allclose(left.recording["T3_K"], 500.0)
    np.testing.assert_allclose(left.recording["N1_rpm"], 5000.0)
    np.testing.assert_allclose(right.recording["N1_rpm"], 10000.0)
    np.testing.assert_allclose(left.recording["Wf_kg_s"], 201 * 0.45359237 / 3600)
    np.testing.assert_allclose(right.recording["altitude_m"], 6.0)
    assert left.recording.text == {
        "flight": ["007", "007"],
        "comment": ["a, b", "c"],
        "engine": ["left", "left"],
    }
    assert left.recording.line.tolist() == [3, 4]


def test_values_outside_the_limits_are_masked_and_reported(tmp_path):
    right = recorder(tmp_path, TWO_ENGINES).read(io.StringIO(FILE))[1]
    assert np.isnan(right.recording["T3_K"]).tolist() == [False, True]
    assert right.masks.report_lines() == ["T3_K: 1 of 2 values masked (out of limits 1)"]


def test_a_file_without_a_column_that_the_recorder_needs_is_refused(tmp_path):
    with pytest.raises(DataError, match="missing column R_n1"):
        recorder(tmp_path, TWO_ENGINES).read(io.StringIO(FILE.replace("R_n1", "R_np")))


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("L_t3", "L_t3", 0, ""),
        ('{prefix}_t3_degF"', '{prefix}_t3"', 5, "unit of {prefix}_t3 is not known"),
        ("unit: pct, full_scale", "unit: pctt, full_scale", 6, "did you mean 'pct"),
        ("Wf_kg_s:", "Wf_lb_h:", 7, "not in SI"),
        ("Wf_kg_s:", "Wf_K:", 7, "lb_h is a mass flow and K is a temperature"),
        ("keep: [comment]", "steady: {minimum: {N2_rpm: 1}}", 12, "no column N2_rpm .*N1_rpm"),
        ("keep: [comment]", "derived:\n  - {name: dT_isa_K, rule: isa_deviation}", 13, "ambient_temperature_K"),
        ("keep: [comment]", "derived:\n  - {name: x, rule: isa_deviatoin}", 13, "isa_deviation"),
        ("keep:", "kept:", 12, "keep"),
    ],
)
def test_a_wrong_recorder_file_names_the_line_and_a_near_match(tmp_path, old, new, line, message):
    content = TWO_ENGINES.replace(old, new)
    if not message:
        recorder(tmp_path, content)
        return
    with pytest.raises(ConfigError, match=message) as caught:
        recorder(tmp_path, content)
    assert f"r.yaml:{line}:" in str(caught.value)


def test_a_failed_check_tells_the_user_what_the_file_is_not(tmp_path):
    check = "checks:\n  - {name: n over t, of: N1_rpm, over: T3_K, between: [1, 2], otherwise: wrong file}\n"
    with pytest.raises(DataError, match=r"n over t: the median of N1_rpm / T3_K is 10, .*: wrong file"):
        recorder(tmp_path, TWO_ENGINES + check).read(io.StringIO(FILE))


def test_no_steady_record_is_no_verdict_and_not_an_empty_answer(tmp_path):
    with pytest.raises(NoVerdictError, match="kept 0 of 2 records"):
        recorder(tmp_path, TWO_ENGINES + "steady: {minimum: {N1_rpm: 90000}}\n").read(io.StringIO(FILE))


@pytest.mark.shared_data
def test_citation_recordings_give_steady_windows_of_both_engines():
    recorder = load_recorder(RECORDERS / "citation_jt15d.yaml")
    left, right = recorder.read(shared_data("c550_jt15d/flight_ref.csv"))
    assert 295 <= left.gate.kept <= 320 and 295 <= right.gate.kept <= 320
    for engine in (left, right):
        assert engine.masks.total <= 5
        r = engine.recording
        assert all(np.isfinite(values).all() for values in r.columns.values())
        assert np.ptp(r["dT_isa_K"]) < 10.0 and r["N1_rpm"].max() < 1.04 * 15900
        assert np.abs(r["N1_soak_rpm"]).max() < 1200.0
    common = np.intersect1d(left.recording["time_s"], right.recording["time_s"])
    assert len(common) > 0.95 * len(left.recording)


@pytest.mark.shared_data
def test_the_power_plant_s_discharge_pressure_is_absolute_by_the_law_of_the_choked_turbine():
    recorder = load_recorder(RECORDERS / "uci_gas_turbine.yaml")
    for year in (2011, 2012):
        (result,) = recorder.read(shared_data(f"uci_gas_turbine/gt_{year}.csv"))
        assert 0.55 < result.gate.kept / result.gate.total < 0.60
        r = result.recording
        assert 0.002 < r["humidity_kg_kg"].min() and r["humidity_kg_kg"].max() < 0.025
        back_pressure = np.log(r["dP_exhaust_Pa"] * r["ambient_pressure_Pa"] / r["T5_K"])
        exponents = [
            np.polyfit(np.log((r["P3_Pa"] + added) / np.sqrt(r["T4_K"])), back_pressure, 1)[0]
            for added in (0.0, r["ambient_pressure_Pa"])
        ]
        assert abs(exponents[0] - 2.0) < 0.03 < 0.12 < abs(exponents[1] - 2.0)


@pytest.mark.shared_data
def test_cmapss_has_phi_and_ps30_swapped_and_the_recorder_checks_it(tmp_path):
    path = RECORDERS / "cmapss.yaml"
    (result,) = load_recorder(path).read(shared_data("cmapss/train_FD001.csv.gz"))
    r = result.recording
    assert result.masks.total == 0 and len(r) == 20631 and len(set(r.text["engine"])) == 100
    # 24,800 pph of fuel, as 47.5 pph/psi times 521.6 psi
    np.testing.assert_allclose(np.median(r["Wf_kg_s"]), 24_800 * 0.45359237 / 3600, rtol=0.01)
    as_published = path.read_text(encoding="utf-8").replace("from: phi_pps_psi", "from: Ps30_psia", 1)
    with pytest.raises(DataError, match="swapped"):
        recorder(tmp_path, as_published).read(shared_data("cmapss/train_FD001.csv.gz"))


@pytest.mark.shared_data
def test_naval_states_keep_the_sound_levers_and_their_power_is_that_of_an_lm2500():
    recorder = load_recorder(RECORDERS / "naval_gas_turbine.yaml")
    (result,) = recorder.read(shared_data("naval_gas_turbine/states.csv"))
    assert (result.gate.kept, result.gate.total) == (4732, 6084)
    r = result.recording
    assert 25e6 < r["power_W"].max() < 30e6
    # heat balance of the gas generator: W from the power turbine's work, cp 1005 and 1150 J/(kg K)
    full = r["lever"] == r["lever"].max()
    pressure_ratio = r["P45_Pa"] / r["P5_Pa"]
    drop = 0.88 * r["T45_K"] * (1.0 - pressure_ratio**-0.245)
    flow = r["power_W"] / (1150.0 * drop)
    balance = (flow * 1005.0 * r["T2_K"] + 42.7e6 * r["Wf_kg_s"]) / (flow * 1150.0)
    error_if_K = np.abs(balance - r["T45_K"])[full]
    error_if_degC = np.abs(balance - r["T45_K"] - 273.15)[full]
    assert np.median(error_if_K) < 150.0 < np.median(error_if_degC)


@pytest.mark.shared_data
def test_cmapss_text_as_distributed_reads_as_the_csv_does(tmp_path):
    with gzip.open(shared_data("cmapss/train_FD001.csv.gz"), "rt") as stream:
        lines = stream.readlines()[:400]
    (tmp_path / "train.csv").write_text("".join(lines))
    (tmp_path / "train.txt").write_text("".join(line.strip().replace(",", " ") + "  \n" for line in lines[1:]))
    (as_csv,) = load_recorder(RECORDERS / "cmapss.yaml").read(tmp_path / "train.csv")
    (as_text,) = load_recorder(RECORDERS / "cmapss_text.yaml").read(tmp_path / "train.txt")
    assert as_text.recording.text == as_csv.recording.text and len(as_text.recording) == 399
    for column, values in as_csv.recording.columns.items():
        np.testing.assert_array_equal(as_text.recording[column], values)
    wider = (tmp_path / "train.txt").read_text().replace("  \n", " 1.0  \n")
    (tmp_path / "train.txt").write_text(wider)
    with pytest.raises(DataError, match=r"train.txt:1: 27 fields where `names` has 26"):
        load_recorder(RECORDERS / "cmapss_text.yaml").read(tmp_path / "train.txt")
