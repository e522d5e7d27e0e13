"""What no listed effect explains, as a curve with its band in one SVG: a law along its variable, or a free curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.laws import equation
from enginediag_cli.presentation.pictures.axes import Panel, padded
from enginediag_cli.presentation.pictures.svg import BLUE, INK, ORANGE, SMALL
from enginediag_cli.presentation.refinement_picture import HEAD, LINE, MARGIN, WIDTH, headed, lines_of

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.story import Story

LEFT, HEIGHT, BELOW = 90.0, 300.0, 60.0
"""Room for the vertical axis, height of the panel, and room for the horizontal one, in pixels."""
PERCENT = 100.0
"""Of a share."""


@dataclass(frozen=True)
class _Drawn:
    """A curve (G,) with its standard error, words for its axes, and lines about it."""

    x: np.ndarray
    change: np.ndarray
    error: np.ndarray
    along: str
    what: str
    told: Sequence[str]


def picture(story: Story) -> str:
    """SVG text; ValueError where nothing that was found is a curve of one variable."""
    drawn = _of_law(story) or _of_free_curve(story)
    if drawn is None:
        raise ValueError("nothing that was found is a curve of one variable")
    lines = lines_of(drawn.told)
    top = HEAD + LINE * len(lines)
    on = headed(f"{drawn.what} along {drawn.along}", lines, top + HEIGHT + BELOW)
    low, high = drawn.change - NORMAL_95 * drawn.error, drawn.change + NORMAL_95 * drawn.error
    panel = Panel(
        LEFT,
        top,
        WIDTH - LEFT - MARGIN,
        HEIGHT,
        padded(drawn.x.tolist(), 0.02),
        padded([*low.tolist(), *high.tolist()]),
    )
    panel.draw(on, drawn.along, "change about the mean")
    for values, colour, width in ((low, ORANGE, 1.0), (high, ORANGE, 1.0), (drawn.change, BLUE, 2.0)):
        on.path([panel.at(x, y) for x, y in zip(drawn.x, values, strict=True)], colour, width=width)
    on.dots([panel.at(x, y) for x, y in zip(drawn.x, drawn.change, strict=True)], INK, radius=1.5)
    on.words(WIDTH - MARGIN, top - 6, "likeliest forms together (blue), 95 % (orange)", letters=SMALL, anchor="end")
    return on.text()


def _of_law(story: Story) -> _Drawn | None:
    law = story.answer.law
    if law is None or law.band is None:
        return None
    band, first = law.band, law.laws[0]
    factor = PERCENT if band.unit in ("", "1") else 1.0
    words = first.location.words or first.location.name
    unit = "%" if factor == PERCENT else band.unit
    over = "" if band.of.variable.recorded else " (1: at the design point)"
    effect = first.option.hypothesis.effects[0]
    told = [
        effect.term.STATEMENT,
        equation(effect.term),
        f"Vertical: {words}, {unit}, over the records that were flown.",
    ]
    return _Drawn(
        band.at,
        factor * band.change,
        factor * band.standard_error,
        f"{band.of.variable.words}{over}",
        f"{words}, {unit},",
        told,
    )


def _of_free_curve(story: Story) -> _Drawn | None:
    curve = next((c for c in story.curves if c.converged and c.driver.driver != CONSTANT), None)
    if curve is None:
        return None
    factor = PERCENT if curve.unit in ("", "1") else 1.0
    unit = "%" if factor == PERCENT else curve.unit
    told = ["No listed effect and no law explains it: a free curve of second degree."]
    words = curve.location.words
    return _Drawn(
        curve.values,
        factor * curve.change,
        factor * curve.standard_error,
        f"{curve.driver.driver.words} ({curve.driver.unit})",
        f"{words}, {unit},",
        told,
    )
