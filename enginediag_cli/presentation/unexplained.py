"""What an explanation leaves of a mismatch, in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.explain.curves import best_places
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import probability

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.answer import Answer

LEAST_SHARE = 0.005
"""A share that is told as nothing."""
LIKELIER = 0.5
"""Probability of all that is told from which it is likelier than not."""
PLACES = 3
"""Places that are told one by one."""


def share_left(a: Answer) -> str:
    """How much of the excess χ² stays with what is named; empty where there is none to explain."""
    if a.unexplained is None or a.in_part:
        return ""
    if a.unexplained < LEAST_SHARE:
        return "; nothing of its excess stays unexplained"
    return f"; {100 * a.unexplained:.0f} % of its excess stays unexplained"


def doubt_sentence(a: Answer) -> Iterator[str]:
    """Where what is named and its rivals are together less likely than all that was fitted and not named."""
    told = sum(x.probability for x in a.explanations)
    if told < LIKELIER and not a.in_part:
        yield (
            f"It is more likely something else (probability {probability(1.0 - told)}): sets that leave a misfit, or "
            "hold physics that is not listed, are together likelier than all that explains everything."
        )


def rest_sentences(a: Answer) -> Iterator[str]:
    """Of an explanation in part: how much stays, and where."""
    if not a.in_part or a.unexplained is None:
        return
    cells = best_places(a.rest)
    places = listed(list(dict.fromkeys(c.location.words for c in cells))[:PLACES], "or")
    more = len({c.location.words for c in cells}) - PLACES
    further = f" (or {more} further places)" if more > 0 else ""
    drivers = dict.fromkeys(c.driver.driver.words for c in cells if c.driver.driver != CONSTANT)
    along = f", varying with {listed(list(drivers)[:PLACES], 'or')}" if drivers else ""
    yield (
        f"  This is part of the mismatch: {100 * a.unexplained:.0f} % of it (of the excess χ²) stays unexplained, at "
        f"{places}{further}{along}: unlisted physics, or something listed that these flights do not show surely."
    )
