"""`locate`: its tables, its words and its picture: where model and recordings differ, and along which driver."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from enginediag_cli.drivers import CONSTANT, TIME
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.sentences import format_quantity, listed, p_value, rounded
from enginediag_cli.report.tables import Columns, Table, column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.mismatch.locate.fleet import Difference
    from enginediag_cli.mismatch.locate.locate import Located, Place
    from enginediag_cli.mismatch.locate.presence import Test
    from enginediag_cli.mismatch.locate.verdict_kind import Kind
    from enginediag_cli.mismatch.unrecorded.control_law import HeldReading, Stop
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding
    from enginediag_cli.mismatch.unrecorded.per_record import PerRecord
    from enginediag_cli.mismatch.unrecorded.per_record_effects import SimilarEffect
    from enginediag_cli.report.plotting.discrepancy import ScatterData


LOCATE: Table[Mapping[str, Any]] = Table(
    "locate",
    1,
    "one row per place within reach of the best; a single one where there is no place",
    (
        column("verdict", "text", "what kind of mismatch it is, or that there is none"),
        column("rank", "integer?", "rank of the place, from 1"),
        column("driver", "text?", "what it varies with; what these flights do not separate as a = b"),
        column("along", "text?", "the driver of the group that was scored"),
        column("location", "text?", "where it acts"),
        column("component", "text?", "component of the place"),
        column("within", "boolean?", "whether the place is within reach of the best"),
        column("statistic", "number?", "fall of χ² by a free-form correction there"),
        column("dof", "number?", "degrees of freedom of the correction"),
        column("p_value", "number?", "adjusted for all places looked at"),
        column("share", "number?", "share of the excess χ² that it takes away"),
        column("stability", "number?", "share of resamples of whole flights in which it comes first"),
        column("driver_stability", "number?", "share of resamples in which its driver comes first"),
        column("refit", "text?", "converged, or did not converge, where the place was refitted inside the model"),
    ),
    terminal=(
        "rank",
        "location",
        "driver",
        "statistic",
        "p_value",
        "share",
        "stability",
        "verdict",
        "component",
        "refit",
    ),
)


class PlaceFit(NamedTuple):
    """A free amplitude in every record at one place, with the χ² per record of the best place."""

    rank: int
    fit: PerRecord
    best: float


fit_column: Columns[PlaceFit] = Columns()

PER_RECORD: Table[PlaceFit] = Table(
    "locate/per-record",
    1,
    "locate --per-record: one row per place with a free amplitude in every record, best first",
    (
        fit_column("rank", "integer", "rank of the place, from 1"),
        fit_column(
            "location", "text", "where the amplitude acts; nothing for the model as it is", lambda row: row.fit.name
        ),
        fit_column(
            "component",
            "text?",
            "component of the place",
            lambda row: row.fit.location.component if row.fit.location else None,
        ),
        fit_column("chi2_per_record", "number", "χ² per record that is left", lambda row: row.fit.per_record),
        fit_column(
            "times_best", "number", "that over the χ² per record of the best", lambda row: row.fit.per_record / row.best
        ),
        fit_column(
            "at_bound", "integer", "identified parameters that end at a bound", lambda row: len(row.fit.at_bound)
        ),
        fit_column("failed", "integer", "records that could not be computed", lambda row: row.fit.failed),
        fit_column("converged", "boolean", "whether the fit converged", lambda row: row.fit.converged),
    ),
    terminal=("rank", "location", "chi2_per_record", "times_best", "at_bound", "failed", "converged", "component"),
)

TESTS = {
    "omnibus": "χ² of the fit {value}, {about}",
    "order": "residuals in the order of a driver: von Neumann's ratio {value} where chance gives 2, {about}",
    "directed": "best place of the map: −ln p = {value}, {about}",
}


def kind_words(kind: Kind) -> str:
    """The kinds as one cell: "effect", or "fault or sensor fault" where the flights do not show which."""
    return " or ".join(kind.names)


def located_rows(located: Located, kind: Kind, everything: bool) -> Iterator[dict[str, Any]]:
    """One row per place within reach, or per place of the map; a single row where there is no place to name.

    What has no recorded driver comes first, with 2 ln of its likelihood ratio as statistic.
    """
    empty: dict[str, Any] = dict.fromkeys(LOCATE.names) | {"verdict": kind_words(kind)}
    hidden = kind.hidden
    found = [] if hidden is None else list(_hidden_places(hidden))
    leads = {lead.group: lead.stability for lead in located.leads}
    for p in located.places if everything else () if hidden is not None else located.within:
        place = {
            "driver": p.group,
            "along": p.cell.driver.name,
            "location": p.location,
            "component": p.component,
            "within": p.within and hidden is None,
            "statistic": p.statistic,
            "dof": p.cell.score.dof,
            "p_value": p.p,
            "share": p.share,
            "stability": p.stability,
            "driver_stability": leads[p.group],
            "refit": p.refit,
        }
        found.append(place)
    yield from (empty | {"rank": rank} | place for rank, place in enumerate(found, start=1))
    if not found:
        yield empty


def _hidden_places(hidden: HiddenFinding) -> Iterator[dict[str, Any]]:
    for place in (hidden.location, *hidden.rivals):
        first = place == hidden.location
        yield {
            "driver": "not recorded",
            "location": place.name,
            "component": hidden.location.component if first else None,
            "within": True,
            "statistic": 2.0 * hidden.lr if first else None,
        }


def sentences(located: Located, kind: Kind, engine: Engine) -> Iterator[str]:
    """What was found, for stderr."""
    from enginediag_cli.mismatch.locate import verdict_kind

    if not located.converged or located.presence is None:
        yield f"no verdict: the model could not be fitted to these recordings: {located.reason}"
        return
    presence, name = located.presence, kind.names[0]
    tests = "; ".join(_test(t) for t in presence.tests)
    if name == verdict_kind.NOTHING:
        yield f"no mismatch beyond noise and identified parameters ({tests})"
    else:
        yield f"model and recordings differ ({tests})"
    if name == verdict_kind.UNLOCATED:
        yield (
            "nothing that was looked at explains it: the noise may be larger than stated or correlated in time "
            "(--noise estimate)"
        )
    if kind.hidden is not None:
        yield _hidden(kind)
    elif located.within:
        yield from _place_sentences(located)
        yield _kind(located, kind)
    yield from (_outlier_sentence(d, engine) for d in kind.worn)
    if len(located.found.evidence.engines) == 1:
        yield (
            "one engine is recorded: what is constant on it is identified with its parameters and is no mismatch; "
            "whether an effect is common to its type is unknown"
        )


def _test(test: Test) -> str:
    value = f"{test.statistic:.0f}" if test.name == "omnibus" else rounded(test.statistic)
    what = TESTS[test.name].format(value=value, about=_test_words(test))
    p = p_value(test.p)
    return f"{what}, p {p if p.startswith('<') else '= ' + p}"


def _test_words(test: Test) -> str:
    """ "hpc.efficiency along mach" in words; where it is the order of residuals, of a sensor's column."""
    return f"{test.where} along {test.along}" if test.along else test.about


