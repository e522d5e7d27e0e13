"""The fingerprint: how far each reading is off, beside what each leading answer would do to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.model import Axis, Bars, Chart, Column, Intervals, Origin, Table, Value


@dataclass(frozen=True)
class Answer:
    """What would explain a window: in words, its probability (NaN: not known), and the deviation of each reading that
    it foretells, in the reading's unit."""

    words: str
    probability: float
    foretold: Sequence[float]


@dataclass(frozen=True)
class Deviations:
    """Of one window: `readings` in words with their `units`, how far each is off nominal, and the standard error."""

    window: str
    readings: Sequence[str]
    units: Sequence[str]
    deviation: Sequence[float]
    error: Sequence[float]
    origin: Origin


def fingerprint(key: str, found: Deviations, answers: Sequence[Answer]) -> Chart:
    """In standard errors, which all readings share; the table has units."""
    from enginediag_cli.presentation.numbers import probability

    names = list(found.readings)
    rows = range(len(names))
    score = [_over(d, e) for d, e in zip(found.deviation, found.error, strict=True)]
    low, high = [s - NORMAL_95 for s in score], [s + NORMAL_95 for s in score]
    places = [found.origin] * len(names)
    layers: list[Bars | Intervals] = []
    thick = 0.7 / max(len(answers), 1)
    told = [
        answer.words + ("" if math.isnan(answer.probability) else f" ({probability(answer.probability)})")
        for answer in answers
    ]
    foretold = [[_over(v, e) for v, e in zip(a.foretold, found.error, strict=True)] for a in answers]
    for k, (words, values) in enumerate(zip(told, foretold, strict=True)):
        shift = thick * (k - (len(answers) - 1) / 2)
        layers.append(Bars(words, list(rows), values, k + 1, shift, thick * 0.9, places))
    layers.append(Intervals("measured, with 95 % interval", score, list(rows), low, high, 0, True, places))
    columns = [
        Column("reading"),
        Column("unit"),
        Column("measured"),
        Column("95 % ±"),
        Column("in standard errors"),
        *(Column(f"foretold by {words}") for words in told),
    ]
    cells: list[Sequence[Value]] = [
        (
            names[k],
            found.units[k],
            found.deviation[k],
            NORMAL_95 * found.error[k],
            score[k],
            *(a.foretold[k] for a in answers),
        )
        for k in rows
    ]
    return Chart(
        key,
        f"Fingerprint of {found.window}",
        Axis("deviation from nominal in standard errors"),
        Axis("", categories=names),
        layers,
        Table(columns, cells, places),
        "Dots: how far the mean of each reading is from the nominal engine, once what is uncertain about nominal is "
        "allowed for. Bars: what each answer would do to it. An answer fits where its bars end in the dots' intervals.",
    )


def _over(value: float, error: float) -> float:
    return value / error if error > 0 else math.nan
