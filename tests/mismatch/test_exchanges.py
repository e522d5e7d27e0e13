"""Members are exchanged for what promises more in their place, in what was settled and in what holds something else."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.drivers import CONSTANT, TIME
from enginediag_cli.mismatch.explain.currency import Offer
from enginediag_cli.mismatch.explain.deciding import Deciding
from enginediag_cli.mismatch.explain.exchanges import exchanges, in_rivals, two_for_a_law
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import EFFECT, FAULT, FORMULA_OPTION, FREE, Option


def option(name: str, kind: str = EFFECT, at: str = "") -> Option:
    moved = (Discrepancy(at, name, 1.0),) if at else ()
    return Option(kind, name, "", CONSTANT, Hypothesis((), moved))


def change(at: str, first: int) -> Option:
    name = f"since {first}"
    moved = Hypothesis((), (Discrepancy(at, name, 1.0),), {name: (np.arange(3) >= first).astype(float)})
    return Option(FAULT, f"{at} {name}", "", TIME, moved)


BY_NAME = {o.label: o for o in (*map(option, "abcd"), option("f", FREE, "x"), option("l", FORMULA_OPTION, "y"))}
"""Four that are listed, a free curve, and a law."""


class Sets:
    """Sets of these ln evidences, a letter for each member, and what each would gain by an option."""

    def __init__(self, evidence: dict[str, float], gains: dict[tuple[str, str], float]):
        trials = (SimpleNamespace(options=tuple(BY_NAME[n] for n in k), evidence=e) for k, e in evidence.items())
        self.of = {self._key(t.options): t for t in trials}
        self.gains = gains

    def likeliest(self, listed=False):
        return sorted(self.of.values(), key=lambda t: -t.evidence)

    def evidence(self, trial):
        return trial.evidence

    def fitted(self, members):
        return self.of.get(self._key(members))

    def known(self, members):
        return self._key(members) in self.of

    def offered(self, trial, proposers, most):
        own = (self._offer(trial, BY_NAME[n]) for n in "abcd")
        return [o for o in own if o is not None][:most]

    def offered_by(self, proposer, trial):
        found = self._offer(trial, BY_NAME["f"])
        return [found] if found is not None else []

    def hope(self, trial, offer):
        return trial.evidence + offer.gain

    def _offer(self, trial, option):
        gain = self.gains.get((self._key(trial.options), option.label))
        return None if gain is None else Offer(option, 0.0, gain)

    def _key(self, members):
        return "".join(sorted(o.label for o in members))


def labels(found) -> list[str]:
    return ["".join(sorted(o.label for o in members)) for members in found]


def test_what_promises_more_in_the_place_of_a_member_is_tried_and_no_other():
    sets = Sets({"ab": 0.0, "a": -20.0, "b": -30.0}, {("a", "c"): 19.0, ("a", "d"): 5.0, ("b", "a"): 40.0})
    trial = sets.of["ab"]
    assert labels(exchanges(sets, trial, (), -3.0)) == ["ac"]
    assert labels(exchanges(sets, trial, (), -3.0, of=[BY_NAME["a"]])) == []


@pytest.mark.parametrize(
    ("rival", "tried"),
    [
        ("ac", ["ad"]),  # c has d in its place
        ("abc", []),  # more of the same
        ("a", []),  # less of it
    ],
)
def test_members_of_a_set_that_holds_something_else_are_exchanged_too(rival, tried):
    sets = Sets({"ab": 0.0, "a": -20.0, "c": -40.0, rival: -4.0}, {("a", "d"): 25.0})
    settled = sets.of["ab"]
    assert labels(in_rivals(sets, settled, lambda t: [], -15.0, -8.0)) == tried
    assert in_rivals(sets, settled, lambda t: [], -3.0, -8.0) == []  # too far behind


def test_a_rival_has_a_free_curve_beside_it_where_that_promises_more():
    sets = Sets({"ab": 0.0, "ac": -4.0, "a": -20.0, "c": -40.0}, {("ac", "f"): 6.0})
    assert labels(in_rivals(sets, sets.of["ab"], lambda t: [], -15.0, -8.0)) == ["acf"]


def test_a_change_in_time_is_tried_with_the_onset_of_the_one_in_whose_place_it_is_too(monkeypatch):
    early, late = change("x", 1), change("y", 2)
    for o in (early, late):
        monkeypatch.setitem(BY_NAME, o.label, o)
    sets = Sets({"a": -20.0}, {})
    monkeypatch.setattr(sets, "offered", lambda *_: [Offer(early, 0.0, 30.0)])
    trial = SimpleNamespace(options=(BY_NAME["a"], late), evidence=0.0)
    assert [m[-1].label for m in exchanges(sets, trial, (), 0.0, of=[late])] == ["x since 1", "x since 2"]


def test_a_law_has_two_listed_ones_in_its_place_where_either_alone_promises_far_too_little():
    gains = {("a", "c"): 30.0, ("ac", "d"): 29.0, ("ac", "b"): 2.0}
    sets = Sets({"al": 0.0, "a": -60.0, "ac": -30.0}, gains)
    assert labels(exchanges(sets, sets.of["al"], (), -10.0)) == []
    assert labels(two_for_a_law(sets, sets.of["al"], -10.0)) == ["acd"]
    of_listed = Sets({"ab": 0.0, "a": -60.0, "ac": -30.0}, gains)
    assert two_for_a_law(of_listed, of_listed.of["ab"], -10.0) == []


@pytest.mark.parametrize("evidence", [-1021.8186973059272, -510.17751482413536, -3.693201614627458, 0.0])
def test_what_is_settled_is_settled_at_once_whatever_its_evidence(evidence):
    """−510.17751482413536 − 3 + 3 is a little less."""
    sets, asked = Sets({"ab": evidence}, {}), []

    def good(beam):
        asked.append(beam)
        assert len(asked) < 5
        return sets.of["ab"]

    for name, answer in {"weighed": None, "near": -np.inf, "fit": None, "beam": [], "unlisted": None}.items():
        setattr(sets, name, lambda *_, answer=answer, **__: answer)
    sets.fits = SimpleNamespace(named=lambda near, weighed: near)
    deciding = Deciding(sets, None)
    deciding._good, deciding._counts, deciding.imitates = good, lambda trial: True, lambda trial: False
    deciding.settled([])
    assert len(asked) == 2
