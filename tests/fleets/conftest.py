"""One small fleet, written once for each process of the tests."""

from __future__ import annotations

from pathlib import Path

import pytest
import small_fleet


@pytest.fixture(scope="session")
def fleet_file(tmp_path_factory) -> Path:
    return small_fleet.make(tmp_path_factory.mktemp("fleet"))
