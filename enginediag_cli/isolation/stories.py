"""What has happened to each engine of several: its own series judged, engines side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from enginediag_cli.detection.glr import glr_test
from enginediag_cli.detection.trend_of_files import FEWEST, Series, Stretch
from enginediag_cli.isolation.over_time import TrendOptions, epochs_of, judge_series
from enginediag_cli.isolation.story import Story
from enginediag_cli.progress import each
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.side_by_side import in_turn

GROSS = 1e-4
"""Chance of one flight among all of a healthy series to count as one that differs from nominal for certain."""


def departures(stretches: Sequence[Stretch]) -> tuple[int, ...]:
    """Numbers, from 1, of the flights that differ from nominal for certain, each by itself."""
    found = []
    for number, stretch in enumerate(stretches, start=1):
        score = fisher_score(stretch.statistics.without(stretch.window.silent))
        if glr_test(score, GROSS / len(stretches)).alarm:
            found.append(number)
    return tuple(found)


def stories_of(
    series: Series, *, reference: int = 0, sensors: bool = True, generic: bool = True, against_nominal: bool = False
) -> Iterator[tuple[str, Story]]:
    """Engine and story, of those that have flights enough, in their order. reference: records of an engine in the
    first of which nothing began; sensors, generic: as of `TrendOptions`; against_nominal: the statistics hold what is
    uncertain about nominal, too, so that each flight can be tested by itself. Raises DataError."""
    engines = [engine for engine, stretches in series.stretches.items() if len(stretches) >= FEWEST]
    most = epochs_of(len(series.stretches))

    def judged(k: int) -> Story:
        options = TrendOptions(
            healthy=series.healthy(engines[k], reference), sensors=sensors, generic=generic, governed=series.governed
        )
        story = judge_series(series.readings(engines[k]).joined(most), series.known, options)
        return replace(story, departures=departures(series.stretches[engines[k]])) if against_nominal else story

    stories = zip(engines, in_turn(judged, len(engines)), strict=True)
    return each(stories, "engines judged", len(engines))
