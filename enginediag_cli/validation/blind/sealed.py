"""What is concealed in a trial: drawn from the trial's own seed, never shown to the explainer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.causes import Cause
from enginediag_cli.validation.blind.flights import draw_flights
from enginediag_cli.validation.blind.laws.drawn import NothingShownError, draw_law
from enginediag_cli.validation.blind.laws.truth import LawTruth
from enginediag_cli.validation.blind.map_error import MapErrors, draw_map_errors
from enginediag_cli.validation.blind.memories import draw_memories
from enginediag_cli.validation.blind.moving_flights import draw_moving_flights
from enginediag_cli.validation.blind.several.drawn import draw_several
from enginediag_cli.validation.blind.truths.realistic import Realistic, draw_realistic
from enginediag_cli.validation.blind.visible import drawable, weights

SIZE = (0.3, 1.5)  # of a typical size
HEALTH, SENSOR_SCALE = 0.005, 0.001
"""Standard deviations of how a healthy engine and its sensors differ from nominal, as a share. Judgement: engines of a
fleet."""
HEALTH_FAULT, SENSOR_FAULT = 0.01, 0.005  # typical steps, relative
DWELL = (6.0, 20.0)  # records, mean of a random telegraph
RHO = (0.3, 0.7)
"""Correlation of noise from record to record, from and to, in trials with correlated noise."""
NOISE_FACTOR = (0.5, 2.0)
"""True noise over what is stated, from and to, in trials where it is misjudged."""
INPUT_SIGMA: Mapping[str, float] = {"altitude_m": 8.0, "mach": 0.001}
"""Noise of recorded conditions, in their unit: what an air-data computer is good for."""
POWER_SIGMA = 0.002  # of a reading
AGAIN = 4
"""Times that a trial is drawn anew, flights, kind and all, where its flights show nothing that it could conceal."""
TRIAL_STREAM, SIZE_STREAM, TRUTH_STREAM, ENGINE_STREAM, LAW_STREAM = 0, 1, 2, 3, 5
"""Streams of random numbers that must not share a draw."""


@dataclass(frozen=True)
class Noise:
    """`factor`: realised standard deviation over the engine file's; `rho`: lag-1 correlation, of every sensor;
    `inputs` and `input_shares`: standard deviation by input column, in its unit or as a share of the reading."""

    factor: float = 1.0
    rho: float = 0.0
    inputs: Mapping[str, float] | None = None
    input_shares: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Sealed:
    """The answer of a trial. `values`: coefficients of the effects by parameter; `change`: size of the step, if one
    of the causes is a step; `states` (N,), 0 or 1, of a hidden switch; `flights`: inputs of every flight, the last
    ones held back; `without`: terms that the explainer's library lacks; `realistic`: what is wrong beside, of realistic
    truths; `law`: an effect that no library holds, one of the effects; `changes`: sizes of steps by parameter, where
    there may be more than one."""

    trial: int
    truth: str
    kind: str
    health: Mapping[str, float]
    causes: tuple[Cause, ...]
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    change: float
    states: np.ndarray | None
    flights: Sequence[Mapping[str, np.ndarray]]
    training: int
    without: tuple[str, ...]
    noise: Noise
    map_errors: MapErrors | None
    noise_seed: int
    realistic: Realistic | None = None
    law: LawTruth | None = None
    changes: Mapping[str, float] = field(default_factory=dict)

    @property
    def records(self) -> np.ndarray:
        """Number of records of every flight."""
        return np.array([len(f["time_s"]) for f in self.flights])

    def recorded(self, engine: Engine) -> tuple[str, ...]:
        """The sensors that are recorded."""
        return self.realistic.sensors if self.realistic else tuple(engine.sensors)


def stream(seed: int, trial: int, what: int = TRIAL_STREAM, again: int = 0) -> np.random.Generator:
    """A trial's own random numbers, whatever other trials there are; others each time that it is drawn `again`."""
    key = (what, trial, again) if again else (what, trial)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def engine_of(engines: Sequence[str], seed: int, trial: int) -> str:
    """The engine file of a trial that has the choice."""
    return engines[int(stream(seed, trial, ENGINE_STREAM).integers(len(engines)))]


def draw(engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str]) -> Sealed:
    """Trial number `trial` of a seed, of one of these truths and kinds. Raises DataError of an engine that cannot be
    flown so; NothingShownError where no flights show what the trial could conceal."""
    for again in range(AGAIN):
        try:
            return _drawn(engine, seed, trial, truths, chosen, again)
        except (NothingShownError, NoVerdictError):  # the second: where what was tried lets the engine run nowhere
            continue
    return _drawn(engine, seed, trial, truths, chosen, AGAIN)


