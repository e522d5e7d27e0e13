"""What would flip the name that `explain` gives: closed forms, and fits to readings that carry the error."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan
from scipy.optimize import minimize

from enginediag_cli.mismatch.explain.answer import IDENTIFIED
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.flips import flips_of_answer, shortest
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with
from enginediag_cli.mismatch.fit.options import effect_options
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import Gates
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.report.tables.isolation import flips_sentence

LIBRARY = ("reynolds_efficiency", "reynolds_turbine_efficiency", "power_offtake")


@pytest.mark.parametrize("seed", range(4))
def test_the_shortest_error_is_the_nearest_point_of_the_quadric(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = 1 + seed % 4
    A = rng.standard_normal((k, k))
    G, g, gap = (A + A.T) / 2, rng.standard_normal(k), 1.5
    found = shortest(gap, g, G)
    constraint = {"type": "eq", "fun": lambda a: gap + 2 * a @ g + a @ G @ a}
    starts = rng.standard_normal((8, k)) * 3
    tried = [minimize(lambda a: a @ a, s, constraints=[constraint], method="SLSQP") for s in starts]
    best = min((t.fun for t in tried if t.success and abs(constraint["fun"](t.x)) < 1e-6), default=np.inf)
    if found is None:
        assert not np.isfinite(best)
    else:
        assert gap + 2 * found @ g + found @ G @ found == pytest.approx(0.0, abs=1e-6)
        assert found @ found == pytest.approx(best, rel=1e-3)


def test_where_nothing_pulls_along_the_softest_direction_the_rest_of_the_way_is_along_it() -> None:
    a = shortest(3.0, np.array([0.0, 0.5]), np.diag([-1.0, 2.0]))
    assert 3.0 + 2 * 0.5 * a[1] - a[0] ** 2 + 2 * a[1] ** 2 == pytest.approx(0.0, abs=1e-6)
    assert shortest(3.0, np.array([0.1]), np.array([[2.0]])) is None
    assert shortest(0.0, np.ones(2), np.eye(2)) == pytest.approx([0.0, 0.0])


@pytest.fixture(scope="module")
def told():
    """A concealed effect and rivals, fitted; the best of them as an answer; what would flip it."""
    recorded = flights(carried(("reynolds_efficiency", "hpc", {"exponent": 0.1})), np.random.default_rng(5), count=3)
    library = [e for e in candidate_effects(turbofan()) if e.term.NAME in LIBRARY]
    search = Search(evidence(recorded, map_accuracy=0.003), library)
    base = identify_with(search.evidence, NULL_HYPOTHESIS, search.along)
    search.look_from(HypothesisFit((), base, Projection(base)))
    search.detect = Gates(7.0, 7.0, 7.0)
    best, *_ = search.refit([(o,) for o in effect_options(library)])
    named = search.explanation(best, 0.9, 1.0, 1.0)
    answer = SimpleNamespace(status=IDENTIFIED, explanations=(named,))
    return search, answer, flips_of_answer(answer, search)


def test_the_error_that_is_told_makes_the_rival_fit_better_and_a_little_less_does_not(told) -> None:
    search, _, flips = told
    assert flips.conclusion == ("reynolds_efficiency@hpc",)
    options = {o.label: o for o in effect_options(search.effects)}
    nearest = next(f for f in flips.changes if f.kind == "sensor" and f.conclusion and f.name.endswith("bias"))
    for share, changed in ((0.85, False), (1.15, True)):
        moved = []
        for flight in search.evidence.flights:
            columns = dict(flight.columns)
            columns[nearest.error.column] = columns[nearest.error.column] + share * nearest.size
            moved.append(Flight(flight.label, flight.engine, columns))
        wrong = replace(search.evidence, flights=tuple(moved))
        base = identify_with(wrong, NULL_HYPOTHESIS, search.along)
        start = HypothesisFit((), base, Projection(base)).found
        named, rival = (
            attempt((options[n],), start, search.along) for n in (flips.conclusion[0], nearest.conclusion[0])
        )
        assert named.converged and rival.converged
        assert (rival.weighed < named.weighed) == changed


def test_maps_instruments_inputs_and_the_prior_are_tried_and_told_in_order(told) -> None:
    _, _, flips = told
    assert {f.kind for f in flips.changes} >= {"sensor", "prior"}
    times = [f.times for f in flips.changes]
    assert times == sorted(times)
    assert flips_sentence(flips, lambda names: list(names)).startswith("the answer would ")
