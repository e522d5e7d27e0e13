"""What has happened to each engine of several: its own series judged, engines side by side."""

from __future__ import annotations

from collections.abc import Iterator

from enginediag_cli.detection.trend_of_files import FEWEST, Series
from enginediag_cli.isolation.over_time import TrendOptions, epochs_of, judge_series
from enginediag_cli.isolation.story import Story
from enginediag_cli.progress import each
from enginediag_cli.side_by_side import in_turn


def stories_of(
    series: Series, *, reference: int = 0, sensors: bool = True, generic: bool = True
) -> Iterator[tuple[str, Story]]:
    """Engine and story, of those that have flights enough, in their order. reference: records of an engine in the
    first of which nothing began; sensors, generic: as of `TrendOptions`. Raises DataError."""
    engines = [engine for engine, stretches in series.stretches.items() if len(stretches) >= FEWEST]
    most = epochs_of(len(series.stretches))

    def judged(k: int) -> Story:
        options = TrendOptions(
            healthy=series.healthy(engines[k], reference), sensors=sensors, generic=generic, governed=series.governed
        )
        return judge_series(series.readings(engines[k]).joined(most), series.known, options)

    stories = zip(engines, in_turn(judged, len(engines)), strict=True)
    return each(stories, "engines judged", len(engines))