def _drawn(engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str], again: int) -> Sealed:
    """The trial, drawn as often before as `again` says."""
    rng = stream(seed, trial, again=again)
    truth = str(rng.choice(list(truths)))
    weights = np.array([kinds.weight(k) for k in chosen], float)
    kind = str(rng.choice(list(chosen), p=weights / weights.sum()))
    health = draw_health(engine, rng)
    flights, training = draw_moving_flights(engine, rng) if kinds.moves(kind) else draw_flights(engine, rng)
    realistic = None
    if truth == kinds.REALISTIC:
        own = stream(seed, trial, TRUTH_STREAM, again)
        realistic, kind = draw_realistic(engine, flights, own), kinds.base(kind)
    sizes = [len(f["time_s"]) for f in flights]
    n = sum(sizes[:training])
    what = kinds.base(kind)
    effects, values = _effects(engine, kind, rng)
    causes = [Cause(e.label) for e in effects]
    change = 0.0
    if what in (kinds.FAULT, kinds.EFFECT_AND_FAULT):
        cause, change = _step(engine, n, rng, realistic.sensors if realistic else tuple(engine.sensors))
        causes.append(cause)
    states = None
    if what == kinds.HIDDEN_SWITCH:
        dwell = rng.uniform(*DWELL)
        states = np.concatenate([_telegraph(m, dwell, rng) for m in sizes])
    without = tuple(e.term.NAME for e in effects) if what == kinds.WITHHELD else ()
    sealed = Sealed(
        trial,
        truth,
        kind,
        health,
        tuple(causes),
        effects,
        values,
        change,
        states,
        flights,
        training,
        without,
        Noise(rho=realistic.rho) if realistic else _noise(engine, kinds.variant(kind), rng),
        draw_map_errors(engine, rng) if truth == kinds.MAP_ERROR else None,
        int(rng.integers(2**62)),
        realistic,
    )
    conceal = {kinds.LAW: with_law, kinds.SEVERAL: with_several}.get(kinds.choice(kind))
    return conceal(engine, sealed, stream(seed, trial, LAW_STREAM, again)) if conceal else sealed


def with_law(engine: Engine, sealed: Sealed, rng: np.random.Generator) -> Sealed:
    """The trial with a law concealed, unless it is one that conceals nothing."""
    if kinds.base(sealed.kind) == kinds.NULL:
        return sealed
    law = draw_law(engine, sealed.flights, sealed.training, kinds.MODEL_ERROR[sealed.truth] or 0.0, rng)
    return replace(
        sealed,
        effects=(law.effect,),
        causes=(Cause(law.effect.label),),
        values=law.values,
        law=law,
    )


def with_several(engine: Engine, sealed: Sealed, rng: np.random.Generator) -> Sealed:
    """The trial with two to four causes concealed."""
    model_error = kinds.MODEL_ERROR[sealed.truth] or 0.0
    count = kinds.COUNTS[sealed.kind]
    found = draw_several(engine, sealed.flights[: sealed.training], model_error, count, rng)
    return replace(
        sealed,
        effects=found.effects,
        causes=found.causes,
        values=found.values,
        changes=found.changes,
        law=found.law,
    )


def draw_health(engine: Engine, rng: np.random.Generator) -> dict[str, float]:
    """Monitored parameters and sensors' scale errors of this engine."""
    drawn: dict[str, float] = {}
    for names, sigma in ((engine.monitored, HEALTH), (_scales(engine, tuple(engine.sensors)), SENSOR_SCALE)):
        for n in names:
            p = engine.parameters[n]
            value = p.nominal + sigma * (abs(p.nominal) or 1.0) * rng.standard_normal()
            drawn[n] = float(np.clip(value, p.lower, p.upper))
    return drawn


def _scales(engine: Engine, columns: Sequence[str]) -> list[str]:
    return [f"sensor.{engine.sensors[c].quantity}.scale" for c in columns]


def _effects(engine: Engine, kind: str, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    what = kinds.base(kind)
    count = {kinds.NULL: 0, kinds.FAULT: 0, kinds.PAIR: 2}.get(what, 1)
    if kinds.choice(kind) in (kinds.LAW, kinds.SEVERAL):
        return (), {}  # drawn from a stream of their own
    if kinds.moves(kind):
        return draw_memories(engine, count, rng)
    library = drawable(engine)
    if what == kinds.HIDDEN_SWITCH:
        library = [e for e in library if e.term.SWITCHES]
    share = np.array([weights(engine.path, SIZE[1])[e.label] for e in library])
    chosen = rng.choice(len(library), count, replace=False, p=share / share.sum())
    effects = tuple(library[k] for k in chosen)
    values = {}
    for e in effects:
        for c in e.term.amplitudes():
            value = c.absent + rng.uniform(*SIZE) * (c.typical - c.absent)
            values[e.parameter_name(c.name)] = float(np.clip(value, c.lower, c.upper))
    return effects, values


def _step(engine: Engine, n: int, rng: np.random.Generator, sensors: Sequence[str]) -> tuple[Cause, float]:
    """A health parameter, or a sensor's scale, that changes at some record of the middle half and stays."""
    first = int(rng.integers(n // 4, 3 * n // 4))
    size, sign = rng.uniform(*SIZE), rng.choice((-1.0, 1.0))
    if rng.random() < 0.5:
        name = str(rng.choice(_scales(engine, sensors)))
        return Cause(name, first), float(sign * size * SENSOR_FAULT)
    name = str(rng.choice(list(engine.monitored)))
    if engine.parameters[name].wear < 0:
        sign = -1.0  # no fault makes a part better
    return Cause(name, first), float(sign * size * HEALTH_FAULT * (abs(engine.parameters[name].nominal) or 1.0))


def _telegraph(n: int, dwell: float, rng: np.random.Generator) -> np.ndarray:
    """States (n,) that change with probability 1/dwell from one record to the next."""
    switched = rng.random(n) < 1.0 / dwell
    return np.asarray((rng.integers(0, 2) + np.cumsum(switched)) % 2, float)


def _noise(engine: Engine, variant: str, rng: np.random.Generator) -> Noise:
    if variant == kinds.CORRELATED_NOISE:
        return Noise(rho=float(rng.uniform(*RHO)))
    if variant == kinds.UNKNOWN_NOISE:
        return Noise(factor=float(np.exp(rng.uniform(*np.log(NOISE_FACTOR)))))
    if variant == kinds.INPUT_NOISE:
        known = {c: INPUT_SIGMA[c] for c in engine.inputs if c in INPUT_SIGMA}
        return Noise(inputs=known, input_shares={engine.power_setting: POWER_SIGMA})
    return Noise()
