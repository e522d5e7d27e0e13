"""A refinement in rows, sentences and one JSON object: what unseen flights say before and after."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.names import spelled
from enginediag_cli.presentation.numbers import p_value, with_unit
from enginediag_cli.presentation.sentences import count

if TYPE_CHECKING:
    from enginediag_cli.engine.term import Coefficient, Effect
    from enginediag_cli.mismatch.refine.alarms import Alarms
    from enginediag_cli.mismatch.refine.refine import Refinement

COLUMNS = ("what", "of", "unit", "before", "after", "n")


def rows(r: Refinement) -> Iterator[dict[str, Any]]:
    """RMS and χ²/N by sensor, then totals, gains by flight, and what `detect` does."""
    u = r.unseen
    if u is None:
        return
    for one, other in zip(u.quality_before, u.quality_after, strict=True):
        yield _row("rms", one.sensor, one.unit, one.rms, other.rms, one.n)
    for one, other in zip(u.quality_before, u.quality_after, strict=True):
        yield _row("chi2 per reading", one.sensor, "1", one.chi2, other.chi2, one.n)
    yield _row("chi2 per reading", "all", "1", u.chi2_before, u.chi2_after, u.readings)
    for label, one_l, other_l in zip(u.labels, u.flights_before, u.flights_after, strict=True):
        yield _row("log likelihood", label, "1", float(one_l), float(other_l), None)
    for name, state in (u.states or {}).items():
        yield _row("chi2 per reading", name, "1", state[0], state[1], state[2])
    if r.alarms_before is not None and r.alarms_after is not None:
        one_a, other_a = r.alarms_before, r.alarms_after
        yield _row("false-alarm rate of detect", "nominal 1 %", "1", one_a.rate, other_a.rate, one_a.judged)
        yield _row("windows that do not fit", "at 1 %", "1", _share(one_a), _share(other_a), one_a.judged)
        yield _row("fit of detect", "median", "1", one_a.fit, other_a.fit, one_a.judged)


def sentences(r: Refinement) -> Iterator[str]:
    """Coefficients, gains and alarms, or why nothing is written."""
    for e in r.effects:
        yield f"{named_effect(e)}:"
        for c in e.term.COEFFICIENTS:
            if c.name in e.values:
                yield f"  {_coefficient(c, e.values[c.name], r.standard_errors.get(e.parameter_name(c.name)))}"
    if r.unseen is not None and r.gain is not None:
        yield f"{unseen_in_words(r)}."
        if r.unseen.lost:
            yield f"{count(r.unseen.lost, 'unseen record')} could not be computed by both models."
        if r.unseen.states:
            told = [
                f"{name}: {before:.2f} before, {after:.2f} after"
                for name, (before, after, _) in r.unseen.states.items()
            ]
            yield f"χ² per reading within the states inferred there: {'; '.join(told)}."
    if r.alarms_before is not None and r.alarms_after is not None:
        yield f"{alarms_in_words(r)}."
        before, after = r.alarms_before, r.alarms_after
        yield (
            f"Windows that the model does not fit, at a level of 1 %: {before.misfits} of {before.judged} before, "
            f"{after.misfits} of {after.judged} after."
        )
    if r.still_missing:
        yield f"The fitted flights show more than that: {r.still_missing}."


def named_effect(e: Effect) -> str:
    """ "Reynolds number, compressor efficiency at HPC (reynolds_efficiency@hpc)"."""
    return f"{e.term.TITLE} at {spelled(e.site.name)} ({e.label})"


def _coefficient(declared: Coefficient, value: float, error: float | None) -> str:
    """A coefficient with what it is, its unit and its 95 % interval."""
    unit = "" if declared.unit == "1" else declared.unit
    size = with_unit(value, unit, NORMAL_95 * error if error else None)
    return f"{declared.name} = {size}{' (95 %)' if error else ''}: {declared.description}"


def unseen_in_words(r: Refinement) -> str:
    """What the unseen flights say of the fit, or nothing."""
    u, g = r.unseen, r.gain
    if u is None or g is None:
        return ""
    return (
        f"Unseen flights: χ² per reading {u.chi2_before:.3f} before, {u.chi2_after:.3f} after; log likelihood "
        f"{g.total:+.1f}; {g.gained} of {g.units} {_units(g.unit)} gain (signed-rank test, p {_equal(g.p)})"
    )


def alarms_in_words(r: Refinement) -> str:
    """False alarms on the unseen flights, or nothing."""
    if r.alarms_before is None or r.alarms_after is None:
        return ""
    return (
        f"False alarms of detect on them at nominal 1 %: {_rate(r.alarms_before)} before, {_rate(r.alarms_after)} after"
    )


def state_rows(r: Refinement) -> Iterator[dict[str, Any]]:
    """States of a switched effect in every record of every flight, in the order of the flights."""
    column = next((e.switch for e in r.effects if e.switch), "")
    for f in r.flights if column else ():
        time = f.columns.get("time_s")
        for k, state in enumerate(f.columns[column].tolist()):
            yield {
                "engine": f.engine,
                "flight": f.label,
                "record": k + 1,
                "time_s": None if time is None else float(time[k]),
                column: int(state),
            }


def document(r: Refinement, provenance: tuple[str, ...]) -> dict[str, Any]:
    """Everything as one object."""
    u, g = r.unseen, r.gain
    return {
        "refused": r.refused or None,
        "still_missing": r.still_missing or None,
        "sentences": list(sentences(r)),
        "effects": [{"term": e.term.NAME, "at": e.site.name, "coefficients": dict(e.values)} for e in r.effects],
        "standard_errors": r.standard_errors,
        "gain": None if g is None else {**vars(g), "significant": g.significant},
        "flights": []
        if u is None
        else [
            {"flight": label, "before": a, "after": b, "gain": b - a}
            for label, a, b in zip(u.labels, u.flights_before, u.flights_after, strict=True)
        ],
        "chi2_per_reading": None if u is None else {"before": u.chi2_before, "after": u.chi2_after, "of": u.readings},
        "detect": None
        if r.alarms_before is None or r.alarms_after is None
        else {"before": _alarms(r.alarms_before), "after": _alarms(r.alarms_after)},
        "rows": list(rows(r)),
        "provenance": list(provenance),
    }


def _row(what: str, of: str, unit: str, before: float, after: float, n: int | None) -> dict[str, Any]:
    return {"what": what, "of": of, "unit": unit, "before": before, "after": after, "n": n}


def _alarms(a: Alarms) -> dict[str, Any]:
    low, high = a.interval
    return {
        "rate": a.rate,
        "count": a.alarms,
        "of": a.judged,
        "low": low,
        "high": high,
        "misfits": a.misfits,
        "fit": a.fit,
        "without_verdict": a.without_verdict,
        "reason": a.reason,
    }


def _share(a: Alarms) -> float:
    return a.misfits / a.judged if a.judged else float("nan")


def _rate(a: Alarms) -> str:
    if not a.judged:
        return f"none judged ({a.reason or 'no window'})"
    low, high = a.interval
    interval = f"95 % interval {100 * low:.0f} to {100 * high:.0f} %"
    return f"{a.alarms} of {a.judged} windows ({100 * a.rate:.0f} %, {interval})"


def _units(unit: str) -> str:
    return {"flight": "flights", "run of records": "runs of records"}[unit]


def _equal(p: float) -> str:
    text = p_value(p)
    return text if text.startswith("<") else f"= {text}"
