"""Effects of another simulator that the library does not hold are told as laws, and what follows nothing as none."""

from __future__ import annotations

import pycycle_concealed as concealed
import pycycle_laws as laws
import pytest
import shared_data

from enginediag_cli.drivers import REYNOLDS_INDEX
from enginediag_cli.mismatch.explain.answer import FORMULA, HIDDEN_STATE
from enginediag_cli.mismatch.laws.scan import known_variables

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.slow,
    pytest.mark.skipif(not shared_data.available("pycycle_hbtf"), reason=shared_data.reason("pycycle_hbtf")),
]


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    return concealed.engine(tmp_path_factory.mktemp("hbtf"))


def test_reynolds_effects_without_their_terms_are_laws_at_the_three_machines_with_their_slopes(engine):
    search, answer = laws.searched(engine, "concealed_3")
    assert answer.status == FORMULA and answer.law is not None
    best = answer.explanations[0]
    assert all(o.driver == REYNOLDS_INDEX for o in best.options)
    found = laws.slopes(best, known_variables(search.base.found))
    assert set(found) == {f"{c}.efficiency" for c in laws.TRUE_PER_DECADE}
    for component, true in laws.TRUE_PER_DECADE.items():
        assert abs(found[f"{component}.efficiency"] - true) < 0.005


@pytest.mark.parametrize("name", ["concealed_1", "concealed_2", "concealed_4"])
def test_what_moves_from_record_to_record_is_no_law(engine, name):
    assert laws.searched(engine, name)[1].status == HIDDEN_STATE
