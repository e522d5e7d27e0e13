"""Charts of residuals: along windows, records, drivers and flights, and as fingerprints.

The statistic of `detect` as a multiple of its threshold; the fingerprint of a window, its residuals beside the effect
of each leading answer; residuals over time and over drivers (a fault is constant, missing physics bends with its
driver); the health of instruments; snapshots at take-off and in cruise, as engine trend monitoring has them; raw deltas
from rows of `trend --what deltas`, and which of them are beyond alert levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.history.deltas import CAUTION, WARNING
from enginediag_cli.isolation.results import fingerprint as isolation_fingerprint
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.plotting import (
    Axis,
    Band,
    Bars,
    Chart,
    ChartColumn,
    ChartTable,
    EventMark,
    Intervals,
    Layer,
    Line,
    Points,
    ReferenceLine,
    RowOrigin,
    Value,
    chart_columns,
    every,
)
from enginediag_cli.report.result_files import ResidualRecords, Row, finite_mean, order_windows
from enginediag_cli.report.sentences import format_quantity, listed, probability
from enginediag_cli.report.tables.trend import ALERT_LEVELS
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.units import split_column

COLUMNS = chart_columns("flight", "verdict", "statistic", "threshold", "p value", "fit", "records judged")

SMALLEST = 1e-3
"""Multiple of the threshold at which smaller ones are drawn: far below, nothing can be separated."""


def detection_course(key: str, rows: Sequence[Row], marks: Sequence[EventMark] = ()) -> Chart:
    """Rows of `detect`, in order."""
    order = order_windows(rows)
    height = [math.log10(max(r.number("statistic") / r.number("threshold"), SMALLEST)) for r in rows]
    layers = []
    for colour, (word, name) in enumerate((("healthy", "below the threshold"), ("fault", "alarm"))):
        mine = [k for k, row in enumerate(rows) if row.text("verdict") == word]
        if mine:
            layers.append(
                Points(
                    name,
                    [order.x[k] for k in mine],
                    [height[k] for k in mine],
                    colour,
                    origins=[rows[k].origin for k in mine],
                )
            )
    alarms = sum(row.text("verdict") == "fault" for row in rows)
    silent = sum(row.text("verdict") == "no verdict" for row in rows)
    caption = f"{alarms} of {len(rows)} windows depart from nominal." + (
        f" {silent} have no verdict and are not drawn." if silent else ""
    )
    return Chart(
        key,
        "Does it depart from nominal?",
        order.axis,
        Axis("statistic over threshold, powers of ten"),
        layers,
        ChartTable(COLUMNS, [_cells(row) for row in rows], [row.origin for row in rows]),
        caption,
        marks,
        [ReferenceLine(0.0, "threshold")],
    )


def _cells(row: Row) -> tuple[str | float | int, ...]:
    return (
        row.text("flight") or row.window,
        row.text("verdict") + (f": {row.text('reason')}" if row.text("reason") else ""),
        row.number("statistic"),
        row.number("threshold"),
        row.number("p_value"),
        row.number("fit"),
        row.count("judged"),
    )


@dataclass(frozen=True)
class PredictedAnswer:
    """What would explain a window: in words, its probability (NaN: not known), and the deviation of each reading that
    it foretells, in the reading's unit."""

    words: str
    probability: float
    predicted: Sequence[float]


@dataclass(frozen=True)
class Deviations:
    """Of one window: `readings` in words with their `units`, how far each is off nominal, and the standard error."""

    window: str
    readings: Sequence[str]
    units: Sequence[str]
    deviation: Sequence[float]
    error: Sequence[float]
    origin: RowOrigin


