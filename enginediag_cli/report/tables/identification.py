"""`identify` and `refine`: their tables, words and documents.

`identify`: estimates, lags, errors of maps, and probes that the heat balances contradict. `refine`: the fit on unseen
flights before and after, of effects or of a control.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.error_model.maps import FAMILY, POINT_FAMILY, PointErrorModel
from enginediag_cli.identification.covariance import ActiveBound
from enginediag_cli.identification.identify import OUTSIDE_MAPS, Identification
from enginediag_cli.identification.nominal import EVERYTHING, Estimate, SensorQuality
from enginediag_cli.identification.passes import Simplification
from enginediag_cli.identification.probes import WrongProbe
from enginediag_cli.identification.problem import Repeat
from enginediag_cli.mismatch.controlled.fitted import BLOCKS
from enginediag_cli.mismatch.refine.criteria import BETTER, LEVEL, Criterion, Records, Significance, Verdict
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.output import short_cell
from enginediag_cli.report.sentences import count, format_quantity, p_value, rounded, spelled
from enginediag_cli.report.tables import Table, column, part
from enginediag_cli.report.tables.explanation_text import control_headline, rate_words
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.term import Coefficient, Effect
    from enginediag_cli.mismatch.refine.alarms import Alarms
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement
    from enginediag_cli.mismatch.refine.refine import Refinement


SHAPES_AS_STATED = "map shapes were not estimated and are as the engine file states them"
GIVEN_UP = {
    Simplification.SHAPES_AT_FEW_POINTS: f"{SHAPES_AS_STATED}: at so few operating points errors of the maps can do "
    "whatever shapes would",
    Simplification.SHAPES: f"{SHAPES_AS_STATED}: with them the fit did not converge",
    Simplification.SHAPES_AT_BOUND: f"{SHAPES_AS_STATED}: the fit drove one of them to a bound",
    Simplification.SIZES: "how wrong the maps are was not estimated, because the fit did not converge with it: they "
    "may be as wrong as stated, and the standard errors hold that",
}
"""What is said of what an identification gave up."""
NOTEWORTHY = 1.1
"""Size of a map error, as a multiple of what is stated, from which it is reported."""
PLAINLY = 0.9
"""Share of a reading's error while power changes that remains without its lag, below which that is reported."""
SHOWN_COMBINATIONS = 12
"""Unidentified combinations that are listed; the rest are counted."""
FEW_RECORDS = 20.0
"""Independent records below which the size of the noise is not known to a sixth (1/√(2n))."""


def report_lines(result: Identification) -> Iterator[str]:
    """Records, fit, parameters by status, and what the data leave open."""
    yield _records_line(result)
    if not result.converged:
        yield f"did not converge: {result.reason}"
    else:
        yield f"converged after {result.noise_passes} passes over noise and fit; {result.reason}"
    yield from (GIVEN_UP[what] for what in result.simplifications)
    yield ""
    yield from fit_table(result)
    yield from noise_lines(result)
    yield ""
    yield from parameter_lines([e for e in result.estimates if e.family not in (FAMILY, POINT_FAMILY)])
    yield from map_error_lines(result)
    yield from point_error_lines(result)
    yield from offset_lines(result)
    yield from lagging_lines(result)
    yield ""
    yield from combination_lines(result)


def _records_line(result: Identification) -> str:
    n = len(result.problem.labels)
    used = f"{result.records['used']:,} records of {n} recording{'s' * (n > 1)} used"
    outside = result.records.get(OUTSIDE_MAPS, 0)
    used += f" ({outside:,} of them outside the maps)" if outside else ""
    left = [f"{n:,} {why}" for why, n in result.records.items() if why not in ("used", OUTSIDE_MAPS) and n]
    return used + (f"; excluded: {', '.join(left)}" if left else "; none excluded")


def repeat_lines(repeats: Iterable[Repeat]) -> Iterator[str]:
    """What was given twice and is counted once."""
    for r in repeats:
        what = f"all {r.records:,} records" if r.whole else f"{r.records:,} records"
        yield f"{r.label}: {what} are in {r.original}, too, and are counted once"


