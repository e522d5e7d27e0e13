"""Laws as members of a set: where they are offered, and what several of them cost together."""

from dataclasses import replace

import numpy as np
import pytest
from concealed import carried, evidence, flights

from enginediag_cli.mismatch.explain.currency import FREE_FORM, Prices
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.free_members import Unlisted
from enginediag_cli.mismatch.explain.law_members import LawMembers
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, fault_options
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.mismatch.laws.steps import Bends, as_curve


@pytest.fixture(scope="module")
def base():
    e = evidence(flights(carried(("reynolds_efficiency", "hpc", {"exponent": 0.1})), np.random.default_rng(22)))
    found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
    return HypothesisFit((), found, Projection(found))


@pytest.fixture(scope="module")
def members(base):
    return LawMembers(base.found, Prices([]))


def law(members, base, place, form, variable):
    """This formula at this place as an option that the members know."""
    where = [w for w in members.where if w.name == place]
    own = [f for f in members.formulas if f.form.name == form and [k.variable.name for k in f.of] == [variable]]
    found = proposal(scored(base.found, base.projection, where, own, 0.0)[0], base.found.evidence.engine)
    members.learn([found])
    return found.option


def test_laws_are_offered_where_a_free_curve_says_that_something_acts(base, members):
    search = Search(base.found.evidence, [])
    search.look_from(base)
    curves = sorted(Unlisted(members.prices, search.along_drivers)(base), key=lambda o: -o.gain)
    offers = members.offers(base, curves)
    assert offers and all(o.option.kind == FORMULA_OPTION for o in offers)
    assert max(offers, key=lambda o: o.gain).option.component == "hpc"
    assert all(o.price == members.price([o.option]) for o in offers)


def test_a_further_form_of_the_same_variable_costs_less_than_a_law_by_itself(base, members):
    first = law(members, base, "hpc.efficiency", "linear", "mach")
    further = law(members, base, "hpc.efficiency", "bump", "mach")
    elsewhere = law(members, base, "fan.flow_capacity", "bump", "mach")
    alone = members.price([first]) + members.price([further])
    assert members.price([first, further]) < alone - 1.0
    assert members.price([first, elsewhere]) == pytest.approx(members.price([first]) + members.price([elsewhere]))


def test_the_same_formula_at_another_place_costs_the_choice_among_its_places(base, members):
    here = law(members, base, "hpc.efficiency", "linear", "mach")
    there = law(members, base, "fan.efficiency", "linear", "mach")
    places = sum(w.quantity == "efficiency" for w in members.where)
    assert members.price([here, there]) == pytest.approx(members.price([here]) + np.log(places))


def test_what_laws_cost_does_not_depend_on_their_order(base, members):
    of = [
        law(members, base, "hpc.efficiency", "linear", "mach"),
        law(members, base, "hpc.efficiency", "bump", "mach"),
        law(members, base, "fan.efficiency", "linear", "mach"),
    ]
    assert members.price(of) == pytest.approx(members.price(of[::-1]))


def test_a_sensor_may_step_whether_or_not_its_constant_error_is_identified(base):
    e = base.found.evidence
    health = {n: v for n, v in e.settings.nuisance.items() if not n.startswith("sensor.")}
    without = replace(e, settings=replace(e.settings, nuisance=health))
    found = identify_with(without, NULL_HYPOTHESIS, nuisance(without))
    targets = {o.target.name for o in fault_options(found)}
    assert {"sensor.T45.scale", "sensor.N2.scale", "hpc.efficiency"} <= targets
    assert targets == {o.target.name for o in fault_options(base.found)}


def test_a_curve_in_several_parts_pays_for_its_place_once(base, members):
    where = next(w for w in members.where if w.name == "hpc.efficiency")
    of = tuple(next(k for k in known_variables(base.found) if k.variable.name == n) for n in ("mach", "power"))
    laws = as_curve(where, Bends(of, (4, 4), 0.01, 0.0, 0.0), -5.0, -3.0, base.found.evidence.engine)
    members.learn(laws)
    options = [p.option for p in laws]
    places = np.log(len(members.where)) - np.log(FREE_FORM)
    assert members.price(options) == pytest.approx(5.0 + places)
    assert members.price(options[::-1]) == pytest.approx(5.0 + places)


def test_a_curve_of_other_steps_and_the_same_name_takes_its_place(base, members):
    """Another fit of a set finds another curve of the same variable there, of more steps."""
    where = next(w for w in members.where if w.name == "fan.efficiency")
    of = (next(k for k in known_variables(base.found) if k.variable.name == "mach"),)
    engine = base.found.evidence.engine
    few, more = (as_curve(where, Bends(of, (n,), 0.01, 0.0, 0.0), -n, -3.0, engine) for n in (4, 8))
    trial = attempt([p.option for p in more], base.found, nuisance(base.found.evidence))
    members.learn(few)
    cheaper = members.price([trial.options[0]])
    members.learn(more)
    assert few[0].option.label == more[0].option.label
    assert members.price([trial.options[0]]) == pytest.approx(cheaper + 4.0)
    members.learn(few)
    assert members.within(trial) == 0.0
