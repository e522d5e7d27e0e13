"""What fits far worse than another set is no explanation, whatever that one leaves; one law is simpler than two."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.mismatch.explain.deciding import Deciding
from enginediag_cli.mismatch.explain.judging import ALIAS, Fits
from enginediag_cli.mismatch.explain.law_of_set import ANOTHER_PLACE, _simplest
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, FREE


def deciding_of(evidence: dict[str, float], idle: tuple[str, ...] = ()) -> Deciding:
    """Of sets of which only the evidence is known, and which of them hold a member that is not needed."""
    trials = {label: SimpleNamespace(label=label) for label in evidence}
    sets = SimpleNamespace(
        fits=SimpleNamespace(fitted=trials),
        evidence=lambda t: evidence[t.label],
        likeliest=lambda listed=False: sorted(trials.values(), key=lambda t: -evidence[t.label]),
        without_idle=lambda t: ("others",) if t.label in idle else (),
    )
    return Deciding(sets, None)


@pytest.mark.parametrize(
    ("behind", "idle", "stands"), [(0.5 * ALIAS - 0.1, (), True), (20.0, (), False), (20.0, ("better",), True)]
)
def test_a_pair_that_is_left_far_behind_is_not_named(behind, idle, stands):
    deciding = deciding_of({"base": -500.0, "named": -behind, "better": 0.0}, idle)
    named = [SimpleNamespace(label="named")]
    assert deciding.unless_outdone(named) == (named if stands else [])
    assert deciding.unless_outdone([]) == []


@pytest.mark.parametrize(
    ("left", "coefficients", "kind", "less"),
    [
        (90.0, 4, FREE, True),
        (93.0, 4, FREE, False),
        (90.0, 4, FORMULA_OPTION, False),
    ],
)
def test_a_curve_that_leaves_less_than_it_costs_calls_for_a_law(left, coefficients, kind, less):
    def trial(label, objective, k, of):
        return SimpleNamespace(
            label=label,
            objective=objective,
            hypothesis=SimpleNamespace(names=["x"] * k),
            options=[SimpleNamespace(kind=o) for o in of],
        )

    named, other = trial("named", 100.0, 1, ["effect"]), trial("other", left, coefficients + 1, ["effect", kind])
    fits = SimpleNamespace(fitted={t.label: t for t in (named, other)})
    deciding = Deciding(SimpleNamespace(fits=fits, likeliest=lambda listed=False: [named, other]), None)
    assert deciding.leaves_to_a_curve("named") is less
    assert not deciding.leaves_to_a_curve("of other records")


def named_of(weighed: dict[str, float], **why: Reason) -> tuple[list[str], Fits]:
    """What is named of trials of which only χ² is known, and why they are no explanation."""
    fits = object.__new__(Fits)
    fits.rejected = {}
    fits.judge = lambda t: (1.0, 1.0, Rejected(why[t.label]) if t.label in why else None)
    fits.explanation = lambda t, p, left, flights: SimpleNamespace(label=t.label, probability=p)
    trials = [SimpleNamespace(label=n, weighed=w, projection=SimpleNamespace(rest=int)) for n, w in weighed.items()]
    return [x.label for x in fits.named(trials)], fits


def test_what_is_left_far_behind_by_what_leaves_a_misfit_is_no_explanation():
    # it leaves all of that misfit and more, only where nothing is over a gate
    named, fits = named_of({"better": 0.0, "worse": ALIAS + 1.0}, better=Reason.LEAVES_MISFIT)
    assert named == [] and fits.rejected["worse"].reason is Reason.WORSE
    assert named_of({"better": 0.0, "near": ALIAS - 1.0}, better=Reason.LEAVES_MISFIT)[0] == ["near"]


@pytest.mark.parametrize("why", [Reason.AT_BOUND, Reason.NOT_NEEDED, Reason.FEW_FLIGHTS])
def test_what_is_no_explanation_for_another_reason_leaves_the_name_to_others(why):
    assert named_of({"better": 0.0, "worse": ALIAS + 1.0}, better=why)[0] == ["worse"]


def law(standing: float, *at: tuple[str, str]):
    laws = tuple(
        SimpleNamespace(candidate=SimpleNamespace(formula=SimpleNamespace(form=SimpleNamespace(name=form), groups=0)))
        for _, form in at
    )
    return SimpleNamespace(standing=standing, laws=laws, at_one_place=len({place for place, _ in at}) == 1)


def test_two_halves_of_a_law_at_two_places_give_way_to_one_that_is_nearly_as_likely():
    two = law(100.0, ("turbine.flow_capacity", "bump"), ("cooling.turbine_vanes.fraction", "spot"))
    one = law(100.0 - ANOTHER_PLACE + 0.1, ("cooling.turbine_vanes.fraction", "bump"))
    assert _simplest([two, one]) == [one]
    assert _simplest([two, law(100.0 - ANOTHER_PLACE - 0.1, ("cooling.turbine_vanes.fraction", "bump"))])[0] is two
    everywhere = law(100.0, ("fan.efficiency", "power"), ("hpc.efficiency", "power"))
    assert _simplest([everywhere, one])[0] is everywhere
