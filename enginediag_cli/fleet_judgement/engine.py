"""What the history of one engine says."""

from __future__ import annotations

from enginediag_cli.detection.trend_of_files import Series
from enginediag_cli.fleet_judgement.finding import NO_VERDICT, EngineFinding, FleetSettings
from enginediag_cli.fleet_judgement.history import EngineHistory


def judged_engine(history: EngineHistory, series: Series, settings: FleetSettings) -> EngineFinding:
    """Stands in until there is one."""
    series.readings(history.serial)
    flights = len(history.stretches)
    records = sum(x.window.records for x in history.stretches)
    return EngineFinding(
        history.serial, history.build, flights, records, NO_VERDICT, "not judged yet", baseline=history.baseline
    )
