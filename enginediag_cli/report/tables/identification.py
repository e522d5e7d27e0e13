"""What identification found, in lines of text for people.

Probes that the heat balances contradict, in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from enginediag_cli.error_model.maps import FAMILY, POINT_FAMILY, PointErrorModel
from enginediag_cli.identification.covariance import ActiveBound
from enginediag_cli.identification.identify import OUTSIDE_MAPS, Identification
from enginediag_cli.identification.nominal import EVERYTHING, Estimate, SensorQuality
from enginediag_cli.identification.passes import Simplification
from enginediag_cli.identification.probes import WrongProbe
from enginediag_cli.identification.problem import Repeat
from enginediag_cli.report.sentences import rounded
from enginediag_cli.units import split_column

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
"""Size of a map error, as a multiple of what is stated, from which it is told."""
PLAINLY = 0.9
"""Share of a reading's error while power changes that is left without what it lags by, below which that is told."""
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
