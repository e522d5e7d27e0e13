"""What is concealed in a trial of isolation, and its recordings as files.

Drawn from the trial's own seed, never shown to the process that isolates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import DataError
from enginediag_cli.simulation.flights import default_plan, generate_flights
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import SELDOM, draw_weights, drawable_effects, instrument_place, true_readings
from enginediag_cli.validation.concealed_effects import EFFECT_SIZE as SIZE
from enginediag_cli.validation.concealed_effects import copy_engine_file, draw_health, random_stream, write_recording
from enginediag_cli.validation.trial_flights import draw_flights, stack_flights
from enginediag_cli.validation.truth_instruments import (
    RealisticErrors,
    add_sensor_noise,
    draw_realistic,
    input_spread,
    realistic_engine,
)

FAULT = (0.003, 0.03)
"""Relative change of a component's parameter, from and to, on a logarithmic scale."""
SENSOR = (3.0, 30.0)
"""Error of an output sensor over its noise, from and to, on a logarithmic scale: from what the mean of a flight shows
to what is seen at a glance."""
INPUT = (4.0, 20.0)
"""Error of an input channel over what such channels differ by from flight to flight."""
TOGETHER = (2, 3)
"""Changes at once, from and to, in trials with several."""
FIELD_FAULT = (0.01, 0.03)
"""Relative change of a component's parameter, and error of an output sensor over its median reading, in the field: what
a shop visit or a check of the instrument confirms."""
FIELD_HEALTHY, FIELD_TOGETHER = 6, 2
"""Healthy flights that an engine is identified on, and changes at once in trials with several, in the field."""
FIELD_STEP_S, FIELD_EVERY = 10.0, 6
"""Points of a flight in the field are as close as lags and clocks ask for; every sixth is recorded, one a minute."""
SENSOR_AMONG = 0.2
"""Chance that one of several changes is of an output sensor."""
TRIAL_STREAM, TRUTH_STREAM, CHANGE_STREAM = 10, 11, 12
"""Streams of random numbers that no other trials use."""


@dataclass(frozen=True)
class ConcealedChange:
    """One thing that is wrong in the flight to be judged. `place`: the parameter's name, `reading` and column of an
    instrument, or the effect's label; `size`: in the parameter's unit, the column's unit, or the share of the reading
    where `share`; `instrument`: it is an instrument's error."""

    place: str
    size: float
    share: bool = False
    instrument: bool = False

    def to_json(self) -> dict[str, Any]:
        return {"place": self.place, "size": self.size, "share": self.share}


@dataclass(frozen=True)
class ConcealedChanges:
    """The answer of a trial. `flights`: inputs of every flight, the last one to be judged and the others healthy;
    `values`: coefficients of `effects` in that last one; `realistic`: what else is wrong, None where nothing is; every:
    how many points of a flight there are for each that is recorded."""

    trial: int
    truth: str
    kind: str
    health: Mapping[str, float]
    changes: tuple[ConcealedChange, ...]
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    flights: Sequence[Mapping[str, np.ndarray]]
    realistic: RealisticErrors | None
    noise_seed: int
    every: int = 1


def draw_changes(
    engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str]
) -> ConcealedChanges:
    """Trial number `trial` of a seed, of one of these truths and kinds."""
    if tuple(chosen) == (kinds.FIELD,):
        return _draw_field_changes(engine, seed, trial, truths)
    rng = random_stream(seed, trial, TRIAL_STREAM)
    truth = str(rng.choice(list(truths)))
    share = np.array([kinds.ISOLATION_WEIGHTS[k] for k in chosen], float)
    kind = str(rng.choice(list(chosen), p=share / share.sum()))
    health = draw_health(engine, rng)
    flights, training = draw_flights(engine, rng)
    flights = flights[: training + 1]
    own = random_stream(seed, trial, TRUTH_STREAM)
    realistic = draw_realistic(engine, flights, own) if truth == kinds.REALISTIC else None
    sensors = realistic.sensors if realistic else tuple(engine.sensors)
    effects, values = _draw_effect(engine, rng) if kind == kinds.PHYSICS else ((), {})
    changes = [ConcealedChange(e.label, 0.0) for e in effects]
    changes += _changes(engine, kind, sensors, rng)
    return ConcealedChanges(
        trial, truth, kind, health, tuple(changes), effects, values, flights, realistic, int(rng.integers(2**62))
    )