def bounds_line(bounds: Sequence[ActiveBound]) -> str:
    """Why parameters at their bounds are no nominal state, and what can be done."""
    named = ", ".join(map(str, bounds))
    what = (
        "the model lacks something, or has wrong sizes: look at the sensors that fit worst, state what is "
        "known of the engine, or hold parameters with `fixed:`; --allow-bounds writes it as it is"
    )
    return f"no nominal state: {named}; nothing is written ({what})"


def doubt_lines(result: Identification) -> Iterator[str]:
    """What speaks against a fit that has converged: parameters where no engine of the kind is, readings that the model
    does not explain."""
    for e in result.implausible_estimates:
        off = abs(e.value - e.prior_mean) / e.prior_sigma
        unit = f" {e.unit}" if e.unit not in ("", "1") else ""
        yield (
            f"{e.name} is {rounded(e.value)}{unit}, {off:.0f} standard deviations of its prior from "
            f"{rounded(e.prior_mean)}{unit}: check the engine file, and columns and units of the recordings"
        )
    if result.unexplained_sensors:
        named = ", ".join(f"{sensor} {ratio:.0f} times" for sensor, ratio in result.unexplained_sensors)
        yield f"the fit leaves far more than the stated noise: {named}; the model does not explain these readings"


def noise_lines(result: Identification) -> Iterator[str]:
    """Which sensors' noise rests on few independent records."""
    noise = result.noise
    few = [
        f"{sensor} {rounded(float(n))}"
        for sensor, n in zip(result.problem.sensors, noise.n_effective, strict=True)
        if n < FEW_RECORDS
    ]
    if few:
        yield f"noise from few independent records, so that size and correlation are vague: {', '.join(few)}"


def fit_table(result: Identification) -> list[str]:
    """Per sensor and regime: RMS in sample, by left-out blocks and held out; and the noise of each sensor."""
    found = [_index_by_place(q) for q in (result.in_sample, result.cross_validated, result.held_out)]
    rows: list[tuple[str, ...]] = [
        ("sensor", "regime", "records", "RMS in sample", "cross-validated", "held out", "chi2/N", "rho1")
    ]
    noise = dict(zip(result.problem.sensors, result.noise.rho1, strict=True))
    places = list(dict.fromkeys(place for table in found for place in table))
    for sensor, regime in sorted(places, key=lambda p: (result.problem.sensors.index(p[0]), p[1] != EVERYTHING)):
        q = [table.get((sensor, regime)) for table in found]
        inside = q[0]
        rows.append(
            (
                sensor if regime == EVERYTHING else "",
                regime,
                str(inside.n) if inside else "",
                *(f"{rounded(x.rms)} {x.unit}".rstrip() if x else "-" for x in q),
                rounded(inside.chi2) if inside else "-",
                rounded(float(noise[sensor]), digits=2) if regime == EVERYTHING else "",
            )
        )
    lines = _aligned(rows)
    cv = result.cross_validation
    if cv.folds:
        lines.append(
            f"cross-validated over {cv.folds} folds of contiguous blocks"
            + (f"; {cv.failed_folds} did not converge and count nowhere" if cv.failed_folds else "")
        )
    return lines


def parameter_lines(estimates: Sequence[Estimate]) -> list[str]:
    """Estimates with their standard errors; those that stayed at their prior are named, not quoted."""
    told = [e for e in estimates if e.status != "at prior"]
    rows = [("parameter", "value", "± standard error", "unit", "prior", "from data", "status")]
    rows += [
        (
            e.name,
            rounded(e.value, e.standard_error),
            rounded(e.standard_error, digits=2),
            e.unit,
            f"{e.prior_mean:g} ± {e.prior_sigma:g}",
            f"{100 * e.from_data:.0f} %",
            e.status,
        )
        for e in told
    ]
    lines = _aligned(rows) if told else []
    bound = [e.name for e in estimates if e.status == "at bound"]
    if bound:
        lines.append(f"{len(bound)} at a bound, a sign that the model lacks something: {', '.join(bound)}")
    prior = [e.name for e in estimates if e.status == "at prior"]
    if prior:
        lines.append(f"{len(prior)} not found by these recordings, left at what was assumed: {', '.join(prior)}")
    return lines


