from __future__ import annotations

import pytest
from simulation_toy import CONFIGS, ToyEngine


@pytest.fixture
def engine() -> ToyEngine:
    return ToyEngine()


@pytest.fixture
def flight_values():
    """Values of a flight file of configs/flights by its name, without the constants that only its engine takes."""
    from enginediag_cli.config.validate import load_checked

    return lambda name: {**load_checked(CONFIGS / "flights" / f"{name}.yaml", "flight").values, "constants": {}}
