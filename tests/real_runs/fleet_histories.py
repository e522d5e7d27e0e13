"""The flights of a fleet of C-MAPSS as histories, one per engine, from a nominal file and a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ground_recordings import CONFIGS

from enginediag_cli.detection.series import Series, build_series
from enginediag_cli.fleets.findings import EngineHistory
from enginediag_cli.history.engines import EngineSums, HistoryWindows
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.residuals.files import WindowReader, WindowSettings
from enginediag_cli.residuals.monitor import build_monitor
from enginediag_cli.residuals.reduced import monitor_for_series
from enginediag_cli.residuals.windows import WindowPlan

RECORDER = CONFIGS / "recorders" / "cmapss.yaml"


def fleet_series(nominal: Path, recording: Path) -> tuple[Series, Mapping[str, EngineSums]]:
    """The flights of every engine, one record each, and the sums of their statistics, as `enginediag trend` reads
    them."""
    monitor = monitor_for_series(build_monitor(open_baseline(nominal), sensors=True))
    intake = RecordingLoader(
        RecordingSource((str(recording),), str(RECORDER)), required_columns(monitor.engine, monitor.sensors)
    )
    windows = HistoryWindows(WindowReader(intake, monitor, WindowSettings(WindowPlan().series_plan), series=True))
    return build_series(windows, law="none"), windows.engines


def histories(series: Series, sums: Mapping[str, EngineSums], baseline: int = 20) -> list[EngineHistory]:
    """One per engine, with its first flights as baseline."""
    return [EngineHistory(serial, "", mine, sums[serial], baseline) for serial, mine in series.stretches.items()]


def chosen(history: EngineHistory, flights: Sequence[int]) -> EngineHistory:
    """The history of these flights alone, in this order."""
    epochs = [replace(history.sums.epochs[k], first=number) for number, k in enumerate(flights)]
    sums = EngineSums(history.sums.like, epochs, len(epochs))
    return replace(history, stretches=[history.stretches[k] for k in flights], sums=sums)