def _place_sentences(located: Located) -> Iterator[str]:
    first = next(lead for lead in located.leads if lead.within)
    constant = first.driver == CONSTANT.word
    told = [lead for lead in located.leads if lead.told] or [first]
    varying = [lead for lead in told if lead.driver != CONSTANT.word]
    members = [name for lead in varying for name in lead.words]
    others = [name for lead in located.leads if lead.within and lead not in (first, *varying) for name in lead.words]
    stability = min(1.0, sum(lead.stability for lead in told))
    if constant:
        whether = (
            f" (whether it varies with {listed(members, 'or')} is not known from these recordings)" if members else ""
        )
        varies = f"it need not vary with anything{whether}"
    else:
        varies = f"it varies with {listed(members, 'or')}"
        varies += " (which these recordings do not separate)" if len(members) > 1 else ""
    rivals = f"; {listed(others, 'or')} cannot be excluded" if others else ""
    yield f"{varies}: first in {100 * stability:.0f} % of resamples of {located.resampled}{rivals}"
    place = located.within[0]
    names = list(dict.fromkeys(place_words(p) for p in located.within))
    share = f"{100 * place.share:.0f} % of the excess"
    acts = f"it acts at {place_words(place)} (a correction there lowers χ² by {rounded(place.statistic)}, {share})"
    if len(names) > 1:
        acts += f"; within reach of that: {listed(names[1:], 'or')}"
    yield acts
    if place.refit == "did not converge":
        yield "the refit with the full model did not converge: places are ranked by their linear scores"


