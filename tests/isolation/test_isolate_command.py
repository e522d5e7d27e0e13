"""`isolate` with sensors, a catalogue, signs, advice and large faults, on a turbofan with a written nominal."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known

from enginediag_cli.__main__ import main
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

CONFIGS = Path(__file__).parents[2] / "configs"
ENGINE = CONFIGS / "turbofan.yaml"
N = 100
WINDOWS = {
    "hpc": {"hpc.efficiency": 0.98},
    "T3": {"sensor.T3.bias": 5.0},
    "fouled": {"hpc.flow_capacity": 0.97, "hpc.efficiency": 0.985},
    "large": {"lpt.flow_capacity": 0.9},
    "slight": {"hpc.efficiency": 0.998},
    "worn": {f"{part}.efficiency": 0.985 for part in ("fan", "booster", "hpc", "hpt", "lpt")},
    "other_maps": {
        "fan.map.flow_speed_exponent": 3.5,
        "hpt.map.capacity_speed_slope": 0.4,
        "lpt.map.capacity_speed_slope": -0.4,
    },
    "healthy": {},
}
INSTRUMENTS = {
    "stuck": ("T45_K", lambda x, rng: np.full(N, 1234.5)),
    "stuck_late": ("P3_Pa", lambda x, rng: np.where(np.arange(N) < 40, x, x[40])),
    "stuck_input": ("Wf_kg_s", lambda x, rng: np.where(np.arange(N) < 60, x, x[60])),
    "noisy": ("T3_K", lambda x, rng: x + 12.0 * rng.standard_normal(N)),
    "noisy_input": ("Wf_kg_s", lambda x, rng: x * (1 + 0.03 * rng.standard_normal(N))),
    "drifting": ("P3_Pa", lambda x, rng: x + 40_000.0 * np.linspace(0, 1, N)),
    "drifting_input": ("Wf_kg_s", lambda x, rng: x + 0.06 * np.linspace(0, 1, N)),
    "noisy_beside_hpc": ("T5_K", lambda x, rng: x + 20.0 * rng.standard_normal(N)),
}
"""Column, and what its instrument makes of it."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """nominal.yaml and one recording per fault of WINDOWS."""
    folder = tmp_path_factory.mktemp("isolate")
    engine, rng = load_engine(ENGINE), np.random.default_rng(1)
    inputs = climb(engine, N)
    for name, fault in WINDOWS.items():
        write_csv(folder / f"{name}.csv", [Recording(recorded(engine, inputs, fault, rng))])
    broken = np.random.default_rng(2)
    for name, (column, read) in INSTRUMENTS.items():
        columns = recorded(engine, inputs, WINDOWS["hpc"] if "beside" in name else {}, broken)
        write_csv(folder / f"{name}.csv", [Recording({**columns, column: read(columns[column], broken)})])
    write_known(engine, ENGINE, inputs, folder / "nominal.yaml")
    return folder


@pytest.fixture
def isolate(folder, capsys):
    """`isolate(recording, *options)` → exit code, rows, what was said."""

    def call(recording, *options, nominal=True):
        words = ["-n", str(folder / "nominal.yaml")] if nominal else []
        code = main(["isolate", *words, str(folder / f"{recording}.csv"), *options, "--format", "json"])
        out, err = capsys.readouterr()
        return code, json.loads(out) if code == 0 else [], err

    return call


@pytest.mark.parametrize(("recording", "name"), [("hpc", "hpc.efficiency"), ("T3", "sensor.T3.bias")])
def test_the_fault_is_one_of_twenty_and_the_right_one(isolate, recording, name):
    _, rows, _ = isolate(recording)
    assert rows[0]["isolated"] == [name]


def test_a_wrong_sensor_is_taken_for_a_change_of_the_engine_only_when_sensors_are_excluded(isolate):
    for options in (("--no-sensors",), ("--monitor", "hp*", "--monitor", "core_nozzle.*")):
        _, rows, _ = isolate("T3", *options)
        assert rows[0]["isolated"] and not any("sensor" in name for name in rows[0]["isolated"])
    _, rows, _ = isolate("T3", "--method", "incremental", "--sensors")
    assert rows[0]["isolated"] == ["sensor.T3.bias"]


def test_a_worn_engine_is_not_explained_by_sensors_although_all_are_suspects(isolate):
    _, rows, _ = isolate("worn")
    assert set(rows[0]["isolated"]) >= {"hpc.efficiency", "hpt.efficiency", "fan.efficiency"}
    assert not any("sensor" in name for name in rows[0]["isolated"])


@pytest.mark.parametrize("options", [pytest.param((), marks=pytest.mark.slow), ("--by", "component")])
def test_an_engine_with_other_maps_gets_the_verdict_cannot_tell_and_the_reason(isolate, options):
    code, rows, err = isolate("other_maps", *options)
    assert code == 0 and rows[0]["verdict"] == "cannot tell"
    reason = rows[0]["note"].split(";")[0]
    assert (
        reason.startswith("something that is not among the suspects ")
        and reason.endswith("no conclusion")
        and reason in err
    )
    assert rows[0]["fit"] > 1 and isolate("other_maps", *options, "--exit-code")[0] == 0


def test_where_the_model_fits_the_verdict_is_a_fault_and_fit_is_near_1(isolate):
    _, rows, _ = isolate("hpc")
    assert rows[0]["verdict"] == "fault" and 0.7 < rows[0]["fit"] < 1.3 and not rows[0]["note"]
    assert rows[0]["unlisted"] < 0.05 and rows[0]["probability"] + rows[0]["unlisted"] <= 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"T45_K": 0.88}, {"sensor.T45.bias", "sensor.T45.scale"}),
        ({"P3_Pa": 1.08}, {"sensor.P3.bias", "sensor.P3.scale"}),
        ({"T3_K": "T45_K", "T45_K": "T3_K"}, None),
    ],
)
def test_an_instrument_far_off_is_named_and_none_that_is_off_by_more_than_instruments_are(
    isolate, folder, change, named
):
    """Columns times a factor, or with another's readings."""
    with open(folder / "healthy.csv") as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    with open(folder / "wrong.csv", "w") as out:
        table = csv.DictWriter(out, rows[0])
        table.writeheader()
        for row in rows:
            new = {c: row[x] if isinstance(x, str) else repr(float(row[c]) * x) for c, x in change.items()}
            table.writerow(row | new)
    _, found, err = isolate("wrong", "--accept-mismatch")
    if named is None:
        assert {row["verdict"] for row in found} == {
            "cannot tell"
        } and "the recording is likelier wrong than the engine (probability > 0.99)" in err
        assert all(row["probability"] < 0.01 and row["unlisted"] > 0.99 for row in found)
        _, found, _ = isolate("wrong", "--accept-mismatch", "--by", "component")
        assert found[0]["verdict"] == "cannot tell" and found[0]["probability"] < 0.01 and len(found[0]["rivals"]) < 50
    else:
        assert found[0]["verdict"] == "fault" and len(found[0]["isolated"]) == 1 and set(found[0]["isolated"]) <= named


