"""Which engine the events of a file are of."""

from __future__ import annotations

import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import MaintenanceEvent
from enginediag_cli.fleets.maintenance import events_by_engine


def events(*engines: str) -> list[MaintenanceEvent]:
    return [MaintenanceEvent(engine, "wash", str(k)) for k, engine in enumerate(engines, start=1)]


def test_one_engine_needs_no_name_on_either_side():
    nameless, named = events("", ""), events("A", "A")
    assert events_by_engine(nameless, [""], "e.csv") == ({"": tuple(nameless)}, ())
    assert events_by_engine(named, [""], "e.csv") == ({"": tuple(named)}, ())
    assert events_by_engine(nameless, ["A"], "e.csv") == ({"A": tuple(nameless)}, ())


def test_events_of_engines_that_are_not_recorded_are_told_beside_those_that_are():
    a, b = found = events("A", "B")
    assert events_by_engine(found, ["A", "C"], "e.csv") == ({"A": (a,), "C": ()}, ("B",))
    assert b.engine == "B"


@pytest.mark.parametrize(
    ("named", "recorded", "says"),
    [
        (("A", "B"), ("",), "keep those of one"),
        (("A", ""), ("A", "B"), "names no engine"),
        (("ESN-1O1",), ("ESN-101", "ESN-107"), "did you mean 'ESN-101'"),
    ],
)
def test_events_whose_engine_is_not_known_are_refused(named, recorded, says):
    with pytest.raises(DataError, match=says):
        events_by_engine(events(*named), recorded, "e.csv")


def test_no_events_are_of_no_engine():
    assert events_by_engine((), ["A"], "") == ({"A": ()}, ())