def fingerprint(key: str, found: Deviations, answers: Sequence[PredictedAnswer]) -> Chart:
    """In standard errors, which all readings share; the table has units."""
    names = list(found.readings)
    rows = range(len(names))
    score = [_ratio(d, e) for d, e in zip(found.deviation, found.error, strict=True)]
    low, high = [s - NORMAL_95 for s in score], [s + NORMAL_95 for s in score]
    places = [found.origin] * len(names)
    layers: list[Bars | Intervals] = []
    thick = 0.7 / max(len(answers), 1)
    told = [
        answer.words + ("" if math.isnan(answer.probability) else f" ({probability(answer.probability)})")
        for answer in answers
    ]
    foretold = [[_ratio(v, e) for v, e in zip(a.predicted, found.error, strict=True)] for a in answers]
    for k, (words, values) in enumerate(zip(told, foretold, strict=True)):
        shift = thick * (k - (len(answers) - 1) / 2)
        layers.append(Bars(words, list(rows), values, k + 1, shift, thick * 0.9, places))
    layers.append(Intervals("measured, with 95 % interval", score, list(rows), low, high, 0, True, places))
    columns = [
        ChartColumn("reading"),
        ChartColumn("unit"),
        ChartColumn("measured"),
        ChartColumn("95 % ±"),
        ChartColumn("in standard errors"),
        *(ChartColumn(f"foretold by {words}") for words in told),
    ]
    cells: list[Sequence[Value]] = [
        (
            names[k],
            found.units[k],
            found.deviation[k],
            NORMAL_95 * found.error[k],
            score[k],
            *(a.predicted[k] for a in answers),
        )
        for k in rows
    ]
    return Chart(
        key,
        f"Fingerprint of {found.window}",
        Axis("deviation from nominal in standard errors"),
        Axis("", categories=names),
        layers,
        ChartTable(columns, cells, places),
        "Dots: how far the mean of each reading is from the nominal engine, once what is uncertain about nominal is "
        "allowed for. Bars: what each answer would do to it. An answer fits where its bars end in the dots' intervals.",
    )


def _ratio(value: float, error: float) -> float:
    return value / error if error > 0 else math.nan


MOST_RIVALS = 2
"""Answers beside the first in a fingerprint: the eye does not separate more bars."""

Answers = Sequence[tuple[tuple[str, ...], float]]
"""Sets of parameters with their probabilities, the leading one first."""


def window_fingerprint(
    key: str, window: WindowStatistics, origin: RowOrigin, answers: Answers, known: Mapping[str, Parameter]
) -> Chart | None:
    """Of the answers that differ in what they predict, the leading ones. None where the statistics hold no error of any
    sensor."""
    statistics = window.statistics
    shown = [a for a in answers if statistics is not None and a[0] and set(a[0]) <= set(statistics.parameters)]
    found = None if statistics is None else isolation_fingerprint(statistics, [names for names, _ in shown])
    if found is None or statistics is None:
        return None
    kept: list[int] = []
    for k, values in enumerate(found.predicted):
        apart = [np.max(np.abs(values - found.predicted[other]) / found.error) for other in kept]
        if len(kept) <= MOST_RIVALS and all(a > 1.0 for a in apart):  # less than a standard error is no difference
            kept.append(k)
    shown, predicted = [shown[k] for k in kept], found.predicted[kept]
    meaning = statistics.meaning
    sensors = [meaning[name].part.removesuffix(" sensor") for name in found.biases]
    units = [meaning[name].shown_unit for name in found.biases]
    lines = f"{window.source}, lines {window.first_line} to {window.last_line}"
    name = f"flight {window.flight}" if window.flight else lines
    told = [
        PredictedAnswer(listed([p.words for p in meanings(known, names).values()]), chance, list(values))
        for (names, chance), values in zip(shown, predicted.tolist(), strict=True)
    ]
    deviations = Deviations(name, sensors, units, found.deviation.tolist(), found.error.tolist(), origin)
    return fingerprint(key, deviations, told)


MOST_POINTS, SENSORS = 2000, 3
"""Points of a chart: more only make it slow; and readings, of which more cover each other."""
HOUR = 3600.0
"""Seconds."""


