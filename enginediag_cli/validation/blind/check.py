"""Whether an engine can be flown in blind trials, before any worker is started."""

from __future__ import annotations

from enginediag_cli.errors import DataError
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.blind.flights import check_engine as check_flights
from enginediag_cli.validation.blind.visible import drawable


def check_engine(path: str) -> None:
    """Raises DataError, or ConfigError of the engine file, for an engine that cannot."""
    engine = load_engine(path)
    check_flights(engine)
    silent = [c for c, s in engine.sensors.items() if not s.noise_sigma > 0]
    if silent:
        raise DataError(
            f"{engine.name}: blind trials need the noise of every sensor; none is stated for {', '.join(silent)}"
        )
    if not engine.monitored or not drawable(engine):
        raise DataError(f"{engine.name}: nothing to conceal: no monitored parameter, or no effect that can act")
