"""What is concealed in a trial of isolation: drawn from the trial's own seed, never shown to who isolates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.trials.blind.flights import draw_flights
from enginediag_cli.trials.blind.sealed import SIZE, draw_health, stream
from enginediag_cli.trials.blind.truths.instruments import input_spread
from enginediag_cli.trials.blind.truths.realistic import Realistic, draw_realistic
from enginediag_cli.trials.blind.visible import SELDOM, drawable, weights
from enginediag_cli.trials.isolated import kinds

FAULT = (0.003, 0.03)
"""Relative change of a component's parameter, from and to, on a logarithmic scale."""
SENSOR = (3.0, 30.0)
"""Error of an output sensor over its noise, from and to, on a logarithmic scale: from what the mean of a flight shows
to what is seen at a glance."""
INPUT = (4.0, 20.0)
"""Error of an input channel over what such channels differ by from flight to flight."""
TOGETHER = (2, 3)
"""Changes at once, from and to, in trials with several."""
SENSOR_AMONG = 0.2
"""Chance that one of several changes is of an output sensor."""
TRIAL_STREAM, TRUTH_STREAM = 10, 11
"""Streams of random numbers that no other trials use."""


@dataclass(frozen=True)
class Change:
    """One thing that is wrong in the flight to be judged. `place`: the parameter's name, `reading` and column of an
    instrument, or the effect's label; `size`: in the parameter's unit, the column's unit, or the share of the reading
    where `share`; `instrument`: it is an instrument's error."""

    place: str
    size: float
    share: bool = False
    instrument: bool = False

    def as_json(self) -> dict[str, Any]:
        return {"place": self.place, "size": self.size, "share": self.share}


@dataclass(frozen=True)
class Sealed:
    """The answer of a trial. `flights`: inputs of every flight, the last one to be judged and the others healthy;
    `values`: coefficients of `effects` in that last one; `realistic`: what else is wrong, None where nothing is."""

    trial: int
    truth: str
    kind: str
    health: Mapping[str, float]
    changes: tuple[Change, ...]
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    flights: Sequence[Mapping[str, np.ndarray]]
    realistic: Realistic | None
    noise_seed: int


def reading(column: str) -> str:
    """The place of an instrument's error."""
    return f"reading {column}"


def draw(engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str]) -> Sealed:
    """Trial number `trial` of a seed, of one of these truths and kinds."""
    rng = stream(seed, trial, TRIAL_STREAM)
    truth = str(rng.choice(list(truths)))
    share = np.array([kinds.WEIGHTS[k] for k in chosen], float)
    kind = str(rng.choice(list(chosen), p=share / share.sum()))
    health = draw_health(engine, rng)
    flights, training = draw_flights(engine, rng)
    flights = flights[: training + 1]
    own = stream(seed, trial, TRUTH_STREAM)
    realistic = draw_realistic(engine, len(flights), own) if truth == kinds.REALISTIC else None
    sensors = realistic.sensors if realistic else tuple(engine.sensors)
    effects, values = _physics(engine, rng) if kind == kinds.PHYSICS else ((), {})
    changes = [Change(e.label, 0.0) for e in effects]
    changes += _changes(engine, kind, sensors, rng)
    return Sealed(
        trial, truth, kind, health, tuple(changes), effects, values, flights, realistic, int(rng.integers(2**62))
    )


def _changes(engine: Engine, kind: str, sensors: Sequence[str], rng: np.random.Generator) -> list[Change]:
    if kind == kinds.COMPONENT:
        return _of_components(engine, 1, rng)
    if kind == kinds.OUTPUT_SENSOR:
        return [_of_sensor(engine, sensors, rng)]
    if kind == kinds.INPUT_CHANNEL:
        return [_of_input(engine, rng)]
    if kind == kinds.SEVERAL:
        count = int(rng.integers(TOGETHER[0], TOGETHER[1] + 1))
        wrong = [_of_sensor(engine, sensors, rng)] if rng.random() < SENSOR_AMONG else []
        return [*_of_components(engine, count - len(wrong), rng), *wrong]
    return []


def _log_uniform(of: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(of))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _of_components(engine: Engine, count: int, rng: np.random.Generator) -> list[Change]:
    """Changes of monitored parameters; what only wears never gets better."""
    found = []
    for name in rng.choice(list(engine.monitored), count, replace=False):
        p = engine.parameters[str(name)]
        size, sign = _log_uniform(FAULT, rng), _sign(rng)
        found.append(Change(p.name, (p.wear or sign) * size * (abs(p.nominal) or 1.0)))
    return found


def _of_sensor(engine: Engine, sensors: Sequence[str], rng: np.random.Generator) -> Change:
    column = str(rng.choice(list(sensors)))
    return Change(
        reading(column), _sign(rng) * _log_uniform(SENSOR, rng) * engine.sensors[column].noise_sigma, instrument=True
    )


def _of_input(engine: Engine, rng: np.random.Generator) -> Change:
    column = str(rng.choice(list(engine.inputs)))
    scale, bias = input_spread(column)
    return Change(
        reading(column), _sign(rng) * _log_uniform(INPUT, rng) * (scale or bias), bool(scale), instrument=True
    )


def _physics(engine: Engine, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """An effect that flights show, at a size that engines have: no fault, and nothing that isolation knows."""
    weight = weights(engine.path, SIZE[1])
    library = [e for e in drawable(engine) if weight[e.label] > SELDOM]
    e = library[int(rng.integers(len(library)))]
    values = {}
    for c in e.term.amplitudes():
        value = c.absent + rng.uniform(*SIZE) * (c.typical - c.absent)
        values[e.parameter_name(c.name)] = float(np.clip(value, c.lower, c.upper))
    return (e,), values
