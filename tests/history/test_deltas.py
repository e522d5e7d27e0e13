"""Raw deltas over flights, their smoothing and alert levels: `trend --what deltas`."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli import load_nominal, simulate, trend
from enginediag_cli.__main__ import main
from enginediag_cli.errors import ConfigError
from enginediag_cli.history.deltas import _levels, _smooth, load_alerts
from enginediag_cli.shipped import shipped

CONFIGS = Path(__file__).parents[2] / "configs"
FAULT = """
kind: faults
description: a worn compressor from the fifth flight on
source: assumed
faults:
  - {name: worn, assumed: true, changes: {compressor.efficiency: -0.01}, law: {type: step, clock: flight, onset: 5}}
"""
ALERTS = """
kind: alerts
description: levels of a turbojet
setting: N1_rpm
smoothing_flights: 3
deltas:
  T5_K: {name: EGT, caution_high: 3, flights: 2}
"""
EPOCH_S = 1_700_000_000.0
DAY_S = 86_400.0


def call(*arguments) -> int:
    return int(main([str(a) for a in arguments]) or 0)


def table(path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A turbojet, its nominal file, and eight flights without noise, one a day, worn from the fifth on."""
    folder = tmp_path_factory.mktemp("deltas")
    (folder / "fault.yaml").write_text(FAULT, encoding="utf-8")
    engine = CONFIGS / "turbojet.yaml"
    assert call("simulate", engine, "--flights", 4, "--seed", 31, "-o", folder / "healthy.csv", "-q") == 0
    fitted = ["--no-cross-validation", "-o", folder / "nominal.yaml", "-q"]
    assert call("identify", engine, folder / "healthy.csv", *fitted) == 0
    # flown as identified, so that nothing but the fault is between reading and prediction
    flown = simulate(
        nominal=folder / "nominal.yaml", faults=folder / "fault.yaml", flights=8, noise="none", seed=31
    ).arrays()
    flown["time_s"] = EPOCH_S + DAY_S * np.asarray(flown["flight"], float) + flown["time_s"] % 1000.0
    names = list(flown)
    with open(folder / "flown.csv", "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(names)
        writer.writerows(zip(*(flown[name].tolist() for name in names), strict=True))
    return folder


def first_screen(page) -> str:
    return page[: page.index("<nav")]


def test_a_page_draws_deltas_and_says_first_which_are_beyond_a_level(folder, tmp_path):
    """The same from the rows of `trend` and from the recordings: five dots worn, a caution of 3 °C, two flights."""
    alerts, rows = tmp_path / "alerts.yaml", tmp_path / "deltas.csv"
    alerts.write_text(ALERTS, encoding="utf-8")
    asked = ["-n", folder / "nominal.yaml", "--alerts", alerts, folder / "flown.csv"]
    assert call("trend", "--what", "deltas", *asked, "-o", rows, "-q", "--event", 3) == 0
    pages = [tmp_path / "rows.html", tmp_path / "recordings.html"]
    assert call("report", rows, "-q", "--static", "-o", pages[0]) in (0, 3)
    assert call("report", *asked, "-q", "--static", "-o", pages[1]) == 0
    since = [row for row in table(rows) if row["column"] == "T5_K"][-1]["since"]
    for page in (file.read_text(encoding="utf-8") for file in pages):
        assert f"ΔEGT caution since flight {since} (2023-11-" in first_screen(page) and "now +" in first_screen(page)
        assert "<strong>ΔEGT at equal N1</strong>" in page and "Raw deltas of other readings" in page
        assert "smoothed over 3 flights, with 95 % band" in page
    assert ">maintenance</text>" in pages[0].read_text(encoding="utf-8")


def test_alert_levels_of_a_page_need_the_nominal_engine(folder, tmp_path, capfd):
    rows, alerts = tmp_path / "deltas.csv", tmp_path / "alerts.yaml"
    alerts.write_text(ALERTS, encoding="utf-8")
    plain = ["trend", "-n", folder / "nominal.yaml", "--what", "deltas", folder / "flown.csv", "-o", rows, "-q"]
    assert call(*plain) == 0
    assert call("report", rows, "--alerts", alerts, "-o", tmp_path / "page.html") == 2
    assert "--alerts needs -n NOMINAL" in capfd.readouterr().err
    assert call("report", rows, "-q", "--static", "-o", tmp_path / "page.html") in (0, 3)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    # nothing else is shown, so that nothing is folded
    assert "ΔT5" in page and "Raw deltas of readings, flight by flight" not in page
    assert "caution" not in first_screen(page) and "Give the recordings with -n NOMINAL" in first_screen(page)


def test_at_the_engines_own_power_setting_deltas_are_mean_residuals(folder, tmp_path):
    nominal, flown, records = folder / "nominal.yaml", folder / "flown.csv", tmp_path / "records.csv"
    assert call("residual", "-n", nominal, "--what", "records", flown, "-o", records) == 0
    rows = [row for row in table(records) if row["state"] in ("ok", "outside the operating points identified")]
    found = trend(nominal, flown, what="deltas").deltas()[""]
    assert found.setting == "Wf_kg_s" and found.dates is not None and not found.level.any()
    for t, flight in ((1, "2"), (6, "7")):
        for column in ("T5_K", "N1_rpm"):
            j = found.columns.index(column)
            mine = [float(row[f"{column}:residual"]) for row in rows if row["flight"] == flight]
            shown = found.delta[t, j]
            if found.units[j] == "%":
                read = found.stretches[t].window.readings[column]
                shown *= (read - np.mean(mine)) / 100.0
            assert shown == pytest.approx(np.mean(mine), rel=0.02, abs=1e-3)


def test_at_equal_shaft_speed_they_are_what_the_engine_model_solves(folder):
    nominal, flown = folder / "nominal.yaml", folder / "flown.csv"
    found = trend(nominal, flown, what="deltas", setting="N1_rpm").deltas()[""]
    assert "N1_rpm" not in found.columns
    baseline = load_nominal(nominal)
    model = baseline.nominal.error_model.wrap(baseline.engine) if baseline.nominal.error_model else baseline.engine
    theta = baseline.nominal.theta0
    window = found.stretches[6].window
    inputs = {c: np.array([v]) for c, v in window.conditions.items()}
    worn = model.predict(inputs, {**theta, "compressor.efficiency": 0.99 * theta["compressor.efficiency"]})
    N1, T5 = (dict(zip(worn.columns, worn.y[0], strict=True))[c] for c in ("N1_rpm", "T5_K"))
    low, high = 0.9, 1.1  # the nominal engine at that speed, by bisection on its fuel
    for _ in range(40):
        middle = 0.5 * (low + high)
        at = model.predict({**inputs, "Wf_kg_s": middle * inputs["Wf_kg_s"]}, theta, sensors=["N1_rpm", "T5_K"])
        low, high = (middle, high) if at.y[0, 0] < N1 else (low, middle)
    fuel, hot = found.delta[6, found.columns.index("Wf_kg_s")], found.delta[6, found.columns.index("T5_K")]
    assert fuel == pytest.approx(100.0 * (1.0 / middle - 1.0), rel=0.1) and fuel > 0.3
    assert hot == pytest.approx(T5 - at.y[0, 1], rel=0.1) and hot > 3


def test_levels_come_after_so_many_flights_and_are_shown_with_dates_and_events(folder, tmp_path, capfd):
    alerts, out, picture = tmp_path / "alerts.yaml", tmp_path / "deltas.csv", tmp_path / "deltas.svg"
    alerts.write_text(ALERTS, encoding="utf-8")
    plain = ["trend", "-n", folder / "nominal.yaml", "--what", "deltas", "--alerts", alerts]
    assert call(*plain, folder / "flown.csv", "-o", out, "--picture", picture, "--event", 3) == 0
    assert "ΔEGT: caution since flight" in capfd.readouterr().err
    hot = [row for row in table(out) if row["column"] == "T5_K"]
    assert [row["name"] for row in hot] == ["EGT"] * 8 and {row["unit"] for row in hot} == {"°C"}
    assert [row["level"] for row in hot[:5]] == [""] * 5 and hot[-1]["level"] == "caution"
    first = next(k for k, row in enumerate(hot) if row["level"])
    assert int(hot[first]["since"]) == first and hot[0]["date"].startswith("2023-11-15")  # two flights in a row
    drawn = picture.read_text(encoding="utf-8")
    assert "ΔEGT at equal N1<" in drawn and "2023-11-1" in drawn and "maintenance" in drawn and "caution" in drawn


def test_smoothing_is_the_weighted_mean_it_states_and_begins_anew_after_maintenance():
    delta = np.array([[1.0], [3.0], [np.nan], [5.0], [9.0]])
    mean, _ = _smooth(delta, np.full((5, 1), 0.5), 3.0, (5,))
    w = 0.5 ** np.arange(4.0)  # 1 - 2/(3 + 1)
    expected = (5.0 + 3.0 * w[2] + 1.0 * w[3]) / (1.0 + w[2] + w[3])
    assert mean[3, 0] == pytest.approx(expected) and mean[2, 0] == mean[1, 0] and mean[4, 0] == 9.0
    many = np.random.default_rng(3).normal(0.0, 2.0, (4000, 1))
    mean, error = _smooth(many, np.full((4000, 1), 0.01), 5.0, ())
    assert np.std(mean[50:, 0]) == pytest.approx(np.mean(error[50:, 0]), rel=0.08)  # by how flights scatter


def test_a_level_that_must_last_days_needs_dates():
    smoothed = np.array([[0.0], [5.0], [5.0], [5.0], [0.0]])
    own = {
        "caution_high": 4.0,
        "warning_high": None,
        "caution_low": None,
        "warning_low": None,
        "flights": 1,
        "days": 2.0,
    }
    level, since = _levels(("T5_K",), smoothed, {"T5_K": own}, DAY_S * np.arange(5.0))
    assert level[:, 0].tolist() == ["", "", "", "caution", ""] and since[:, 0].tolist() == [0, 0, 0, 2, 0]
    with pytest.raises(Exception, match="needs dates"):
        _levels(("T5_K",), smoothed, {"T5_K": own}, None)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("caution_high: 3", "caution_high: 3, warning_high: 2"), "comes before the caution"),
        (("caution_high: 3, ", ""), "no level"),
        (("kind: alerts", "kind: faults"), "alerts"),
    ],
)
def test_files_of_levels_that_make_no_sense_are_refused(tmp_path, change, message):
    file = tmp_path / "alerts.yaml"
    file.write_text(ALERTS.replace(*change), encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        load_alerts(file)


def test_shipped_levels_are_of_the_engine_that_they_name():
    found = load_alerts(shipped("alerts/turbofan.yaml"))
    assert found.setting == "N1_rpm" and list(found.levels) == ["T45_K", "Wf_kg_s", "N2_rpm"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--alerts", "alerts/turbofan.yaml"], "go with --what deltas"),
        (["--what", "deltas", "--setting", "N7_rpm"], "no reading 'N7_rpm'"),
        (["--what", "deltas", "--alerts", "alerts/turbofan.yaml"], "alert levels of 'T45_K'"),
        (["--what", "deltas", "--limit", "T5_K", "1000"], "leave its limits"),
    ],
)
def test_what_makes_no_sense_is_refused(folder, capfd, options, message):
    assert call("trend", "-n", folder / "nominal.yaml", *options, folder / "flown.csv") != 0
    assert message in capfd.readouterr().err
