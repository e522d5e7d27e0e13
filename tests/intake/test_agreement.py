"""Wrong files are recognised, right ones are not refused: single mistakes, faults, flights in which a unit changes."""

from __future__ import annotations

import numpy as np
import pytest
from made_mistakes import KINDS, mistaken, recording

from enginediag_cli.__main__ import main
from enginediag_cli.engine.overview import design_table, heating_value_doubts, heating_values
from enginediag_cli.intake.agreement import AgreementCheck, check_against_engine
from enginediag_cli.intake.comparison import nominal_reference
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.shipped import shipped


@pytest.fixture(scope="module")
def turbofan():
    return load_engine(shipped("turbofan.yaml"))


@pytest.fixture(scope="module")
def inputs(turbofan):
    """Sixty points of flights between 500 m and 11 km."""
    rng = np.random.default_rng(11)
    altitude = rng.uniform(500, 11000, 60)
    known = {
        "altitude_m": altitude,
        "mach": np.clip(0.25 + 0.5 * altitude / 11000 + rng.uniform(-0.05, 0.05, 60), 0.2, 0.82),
        "dT_isa_K": rng.uniform(-12, 12, 60),
    }
    return {**known, "Wf_kg_s": turbofan.power_from_fraction(rng.uniform(0.3, 1.0, 60), known)}


@pytest.fixture(scope="module")
def identified(turbofan):
    noise = np.array([s.noise_sigma for s in turbofan.sensors.values()])
    return AgreementCheck(nominal_reference(turbofan, {}, tuple(turbofan.sensors), noise), turbofan)


def test_a_constant_input_is_not_taken_for_a_sensor_that_is_in_the_wrong_unit():
    plant = load_engine(shipped("power_plant.yaml"))
    rng = np.random.default_rng(13)
    middle = {c: np.full(40, sum(plant.envelope[c]) / 2) for c in plant.inputs if c in plant.envelope}
    moved = {c: v * rng.uniform(0.98, 1.02, 40) for c, v in middle.items() if c != "dP_inlet_Pa"}
    columns = recording(plant, {"dP_inlet_Pa": np.full(40, 450.0), **moved}, rng)
    (found,) = check_against_engine(plant).find_mismatches(
        Recording({**columns, "P3_Pa": columns["P3_Pa"] / 6894.757}, source="x.csv")
    )
    assert "P3_Pa is in psi" in str(found)


QUICK = ("swapped",)


@pytest.mark.parametrize("kind", [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in KINDS])
def test_a_single_mistake_is_named(kind, turbofan, inputs, identified):
    rng = np.random.default_rng(5)
    wrong = mistaken(recording(turbofan, inputs, rng, identified=True), turbofan, kind, rng)
    (found,) = identified.find_mismatches(Recording(wrong.columns, source="flight.csv"))
    assert found.trial is not None, str(found)
    assert any(word in found.trial.mistake.words for word in wrong.words), str(found)
    assert wrong.column in ("", found.trial.mistake.column)


def test_a_sound_recording_of_another_engine_of_the_kind_passes_and_one_in_fahrenheit_does_not(turbofan, inputs):
    rng = np.random.default_rng(6)
    agreement = check_against_engine(turbofan)
    columns = recording(turbofan, inputs, rng)
    assert agreement.find_mismatches(Recording(columns, source="x.csv")) == []
    (found,) = agreement.find_mismatches(
        Recording({**columns, "T45_K": columns["T45_K"] * 1.8 - 459.67}, source="x.csv")
    )
    assert "T45_K is in degF" in str(found)


@pytest.mark.parametrize(
    "values",
    [{"hpc.efficiency": 0.92}, {"fan.flow_capacity": 0.92, "fan.efficiency": 0.96}],
)
def test_a_damaged_engine_is_not_refused(values, turbofan, inputs, identified):
    answer = turbofan.predict(inputs, values)
    columns = {**inputs, **{c: answer.y[:, j] for j, c in enumerate(turbofan.sensors)}}
    assert identified.find_mismatches(Recording(columns, source="x.csv")) == []


@pytest.mark.parametrize(("sensor", "change"), [("T3_K", 10.0), ("P3_Pa", 4e4)])
def test_a_wrong_instrument_is_not_refused(sensor, change, turbofan, inputs, identified):
    columns = recording(turbofan, inputs, np.random.default_rng(8), identified=True)
    assert identified.find_mismatches(Recording({**columns, sensor: columns[sensor] + change}, source="x.csv")) == []


