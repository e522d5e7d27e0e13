"""What to record next, in words and as rows of a document."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.planning.flight import RECORDS
from enginediag_cli.planning.manoeuvres import DURATION_S, MANOEUVRE
from enginediag_cli.planning.suggestion import SAME, SENSOR, SWITCH, best_of_each_kind
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import probability
from enginediag_cli.presentation.sentences import count

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.plan import Advice
    from enginediag_cli.planning.suggestion import Suggestion

TOLD = 2
"""Suggestions that are told unasked: the best, and one to choose instead."""


def advice_sentences(advice: Advice | None, *, all_kinds: bool = False) -> Iterator[str]:
    """The rivals, and what would tell them apart: the best two, or the best of every kind."""
    if advice is None:
        return
    rivals = [f"{label} ({probability(p)})" for label, p in advice.rivals]
    yield f"To tell {rivals[0]} from {listed(rivals[1:], 'or')}:"
    kinds = best_of_each_kind(advice.suggestions)
    useful = [s for s in kinds if math.isfinite(s.records)]
    if not useful:
        yield "  no recording that was tried would do so surely."
    for s in kinds if all_kinds else useful[:TOLD]:
        yield f"  {suggestion(s)}"


def suggestion(s: Suggestion) -> str:
    """One recording that would help, how soon, and what RECORDS records of it promise."""
    what = {
        SAME: "more records like these",
        SWITCH: f"records like these with {s.what} switched off and on by turns",
        SENSOR: f"records like these with {s.what} recorded",
    }.get(s.kind, s.what)
    beyond = "" if s.known else " (beyond the conditions flown)"
    settled = f"after {RECORDS} the right one stands out with probability {probability(s.chance)}"
    if not math.isfinite(s.records):
        return f"{what}{beyond}: {settled}"
    if s.kind == MANOEUVRE:
        return f"{what}, recorded once a second: {count(math.ceil(s.records / DURATION_S), 'time')}"
    return f"{what}{beyond}: {count(int(s.records), 'record')} ({settled})"


def advice_document(advice: Advice | None) -> dict[str, Any] | None:
    """For JSON: rivals, and every suggestion with its words."""
    if advice is None:
        return None
    return {
        "rivals": [{"label": label, "probability": p} for label, p in advice.rivals],
        "separates": advice.separates,
        "suggestions": [
            {
                "kind": s.kind,
                "what": s.what,
                "records": s.records,
                "chance": s.chance,
                "known": s.known,
                "in_words": suggestion(s),
            }
            for s in advice.suggestions
        ],
    }
