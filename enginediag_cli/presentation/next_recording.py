"""What to record next to tell an answer from its leading rival, in sentences."""

from __future__ import annotations

from math import isfinite

from enginediag_cli.isolation.of_windows import NextRecording
from enginediag_cli.presentation.names import listed, told
from enginediag_cli.presentation.plans import suggestion
from enginediag_cli.presentation.sentences import further_records

FLIGHTS = 2
"""Whole flights that are told: the best, and one of another kind to choose instead."""


def next_recording(found: NextRecording | None) -> list[str]:
    """The rivals, then the best operating conditions, sensors and whole flights (between all leading sets), with the
    records that each takes; empty where the answer has no rival."""
    if found is None:
        return []
    words = [listed(told(found.known, names)) or "no change" for names in found.rivals]
    lines = [f"to tell {words[0]} from {words[1]}:"]
    for one in found.conditions:
        where = ", ".join(f"{column} {value:.4g}" for column, value in one.values.items())
        unseen = "" if one.known else " (beyond the operating points identified)"
        lines.append(f"{further_records(f'at {where}', one.records, one.odds, one.noncentrality)}{unseen}")
    for one in found.sensors or ():
        where = f"with {one.label}" if one.values else "like these"
        lines.append(further_records(where, one.records, one.odds, one.noncentrality))
    useful = [one for one in found.flights if isfinite(one.records)]
    lines += [f"a whole flight: {suggestion(one)}" for one in useful[:FLIGHTS]]
    if found.flights and not useful:
        lines.append("no whole flight of those tried would tell all of them apart")
    return lines