def residual_course(key: str, records: ResidualRecords) -> Chart:
    """Every record, or every so manieth where there are too many."""
    names = records.farthest(SENSORS)
    step = every(len(records) * len(names), MOST_POINTS)
    kept = list(range(0, len(records), step))
    timed = bool(len(records)) and bool(np.all(np.isfinite(records.time_s)) and np.all(np.diff(records.time_s) >= 0))
    x = records.time_s / HOUR if timed else np.arange(1.0, len(records) + 1)
    layers: list[Layer] = []
    columns = [ChartColumn("time", "h") if timed else ChartColumn("record")]
    for colour, name in enumerate(names):
        quantity, unit = split_column(name)
        values = records.sigmas[name]
        shown = [k for k in kept if np.isfinite(values[k])]
        places = [records.origin(k) for k in shown]
        layers.append(
            Points(quantity, [float(x[k]) for k in shown], [float(values[k]) for k in shown], colour, True, places)
        )
        columns += [ChartColumn(f"{quantity}, standard deviations"), ChartColumn(quantity, unit)]
    cells = [
        [float(x[k]), *(float(v[name][k]) for name in names for v in (records.sigmas, records.residual))] for k in kept
    ]
    origins = [records.origin(k) for k in kept]
    axis = Axis("time", "h") if timed else Axis("record, counted")
    return Chart(
        key,
        "Residuals over time",
        axis,
        Axis("measured − nominal, standard deviations"),
        layers,
        ChartTable(columns, cells, origins),
        f"Measured minus nominal, of the {len(names)} readings that are farthest off at the end.",
        levels=[ReferenceLine(2.0, ""), ReferenceLine(-2.0, "")],
        thinned=f"One record in {step} is drawn, of {len(records):,}." if step > 1 else "",
    )


BINS, FEWEST = 10, 5
"""Groups of records along a driver, equally many in each; and records of one that still has a middle half."""
VARIES = 1e-9
"""Relative range below which a driver stands still."""
APART = 0.12
"""Share of the distance of two groups by which series are moved apart."""


def residual_drivers(key: str, records: ResidualRecords, which: str) -> list[Chart]:
    """One chart for each input that varies; which: the records that these are, in words."""
    return [
        _chart(f"{key}-{number}", records, driver, which)
        for number, driver in enumerate(d for d, values in records.inputs.items() if _varies(values))
    ]


