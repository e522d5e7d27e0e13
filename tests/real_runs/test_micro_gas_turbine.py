"""A real machine whose load controller ramps, which no column tells: named, and unseen runs predicted."""

from __future__ import annotations

import pytest
from ground_recordings import public_data
from micro_gas_turbine import judged, rms

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


def test_the_rate_limit_is_named_from_four_runs_and_predicts_two_others():
    folder = public_data("micro_gas_turbine")
    train = [str(folder / f"ex_{k}.csv") for k in (20, 21, 23, 9)]
    label, intervals, left = judged(train, [str(folder / f"ex_{k}.csv") for k in (1, 24)])
    assert label == "load_rate_limit@generator"
    assert set(intervals) == {f"load_rate_limit.generator.{way}" for way in ("rise", "fall")}
    assert rms(left["static"]) > 300.0 and rms(left["lag"]) > 200.0
    assert rms(left["found"]) < 150.0
    assert rms(left["found_with_offset"]) < 125.0