def test_a_bias_is_told_in_the_sensors_own_words(isolate):
    assert "T3 sensor reads 5" in isolate("T3")[2]


def test_json_says_what_would_flip_the_answer_and_what_restoring_brings_and_csv_when_asked(isolate, folder, capsys):
    _, rows, err = isolate("hpc")
    flips = rows[0]["flips"]
    assert [f["times"] for f in flips] == sorted(f["times"] for f in flips)
    assert {f["kind"] for f in flips} == {"map", "sensor", "input", "prior"}
    assert f"{flips[0]['words']};" in f"{rows[0]['flips_told']};" and rows[0]["flips_told"] in err
    (module,) = rows[0]["work_scope"]["modules"]
    assert module["module"] == "hpc" and 0 < module["temperature_low"] < module["temperature_high"]
    assert "restoring the HPC would lower T45 by" in err
    assert (
        isolate("hpc", "--by", "component")[1][0]["flips"] and isolate("hpc", "--no-flips")[1][0].get("flips") is None
    )
    words = ["isolate", "-n", str(folder / "nominal.yaml"), str(folder / "hpc.csv"), "--no-header", "-f", "csv", "-q"]
    main(words)
    plain = capsys.readouterr().out.splitlines()[0].split(",")
    main([*words, "--flips", "--work-scope"])
    assert capsys.readouterr().out.splitlines()[0].split(",") == [*plain, "flips", "work_scope"]


def test_fouling_is_named_with_its_severity_out_of_the_catalogue(isolate):
    files = [
        word
        for name in ("hpc_fouling", "hpc_damage", "hpt_erosion", "fan_damage", "sensor_T3_bias")
        for word in ("--catalogue", str(CONFIGS / "faults" / f"{name}.yaml"))
    ]
    _, rows, err = isolate("fouled", *files)
    assert rows[0]["named"] == ["hpc_fouling"] and rows[0]["named_probability"] > 0.5
    assert "HPC fouling, severity " in err


def test_a_folder_is_a_catalogue(isolate):
    _, rows, _ = isolate("fouled", "--catalogue", str(CONFIGS / "faults"), "--one-sided")
    assert rows[0]["named"] in (["hpc_fouling"], ["hpc_wear"])
    assert {"hpc.efficiency", "hpc.flow_capacity"} <= set(rows[0]["isolated"])


