"""A refinement with a control, in rows, sentences and one JSON object."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.identification.quality import EVERYTHING
from enginediag_cli.mismatch.controlled.fitted import BLOCKS
from enginediag_cli.presentation.controls import headline
from enginediag_cli.presentation.numbers import rounded, with_unit
from enginediag_cli.presentation.outputs.refine import CONTROL

if TYPE_CHECKING:
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement

FEWEST = 30
"""Records of a regime below which its figures are not told in a sentence; rows have them."""
COLUMNS = CONTROL.names


def rows(r: ControlRefinement) -> Iterator[dict[str, Any]]:
    """RMS by sensor, over all unseen records and by what the control does."""
    after = {(q.sensor, q.regime): q for q in r.after}
    for one in r.before:
        other = after.get((one.sensor, one.regime))
        if other is not None:
            yield dict(zip(COLUMNS, ("rms", one.sensor, one.regime, one.unit, one.rms, other.rms, one.n), strict=True))


def sentences(r: ControlRefinement) -> Iterator[str]:
    """What unseen flights say."""
    if r.unconverged:
        yield "The model without the control could not be fitted; its errors are those where the fit ended."
    told = [row for row in rows(r) if row["n"] >= FEWEST]
    names = [f"{row['of']}{'' if row['where'] == EVERYTHING else ', ' + row['where']}" for row in told]
    width = max(map(len, names), default=0)
    if told:
        yield f"{'RMS on unseen flights':{width}}  {'before':>10}  {'after':>10}  {'records':>8}"
    for name, row in zip(names, told, strict=True):
        one, other = (with_unit(row[k], row["unit"]) for k in ("before", "after"))
        yield f"{name:{width}}  {one:>10}  {other:>10}  {row['n']:>8,}"
    yield from fall_in_words(r)


def fall_in_words(r: ControlRefinement) -> Iterator[str]:
    """By how much errors on unseen flights fall, where that was judged."""
    if math.isfinite(r.fall):
        yield (
            f"Errors on unseen flights are {rounded(math.exp(r.fall))} times smaller (mean over the sensors), in "
            f"{rounded(100.0 * r.runs, digits=2)} % of {BLOCKS} runs of records."
        )


def refusal(r: ControlRefinement) -> str:
    """Why nothing is written."""
    return r.failed or f"unseen flights are not predicted better with {headline(r.law)}"


def document(r: ControlRefinement, head: tuple[str, ...]) -> dict[str, Any]:
    """Everything as one object."""
    return {
        "schema": CONTROL.id,
        "accepted": r.accepted,
        "failed": r.failed,
        "control": headline(r.law),
        "standard_errors": dict(r.standard_errors),
        "rows": list(rows(r)),
        "errors_smaller_by": math.exp(r.fall) if math.isfinite(r.fall) else None,
        "runs_gained": r.runs if math.isfinite(r.runs) else None,
        "sentences": list(sentences(r)),
        "provenance": list(head),
    }