def place_words(place: Place) -> str:
    """A location as an engineer says it."""
    at = place.cell.location
    return f"the {at.words}" if at.belongs_to_sensor else at.words


def _kind(located: Located, kind: Kind) -> str:
    from enginediag_cli.mismatch.locate import verdict_kind

    what = {
        verdict_kind.SENSOR_ERROR: "one sensor is wrong: its own error beats every change of the engine",
        verdict_kind.SENSOR_FAULT: "one sensor changed at some time and stays so: no effect",
        verdict_kind.FAULT: "the engine changed at some time and stays so: a fault, no missing physics",
        verdict_kind.EFFECT: "an effect in the engine that the model lacks",
        verdict_kind.COMMON_EFFECT: "an effect that the model lacks, common to all engines: "
        "one coefficient serves them all",
        verdict_kind.ONE_ENGINE: "an effect that the engines do not share",
        verdict_kind.SWITCH: "it follows a recorded switch",
    }
    told = listed([what[n] for n in kind.names], "or")
    if not kind.certain:
        told = f"these flights do not separate them: {told}"
    if kind.engines is not None and {verdict_kind.COMMON_EFFECT, verdict_kind.ONE_ENGINE} & set(kind.names):
        own = ", ".join(f"{name} {rounded(T)}" for name, T in kind.engines.statistics.items())
        told += f" (χ² by engine: {own}; p of one coefficient for all {p_value(kind.engines.p)})"
    if verdict_kind.FAULT in kind.names or verdict_kind.SENSOR_FAULT in kind.names:
        since = next(p.cell.driver.name for p in located.within if p.cell.driver.driver == TIME)
        told += f"; best onset: {since}"
    return told


def _hidden(kind: Kind) -> str:
    f = kind.hidden
    assert f is not None
    where = listed([at.words for at in (f.location, *f.rivals)], "or")
    likelier = f"log likelihood +{rounded(f.lr)}; chance alone reaches +{rounded(f.threshold)}"
    if f.is_switch:
        return (
            f"it switches between two states that no column records, {len(f.switches)} times within flights, and "
            f"acts at {where} ({likelier})"
        )
    return f"it varies with something that no column records and acts at {where} ({likelier})"


def _outlier_sentence(d: Difference, engine: Engine) -> str:
    parameter = engine.parameters[d.parameter]
    factor, shown = (1.0, parameter.shown_unit) if parameter.shown_unit else (100.0, "%")
    size = format_quantity(factor * abs(d.value), shown, factor * NORMAL_95 * d.standard_error)
    way = "above" if d.value > 0 else "below"
    return (
        f"engine {d.engine} differs from the fleet: {parameter.words} {size} {way} the others' "
        f"(p {p_value(d.p)}); constant, so identified and no missing physics"
    )


def picture(located: Located, kind: Kind, title: str, notes: Sequence[str]) -> str:
    """The SVG of a map that was judged."""
    import math

    from enginediag_cli.report.plotting.discrepancy import build_heat_map, mismatch_picture

    assert located.presence is not None
    gate = math.log(located.presence.looks / (0.5 * located.presence.false_alarm))
    told = [
        (p.cell.location.words, _column(p.words), p.surprise, p.within and kind.hidden is None) for p in located.places
    ]
    heat = build_heat_map(told, [_column(lead.words) for lead in located.leads], gate)
    if kind.hidden is not None:
        return mismatch_picture(title, notes, heat, _amplitude(kind.hidden))
    return mismatch_picture(title, notes, heat, _residuals(located) if located.within else None)