def test_fillers_in_two_of_a_hundred_cells_are_no_mistake(turbofan, inputs, identified):
    rng = np.random.default_rng(9)
    columns = recording(turbofan, inputs, rng, identified=True)
    spoilt = {c: np.where(rng.uniform(size=60) < 0.02, 999.0, v) for c, v in columns.items()}
    assert identified.find_mismatches(Recording(spoilt, source="x.csv")) == []


@pytest.mark.parametrize("known", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_flights_since_which_a_unit_has_changed_are_named(known, turbofan, inputs, identified):
    agreement = identified if known else check_against_engine(turbofan)
    columns = recording(turbofan, inputs, np.random.default_rng(10), identified=True)
    flight = np.repeat(np.arange(1, 7), 10)
    columns["Wf_kg_s"] = np.where(flight >= 4, columns["Wf_kg_s"] / 0.45359237, columns["Wf_kg_s"])
    table = Recording(columns, {"flight": [str(f) for f in flight]}, line=np.arange(2, 62), source="x.csv")
    (found,) = agreement.find_mismatches(table)
    assert found.flights == ("4", "5", "6") and "lb_" in str(found)


@pytest.mark.slow
def test_another_shipped_engine_is_named(turbofan, inputs):
    columns = recording(turbofan, inputs, np.random.default_rng(12), identified=True)
    (found,) = check_against_engine(load_engine(shipped("turbojet.yaml"))).find_mismatches(Recording(columns))
    assert "this is the engine turbofan (turbofan.yaml)" in str(found)


def test_commands_end_with_2_before_they_judge_and_go_on_where_it_is_accepted(tmp_path, capsys):
    engine, flight, wrong = shipped("turbojet.yaml"), tmp_path / "flight.csv", tmp_path / "wrong.csv"
    nominal, other = tmp_path / "nominal.yaml", tmp_path / "other.yaml"
    assert main(["simulate", str(engine), "--records", "80", "--seed", "4", "-q", "-o", str(flight)]) == 0
    identify = ["identify", str(engine), "--no-cross-validation", "-q"]
    assert main([*identify, str(flight), "-o", str(nominal)]) == 0
    lines = [line for line in flight.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    wrong.write_text(
        "\n".join([lines[0].replace("T5_K", "T_K").replace("T3_K", "T5_K").replace("T_K", "T3_K"), *lines[1:]])
    )
    capsys.readouterr()
    for words in ([*identify, "-o", str(other)], *([c, "-n", str(nominal)] for c in ("detect", "trend"))):
        assert main([*words, str(wrong)]) == 2
        told = capsys.readouterr()
        assert "T3_K and T5_K are swapped" in told.err or "T5_K and T3_K are swapped" in told.err
        assert not told.out and not other.exists()
    assert main(["detect", "-n", str(nominal), str(wrong), "--accept-mismatch"]) in (0, 3)
    assert "as read, readings and model are" in capsys.readouterr().err


def test_heating_values_are_those_of_tables():
    # methane 50.0 and 55.5, n-octane 44.4 and 47.9 MJ/kg (NIST)
    for ratio, lower, higher in ((4.0, 50.0e6, 55.5e6), (18 / 8, 44.4e6, 47.9e6)):
        assert heating_values(ratio) == pytest.approx((lower, higher), rel=0.015)


def test_no_shipped_engine_has_a_heating_value_that_does_not_fit():
    engines = [load_engine(path) for path in sorted(shipped("turbofan.yaml").parent.glob("*.yaml"))]
    assert [str(doubt) for engine in engines for doubt in heating_value_doubts(engine)] == []


def test_the_design_table_is_what_the_engine_predicts(turbofan):
    table = design_table(turbofan)
    assert table.points[0] == "design, rating" and len(table.points) == 10
    known = {c: np.array([turbofan.declared["design"][c]]) for c in ("altitude_m", "mach", "dT_isa_K")}
    power = turbofan.power_from_fraction(1.0, known)
    answer = turbofan.predict({**known, "Wf_kg_s": power}, sensors=["Fn_N", "OPR"])
    shown = dict(zip(table.columns, table.values[0], strict=True))
    assert [shown["Fn_N"], shown["OPR"]] == pytest.approx(answer.y[0].tolist())
    assert shown["SFC_kg_Ns"] == pytest.approx(float(power[0]) / answer.y[0, 0])


def test_a_gearbox_behind_its_turbine_is_called_so(tmp_path, capsys):
    lines = shipped("turboprop.yaml").read_text(encoding="utf-8").splitlines(keepends=True)
    start = next(k for k, line in enumerate(lines) if "type: gearbox" in line)
    end = next(k for k in range(start + 1, len(lines)) if lines[k].lstrip().startswith("- "))
    last = next(k for k, line in enumerate(lines) if "name: exhaust_stubs" in line)
    moved = [*lines[:start], *lines[end:last], *lines[start:end], *lines[last:]]
    path = tmp_path / "turboprop.yaml"
    path.write_text("".join(moved), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert "must stand before turbine 'power_turbine', which drives it" in capsys.readouterr().err


def test_short_recordings_are_predicted_together_as_each_by_itself(turbofan):
    yardstick = nominal_reference(turbofan, {}, tuple(turbofan.sensors), np.ones(len(turbofan.sensors)))
    columns = {"altitude_m": [1e3, 9e3], "mach": [0.3, 0.8], "dT_isa_K": [5.0, 0.0], "Wf_kg_s": [1.6, 0.8]}
    one = {c: np.array(v) for c, v in columns.items()}
    other = {c: v[:1] for c, v in one.items()} | {"Wf_kg_s": np.array([1.2])}
    for alone, together in zip((one, other), yardstick.predict_several([one, other]), strict=True):
        expected = yardstick.predict(alone)
        np.testing.assert_allclose(together.y, expected.y, rtol=1e-9)
        np.testing.assert_allclose(together.jacobian, expected.jacobian, rtol=1e-6, atol=1e-9)
        assert together.ok.tolist() == list(expected.ok)


@pytest.mark.parametrize("drawn", [True, False])
def test_swapped_speeds_in_per_cent_are_named_although_an_engine_of_the_kind_comes_near(
    turbofan, tmp_path, capsys, drawn
):
    """Both spools near 100 %: what is swapped differs from the right file by a few per cent, less than engines do."""
    rng = np.random.default_rng(17)
    altitude = np.repeat([600.0, 10500.0], 30) + rng.uniform(-300, 300, 60)
    flown = {"altitude_m": altitude, "mach": np.where(altitude < 2000, 0.25, 0.78) + rng.uniform(-0.02, 0.02, 60)}
    flown["dT_isa_K"] = rng.uniform(-12, 12, 60)
    power = turbofan.power_from_fraction(np.repeat([0.97, 0.8], 30) + rng.uniform(-0.05, 0.03, 60), flown)
    columns = recording(turbofan, {**flown, "Wf_kg_s": power}, rng, identified=not drawn)
    full = {f"{s['speed_label']}_rpm": s["design_speed_rpm"] for s in turbofan.declared["shafts"]}
    written = {c: 100 * v / full[c] if c in full else v for c, v in columns.items()}
    flight = tmp_path / "flight.csv"
    write_csv(flight, [Recording(written)])
    for low, high, code in (("N1_rpm", "N2_rpm", 0), ("N2_rpm", "N1_rpm", 2)):
        lines = [f"  {c}: {{from: {c}}}" for c in columns if c not in full]
        lines += [f"  N1_rpm: {{from: {low}, unit: pct, full_scale: {full['N1_rpm']}}}"]
        lines += [f"  N2_rpm: {{from: {high}, unit: pct, full_scale: {full['N2_rpm']}}}"]
        (tmp_path / "recorder.yaml").write_text(
            "kind: recorder\ndescription: one\nsources: [one]\ncolumns:\n" + "\n".join(lines)
        )
        words = ["check", "--engine", str(shipped("turbofan.yaml")), "--recorder", str(tmp_path / "recorder.yaml")]
        assert main([*words, str(flight)]) == code
        text = "".join(capsys.readouterr())
        assert ("are swapped" in text) is bool(code), text


def test_what_is_likelier_a_wrong_file_than_an_engine_is_no_healthy_one(turbofan, inputs, identified):
    """Two sensors that nothing explains are a wrong file, one that nothing explains is an instrument that failed."""
    columns = recording(turbofan, inputs, np.random.default_rng(18), identified=True)
    failed = {**columns, "P3_Pa": columns["P3_Pa"] * 0.01}
    swapped = {**columns, "T3_K": columns["T45_K"], "T45_K": columns["T3_K"]}
    (one,), (two,) = (identified.find_mismatches(Recording(c, source="x"), search=False) for c in (failed, swapped))
    assert one.wrong_file < 0.5 < 0.99 < two.wrong_file and two.is_likely_wrong and two.concerns("x", "3", "left")
