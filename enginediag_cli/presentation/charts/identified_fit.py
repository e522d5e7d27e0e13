"""How well an identified engine reproduces each reading, in standard deviations of the noise that was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from enginediag_cli.identification.quality import EVERYTHING, SensorQuality
from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Layer, Mark, Points, Table, Value
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.identification.identify import Identification


def identified_fit(key: str, result: Identification) -> Chart:
    """Records that were fitted, left out in turn, and held out, as far as there are."""
    sets = {
        "fitted": result.in_sample,
        "left out in turn": result.cross_validated,
        "held out": result.held_out,
    }
    names = [q.sensor for q in _of_all(result.in_sample)]
    layers: list[Layer] = []
    rows: list[Sequence[Value]] = []
    for colour, (words, qualities) in enumerate(sets.items()):
        mine = [q for q in _of_all(qualities) if q.sensor in names]
        if mine:
            places = [float(names.index(q.sensor)) for q in mine]
            layers.append(Points(words, [q.chi2**0.5 for q in mine], places, colour))
            rows += [(split_column(q.sensor)[0], words, q.chi2**0.5, q.rms, q.unit, q.n) for q in mine]
    columns = (
        Column("reading"),
        Column("records"),
        Column("RMS, standard deviations"),
        Column("RMS"),
        Column("unit"),
        Column("readings"),
    )
    return Chart(
        key,
        "What identification leaves of each reading",
        Axis("RMS of the residual in standard deviations of the noise"),
        Axis("", categories=[split_column(name)[0] for name in names]),
        layers,
        Table(columns, rows),
        "At 1 a reading is reproduced as well as its noise allows.",
        [Mark(1.0, "noise alone")],
    )


def _of_all(qualities: Sequence[SensorQuality]) -> list[SensorQuality]:
    return [q for q in qualities if q.regime == EVERYTHING and q.n]
