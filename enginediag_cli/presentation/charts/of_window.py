"""The fingerprint of a window, from its statistics and the answers that explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from enginediag_cli.isolation.fingerprint import fingerprint
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.presentation.charts.fingerprint import Answer, Deviations
from enginediag_cli.presentation.charts.fingerprint import fingerprint as chart_of
from enginediag_cli.presentation.charts.model import Chart, Origin
from enginediag_cli.presentation.names import listed
from enginediag_cli.residuals.window import WindowStatistics

MOST_RIVALS = 2
"""Answers beside the first in a fingerprint: more bars are not told apart."""

Answers = Sequence[tuple[tuple[str, ...], float]]
"""Sets of parameters with their probabilities, the leading one first."""


def window_fingerprint(
    key: str, window: WindowStatistics, origin: Origin, answers: Answers, known: Mapping[str, Parameter]
) -> Chart | None:
    """None where the statistics hold no error of any sensor, or no parameter of an answer."""
    statistics = window.statistics
    shown = [answer for answer in answers[: MOST_RIVALS + 1] if answer[0]]
    found = None if statistics is None else fingerprint(statistics, [names for names, _ in shown])
    if found is None or statistics is None:
        return None
    meaning = statistics.meaning
    sensors = [meaning[name].part.removesuffix(" sensor") for name in found.biases]
    units = [meaning[name].shown_unit for name in found.biases]
    lines = f"{window.source}, lines {window.first_line} to {window.last_line}"
    name = f"flight {window.flight}" if window.flight else lines
    told = [
        Answer(listed([p.words for p in meanings(known, names).values()]), chance, list(values))
        for (names, chance), values in zip(shown, found.foretold.tolist(), strict=True)
    ]
    deviations = Deviations(name, sensors, units, found.deviation.tolist(), found.error.tolist(), origin)
    return chart_of(key, deviations, told)
