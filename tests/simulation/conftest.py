from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from simulation_toy import CONFIGS, ToyEngine


@pytest.fixture
def engine() -> ToyEngine:
    return ToyEngine()


@pytest.fixture
def flight_values():
    """Values of a flight file of configs/flights by its name."""
    from enginediag_cli.config.kinds import load_checked

    return lambda name: load_checked(CONFIGS / "flights" / f"{name}.yaml", "flight").values
