"""Colours that are told apart by who is colour-blind, on white and on black.

Light ones are those of P. Tol's "bright" scheme (SRON/EPS/TN/09-002, 2021), darkened to a contrast of 3 to 1 at least;
a page in the dark shows `DARK[k]` where a picture says `LIGHT[k]`.
"""

from __future__ import annotations

from enginediag_cli.presentation.pictures.svg import BLUE, FAINT, INK, ORANGE, PAPER

LIGHT = (BLUE, ORANGE, "#117733", "#aa3377", "#8a7a00", "#00808f", "#6a51a3", "#8c564b")
DARK = ("#7db4ee", "#f5a35c", "#5cc27f", "#e58bc0", "#d9c94a", "#5cc9d6", "#b6a2e8", "#cfa397")

SURFACES_LIGHT = (INK, FAINT, PAPER, "#eeeeee", "#52606d")
SURFACES_DARK = ("#e4e7eb", "#3e4c59", "#1b222b", "#2b3540", "#a6b1bd")
"""Ink, grid, paper, what is empty, and lesser words."""

QUIET = SURFACES_LIGHT[4]

SHADES_UP = ("#fff3e8", "#fdd9bb", "#fdae6b", "#e6731c", "#8f3a00")
SHADES_DOWN = ("#eef5fc", "#cfe1f2", "#94c0e2", "#3d85c6", "#08407d")
"""Steps of a heat map, from faint to full, above zero and below: after ColorBrewer's oranges and blues."""

STEPS = len(SHADES_UP)

ON_LIGHT, ON_DARK = "#20262d", "#fefefe"
"""Ink on the shades, which are the same in the dark."""


def colour(number: int) -> str:
    """A colour of the palette, round and round."""
    return LIGHT[number % len(LIGHT)]


def shade(value: float, largest: float, rooted: bool = False) -> tuple[str, str]:
    """The fill of a cell and the ink on it; 0 is paper. Five steps: more are not told apart by eye."""
    share = min(abs(value) / largest, 1.0) if largest > 0 else 0.0
    share = share**0.5 if rooted else share
    step = min(int(share * STEPS), STEPS - 1)
    fill = (SHADES_UP if value >= 0 else SHADES_DOWN)[step]
    return fill, ON_DARK if step >= 3 else ON_LIGHT


def pairs() -> list[tuple[str, str]]:
    """(light, dark) of every colour that changes in the dark; shades of heat maps stay, and so does ink on them."""
    return [*zip(LIGHT, DARK, strict=True), *zip(SURFACES_LIGHT, SURFACES_DARK, strict=True)]