def point_error_lines(result: Identification) -> Iterator[str]:
    """What the model misses at operating points, of the readings where that is more than the noise of one."""
    inner = getattr(result.problem.model, "model", None)
    if not isinstance(inner, PointErrorModel):
        return
    told = [f"{s} {rounded(size)}" for s, size in inner.sizes.items() if size > inner.sensors[s].noise_sigma]
    if told:
        yield (
            f"beyond errors of the maps, at {len(inner.points)} operating points flown again and again the model "
            f"misses (1 standard deviation) {', '.join(told)}; it is taken out where these points are judged"
        )


def map_error_lines(result: Identification) -> Iterator[str]:
    """How wrong the maps may be, and what that rests on."""
    found = result.map_errors
    if not found:
        return
    stated = f"{100 * found[0].stated:.3g} %"
    larger = [m for m in found if m.estimated > NOTEWORTHY * m.stated]
    words = result.problem.model.parameters
    named = ", ".join(f"{words[m.target].words} {100 * m.estimated:.2g} %" for m in larger)
    rest = f"stated, {stated} (1 standard deviation of each smooth error along speed and flow or pressure ratio)"
    known = np.mean([e.from_data for e in result.estimates if e.family == FAMILY])
    yield f"maps as wrong as {rest}; these records fix {100 * known:.0f} % of that, where they were flown"
    if larger:
        yield f"maps that must be wrong by more for these records: {named}"


def offset_lines(result: Identification) -> Iterator[str]:
    """By how much instruments differ from recording to recording, where that was estimated."""
    found = [o for o in result.problem.offsets if o.recordings]
    if not found:
        return
    by_column: dict[str, list[str]] = {}
    for o in found:
        size = f"{100 * o.prior_sigma:.2g} %" if o.kind == "scale" else f"{o.prior_sigma:.2g}"
        by_column.setdefault(o.sensor, []).append(size)
    named = ", ".join(f"{column} {' and '.join(sizes)}" for column, sizes in by_column.items())
    yield f"instruments differ between the {found[0].recordings} recordings by (1 standard deviation): {named}"


def lagging_lines(result: Identification) -> Iterator[str]:
    """Readings that lag behind the model where the engine moves."""
    if not result.sensor_lags:
        return
    most = min(result.sensor_lags, key=lambda r: r.left / r.moved if r.moved else 1.0)
    told = [r for r in result.sensor_lags if r.left < PLAINLY * r.moved] or [most]
    named = ", ".join(f"{r.sensor} {rounded(r.moved)}, {rounded(r.left)} without that" for r in told)
    yield (
        f"readings lag behind the model when power changes (RMS while it does: {named}): it lacks a dynamic "
        "effect (with memory), such as heat soak or the lag of a probe; counted as uncertain when recordings are "
        "judged, and looked for by `enginediag explain`"
    )


def combination_lines(result: Identification) -> list[str]:
    """Changes of several parameters together that these recordings do not show."""
    joint = [c for c in result.unidentified if len(c.parameters) > 1]
    if not joint:
        return ["no combination of parameters is left open besides those left at what was assumed"]
    more = len(joint) - SHOWN_COMBINATIONS
    return [
        "combinations that these recordings leave open:",
        *(f"  {c}" for c in joint[:SHOWN_COMBINATIONS]),
        *([f"  and {more} more, in the nominal file"] if more > 0 else []),
    ]


def _index_by_place(quality: Sequence[SensorQuality]) -> dict[tuple[str, str], SensorQuality]:
    return {(q.sensor, q.regime): q for q in quality}


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[j]) for row in rows) for j in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def probe_lines(found: Iterable[WrongProbe], *, kept: bool) -> Iterator[str]:
    """One line for each finding; kept: the readings stay in the fit because the user wants it."""
    for w in found:
        unit = split_column(w.columns[0])[1]
        low, middle, high = (f"{v:+.3g}" for v in w.error)
        numbers = f"by {middle} {unit} ({low} to {high} in 8 of 10 records; ± {rounded(w.expected)} expected)"
        told = f"over {w.records:,} records ({', '.join(w.balances)})"
        if not w.is_unique:
            others = ", ".join(w.columns[1:])
            yield (
                f"heat balances contradict {w.columns[0]} {numbers}, or as well {others}, {told}; which of them "
                "is unknown, and all stay in the fit"
            )
            continue
        ends = "it stays in the fit (--keep-probes)" if kept else "it is excluded from the fit (--keep-probes keeps it)"
        yield f"heat balances contradict {w.columns[0]} {numbers} {told}; {ends}"