def _draw_field_changes(engine: Engine, seed: int, trial: int, truths: Sequence[str]) -> ConcealedChanges:
    """Engine, healthy flights and errors from the number of the group; what is wrong from that of the trial."""
    group, number = divmod(trial, kinds.FIELD_JUDGED)
    rng, own = random_stream(seed, group, TRIAL_STREAM), random_stream(seed, group, TRUTH_STREAM)
    truth = str(rng.choice(list(truths)))
    health = draw_health(engine, rng)
    noise_seed = int(rng.integers(2**62))
    flights = field_flights(engine, FIELD_HEALTHY + kinds.FIELD_JUDGED, rng)
    at = [*range(FIELD_HEALTHY), FIELD_HEALTHY + number]
    realistic = None
    if truth == kinds.REALISTIC:
        realistic = draw_realistic(engine, flights, own, airline=0.0).select_flights(at)
    flights = [flights[k] for k in at]
    kind = kinds.field_kind(trial)
    changes = _field_changes(engine, kind, flights[-1], random_stream(seed, trial, CHANGE_STREAM))
    return ConcealedChanges(
        trial, truth, kind, health, tuple(changes), (), {}, flights, realistic, noise_seed, FIELD_EVERY
    )


def field_flights(engine: Engine, count: int, rng: np.random.Generator) -> list[dict[str, np.ndarray]]:
    """Columns (N,) of so many whole flights of an airliner: time and the engine's inputs. Raises DataError for an
    engine that does not fly."""
    if "altitude_m" not in engine.inputs:
        raise DataError(
            f"trials in the field are whole flights of an airliner, and {engine.name!r} stays on the ground"
        )
    plan = default_plan(engine)
    plan["mission"]["record_interval_s"] = FIELD_STEP_S
    columns = generate_flights(plan, engine, rng, flights=count).columns
    kept = ("time_s", *engine.inputs)
    return [{c: np.asarray(columns[c][columns["flight"] == k], float) for c in kept} for k in range(1, count + 1)]


def _field_changes(
    engine: Engine, kind: str, flight: Mapping[str, np.ndarray], rng: np.random.Generator
) -> list[ConcealedChange]:
    """Changes in the field: an instrument's error is an offset as often as a scale."""
    if kind == kinds.OUTPUT_SENSOR:
        return [_field_sensor_change(engine, flight, rng)]
    if kind == kinds.INPUT_CHANNEL:
        return [_input_change(engine, rng)]
    if kind == kinds.SEVERAL:
        wrong = [_field_sensor_change(engine, flight, rng)] if rng.random() < SENSOR_AMONG else []
        return [*_component_changes(engine, FIELD_TOGETHER - len(wrong), rng, FIELD_FAULT), *wrong]
    return _component_changes(engine, 1, rng, FIELD_FAULT) if kind == kinds.COMPONENT else []


def _field_sensor_change(engine: Engine, flight: Mapping[str, np.ndarray], rng: np.random.Generator) -> ConcealedChange:
    column = str(rng.choice(list(engine.sensors)))
    size, share = _sign(rng) * _log_uniform(FIELD_FAULT, rng), bool(rng.random() < 0.5)
    y = engine.predict({c: flight[c] for c in engine.inputs}, sensors=(column,)).y
    return ConcealedChange(
        instrument_place(column), size if share else size * float(np.nanmedian(y)), share, instrument=True
    )


def _changes(engine: Engine, kind: str, sensors: Sequence[str], rng: np.random.Generator) -> list[ConcealedChange]:
    if kind == kinds.COMPONENT:
        return _component_changes(engine, 1, rng)
    if kind == kinds.OUTPUT_SENSOR:
        return [_sensor_change(engine, sensors, rng)]
    if kind == kinds.INPUT_CHANNEL:
        return [_input_change(engine, rng)]
    if kind == kinds.SEVERAL:
        count = int(rng.integers(TOGETHER[0], TOGETHER[1] + 1))
        wrong = [_sensor_change(engine, sensors, rng)] if rng.random() < SENSOR_AMONG else []
        return [*_component_changes(engine, count - len(wrong), rng), *wrong]
    return []


def _log_uniform(of: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(of))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _component_changes(
    engine: Engine, count: int, rng: np.random.Generator, sizes: tuple[float, float] = FAULT
) -> list[ConcealedChange]:
    """Changes of monitored parameters; what only wears never gets better."""
    found = []
    for name in rng.choice(list(engine.monitored), count, replace=False):
        p = engine.parameters[str(name)]
        size, sign = _log_uniform(sizes, rng), _sign(rng)
        found.append(ConcealedChange(p.name, (p.wear or sign) * size * (abs(p.nominal) or 1.0)))
    return found


