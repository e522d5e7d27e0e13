"""Engines that were taken off tell how far the others may go."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.fleet_file import find_recordings, load_fleet
from enginediag_cli.fleets.margin import learnt_limit
from enginediag_cli.fleets.models import SerialRunner
from enginediag_cli.fleets.run import run_fleet
from enginediag_cli.fleets.store import FleetStore


def ran(fleet_file, folder, judge):
    path = fleet_file.with_name(f"fleet_{abs(hash(judge))}.yaml")
    path.write_text(fleet_file.read_text() + f"judge: {judge}\n")
    fleet = load_fleet(path)
    return run_fleet(fleet, find_recordings(fleet), FleetStore(folder), SerialRunner())


def test_what_they_had_lost_is_the_limit_of_all_others(fleet_file, tmp_path):
    result = ran(fleet_file, tmp_path, "{taken_off: ['1', '2', '3']}")
    named = [f for f in result.finding.engines if f.serial in ("1", "2", "3")]
    assert result.consumed_limit_K == pytest.approx(learnt_limit(sorted(named, key=lambda f: f.serial)))
    other = next(f for f in result.finding.engines if f.serial == "4")
    assert not np.isnan(other.margin.remaining_flights.value) or other.margin.reason
    assert "no limit" not in other.margin.reason


def test_an_engine_of_which_there_is_no_recording_tells_nothing(fleet_file, tmp_path):
    with pytest.raises(DataError, match="taken_off names engine 7, which is not judged"):
        ran(fleet_file, tmp_path, "{taken_off: ['1', '2', '7']}")
