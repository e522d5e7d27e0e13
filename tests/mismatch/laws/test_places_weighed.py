"""Smooth curves are weighed wherever they may turn the order of places, not only where one form is near the best."""

from __future__ import annotations

from types import SimpleNamespace

from enginediag_cli.mismatch.laws.search import PLACES, WITHIN, LawSearch


def searched(*places: tuple[str, float], weighed: tuple[str, ...] = ()) -> LawSearch:
    """With the ln evidence of the best single form at each place, likeliest first, and what has been weighed."""
    search = object.__new__(LawSearch)
    search.single = [
        SimpleNamespace(evidence=e, laws=(None,), at_one_place=True, where=(name, frozenset())) for name, e in places
    ]
    search.says = dict.fromkeys(weighed)
    return search


def names(search: LawSearch, gained: float) -> list[str]:
    return [f.where[0] for f in search._at_places(gained)]


def test_places_are_weighed_whose_best_form_is_near_the_best() -> None:
    search = searched(("first", 300.0), ("near", 301.0 - WITHIN), ("far", 299.0 - WITHIN))
    assert names(search, 0.0) == ["first", "near"]


def test_what_the_best_place_has_no_form_for_others_may_have_none_for_either() -> None:
    """A wave of one turbine's capacity: a step fits the other turbine 38 better than any form does at the truth, but
    smooth curves gain 42 there, and 60 at the truth."""
    forms = (("gas_generator_turbine.efficiency", 304.0), ("power_turbine.flow_capacity", 266.0))
    search = searched(*forms, weighed=("gas_generator_turbine.efficiency",))
    assert names(search, 0.0) == [] and names(search, 42.0) == ["power_turbine.flow_capacity"]


def test_no_more_places_are_weighed_than_may_be() -> None:
    search = searched(*((f"place_{k}", 300.0 - k) for k in range(6)), weighed=("place_0", "place_1"))
    assert names(search, 100.0) == [f"place_{k}" for k in range(2, PLACES)]
