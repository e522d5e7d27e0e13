"""The shipped example of a fleet, made as its head says: two of its six engines have changed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "fleet_example.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    specification = importlib.util.spec_from_file_location("fleet_example", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize(("first", "fillers"), [(1, 0.0), (1, 0.002)])
def test_exactly_the_two_engines_that_changed_are_flagged_and_named(example, tmp_path, first, fillers) -> None:
    flagged, named, healthy = example.judge(example.make(tmp_path, first, fillers))
    assert flagged == ["5", "6"] and named == {"5": {"hpc"}, "6": {"sensor.T3"}}
    assert healthy == ["1", "2", "3", "4"]
