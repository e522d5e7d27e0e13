"""What would flip an answer, as cells and in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import isfinite, log10
from typing import TYPE_CHECKING, Any

from enginediag_cli.isolation.flips.errors import ACCURACY, INPUT, MAP, PRIOR, SPREAD, STATED
from enginediag_cli.isolation.flips.flips import Flip, Flips
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.numbers import rounded, with_unit
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.story import Story

TOLD = 3
"""Flips told in a sentence, the nearest first; rows have all."""
LARGE = 0.2
"""Share of a reading that is not told any more: of a temperature's or a height's deviation it means nothing."""
MANY = 1e6
"""Odds from which only their order of magnitude is told."""

Words = Callable[[Sequence[str]], Sequence[str]]
"""How the names of an answer are said."""


def flip_cells(flips: Flips | None, words: Words) -> dict[str, Any]:
    """`flips`: one mapping each, the nearest first, with its sentence; `flips_told`: all in one sentence."""
    if flips is None:
        return {"flips": None, "flips_told": None}
    return {
        "flips": [_cells(flip, flips.first, words) for flip in flips.found],
        "flips_told": flips_sentence(flips, words),
    }


def flip_column(flips: Flips | None, words: Words) -> dict[str, Any]:
    """The nearest flips as one column for a table."""
    return {"flips": None if flips is None else [_short(flip) for flip in flips.found[:TOLD]]}


def _cells(flip: Flip, first: Sequence[str], words: Words) -> dict[str, Any]:
    origin = flip.error.origin if flip.error else "openness of the prior"
    return {
        "what": flip.what,
        "kind": flip.kind,
        "size": flip.size,
        "unit": flip.unit,
        "stated": flip.stated,
        "stated_as": origin,
        "times": flip.times,
        "becomes": " & ".join(flip.becomes) or "nothing",
        "words": f"the answer would {_to(flip, first, words)}",
    }


def _short(flip: Flip) -> str:
    size = f"{rounded(flip.size, digits=2)} {flip.unit}"
    return f"{flip.what} {size} ({rounded(flip.times, digits=2)} stated): {' & '.join(flip.becomes) or 'nothing'}"


def _condition(flip: Flip, words: Words) -> str:
    """For instance "T45 read 1.2 K higher (0.14 % of it; 2.3 times its spread between recordings)"."""
    if flip.kind == PRIOR or flip.error is None:
        size = rounded(flip.size, digits=2) if flip.size < MANY else f"10^{log10(flip.size):.0f}"
        return f"that were {size} times as probable before the data"
    error = flip.error
    times = f"{rounded(flip.times, digits=2)} times"
    size = with_unit(abs(flip.size), flip.unit, digits=2)
    if flip.kind == MAP:
        (name,) = words([error.what])
        by = {ACCURACY: "what training leaves open", STATED: "its stated accuracy"}.get(
            error.origin, f"a {error.origin}"
        )
        where = " where this was flown" if error.origin != STATED else ""
        return f"the map of {name} were wrong by {size}{where} ({times} {by})"
    (name,) = words([error.what])
    channel = split_column(error.column)[0] if error.column else name
    of_it = ""
    share = abs(flip.size / error.reading) if error.reading else float("nan")
    if flip.unit != "%" and isfinite(share) and share < LARGE:
        of_it = f"{rounded(100 * share, digits=2)} % of it; "
    way = "higher" if flip.size > 0 else "lower"
    whose = "its" if error.origin == SPREAD else "a"
    what = f"the input {channel}" if flip.kind == INPUT else channel
    return f"{what} read {size} {way} ({of_it}{times} {whose} {error.origin})"


def flips_sentence(flips: Flips, words: Words) -> str:
    """The nearest flips in one sentence, or that there are none."""
    errors = [flip for flip in flips.found if flip.error is not None]
    prior = [flip for flip in flips.found if flip.error is None]
    if errors:
        return f"the answer would {'; or '.join(_to(flip, flips.first, words) for flip in flips.found[:TOLD])}"
    rest = f"; it would {_to(prior[0], flips.first, words)}" if prior else ""
    return (
        f"no single error of a map, a sensor or an input would change the name within {flips.most:g} times what is "
        f"stated of it ({flips.tried} tried){rest}"
    )


def _to(flip: Flip, first: Sequence[str], words: Words) -> str:
    """For instance "hold fan flow capacity as well if T45 read 1.2 K higher"."""
    more, less = [n for n in flip.becomes if n not in first], [n for n in first if n not in flip.becomes]
    if not flip.becomes:
        told = "be no change"
    elif (less and more) or not first:
        told = f"be {listed(list(words(flip.becomes)))}"
    else:
        told = f"hold {listed(list(words(more)))} as well" if more else f"not hold {listed(list(words(less)))}"
    return f"{told} if {_condition(flip, words)}"


def flip_words(story: Story) -> Words:
    """How names of explanations, and of parameters that may be wrong beside them, are said."""
    known = story.evidence.engine.parameters
    return lambda names: [known[n].words if n in known else n for n in names]


def explanation_flips(story: Story) -> Iterator[str]:
    """What would flip the first name of `explain`; nothing where none is named."""
    if story.flips is not None:
        told = flips_sentence(story.flips, flip_words(story))
        yield f"{told[:1].upper()}{told[1:]}."
