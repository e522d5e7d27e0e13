"""A flight that is followed: instruments that get stuck or scatter are named as it goes on, and raise no alarm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known

from enginediag_cli.history.follow import FlightFollower
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.residuals.monitor import build_monitor
from enginediag_cli.residuals.reduced import add_sensor_lags

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
RECORDS, SINCE = 160, 60
"""Of the flight, and the record from which an instrument is wrong."""


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    folder, engine = tmp_path_factory.mktemp("live"), load_engine(ENGINE)
    write_known(engine, ENGINE, climb(engine, RECORDS), folder / "nominal.yaml")
    return add_sensor_lags(build_monitor(open_baseline(str(folder / "nominal.yaml"))))


def followed(monitor, path: Path, wrong):
    """The reports of a flight in which `wrong` changes columns: column -> what becomes of its readings (n,)."""
    engine = load_engine(ENGINE)
    table = recorded(engine, climb(engine, RECORDS), {}, np.random.default_rng(7))
    for column, become in wrong.items():
        table[column] = np.concatenate([table[column][:SINCE], become(table[column][SINCE:])])
    write_csv(path, [Recording(table)])
    intake = RecordingLoader(RecordingSource((str(path),)), required_columns(monitor.engine, monitor.sensors))
    return list(FlightFollower(intake, monitor, 0.01, idle_s=0.0).reports())


def repeated(x):
    return np.full_like(x, x[0])


def scattered(x):
    return x * (1 + 0.03 * np.random.default_rng(1).standard_normal(len(x)))


@pytest.mark.parametrize(
    ("column", "become", "name"),
    [
        ("T45_K", repeated, "sensor.T45.stuck"),
        ("P3_Pa", scattered, "sensor.P3.noise"),
        ("altitude_m", repeated, "input.altitude.stuck"),
    ],
)
def test_a_wrong_instrument_is_named_and_no_alarm_is_raised(monitor, tmp_path: Path, column, become, name) -> None:
    reports = followed(monitor, tmp_path / "flight.csv", {column: become})
    named = [[fault.name for fault in report.instruments] for report in reports]
    assert all(not names for names, report in zip(named, reports, strict=True) if report.last_line <= SINCE + 1)
    assert named[-1] == [name]
    assert not any(report.alarm for report in reports)
    if name.endswith("stuck"):
        (fault,) = reports[-1].instruments
        # the record before, which read the same, belongs to the run
        assert fault.first == SINCE + 1 and fault.count == fault.records - SINCE


def test_a_good_flight_names_no_instrument(monitor, tmp_path: Path) -> None:
    assert not any(report.instruments or report.alarm for report in followed(monitor, tmp_path / "good.csv", {}))