_WHAT = (
    column("what", "text", "the figure: rms, chi2 per reading, log likelihood …"),
    column("of", "text", "sensor, flight or setting that it is of"),
)
_FIGURES = (
    column("unit", "text", "unit of before and after"),
    column("before", "number?", "with the engine file as it was", "unit"),
    column("after", "number?", "with what was put in", "unit"),
    column("n", "integer?", "readings, or windows, that it is of"),
)
_SAID = (
    column("sentences", "texts", "the result in words"),
    column("provenance", "texts", "what made it, as the head of a CSV"),
)
_SCHEMA = column("schema", "text", "name and version of this schema")

REFINE: Table[Mapping[str, Any]] = Table(
    "refine",
    1,
    "refine --report: figures of flights that were not fitted",
    (*_WHAT, *_FIGURES),
    terminal=("what", "of", "before", "after", "unit", "n"),
    document=(
        _SCHEMA,
        column("verdict", "text", "accepted, refused or cannot be judged"),
        column("refused", "text?", "why nothing was written"),
        column("still_missing", "text?", "what the fitted flights show beyond"),
        part("effects", "terms with their coefficients", many=True),
        part("standard_errors", "of the coefficients"),
        part("criteria", "what was required, what was found", many=True),
        column("log_likelihood_gain", "number?", "on unseen flights"),
        part("flights", "log likelihood of each unseen flight", many=True),
        part("chi2_per_reading", "on unseen flights", empty=True),
        part("detect", "false alarms before and after", empty=True),
        part("rows", "the rows of the CSV", (*_WHAT, *_FIGURES), many=True),
        *_SAID,
    ),
)

CONTROL: Table[Mapping[str, Any]] = Table(
    "refine/control",
    1,
    "refine --report, where a control is put into the engine file",
    (*_WHAT, column("where", "text", "regime of the control, or everything"), *_FIGURES),
    document=(
        _SCHEMA,
        column("accepted", "boolean", "whether the file was written"),
        column("failed", "text?", "why not"),
        column("control", "text", "the control in words"),
        part("standard_errors", "of set point and stops"),
        part("rows", "the rows of the CSV", many=True),
        column("errors_smaller_by", "number?", "factor on unseen flights, mean over the sensors"),
        column("runs_gained", "number?", "share of runs of records that gain"),
        *_SAID,
    ),
)

ABOUT = {Records.ALL: "", Records.ON: ", where it is on", Records.CONTRAST: ", on against off"}
"""Behind "Unseen flights"."""
NOTHING_TO_TELL = {
    Records.ALL: "no record is predicted otherwise",
    Records.ON: "it is not on in any of them",
    Records.CONTRAST: "none of them holds both states, and instruments' zeros may do what a whole flight's state does",
}


def refinement_rows(r: Refinement) -> Iterator[dict[str, Any]]:
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
    for name, (before, after) in (u.states or {}).items():
        for one, other in zip(before, after, strict=True):
            yield _row("rms", f"{one.sensor} {name}", one.unit, one.rms, other.rms, one.n)
            yield _row("chi2 per reading", f"{one.sensor} {name}", "1", one.chi2, other.chi2, one.n)
    if r.alarms_before is not None and r.alarms_after is not None:
        one_a, other_a = r.alarms_before, r.alarms_after
        yield _row("false-alarm rate of detect", "nominal 1 %", "1", one_a.rate, other_a.rate, one_a.judged)
        yield _row("windows that do not fit", "at 1 %", "1", _share(one_a), _share(other_a), one_a.judged)
        yield _row("fit of detect", "median", "1", one_a.fit, other_a.fit, one_a.judged)


