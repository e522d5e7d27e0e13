"""The explainer's plan, as it is handed over: every flight that it would consider, best first."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from enginediag_cli.mismatch.explain.answer import NAMED, Answer
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.plan import plan
from enginediag_cli.mismatch.explain.reach import within_reach


def planned_as_json(search: Search, said: Answer) -> dict[str, Any]:
    """`flights`, best first, and the `chance` that the first of them tells."""
    advice = plan(search.base.found, within_reach(said, search.fitted)) if said.status == NAMED else None
    flights = [] if advice is None else [s for s in advice.suggestions if s.flight is not None]
    return {
        "flights": [asdict(s.flight) for s in flights if s.flight is not None],
        "chance": flights[0].chance if flights else None,
    }
