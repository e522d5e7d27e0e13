"""One free amplitude per record at each place in turn, in words and as rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from enginediag_cli.presentation.numbers import rounded
from enginediag_cli.presentation.outputs.locate import PER_RECORD

if TYPE_CHECKING:
    from enginediag_cli.mismatch.unrecorded.control_law import Held, Stop
    from enginediag_cli.mismatch.unrecorded.per_record import PerRecord
    from enginediag_cli.mismatch.unrecorded.per_record_effects import Alike

COLUMNS = PER_RECORD.names

SEPARATED = 5.0
"""Times the χ² per record of the best from which a place is told apart."""


def per_record_rows(found: Sequence[PerRecord]) -> Iterator[dict[str, Any]]:
    """One row per place, best first; "nothing" is the model as it is."""
    for rank, f in enumerate(found, start=1):
        yield {
            "rank": rank,
            "location": f.name,
            "component": f.location.component if f.location else None,
            "chi2_per_record": f.per_record,
            "times_best": f.per_record / found[0].per_record,
            "at_bound": len(f.at_bound),
            "failed": f.failed,
            "converged": f.converged,
        }


def per_record_sentences(
    found: Sequence[PerRecord], stop: Stop, held: Sequence[Held], alike: Sequence[Alike]
) -> Iterator[str]:
    """What was found, for stderr. `found` is best first, its first not "nothing"."""
    best = found[0]
    none = next(f for f in found if f.location is None)
    if none.at_bound:
        yield (
            f"Without an amplitude {len(none.at_bound)} identified parameters end at a physical bound "
            f"({', '.join(none.at_bound)}): physics is missing."
        )
    rivals = [f for f in found[1:] if f.location is not None and f.per_record < SEPARATED * best.per_record]
    yield (
        f"An amplitude in every record at {best.words} leaves a χ² of {rounded(best.per_record)} per "
        f"record, of {rounded(none.per_record)} without. "
        + (_rivals(rivals) if rivals else f"The next place leaves {rounded(_next(found))}.")
    )
    if stop.bands:
        yield _end(best, stop)
    else:
        yield "Too few records tell whether it lies against an end, and what a control may hold away from it."
    standing = [h for h in held if h.held]
    for h in standing[:1]:
        yield (
            f"Away from it {h.sensor} stands at {rounded(h.value)} within {rounded(h.scatter)}, where it would "
            f"scatter by {rounded(h.free_scatter)}: a control moves what acts there to hold it."
        )
    for h in standing[1:]:
        yield f"So does {h.sensor}, at {rounded(h.value)} within {rounded(h.scatter)}."
    if alike:
        told = ", ".join(f"{x.effect.term.TITLE.lower()} ({x.effect.label}, R² {x.share:.2f})" for x in alike)
        yield f"Listed effects that act there, by how well they follow it: {told}."


def _end(best: PerRecord, stop: Stop) -> str:
    """Where the amplitude ends, how often it is there, and what moves that end."""
    end = "an upper" if stop.upper else "a lower"
    travel = stop.level - stop.beyond
    flat = max(b[3] for b in stop.bands) - min(b[3] for b in stop.bands)
    return (
        f"It lies against {end} end ({rounded(best.theta[_parameter(best)] + stop.level)}) in "
        f"{100 * stop.at.mean():.0f} % of the records, and as far as {rounded(abs(travel))} from it; by ambient "
        f"temperature that end moves by {rounded(flat)}."
    )


def _rivals(rivals: Sequence[PerRecord]) -> str:
    return "Not told from it: " + ", ".join(f"{f.words} ({rounded(f.per_record)})" for f in rivals) + "."


def _next(found: Sequence[PerRecord]) -> float:
    return next(f.per_record for f in found[1:] if f.location is not None)


def _parameter(fit: PerRecord) -> str:
    assert fit.location is not None
    return fit.location.parameter