def _varies(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return known.size > BINS * FEWEST and float(np.ptp(known)) > VARIES * (1.0 + float(np.abs(known).max()))


def _chart(key: str, records: ResidualRecords, driver: str, which: str) -> Chart:
    quantity, unit = split_column(driver)
    values = records.inputs[driver]
    edges = np.unique(np.nanquantile(values, np.linspace(0.0, 1.0, BINS + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    apart = APART * float(np.median(np.diff(edges)))
    layers: list[Layer] = []
    cells = []
    for colour, name in enumerate(records.farthest(SENSORS)):
        words, _ = split_column(name)
        x, y, low, high = [], [], [], []
        for number in range(len(edges) - 1):
            mine = (place == number) & np.isfinite(values) & np.isfinite(records.sigmas[name])
            if mine.sum() < FEWEST:
                continue
            quarter, median, three = np.quantile(records.sigmas[name][mine], [0.25, 0.5, 0.75]).tolist()
            middle = float(np.median(values[mine]))
            x.append(middle + apart * (colour - 1))
            y.append(median)
            low.append(quarter)
            high.append(three)
            cells.append((words, middle, int(mine.sum()), median, quarter, three))
        layers.append(Intervals(words, x, y, low, high, colour))
    columns = chart_columns(
        "reading", (f"{quantity}, middle", unit), "records", "median", "a quarter lies below", "a quarter lies above"
    )
    return Chart(
        key,
        f"Residuals over {quantity.replace('_', ' ')}",
        Axis(quantity, unit),
        Axis("residual, standard deviations"),
        layers,
        ChartTable(columns, cells),
        f"Medians of equally many records each; the bars hold the middle half. Counted is every record {which}.",
    )


def sensors_health(
    key: str, records: ResidualRecords, wrong: Mapping[str, float], masked: Mapping[str, int] | None = None
) -> Chart:
    """wrong: by sensor column, the probability that it reads wrong, where it is known; masked: readings masked."""
    names = list(records.sigmas)
    stretches = [mine for _, mine in records.stretches()]
    scatter = [_scatter(records.sigmas[name], stretches) for name in names]
    last = stretches[-1]
    rows = []
    for name, ratio in zip(names, scatter, strict=True):
        quantity, unit = split_column(name)
        present = int(np.isfinite(records.sigmas[name]).sum())
        rows.append(
            (
                quantity,
                ratio,
                finite_mean(records.sigmas[name][last]),
                finite_mean(records.residual[name][last]),
                unit,
                wrong.get(name, math.nan),
                len(records) - present,
                (masked or {}).get(name, 0),
            )
        )
    shown = [
        f"{q}: reads wrong ({probability(wrong[n])})" if wrong.get(n, 0.0) >= LIKELY else q
        for n, (q, *_) in zip(names, rows, strict=True)
    ]
    columns = chart_columns(
        "reading",
        "scatter over identified noise",
        "mean residual of the last stretch, standard deviations",
        "mean residual",
        "unit",
        "probability that it reads wrong",
        "records without residual",
        "readings masked",
    )
    return Chart(
        key,
        "Health of the instruments",
        Axis("scatter about the mean of its flight, over the noise identified"),
        Axis("", categories=shown),
        [Points("", scatter, list(range(len(names))), 0)],
        ChartTable(columns, rows),
        _instrument_words(wrong)
        + "An instrument that scatters as it did when it was identified is at 1. A failing one "
        "scatters more, a stuck one less; so does one that sees what the model lacks.",
        [EventMark(1.0, "as identified")],
    )


LIKELY = 0.5
"""Probability from which an instrument is reported as wrong."""


def _instrument_words(wrong: Mapping[str, float]) -> str:
    found = [split_column(column)[0] for column, p in wrong.items() if p >= LIKELY]
    if found:
        return f"{listed(found)} probably {'reads' if len(found) == 1 else 'read'} wrong. "
    return "None of them reads wrong by the series. " if wrong else ""


def _scatter(values: np.ndarray, stretches: list[np.ndarray]) -> float:
    """Root of the mean square about the mean of each stretch."""
    parts = [values[mine][np.isfinite(values[mine])] for mine in stretches]
    parts = [part - part.mean() for part in parts if part.size > 1]
    joined = np.concatenate(parts) if parts else np.zeros(0)
    freedoms = sum(part.size - 1 for part in parts)
    return float(math.sqrt(float(joined @ joined) / freedoms)) if freedoms else math.nan


LOW_M, CRUISE, FULL = 600.0, 0.9, 0.9
"""A take-off is recorded up to so many metres above the lowest point of a flight; a cruise above that share of its
height; full power above that share of the flight's most. Judgement."""
Chosen = Callable[[np.ndarray], np.ndarray]

SNAPSHOTS_FEWEST, SNAPSHOTS_SENSORS = 3, 4
"""Records of a snapshot; readings of a chart."""


def snapshots(key: str, records: ResidualRecords) -> list[Chart]:
    """Take-off and cruise of engines that fly, full load of those that stand; none where neither is known."""
    if not records.power:
        return []
    power = records.inputs[records.power]
    stretches = records.stretches()
    if records.altitude:
        height = records.inputs[records.altitude]
        kinds: dict[str, Chosen] = {"take-off": _take_off(height, power), "cruise": _cruise(height)}
    else:
        kinds = {"full load": lambda mine: mine[power[mine] >= FULL * np.nanmax(power[mine])]}
    charts = []
    for name, chosen in kinds.items():
        found = [(stretch, chosen(mine)) for stretch, mine in stretches]
        kept = [(stretch, mine) for stretch, mine in found if len(mine) >= SNAPSHOTS_FEWEST]
        if len(kept) > 1:
            charts.append(_snapshots_chart(f"{key}-{name.replace(' ', '-')}", name, records, kept))
    return charts


def _take_off(height: np.ndarray, power: np.ndarray) -> Chosen:
    def chosen(mine: np.ndarray) -> np.ndarray:
        low = mine[height[mine] <= np.nanmin(height[mine]) + LOW_M]
        return low[power[low] >= FULL * np.nanmax(power[mine])] if len(low) else low

    return chosen


def _cruise(height: np.ndarray) -> Chosen:
    def chosen(mine: np.ndarray) -> np.ndarray:
        low, high = np.nanmin(height[mine]), np.nanmax(height[mine])
        return mine[height[mine] >= low + CRUISE * (high - low)] if high > low else mine[:0]

    return chosen


def _snapshots_chart(key: str, name: str, records: ResidualRecords, kept: list[tuple[str, np.ndarray]]) -> Chart:
    rows = [Row({"flight": records.flights[mine[0]]}, records.origin(int(mine[0]))) for _, mine in kept]
    order = order_windows(rows)
    layers: list[Layer] = []
    cells, origins = [], []
    for colour, sensor in enumerate(records.farthest(SNAPSHOTS_SENSORS)):
        quantity, unit = split_column(sensor)
        mean, low, high = [], [], []
        for (stretch, mine), row in zip(kept, rows, strict=True):
            values = records.sigmas[sensor][mine]
            raw = records.residual[sensor][mine]
            known = np.isfinite(values)
            quarter, middle, three = (
                np.quantile(values[known], [0.25, 0.5, 0.75]).tolist() if known.any() else [np.nan] * 3
            )
            mean.append(middle)
            low.append(quarter)
            high.append(three)
            told = float(np.median(raw[known])) if known.any() else None
            cells.append((stretch, quantity, int(known.sum()), middle, told, unit))
            origins.append(row.origin)
        layers.append(Intervals(quantity, [x + 0.05 * (colour - 1.5) for x in order.x], mean, low, high, colour))
    columns = chart_columns(
        "flight", "reading", "records", "median residual, standard deviations", "median residual", "unit"
    )
    rules = {
        "take-off": f"within {LOW_M:g} m of the lowest record, at {FULL:.0%} of the most power or above",
        "cruise": f"above {CRUISE:.0%} of the flight's height",
        "full load": f"at {FULL:.0%} of the most power or above",
    }
    return Chart(
        key,
        f"Snapshots: {name}",
        order.axis,
        Axis("residual, standard deviations"),
        layers,
        ChartTable(columns, cells, origins),
        f"Median residual of each flight's records {rules[name].replace('%', ' %')}; the bars hold the middle half. "
        "The line named is that of the first record.",
    )


SEVERITY = {"": 0, CAUTION: 1, WARNING: 2}
"""Levels in rising order."""


@dataclass(frozen=True)
class DeltaCourse:
    """One delta of one engine, its rows in the order of flights."""

    rows: Sequence[Row]

    @property
    def name(self) -> str:
        return f"Δ{self.rows[0].text('name')}"

    @property
    def unit(self) -> str:
        return self.rows[0].text("unit")

    @property
    def has_levels(self) -> bool:
        """Whether alert levels of it are stated."""
        return any(self.rows[0].text(name) for name in ALERT_LEVELS)

    @property
    def level(self) -> str:
        """Level at the last flight: "", caution or warning."""
        return self.rows[-1].text("level")

    @property
    def size(self) -> str:
        """Smoothed delta at the last flight, for instance "+12 °C ± 2 °C"."""
        last = self.rows[-1]
        half = (last.number("smoothed_high") - last.number("smoothed_low")) / 2
        value = last.number("smoothed")
        return f"{'+' if value > 0 else ''}{format_quantity(value, self.unit, half)}".replace("-", "−")

    def flight_words(self, number: int) -> str:
        """A flight, counted from 1, with its date where there is one."""
        row = next((row for row in self.rows if row.count("number") == number), None)
        if row is None:
            return f"flight number {number}"
        name = f"flight {row.text('flight')}" if row.text("flight") else f"flight number {number}"
        return f"{name} ({row.text('date')})" if row.text("date") else name

    @property
    def alert(self) -> str:
        """That it is beyond a level, since when, and how large it is; "" where it is not."""
        if not self.level:
            return ""
        return f"{self.name} {self.level} since {self.flight_words(self.rows[-1].count('since'))}, now {self.size}"

    @property
    def past_alert(self) -> str:
        """That it was beyond a level and is not any more; "" where that is not so."""
        beyond = [row for row in self.rows if row.text("level")]
        if self.level or not beyond:
            return ""
        most = max((row.text("level") for row in beyond), key=SEVERITY.__getitem__)
        last = self.flight_words(beyond[-1].count("number"))
        return f"{self.name} was beyond its {most} level until {last}, and is not now ({self.size})"


def delta_courses(rows: Sequence[Row]) -> list[DeltaCourse]:
    """Deltas of one engine, those with levels first, temperatures before others."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.text("column"), []).append(row)
    courses = [DeltaCourse(mine) for mine in found.values() if any(math.isfinite(r.number("delta")) for r in mine)]
    return sorted(courses, key=lambda course: (not course.has_levels, course.unit != "°C"))


def alert_words(rows: Sequence[Row]) -> list[str]:
    """Deltas of one engine that are beyond a level at the last flight, the worst first."""
    courses = sorted(delta_courses(rows), key=lambda course: -SEVERITY[course.level])
    return [course.alert for course in courses if course.alert]


def level_words(rows: Sequence[Row]) -> str:
    """What the levels say of all deltas of one engine, in a sentence; "" where none is stated."""
    courses = [course for course in delta_courses(rows) if course.has_levels]
    if not courses:
        return ""
    told = [*alert_words(rows), *(course.past_alert for course in courses if course.past_alert)]
    names = listed([course.name for course in courses])
    return f"{'; '.join(told)}." if told else f"{names} {'are' if len(courses) > 1 else 'is'} within the alert levels."


def delta_chart(key: str, course: DeltaCourse, whose: str = "") -> Chart:
    """A delta over flights, with levels, maintenance and alerts; whose: engine, where several are drawn."""
    rows, first = course.rows, course.rows[0]
    order = order_windows(rows)
    delta, low, high, smoothed = ([row.number(name) for row in rows] for name in ("delta", "low", "high", "smoothed"))
    origins = [row.origin for row in rows]
    dots = Intervals("flight, with 95 % interval", order.x, delta, low, high, origins=origins)
    words = f"smoothed over {first.number('smoothing_flights'):g} flights, with 95 % band"
    columns = chart_columns(
        *("number", "flight", "date"),
        *((name, course.unit) for name in ("delta", "smoothed", "95 % from", "to")),
        "level",
    )
    cells = [
        (row.count("number"), row.text("flight"), row.text("date"), d, s, *_band(row), row.text("level"))
        for row, d, s in zip(rows, delta, smoothed, strict=True)
    ]
    lines = [ReferenceLine(first.number(name), name.split("_")[0]) for name in ALERT_LEVELS if first.text(name)]
    setting = f" at equal {split_column(first.text('setting'))[0]}" if first.text("setting") else ""
    return Chart(
        key,
        f"{course.name}{whose}{setting}",
        order.axis,
        Axis(course.name, course.unit),
        [dots, *_smoothed_layers(rows, order.x, words)],
        ChartTable(columns, cells, origins),
        "Dots: mean over a flight of reading minus prediction. Line: exponentially weighted mean, begun anew after "
        "maintenance.",
        list(_marks(rows, order.x)),
        [ReferenceLine(0.0, "nominal"), *lines],
    )


def _band(row: Row) -> tuple[float, float]:
    return row.number("smoothed_low"), row.number("smoothed_high")


def _smoothed_layers(rows: Sequence[Row], x: Sequence[float], words: str) -> Iterator[Layer]:
    """The line with its band, interrupted where smoothing begins anew."""
    begun = [0, *(k for k, row in enumerate(rows) if k and row.flag("maintenance")), len(rows)]
    for first, last in pairwise(begun):
        part = rows[first:last]
        low, high = zip(*map(_band, part), strict=True)
        yield Band("", x[first:last], low, high, colour=1)
        yield Line(words if not first else "", x[first:last], [row.number("smoothed") for row in part], colour=1)


def _marks(rows: Sequence[Row], x: Sequence[float]) -> Iterator[EventMark]:
    """Maintenance, and where a level is passed."""
    before = ""
    for row, place in zip(rows, x, strict=True):
        if row.flag("maintenance"):
            yield EventMark(place, "maintenance")
        level = row.text("level")
        if level and level != before:
            yield EventMark(place, level)
        before = level


def leading_delta(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of all rows of `trend --what deltas` one delta of one engine: that of the worst level, else the first that has
    levels, else the last temperature. Raises NoVerdictError where no flight has one."""
    engines: dict[str, list[Row]] = {}
    for cells in rows:
        row = Row(cells, RowOrigin(str(cells.get("source") or ""), str(cells.get("flight") or "")))
        engines.setdefault(row.text("engine"), []).append(row)
    every = [(engine, course) for engine, mine in engines.items() for course in delta_courses(mine)]
    if not every:
        raise NoVerdictError("--picture: no flight has deltas that could be drawn")
    hot = [entry for entry in every if entry[1].unit == "°C"]
    ordered = [*(entry for entry in every if entry[1].has_levels), *reversed(hot), *every]
    engine, course = max(ordered, key=lambda entry: SEVERITY[entry[1].level])
    return delta_chart("deltas", course, f" of engine {engine}" if engine else "")