def comparison_lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The rows as lines of a table."""
    width = max((len(f"{r['what']}, {r['of']}") for r in rows), default=0)
    if rows:
        yield f"{'on unseen flights':{width}}  {'before':>10}  {'after':>10}"
    for r in rows:
        unit = "" if r["unit"] == "1" else f" {r['unit']}"
        what = f"{r['what']}, {r['of']}"
        yield f"{what:{width}}  {short_cell(r['before']):>10}  {short_cell(r['after']):>10}{unit}"


def refinement_sentences(r: Refinement) -> Iterator[str]:
    """Coefficients, gains and alarms, or why nothing is written."""
    for e in r.effects:
        yield f"{named_effect(e)}:"
        for c in e.term.COEFFICIENTS:
            if c.name in e.values:
                error = r.standard_errors.get(e.parameter_name(c.name))
                half, value = NORMAL_95 * (error or 0.0), e.values[c.name]
                yield f"  {_coefficient(c, value, error)}{rate_words(e, c, (value, value - half, value + half))}"
    yield from map(criterion_in_words, r.criteria)
    if r.unseen is not None:
        yield f"{validation_flights_words(r)}."
        if r.unseen.lost:
            yield f"{count(r.unseen.lost, 'unseen record')} could not be computed by both models."
        for name, (before, after) in (r.unseen.states or {}).items():
            told = (f"{x.sensor} {_size(x)} → {_size(y)}" for x, y in zip(before, after, strict=True))
            yield f"RMS where it is {name}, by the states that other sensors show: {', '.join(told)}."
    if r.alarms_before is not None and r.alarms_after is not None:
        yield f"{alarms_in_words(r)}."
        one, other = r.alarms_before, r.alarms_after
        yield (
            f"Windows that the model does not fit, at a level of 1 %: {one.misfits} of {one.judged} before, "
            f"{other.misfits} of {other.judged} after."
        )
    if r.still_missing:
        yield f"The fitted flights show more than that: {r.still_missing}."


def named_effect(e: Effect) -> str:
    """ "Reynolds number, compressor efficiency at HPC (reynolds_efficiency@hpc)"."""
    return f"{e.term.TITLE} at {spelled(e.site.name)} ({e.label})"


def _coefficient(declared: Coefficient, value: float, error: float | None) -> str:
    """A coefficient with what it is, its unit and its 95 % interval."""
    unit = "" if declared.unit == "1" else declared.unit
    size = format_quantity(value, unit, NORMAL_95 * error if error else None)
    return f"{declared.name} = {size}{' (95 %)' if error else ''}: {declared.description}"


def criterion_in_words(c: Criterion) -> str:
    """What was required, what was found, and whether it is enough."""
    if isinstance(c, Significance):
        differs = "differs" if c.met else "does not differ"
        asked = f"Wald's test, p {_equal(c.p)}; below {LEVEL:g} is required"
        return f"Fitted flights: {c.label} {differs} from nothing ({asked})."
    about = ABOUT[c.of]
    if not c.information > 0.0:
        return f"Unseen flights{about}: cannot be judged, {NOTHING_TO_TELL[c.of]}."
    share = f"{rounded(c.share, c.standard_error)} ± {rounded(c.standard_error, c.standard_error)}"
    found = (
        f"Unseen flights{about}: the readings ask for {share} of the change that is predicted, where χ² falls above "
        f"{BETTER:g} (p {_equal(c.p)}; below {LEVEL:g} is required)"
    )
    if c.met is None:
        return f"{found}: too few records to judge."
    return f"{found}: predicted better." if c.met else f"{found}: not predicted better."


def refinement_refusal(r: Refinement) -> str:
    """Why nothing may be written, or nothing."""
    if r.failed:
        return r.failed
    if r.verdict is Verdict.ACCEPTED:
        return ""
    refused = r.verdict is Verdict.REFUSED
    wrong = [criterion_in_words(c) for c in r.criteria if (c.met is False if refused else c.met is None)]
    text = " ".join(wrong) or "no unseen record could be computed by both models."
    return text.removesuffix(".") if refused else f"cannot be judged on these flights. {text.removesuffix('.')}"


def validation_flights_words(r: Refinement) -> str:
    """What the unseen flights say of the fit, or nothing."""
    u = r.unseen
    if u is None:
        return ""
    return (
        f"Unseen flights: χ² per reading {u.chi2_before:.3f} before, {u.chi2_after:.3f} after; log likelihood "
        f"{u.gain:+.1f}"
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


def refinement_document(r: Refinement, provenance: tuple[str, ...]) -> dict[str, Any]:
    """Everything as one object."""
    u = r.unseen
    return {
        "schema": REFINE.id,
        "verdict": r.verdict.value,
        "refused": refinement_refusal(r) or None,
        "still_missing": r.still_missing or None,
        "sentences": list(refinement_sentences(r)),
        "effects": [{"term": e.term.NAME, "at": e.site.name, "coefficients": dict(e.values)} for e in r.effects],
        "standard_errors": r.standard_errors,
        "criteria": [_criterion(c) for c in r.criteria],
        "log_likelihood_gain": None if u is None else u.gain,
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
        "rows": list(refinement_rows(r)),
        "provenance": list(provenance),
    }


def _row(what: str, of: str, unit: str, before: float, after: float, n: int | None) -> dict[str, Any]:
    return REFINE.row({"what": what, "of": of, "unit": unit, "before": before, "after": after, "n": n})


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


def _criterion(c: Criterion) -> dict[str, Any]:
    asked = {"p": c.p, "met": c.met, "effective_stretches": c.effective}
    if isinstance(c, Significance):
        return {"criterion": "significance", "of": c.label, "coefficients": c.coefficients, **asked}
    known = c.information > 0.0
    return {
        "criterion": "prediction",
        "of": c.of.value,
        "share": c.share if known else None,
        "standard_error": c.standard_error if known else None,
        "chi2_fall": c.fall if known else None,
        "records": c.records,
        **asked,
    }


def _size(q: SensorQuality) -> str:
    return f"{rounded(q.rms)} {q.unit}".removesuffix(" 1")


def _equal(p: float) -> str:
    text = p_value(p)
    return text if text.startswith("<") else f"= {text}"


FEWEST = 30
"""Records of a regime below which its figures are not written in a sentence; rows have them."""


def control_refinement_rows(r: ControlRefinement) -> Iterator[dict[str, Any]]:
    """RMS by sensor, over all unseen records and by what the control does."""
    after = {(q.sensor, q.regime): q for q in r.after}
    for one in r.before:
        other = after.get((one.sensor, one.regime))
        if other is not None:
            yield dict(
                zip(CONTROL.names, ("rms", one.sensor, one.regime, one.unit, one.rms, other.rms, one.n), strict=True)
            )


def control_refinement_sentences(r: ControlRefinement) -> Iterator[str]:
    """What unseen flights say."""
    if r.unconverged:
        yield "The model without the control could not be fitted; its errors are those where the fit ended."
    told = [row for row in control_refinement_rows(r) if row["n"] >= FEWEST]
    names = [f"{row['of']}{'' if row['where'] == EVERYTHING else ', ' + row['where']}" for row in told]
    width = max(map(len, names), default=0)
    if told:
        yield f"{'RMS on unseen flights':{width}}  {'before':>10}  {'after':>10}  {'records':>8}"
    for name, row in zip(names, told, strict=True):
        one, other = (format_quantity(row[k], row["unit"]) for k in ("before", "after"))
        yield f"{name:{width}}  {one:>10}  {other:>10}  {row['n']:>8,}"
    yield from fall_in_words(r)


def fall_in_words(r: ControlRefinement) -> Iterator[str]:
    """By how much errors on unseen flights fall, where that was judged."""
    if math.isfinite(r.fall):
        yield (
            f"Errors on unseen flights are {rounded(math.exp(r.fall))} times smaller (mean over the sensors), in "
            f"{rounded(100.0 * r.runs, digits=2)} % of {BLOCKS} runs of records."
        )


def control_refinement_refusal(r: ControlRefinement) -> str:
    """Why nothing is written."""
    return r.failed or f"unseen flights are not predicted better with {control_headline(r.law)}"


def control_refinement_document(r: ControlRefinement, head: tuple[str, ...]) -> dict[str, Any]:
    """Everything as one object."""
    return {
        "schema": CONTROL.id,
        "accepted": r.accepted,
        "failed": r.failed,
        "control": control_headline(r.law),
        "standard_errors": dict(r.standard_errors),
        "rows": list(control_refinement_rows(r)),
        "errors_smaller_by": math.exp(r.fall) if math.isfinite(r.fall) else None,
        "runs_gained": r.runs if math.isfinite(r.runs) else None,
        "sentences": list(control_refinement_sentences(r)),
        "provenance": list(head),
    }