def test_a_large_fault_is_judged_with_the_full_model_and_the_answer_says_so(isolate):
    _, rows, err = isolate("large")
    assert rows[0]["isolated"] == ["lpt.flow_capacity"] and "judged with the full model" in err
    assert rows[0]["lower"] < -0.1 < rows[0]["upper"]
    assert "full model" not in isolate("slight")[2]


@pytest.mark.slow
def test_advice_names_operating_conditions_and_compares_them_with_more_of_the_same(isolate):
    _, rows, err = isolate("fouled", "--window", "10", "--advise", "--extra-sensor", "T4_K", "5")
    advice = rows[0]["advice"]
    assert advice[0].startswith("to separate ")
    assert any("altitude_m" in text for text in advice) and any("like these" in text for text in advice)
    assert any("T4_K" in text for text in advice) and advice[1] in err
    assert any("whole flight" in text for text in advice)


@pytest.mark.parametrize(
    "options",
    [
        ("--one-sided", "--method", "incremental"),
        ("--advise", "--by", "component"),
        ("--extra-sensor", "T4_K", "5"),
        ("--nonlinear", "always", "--reference", "10"),
    ],
)
def test_choices_that_do_not_go_together_are_usage_errors(isolate, options):
    assert isolate("hpc", *options)[0] == 2


def test_sensors_and_advice_need_the_nominal_engine(isolate):
    assert isolate("hpc", "--sensors", nominal=False)[0] == 2


def test_an_unknown_extra_sensor_or_a_catalogue_of_another_engine_is_told_without_a_traceback(isolate, tmp_path):
    code, _, err = isolate("slight", "--advise", "--extra-sensor", "T99_K", "5")
    assert code == 2 and "T99_K" in err and "Traceback" not in err
    other = tmp_path / "other.yaml"
    other.write_text("kind: faults\nfaults:\n  - {name: x, changes: {afterburner.efficiency: -0.1}}\n")
    code, _, err = isolate("hpc", "--catalogue", str(other))
    assert code == 2 and "afterburner.efficiency" in err and "Traceback" not in err


@pytest.mark.parametrize(
    ("recording", "name", "words"),
    [
        ("stuck", "sensor.T45.stuck", "T45 sensor is stuck at 1234.5 K in all 100 records"),
        ("stuck_late", "sensor.P3.stuck", "from record 41 of 100 on"),
        ("stuck_input", "input.Wf.stuck", "from record 61 of 100 on"),
        ("noisy", "sensor.T3.noise", "times its stated noise"),
        ("noisy_input", "input.Wf.noise", "Wf reading scatters by 0.0"),
    ],
)
def test_an_instrument_that_is_stuck_or_scatters_is_named_alone(isolate, recording, name, words):
    code, rows, _ = isolate(recording, "--exit-code")
    assert code == 1
    code, rows, told = isolate(recording)
    assert (rows[0]["verdict"], rows[0]["isolated"]) == ("fault", [name])
    assert words in told and words in rows[0]["instruments"][0]
    assert rows[0]["fit"] < 1.5


def test_a_fault_is_found_beside_a_sensor_that_scatters(isolate):
    _, rows, _ = isolate("noisy_beside_hpc")
    assert rows[0]["isolated"] == ["hpc.efficiency", "sensor.T5.noise"]
    assert rows[0]["lower"] < -2.0 / 100 < rows[0]["upper"]


@pytest.mark.slow
def test_good_instruments_neither_stick_nor_scatter(isolate):
    for recording in WINDOWS:
        _, rows, _ = isolate(recording)
        assert rows[0]["instruments"] == []


@pytest.mark.parametrize(
    ("recording", "name", "rate"),
    [("drifting", "sensor.P3.drift", 40_000.0), ("drifting_input", "input.Wf.drift", 0.06)],
)
def test_an_instrument_that_drifts_is_named_with_its_rate_per_hour(isolate, recording, name, rate):
    _, rows, told = isolate(recording)
    assert (rows[0]["verdict"], rows[0]["isolated"]) == ("fault", [name])
    assert "drifts up by" in told
    per_hour = rate / (10.0 * (N - 1) / 3600)
    assert rows[0]["lower"] < per_hour < rows[0]["upper"]


@pytest.mark.slow
def test_good_instruments_do_not_drift(isolate):
    for recording in WINDOWS:
        _, rows, _ = isolate(recording)
        if rows[0]["verdict"] == "fault":
            assert not any(name.endswith("drift") for name in rows[0]["isolated"]), recording