def _sensor_change(engine: Engine, sensors: Sequence[str], rng: np.random.Generator) -> ConcealedChange:
    column = str(rng.choice(list(sensors)))
    return ConcealedChange(
        instrument_place(column),
        _sign(rng) * _log_uniform(SENSOR, rng) * engine.sensors[column].noise_sigma,
        instrument=True,
    )


def _input_change(engine: Engine, rng: np.random.Generator) -> ConcealedChange:
    column = str(rng.choice(list(engine.inputs)))
    scale, bias = input_spread(column)
    return ConcealedChange(
        instrument_place(column), _sign(rng) * _log_uniform(INPUT, rng) * (scale or bias), bool(scale), instrument=True
    )


def _draw_effect(engine: Engine, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """An effect that flights show, at a size that engines have: no fault, and nothing that isolation knows."""
    weight = draw_weights(engine.path, SIZE[1])
    library = [e for e in drawable_effects(engine) if weight[e.label] > SELDOM]
    e = library[int(rng.integers(len(library)))]
    values = {}
    for c in e.term.amplitudes():
        value = c.absent + rng.uniform(*SIZE) * (c.typical - c.absent)
        values[e.parameter_name(c.name)] = float(np.clip(value, c.lower, c.upper))
    return (e,), values


@dataclass(frozen=True)
class TrialFiles:
    """The open folder: engine file, healthy recordings, the one to be judged; `failed`: records that the truth engine
    could not compute."""

    engine: Path
    healthy: tuple[Path, ...]
    judged: Path
    failed: int


def record_trial(engine: Engine, concealed: ConcealedChanges, folder: Path) -> TrialFiles:
    """Fly the trial and write what is recorded into the open folder."""
    rng = np.random.default_rng(concealed.noise_seed)
    truth = true_engine(engine, concealed)
    drawn = concealed.realistic
    sensors = drawn.sensors if drawn else tuple(engine.sensors)
    paths, failed, last = [], 0, len(concealed.flights) - 1
    for k in range(len(concealed.flights)):
        if k == last:  # trials of one engine share its healthy recordings, not what is judged
            rng = np.random.default_rng((concealed.noise_seed, concealed.trial))
        columns = _true_columns(truth, concealed, k)
        good = np.isfinite(np.stack([columns[c] for c in sensors])).all(axis=0)
        if drawn:
            columns = drawn.read(k, columns)
        columns = _add_instrument_errors(concealed, columns) if k == last else columns
        columns, good = {c: v[:: concealed.every] for c, v in columns.items()}, good[:: concealed.every]
        failed += int((~good).sum())
        columns = drawn.write(engine, columns, rng) if drawn else add_sensor_noise(engine, 0.0, columns, rng)
        path = folder / (f"judged_{concealed.trial}.csv" if k == last else f"healthy_{k + 1}.csv")
        write_recording(path, {c: columns[c][good] for c in ("time_s", *engine.inputs, *sensors)})
        paths.append(path)
    return TrialFiles(copy_engine_file(folder, engine), tuple(paths[:-1]), paths[-1], failed)


def true_engine(engine: Engine, concealed: ConcealedChanges) -> Engine:
    """The truth: the model itself, or its realistic relative, whose tables are read back and gone."""
    if concealed.realistic is None:
        return engine
    return realistic_engine(engine, concealed.realistic, stack_flights(concealed.flights[:-1]))


def _true_columns(truth: Engine, concealed: ConcealedChanges, k: int) -> dict[str, np.ndarray]:
    """Time, inputs and true outputs (N,) of flight k, the last one changed."""
    flight, theta = concealed.flights[k], dict(concealed.health)
    if k == len(concealed.flights) - 1:
        truth = truth.replace_effects((*truth.effects, *concealed.effects))
        theta |= concealed.values
        for c in concealed.changes:
            if c.place in truth.parameters:
                theta[c.place] = theta.get(c.place, truth.parameters[c.place].nominal) + c.size
    given = {c: flight[c] for c in ("time_s", *truth.inputs)}
    return given | dict(zip(truth.sensors, true_readings(truth, [flight], theta).T, strict=True))


def _add_instrument_errors(concealed: ConcealedChanges, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns (N,) with the errors of instruments that the trial conceals."""
    by_place = {instrument_place(c): c for c in columns}
    found = dict(columns)
    for change in concealed.changes:
        column = by_place.get(change.place)
        if column:
            found[column] = columns[column] * (1.0 + change.size) if change.share else columns[column] + change.size
    return found
