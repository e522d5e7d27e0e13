"""What is known of an engine by serial number: its flights in order, and what maintenance did to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

from enginediag_cli.detection.trend_of_files import Stretch

KINDS = ("wash", "overhaul", "exchange")
"""Of maintenance: a compressor wash; an overhaul of the engine, or of the component that is named; its exchange."""


@dataclass(frozen=True)
class Event:
    """Maintenance of an engine. kind: one of KINDS. `flight`: the first flight after it, or `time_s`: when it was; one
    of both. component: what it was done to, "" for the whole engine."""

    engine: str
    kind: str
    flight: str = ""
    time_s: float = nan
    component: str = ""


@dataclass(frozen=True)
class EngineHistory:
    """One engine by serial number. stretches: one per flight, in order; baseline: how many of the first of them are
    believed healthy."""

    serial: str
    build: str
    stretches: Sequence[Stretch]
    baseline: int
    events: Sequence[Event] = ()
