from __future__ import annotations

import pytest
from simulation_toy import ToyEngine


@pytest.fixture
def engine() -> ToyEngine:
    return ToyEngine()
