"""Before and after a control in one SVG: misfit of every sensor on unseen flights."""

from __future__ import annotations

from typing import TYPE_CHECKING

from enginediag_cli.identification.quality import EVERYTHING
from enginediag_cli.presentation.controls import headline
from enginediag_cli.presentation.refined_controls import fall_in_words
from enginediag_cli.presentation.refinement_picture import (
    BESIDE_ROWS,
    HEAD,
    LINE,
    ROW,
    draw_sensors,
    headed,
    lines_of,
)

if TYPE_CHECKING:
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement


def picture(r: ControlRefinement) -> str:
    """SVG text; ValueError when nothing was judged."""
    after = {(q.sensor, q.regime): q for q in r.after}
    pairs = [
        (q, after[q.sensor, q.regime]) for q in r.before if q.regime == EVERYTHING and (q.sensor, q.regime) in after
    ]
    if not pairs:
        raise ValueError("a control that no unseen flight has judged has no picture")
    lines = lines_of([f"In the model now: {headline(r.law)}", *fall_in_words(r)])
    top = HEAD + LINE * len(lines)
    title = f"{r.law.label}: before and after, on flights that were not fitted"
    on = headed(title, lines, top + BESIDE_ROWS + ROW * len(pairs))
    draw_sensors(on, pairs, top)
    return on.text()
