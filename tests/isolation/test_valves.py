"""Bleed valves that stand open are named, or said beside the compressor that they cannot be told from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, nominal_of, recorded

from enginediag_cli.identification.nominal import SensorNoise
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.isolation.diagnosis import DiagnosisOptions
from enginediag_cli.isolation.windows import WindowIsolation
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.residuals.files import WindowReader
from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.monitor import build_monitor

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
RECORDED = ("N1_rpm", "N2_rpm", "T45_K")
"""What most airliners' reports hold beside fuel flow: too few to tell every valve from its compressor."""
RECORDS = 12
"""Of a flight that shows the change, and hardly what it is."""


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    engine, file = load_engine(ENGINE), tmp_path_factory.mktemp("valves") / "nominal.yaml"
    noise = [SensorNoise(c, engine.sensors[c].noise_sigma, 0.0, RECORDS, float(RECORDS), 0) for c in RECORDED]
    write_nominal(replace(nominal_of(engine, ENGINE, noise, climb(engine, RECORDS)), engine_path=str(ENGINE)), file)
    return build_monitor(open_baseline(str(file)), sensors=True)


@pytest.mark.parametrize("valve", ["bleed.booster.fraction", "bleed.hpc.fraction"])
def test_a_valve_that_passes_two_per_cent_is_no_compressor(monitor, valve: str, tmp_path: Path) -> None:
    engine = load_engine(ENGINE)
    for seed in range(4):
        table = recorded(engine, climb(engine, RECORDS), {valve: 0.02}, np.random.default_rng(seed))
        path = tmp_path / f"{seed}.csv"
        write_csv(path, [Recording(table)])
        files = WindowReader(
            RecordingLoader(RecordingSource((str(path),)), required_columns(monitor.engine, monitor.sensors)), monitor
        )
        kept = RecentRecords(monitor, short_windows=False)
        (found,) = WindowIsolation(files, DiagnosisOptions(), 0.01, kept_records=kept).windows()
        result = found.diagnosis.result
        assert result.isolated == (valve,) or (result.ambiguity and (valve,) in result.ambiguity.members)
