"""A control that the model lacks, in sentences, rows and as one object.

A refinement with a control, in rows, sentences and one JSON object.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.identification.nominal import EVERYTHING
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.mismatch.controlled.fitted import BLOCKS
from enginediag_cli.report.outputs.discrepancy import CONTROL
from enginediag_cli.report.sentences import listed, rounded, with_unit
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.mismatch.controlled.find import ControlSearchResult, FittedControlLaw
    from enginediag_cli.mismatch.controlled.law import ControlLaw
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement


KEYS = ("set_point", "low", "high")


def headline(law: ControlLaw) -> str:
    """ "compressor guide vanes hold T5 at 823.1 K until they are open, or closed to 33 deg"."""
    quantity, unit = split_column(law.hold)
    a = law.actuator
    stops = [f"{rounded(v)} {a.unit}" for v in (law.low, law.high)]
    return f"{a.words}: {quantity} is held at {with_unit(law.set_point, unit, digits=5)} between {listed(stops)}"


def control_sentences(f: ControlSearchResult) -> Iterator[str]:
    """What is held by what, when, how surely, and what else was tried."""
    law, unit = f.best.law, split_column(f.best.law.hold)[1]
    still = f.still
    yield f"Missing: a control. {_start(headline(law))}."
    yield (
        f"  {law.hold} stands within {with_unit(still.scatter, unit)} there, where the model without it says "
        f"{with_unit(still.predicted, unit)}; it holds in {_share(f.held)} of the records"
        + "".join(f", is at its {q} stop in {_share(v)}" for q, v in f.at_limit.items() if v > 0.0)
        + (f", and does not act in {_share(f.released)}" if f.released > 0.0 else "")
        + "."
    )
    if law.enabled is not None:
        e = law.enabled
        side = "at most" if e.side == "at_most" else "at least"
        yield (
            f"  It acts while {e.column} is {side} {rounded(e.value, digits=5)}, which tells all but {_share(e.wrong)} "
            f"of the records; else the {law.actuator.words} stand at {rounded(law.actuator.neutral)} "
            f"{law.actuator.unit}."
        )
    for key, error in f.standard_errors.items():
        of = unit if key == "set_point" else law.actuator.unit
        told = key.replace("_", " ") if key == "set_point" else f"{key} stop"
        yield f"  {told}: {with_unit(getattr(law, key), of, error)}"
    if law.assumed:
        yield f"  Positions rest on {law.assumed}, which is assumed: readings only know what they give together."
    yield (
        f"  Identified with it, errors on records that the fit had not seen are {rounded(_times(f.best))} times "
        f"smaller (mean over the sensors), in {_share(f.best.blocks)} of {BLOCKS} runs of records."
    )
    if f.rivals:
        yield f"These flights cannot tell it from {listed([headline(t.law) for t in f.rivals], 'or')}."
    for t in f.worse:
        yield f"Tried and worse: {headline(t.law)} ({rounded(_times(t))} times smaller)."


def control_rows(f: ControlSearchResult) -> Iterator[dict[str, Any]]:
    """One row per number of every law that was not surely worse."""
    for rank, t in enumerate((f.best, *f.rivals), start=1):
        law = t.law
        errors = law.errors(t.fit.standard_errors)
        for key in KEYS:
            error = errors.get(key)
            value = getattr(law, key)
            yield {
                "rank": rank,
                "kind": "control",
                "name": law.label,
                "component": law.component,
                "driver": law.enabled.column if law.enabled else None,
                "coefficient": f"{law.name}.{key}",
                "value": value,
                "standard_error": error,
                "low": None if error is None else value - NORMAL_95 * error,
                "high": None if error is None else value + NORMAL_95 * error,
                "unit": split_column(law.hold)[1] if key == "set_point" else law.actuator.unit,
                "gain": t.gain,
                "statement": headline(law),
            }


def control_document(f: ControlSearchResult) -> dict[str, Any]:
    """Everything as one object."""
    law = f.best.law
    return {
        "name": law.label,
        "in_words": headline(law),
        "actuator": law.actuator.name,
        "hold": law.hold,
        **{k: getattr(law, k) for k in KEYS},
        "standard_errors": dict(f.standard_errors),
        "acts_while": None if law.enabled is None else vars(law.enabled),
        "holds_share": f.held,
        "at_stop_share": dict(f.at_limit),
        "released_share": f.released,
        "errors_smaller_by": _times(f.best),
        "runs_gained": f.best.blocks,
        "rivals": [_rival(t) for t in f.rivals],
        "worse": [_rival(t) for t in f.worse],
    }


def _rival(t: FittedControlLaw) -> dict[str, Any]:
    return {"name": t.law.label, "in_words": headline(t.law), "errors_smaller_by": _times(t), "runs_gained": t.blocks}


def _times(t: FittedControlLaw) -> float:
    return math.exp(t.gain)


def _share(x: float) -> str:
    return f"{rounded(100.0 * x, digits=2)} %"


def _start(text: str) -> str:
    return text[:1].upper() + text[1:]


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
