"""Effects that another simulator conceals in its recordings are found and named."""

from __future__ import annotations

import numpy as np
import pycycle_concealed as concealed
import pytest
import shared_data

from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE, IDENTIFIED, NO_DISCREPANCY

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.slow,
    pytest.mark.skipif(not shared_data.available("pycycle_hbtf"), reason=shared_data.reason("pycycle_hbtf")),
]


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    return concealed.engine(tmp_path_factory.mktemp("hbtf"))


@pytest.mark.parametrize("name", ["nominal", "fault_1", "fault_2"])
def test_nothing_is_missing_where_only_health_differs(engine, name):
    assert concealed.search(concealed.evidence(engine, name)).answer.status == NO_DISCREPANCY


@pytest.mark.parametrize(
    ("name", "place", "column"),
    [
        ("concealed_1", "hpc.cust.fraction", "x_cust_frac"),
        ("concealed_2", "power_offtake@hp", "x_HPX_hp"),
    ],
)
def test_an_amplitude_that_no_column_shows_is_located_and_followed(engine, name, place, column):
    found = concealed.search(concealed.evidence(engine, name))
    assert found.answer.status == HIDDEN_STATE
    assert found.answer.hidden[0].location.name == place
    truth = concealed.opened(name)[column]
    good = np.isfinite(found.amplitude)
    assert np.corrcoef(found.amplitude[good], truth[good])[0, 1] > 0.9
    assert found.after < 0.5 * found.before


def test_reynolds_effects_on_three_components_are_named_together(engine):
    found = concealed.search(concealed.evidence(engine, "concealed_3"))
    assert found.answer.status == IDENTIFIED
    labels = {o.label for o in found.answer.explanations[0].options}
    assert labels == {"reynolds_efficiency@fan", "reynolds_efficiency@hpc", "reynolds_turbine_efficiency@lpt"}
    assert found.after < 0.6 * found.before
