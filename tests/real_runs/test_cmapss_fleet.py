"""C-MAPSS FD001 as a fleet: ranked by the margin used, and how many flights remain."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_histories import RECORDER, fleet_series, histories
from fleet_remaining import FIRST_CUT, QUICK, cut_at
from ground_recordings import CONFIGS, enginediag, public_data
from scipy.stats import spearmanr

from enginediag_cli.fleets.engine_judgement import judge_engine
from enginediag_cli.fleets.margin import margin_scale
from enginediag_cli.fleets.run import judge_fleet

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    """The flights of the 100 engines."""
    fleet, nominal = public_data("cmapss") / "train_FD001.csv.gz", tmp_path_factory.mktemp("cmapss") / "nominal.yaml"
    engine = CONFIGS / "cmapss_turbofan.yaml"
    enginediag(
        "identify", engine, fleet, "--recorder", RECORDER, "--first", "20", "--no-cross-validation", "-o", nominal
    )
    return fleet_series(nominal, fleet)


def test_engines_cut_at_random_are_ranked_as_they_fail(series):
    rng, scale, found, left = np.random.default_rng(0), margin_scale(series), [], []
    for history in histories(series):
        cut = int(rng.integers(FIRST_CUT, len(history.stretches)))
        found.append(judge_engine(cut_at(history, cut), series, QUICK, scale))
        left.append(len(history.stretches) - cut)
    assert spearmanr([f.severity.value for f in found], left).statistic <= -0.8


def test_at_the_end_of_their_lives_all_are_listed_and_have_the_hpc_in_common(series):
    scale = margin_scale(series)
    found = judge_fleet([judge_engine(h, series, QUICK, scale) for h in histories(series)], QUICK, series.parameters)
    assert len(found.flagged.engines) == 100 and not found.excluded
    assert {c.component for c in found.common if c.common} == {"hpc"}


def test_flights_before_any_wear_in_random_order_list_no_engine(series):
    rng, scale, found = np.random.default_rng(1), margin_scale(series), []
    for history in histories(series):
        early = [history.stretches[k] for k in rng.permutation(40)]
        one = cut_at(history, 40)
        found.append(judge_engine(type(one)(one.serial, "", early, 20), series, QUICK, scale))
    assert judge_fleet(found, QUICK, series.parameters).flagged.engines == ()
