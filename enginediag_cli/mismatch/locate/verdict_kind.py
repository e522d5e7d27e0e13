"""What kind of mismatch a map shows: a sensor, a fault, an effect, a switch.

- A *sensor error* touches one reading and no balance: the sensor's own cells beat all others.
- A *fault* begins at some record and stays; an effect comes and goes with its driver.
- An *effect* is common to the engines of a fleet when one coefficient serves them all.
- What *switches*, or varies with something that no column records, has an amplitude in every record that is far
  likelier than any curve along a recorded driver.
A part of one engine that is worn is none of these: it is constant, and identification takes it up (`fleet`).
"""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.drivers import SWITCH as RECORDED_SWITCH
from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.locate.fleet import LEAST_ENGINES, Difference, PerEngine, differences, per_engine
from enginediag_cli.mismatch.locate.locate import Located, Place
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding

NOTHING = "nothing"
UNLOCATED = "not located"
SENSOR_ERROR = "sensor error"
SENSOR_FAULT = "sensor fault"
FAULT = "fault"
EFFECT = "effect"
COMMON_EFFECT = "effect common to all engines"
ONE_ENGINE = "effect that differs between engines"
SWITCH = "effect that switches"
UNRECORDED = "effect of an unrecorded driver"
NO_VERDICT = "did not converge"

AGREE = 0.01
"""Engines do not share a coefficient when the p of that is below this."""


@dataclass(frozen=True)
class Kind:
    """`names`: the kinds that the places within reach are of, the first place's first; `engines`: the first place
    fitted to each engine (None for one engine); `worn`: the engine that stands out of its fleet, where nothing is
    missing, or what is missing has a place; `hidden`: the finding that beats the map, if one does."""

    names: tuple[str, ...]
    engines: PerEngine | None = None
    worn: tuple[Difference, ...] = ()
    hidden: HiddenFinding | None = None

    @property
    def certain(self) -> bool:
        return len(self.names) == 1


def classify_verdict(located: Located) -> Kind:
    """Judge a map."""
    if not located.converged or located.projection is None or located.presence is None:
        return Kind((NO_VERDICT,))
    if not located.mismatch:
        return Kind((NOTHING,), worn=_worn(located.projection, located.presence.false_alarm))
    hidden = hidden_beats_map(located)
    if hidden is not None:
        return Kind((SWITCH if hidden.is_switch else UNRECORDED,), hidden=hidden)
    within = located.within
    if not within:
        return Kind((UNLOCATED,))
    engines = per_engine(located.projection, within[0].cell)
    names = dict.fromkeys(_kind(p, engines) for p in within)
    several = len(located.found.evidence.engines) >= LEAST_ENGINES
    taken_up = located.carrying(within[0].cell) if several else None
    worn = () if taken_up is None else _worn(taken_up, located.presence.false_alarm)
    return Kind(tuple(names), engines, worn)


def _worn(projection: Projection, false_alarm: float) -> tuple[Difference, ...]:
    """The engine that stands out of its fleet at a fit that lacks nothing: what flights show besides, each engine in
    flights of its own, would pass for differences between engines."""
    return tuple(d for d in differences(projection)[:1] if d.p <= false_alarm)


def hidden_beats_map(located: Located) -> HiddenFinding | None:
    """The likeliest amplitude without a driver, when its ln likelihood ratio exceeds that of the best curve, T/2."""
    if not located.hidden:
        return None
    best = max((p.statistic for p in located.within), default=0.0)
    first = located.hidden[0]
    return first if first.lr > 0.5 * best else None


def _kind(place: Place, engines: PerEngine | None) -> str:
    sensor = place.cell.location.belongs_to_sensor
    if place.cell.driver.driver == TIME:
        return SENSOR_FAULT if sensor else FAULT
    if sensor:
        return SENSOR_ERROR
    if place.cell.driver.driver == RECORDED_SWITCH:
        return SWITCH
    if engines is None:
        return EFFECT
    return COMMON_EFFECT if engines.p >= AGREE else ONE_ENGINE