def _column(members: Sequence[str]) -> str:
    return " = ".join(members)


def _residuals(located: Located) -> ScatterData:
    """Residuals of the sensor that shows the first place most, against its driver."""
    import math

    from enginediag_cli.mismatch.locate.residual_curve import residual_curve_points
    from enginediag_cli.report.plotting.discrepancy import ScatterData

    assert located.projection is not None
    cell = located.within[0].cell
    s = residual_curve_points(located.projection, cell)
    driver = cell.driver.driver
    label = cell.driver.short + ("" if driver.unit == "1" else f" [{driver.unit}]")
    scale: Callable[[float], float] = float
    if driver.quantity_unit:  # people read the quantity, not its logarithm
        label, scale = f"{cell.driver.short} ({driver.quantity_unit})", math.exp
    return ScatterData(
        label,
        f"{s.sensor.rsplit('_', 1)[0]}: measured − model [{s.unit}]",
        f"What shows it most: {s.sensor.rsplit('_', 1)[0]}. Dots: readings; black: their means with 95 % intervals; "
        f"orange: what a free curve of {cell.location.words} makes of it",
        [scale(x) for x in s.x.tolist()],
        s.residual.tolist(),
        [(scale(x), mean, error) for x, mean, error, _ in s.bins],
        [(scale(x), curve) for x, _, _, curve in s.bins],
    )


def _amplitude(f: HiddenFinding) -> ScatterData:
    """Amplitude of an effect without a recorded driver, record by record, and its two states where it has them."""
    from enginediag_cli.report.plotting.discrepancy import ScatterData

    number = (f.number + 1).tolist()
    line: list[tuple[float, float]] = []
    if f.is_switch and f.states is not None:
        # the amplitude is told about its mean, which identification took
        steps = f.coefficient * ((f.states > 0.5) - f.states.mean())
        for k, y in zip(number, steps.tolist(), strict=True):
            line += [(k - 0.5, y), (k + 0.5, y)]
    caption = "Dots: amplitude of each record, about its mean" + ("; orange: its two states" if line else "")
    unit = f" [{f.unit}]" if f.unit not in ("", "1") else ""
    label = f"{f.location.words}{unit}"
    return ScatterData("record", label, caption, number, f.amplitude.tolist(), [], line)


SEPARATED = 5.0
"""Times the χ² per record of the best from which a place is separated."""


def per_record_rows(found: Sequence[PerRecord]) -> Iterator[dict[str, Any]]:
    """One row per place, best first; "nothing" is the model as it is."""
    for rank, fit in enumerate(found, start=1):
        yield PER_RECORD.row(PlaceFit(rank, fit, found[0].per_record))


def per_record_sentences(
    found: Sequence[PerRecord], stop: Stop, held: Sequence[HeldReading], alike: Sequence[SimilarEffect]
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
        + (_alternatives_sentence(rivals) if rivals else f"The next place leaves {rounded(_next(found))}.")
    )
    if stop.bands:
        yield _end(best, stop)
    else:
        yield "Too few records show whether it lies against an end, and what a control may hold away from it."
    standing = [h for h in held if h.held]
    for h in standing[:1]:
        yield (
            f"Away from it {h.sensor} stays at {rounded(h.value)} within {rounded(h.scatter)}, where it would "
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


def _alternatives_sentence(rivals: Sequence[PerRecord]) -> str:
    return "Indistinguishable from it: " + ", ".join(f"{f.words} ({rounded(f.per_record)})" for f in rivals) + "."


def _next(found: Sequence[PerRecord]) -> float:
    return next(f.per_record for f in found[1:] if f.location is not None)


def _parameter(fit: PerRecord) -> str:
    assert fit.location is not None
    return fit.location.parameter
