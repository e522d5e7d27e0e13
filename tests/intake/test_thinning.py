"""Training on more records than memory is taken for: runs of them, evenly spread."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.intake.loader import RUN, Thinning, WholeFlight
from enginediag_cli.recordings.table import Recording


def recording(n):
    return Recording({"x": np.arange(n, dtype=float)}, {}, line=np.arange(n), source="a.csv")


@pytest.mark.parametrize("chunk", [100, 333, 20_000])
def test_runs_evenly_spread_are_kept_whatever_the_chunks(chunk):
    whole, thinning = recording(20_000), Thinning(most=3_000)
    kept = thinning.thin(whole.select(slice(i, i + chunk)) for i in range(0, 20_000, chunk))
    assert thinning.total == 20_000 and 1_500 <= len(kept) <= 3_000
    every = 2**thinning.halved
    expected = np.flatnonzero((np.arange(20_000) // RUN) % every == 0)
    np.testing.assert_array_equal(kept["x"], expected)


def test_few_records_are_all_kept_and_files_are_thinned_alike():
    assert len(Thinning(most=3_000).thin([recording(3_000)])) == 3_000
    assert len(Thinning().thin([recording(50_000)])) == 50_000
    thinning = Thinning(most=3_000)
    flights = []
    for _ in range(4):
        part = thinning.thin([recording(2_000)])
        flights.append((WholeFlight("a.csv", "", TrainingRecording("a", dict(part.columns))), thinning.halved))
    sizes = [len(f.recording.columns["x"]) for f in thinning.thin_flights(flights)]
    assert len(sizes) == 4 and sum(sizes) <= 3_000 and max(sizes) - min(sizes) <= RUN
