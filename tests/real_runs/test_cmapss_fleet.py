"""C-MAPSS FD001 as a fleet: ranked by the margin used, and how many flights remain."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_histories import RECORDER, chosen, fleet_series, histories
from fleet_remaining import FIRST_CUT, SETTINGS, cut_at
from ground_recordings import CONFIGS, enginediag, public_data
from scipy.stats import spearmanr

from enginediag_cli.fleets.engine_judgement import judge_engine
from enginediag_cli.fleets.margin import margin_scale
from enginediag_cli.fleets.run import judge_fleet

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """The flights of the 100 engines, and their sums."""
    recording, nominal = (
        public_data("cmapss") / "train_FD001.csv.gz",
        tmp_path_factory.mktemp("cmapss") / "nominal.yaml",
    )
    engine = CONFIGS / "cmapss_turbofan.yaml"
    enginediag(
        "identify", engine, recording, "--recorder", RECORDER, "--first", "20", "--no-cross-validation", "-o", nominal
    )
    return fleet_series(nominal, recording)


def test_engines_cut_at_random_are_ranked_as_they_fail(fleet):
    series, sums = fleet
    rng, scale, found, left = np.random.default_rng(0), margin_scale(series), [], []
    for history in histories(series, sums):
        cut = int(rng.integers(FIRST_CUT, len(history.stretches)))
        found.append(judge_engine(cut_at(history, cut), series, SETTINGS, scale))
        left.append(len(history.stretches) - cut)
    assert spearmanr([f.severity.value for f in found], left).statistic <= -0.8


def test_at_the_end_of_their_lives_all_are_flagged_and_have_the_hpc_in_common(fleet):
    series, sums = fleet
    scale = margin_scale(series)
    found = judge_fleet(
        [judge_engine(h, series, SETTINGS, scale) for h in histories(series, sums)], SETTINGS, series.parameters
    )
    assert len(found.flagged.engines) == 100 and not found.excluded
    assert {c.component for c in found.common if c.common} == {"hpc"}


def test_flights_before_any_wear_in_random_order_flag_no_engine(fleet):
    series, sums = fleet
    rng, scale, found = np.random.default_rng(1), margin_scale(series), []
    for history in histories(series, sums):
        found.append(judge_engine(chosen(history, rng.permutation(40).tolist()), series, SETTINGS, scale))
    assert judge_fleet(found, SETTINGS, series.parameters).flagged.engines == ()
