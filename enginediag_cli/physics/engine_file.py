"""An engine file → Engine, with the effects of the library that the file lists under `physics:`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from enginediag_cli.engine.description import EngineDescription
    from enginediag_cli.engine.engine import Engine


def load_engine(path: str | Path | EngineDescription, power_setting: str | None = None) -> Engine:
    """Reads, checks and sizes an engine, from its file or a description that travels in another file; `power_setting`
    replaces the file's. Raises ConfigError."""
    from enginediag_cli.engine.load import build_engine
    from enginediag_cli.physics.carried import carried_effects

    return build_engine(path, carried_effects, power_setting)
