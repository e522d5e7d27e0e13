"""What is concealed in a trial of `explain`, and the trial's recordings.

Everything is drawn from the trial's own seed and never shown to the diagnosing process, which gets the engine file and
the recordings alone. Two to four causes at once are drawn so that each is visible beside the others: kinds first, then
locations, then sizes. Each cause is to have a λ of its own given all others; its size is scaled by
√(λ wanted/λ given) within what is plausible, and a set that is still not visible is drawn again.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, open_output
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_formulas import (
    ConcealedFormula,
    FormulaDesign,
    FormulaRequest,
    NothingVisibleError,
    draft_formula,
    draw_formula,
)
from enginediag_cli.validation.separability import combine_hypotheses
from enginediag_cli.validation.trial_flights import (
    Cause,
    draw_flights,
    draw_memories,
    draw_moving_flights,
    draw_weights,
    drawable_effects,
    hour_columns,
    noise_free_fit,
    stack_flights,
    true_readings,
)
from enginediag_cli.validation.truth_engines import MapErrors, draw_map_errors
from enginediag_cli.validation.truth_instruments import (
    RealisticErrors,
    correlated_noise,
    draw_realistic,
    realistic_engine,
)

EFFECT, LAW, FAULT, SENSOR_FAULT = "effect", "law", "fault", "sensor fault"
SHARES: Mapping[str, float] = {EFFECT: 0.45, LAW: 0.2, FAULT: 0.2, SENSOR_FAULT: 0.15}
"""Kinds of causes. Of all but effects there is one at most, and never one kind alone."""
SHOWS = 40.0
"""λ of each cause, given the others, from which a trial is judged."""
LAMBDA = (60.0, 2000.0)
"""λ wanted of each cause, given the others, from and to, evenly in the logarithm."""
SIZE = (0.15, 2.0)
"""Of a typical size, the smallest and the largest."""
STEP: Mapping[str, float] = {FAULT: 0.01, SENSOR_FAULT: 0.005}
"""Typical steps of a health parameter and of a sensor's scale, relative."""
TRIES, SCALINGS = 400, 2
"""Sets of causes that are drawn, and times that the sizes of one are scaled, at most."""


@dataclass(frozen=True)
class ConcealedPart:
    """One cause with its size over the typical one; of an effect also `effect` with the values of that size, of a law
    `law`, of a step how much changes at size 1."""

    kind: str
    cause: Cause
    size: float
    effect: Effect | None = None
    law: ConcealedFormula | None = None
    change: float = 0.0

    @property
    def sized_effect(self) -> Effect | None:
        """The effect or law with its values at this size."""
        if self.law is not None:
            values = {n: v * self.size for n, v in self.law.effect.values.items()}
            return replace(self.law.effect, values=values)
        if self.effect is None:
            return None
        known = {c.name: c for c in self.effect.term.amplitudes()}
        values = {n: known[n].absent + self.size * (v - known[n].absent) for n, v in self.effect.values.items()}
        return replace(self.effect, values=values)

    @property
    def is_plausible(self) -> bool:
        """Every coefficient of an effect within its bounds: who explains refuses one that ends at a bound."""
        effect = self.sized_effect if self.law is None else None
        if effect is None:
            return True
        return all(p.lower < p.nominal < p.upper for p in effect.parameters() if p.name in effect.amplitudes)

    def hypothesis(self, engine: Engine, records: int) -> Hypothesis:
        """The cause as something to fit, begun at its size."""
        if self.sized_effect is not None:
            return Hypothesis((self.sized_effect,))
        name = f"since record {self.cause.first}"
        step = (np.arange(records) >= self.cause.first).astype(float)
        sought = Discrepancy(self.cause.name, name, engine.parameters[self.cause.name].prior_sigma)
        return Hypothesis((), (sought,), {name: step})

    def scaled(self, factor: float) -> ConcealedPart:
        """Within what is plausible; a law is, as it was drawn, up to twice its size."""
        return replace(self, size=float(np.clip(self.size * factor, *SIZE)))


@dataclass(frozen=True)
class SeveralCauses:
    """The causes of a trial, as `ConcealedTruth` has them."""

    causes: tuple[Cause, ...]
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    changes: Mapping[str, float]
    law: ConcealedFormula | None
    kinds: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def from_parts(parts: Sequence[ConcealedPart]) -> SeveralCauses:
        carried = {p.cause.name: p.sized_effect for p in parts}
        effects = tuple(e for e in carried.values() if e is not None)
        law = next((replace(p.law, effect=e) for p in parts if p.law is not None for e in [p.sized_effect] if e), None)
        return SeveralCauses(
            tuple(p.cause for p in parts),
            effects,
            {e.parameter_name(c): v for e in effects for c, v in e.values.items()},
            {p.cause.name: p.change * p.size for p in parts if p.cause.is_step},
            law,
            {p.cause.name: p.kind for p in parts},
        )


def draw_several(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    count: int,
    rng: np.random.Generator,
) -> SeveralCauses:
    """So many causes that these flights, those that are searched, show. Raises NothingShownError where none are
    found."""
    design = FormulaDesign.from_flights(engine, flights, model_error)
    for _ in range(TRIES):
        parts = _draw_parts(design, count, rng)
        wanted = np.exp(rng.uniform(np.log(LAMBDA[0]), np.log(LAMBDA[1]), count))
        for _ in range(SCALINGS):
            given = _conditional_lambdas(design, flights, model_error, parts) if parts else None
            if given is None:
                break
            parts = [p.scaled(float(np.sqrt(w / max(g, 1e-3)))) for p, w, g in zip(parts, wanted, given, strict=True)]
        last = _conditional_lambdas(design, flights, model_error, parts) if parts else None
        if last is not None and min(last) >= SHOWS:
            return SeveralCauses.from_parts(parts)
    raise NothingVisibleError(f"{engine.name}: no {count} causes were found that these flights show beside each other")


def _draw_parts(design: FormulaDesign, count: int, rng: np.random.Generator) -> list[ConcealedPart]:
    """So many causes, of two kinds at least; none where one cannot be drawn."""
    n = design.fit.evidence.records
    kinds: list[str] = []
    while len(kinds) < count:
        kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        if kind == EFFECT or kind not in kinds:
            kinds.append(kind)
        if len(kinds) == count and len(set(kinds)) == 1:
            kinds = []
    found: list[ConcealedPart] = []
    for kind in kinds:
        part = {EFFECT: _draw_part_effect, LAW: _draw_part_formula}.get(kind, _draw_step)(design, kind, n, rng)
        if part is None or part.cause.name in {p.cause.name for p in found}:
            return []
        found.append(part)
    return found


def _draw_part_effect(design: FormulaDesign, kind: str, n: int, rng: np.random.Generator) -> ConcealedPart:
    library = drawable_effects(design.engine)
    share = np.array([draw_weights(design.engine.path, SIZE[1])[e.label] for e in library])
    effect = library[int(rng.choice(len(library), p=share / share.sum()))]
    values = {c.name: c.absent + rng.uniform(0.5, 1.0) * (c.typical - c.absent) for c in effect.term.amplitudes()}
    return ConcealedPart(kind, Cause(effect.label), 1.0, replace(effect, values=values))


def _draw_part_formula(design: FormulaDesign, kind: str, n: int, rng: np.random.Generator) -> ConcealedPart | None:
    law = draft_formula(design, FormulaRequest.draw(rng), rng)
    return None if law is None else ConcealedPart(kind, Cause(law.effect.label), 1.0, law=law)


def _draw_step(design: FormulaDesign, kind: str, n: int, rng: np.random.Generator) -> ConcealedPart:
    """A health parameter, or a sensor's scale, that changes at some record of the middle half and stays."""
    engine = design.engine
    first, sign = int(rng.integers(n // 4, 3 * n // 4)), float(rng.choice((-1.0, 1.0)))
    if kind == SENSOR_FAULT:
        name = str(rng.choice([f"sensor.{s.quantity}.scale" for s in engine.sensors.values()]))
    else:
        name = str(rng.choice(list(engine.monitored)))
        if engine.parameters[name].wear < 0:
            sign = -1.0  # no fault makes a part better
    change = sign * STEP[kind] * (abs(engine.parameters[name].nominal) or 1.0)
    return ConcealedPart(kind, Cause(name, first), 1.0, change=change)


def _conditional_lambdas(
    design: FormulaDesign,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    parts: Sequence[ConcealedPart],
) -> list[float] | None:
    """λ of each cause given the others, on these flights without noise; None where one is not plausible, a fit does not
    converge, or begins where the engine cannot run."""
    if not all(p.is_plausible for p in parts):
        return None
    engine, n = design.engine, design.fit.evidence.records
    several = SeveralCauses.from_parts(parts)
    truth = engine.replace_effects((*engine.effects, *several.effects))
    theta: dict[str, float | np.ndarray] = dict(several.values)
    for cause in several.causes:
        if cause.is_step:
            theta[cause.name] = engine.parameters[cause.name].nominal + several.changes[cause.name] * (
                np.arange(n) >= cause.first
            )
    base = noise_free_fit(engine, flights, model_error, true_readings(truth, flights, theta))
    if not base.converged:
        return None
    found = []
    for k in range(len(parts)):
        others = combine_hypotheses(*(p.hypothesis(engine, n) for j, p in enumerate(parts) if j != k))
        try:
            fit = identify_with(base.evidence, others, nuisance(base.evidence), base)
        except NoVerdictError:
            return None
        if not fit.converged:
            return None
        found.append(Projection(fit).objective)
    return found


EFFECT_SIZE = (0.3, 1.5)  # of a typical size
HEALTH, SENSOR_SCALE = 0.005, 0.001
"""Standard deviations of how a healthy engine and its sensors differ from nominal, as a share. Judgement: engines of a
fleet."""
HEALTH_FAULT, SENSOR_STEP = 0.01, 0.005  # typical steps, relative
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
class RealisedNoise:
    """`factor`: realised standard deviation over the engine file's; `rho`: lag-1 correlation, of every sensor;
    `inputs` and `input_shares`: standard deviation by input column, in its unit or as a share of the reading."""

    factor: float = 1.0
    rho: float = 0.0
    inputs: Mapping[str, float] | None = None
    input_shares: Mapping[str, float] | None = None


@dataclass(frozen=True)
class ConcealedTruth:
    """The answer of a trial. `values`: coefficients of the effects by parameter; `change`: size of the step, if one
    of the causes is a step; `states` (N,), 0 or 1, of a hidden switch; `flights`: inputs of every flight, the last
    ones held back; `without`: terms that the explainer's library lacks; `realistic`: what is wrong beside, of realistic
    truths; `law`: an effect that is not in the library, one of the effects; `changes`: sizes of steps by parameter,
    where there may be more than one."""

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
    withheld_terms: tuple[str, ...]
    noise: RealisedNoise
    map_errors: MapErrors | None
    noise_seed: int
    realistic: RealisticErrors | None = None
    formula: ConcealedFormula | None = None
    changes: Mapping[str, float] = field(default_factory=dict)

    @property
    def records(self) -> np.ndarray:
        """Number of records of every flight."""
        return np.array([len(f["time_s"]) for f in self.flights])

    def recorded_sensors(self, engine: Engine) -> tuple[str, ...]:
        """The sensors that are recorded."""
        return self.realistic.sensors if self.realistic else tuple(engine.sensors)


def random_stream(seed: int, trial: int, what: int = TRIAL_STREAM, again: int = 0) -> np.random.Generator:
    """A trial's own random numbers, whatever other trials there are; others each time that it is drawn `again`."""
    key = (what, trial, again) if again else (what, trial)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def draw_engine_file(engines: Sequence[str], seed: int, trial: int) -> str:
    """The engine file of a trial that has the choice."""
    return engines[int(random_stream(seed, trial, ENGINE_STREAM).integers(len(engines)))]


def draw_truth(engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str]) -> ConcealedTruth:
    """Trial number `trial` of a seed, of one of these truths and kinds. Raises DataError of an engine that cannot be
    flown so; NothingShownError where no flights show what the trial could conceal."""
    for again in range(AGAIN):
        try:
            return _draw_once(engine, seed, trial, truths, chosen, again)
        except (NothingVisibleError, NoVerdictError):  # the second: where what was tried lets the engine run nowhere
            continue
    return _draw_once(engine, seed, trial, truths, chosen, AGAIN)


def _draw_once(
    engine: Engine, seed: int, trial: int, truths: Sequence[str], chosen: Sequence[str], again: int
) -> ConcealedTruth:
    """The trial, drawn as often before as `again` says."""
    rng = random_stream(seed, trial, again=again)
    truth = str(rng.choice(list(truths)))
    weights = np.array([kinds.weight(k) for k in chosen], float)
    kind = str(rng.choice(list(chosen), p=weights / weights.sum()))
    health = draw_health(engine, rng)
    flights, training = draw_moving_flights(engine, rng) if kinds.is_dynamic(kind) else draw_flights(engine, rng)
    realistic = None
    if truth == kinds.REALISTIC:
        own = random_stream(seed, trial, TRUTH_STREAM, again)
        realistic, kind = draw_realistic(engine, flights, own), kinds.base_kind(kind)
    sizes = [len(f["time_s"]) for f in flights]
    n = sum(sizes[:training])
    what = kinds.base_kind(kind)
    effects, values = _draw_effects(engine, kind, rng)
    causes = [Cause(e.label) for e in effects]
    change = 0.0
    if what in (kinds.FAULT, kinds.EFFECT_AND_FAULT):
        cause, change = _random_step(engine, n, rng, realistic.sensors if realistic else tuple(engine.sensors))
        causes.append(cause)
    states = None
    if what == kinds.HIDDEN_SWITCH:
        dwell = rng.uniform(*DWELL)
        states = np.concatenate([_random_telegraph(m, dwell, rng) for m in sizes])
    without = tuple(e.term.NAME for e in effects) if what == kinds.WITHHELD else ()
    concealed = ConcealedTruth(
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
        RealisedNoise(rho=realistic.rho) if realistic else _draw_noise(engine, kinds.noise_variant(kind), rng),
        draw_map_errors(engine, rng) if truth == kinds.MAP_ERROR else None,
        int(rng.integers(2**62)),
        realistic,
    )
    conceal = {kinds.LAW: conceal_formula, kinds.SEVERAL: conceal_several}.get(kinds.special_choice(kind))
    return conceal(engine, concealed, random_stream(seed, trial, LAW_STREAM, again)) if conceal else concealed


def conceal_formula(engine: Engine, concealed: ConcealedTruth, rng: np.random.Generator) -> ConcealedTruth:
    """The trial with a law concealed, unless it is one that conceals nothing."""
    if kinds.base_kind(concealed.kind) == kinds.NULL:
        return concealed
    law = draw_formula(engine, concealed.flights, concealed.training, kinds.MODEL_ERROR[concealed.truth] or 0.0, rng)
    return replace(
        concealed,
        effects=(law.effect,),
        causes=(Cause(law.effect.label),),
        values=law.values,
        formula=law,
    )


def conceal_several(engine: Engine, concealed: ConcealedTruth, rng: np.random.Generator) -> ConcealedTruth:
    """The trial with two to four causes concealed."""
    model_error = kinds.MODEL_ERROR[concealed.truth] or 0.0
    count = kinds.COUNTS[concealed.kind]
    found = draw_several(engine, concealed.flights[: concealed.training], model_error, count, rng)
    return replace(
        concealed,
        effects=found.effects,
        causes=found.causes,
        values=found.values,
        changes=found.changes,
        formula=found.law,
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


def _draw_effects(engine: Engine, kind: str, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    what = kinds.base_kind(kind)
    count = {kinds.NULL: 0, kinds.FAULT: 0, kinds.PAIR: 2}.get(what, 1)
    if kinds.special_choice(kind) in (kinds.LAW, kinds.SEVERAL):
        return (), {}  # drawn from a stream of their own
    if kinds.is_dynamic(kind):
        return draw_memories(engine, count, rng)
    library = drawable_effects(engine)
    if what == kinds.HIDDEN_SWITCH:
        library = [e for e in library if e.term.SWITCHES]
    share = np.array([draw_weights(engine.path, EFFECT_SIZE[1])[e.label] for e in library])
    chosen = rng.choice(len(library), count, replace=False, p=share / share.sum())
    effects = tuple(library[k] for k in chosen)
    values = {}
    for e in effects:
        for c in e.term.amplitudes():
            value = c.absent + rng.uniform(*EFFECT_SIZE) * (c.typical - c.absent)
            values[e.parameter_name(c.name)] = float(np.clip(value, c.lower, c.upper))
    return effects, values


def _random_step(engine: Engine, n: int, rng: np.random.Generator, sensors: Sequence[str]) -> tuple[Cause, float]:
    """A health parameter, or a sensor's scale, that changes at some record of the middle half and stays."""
    first = int(rng.integers(n // 4, 3 * n // 4))
    size, sign = rng.uniform(*EFFECT_SIZE), rng.choice((-1.0, 1.0))
    if rng.random() < 0.5:
        name = str(rng.choice(_scales(engine, sensors)))
        return Cause(name, first), float(sign * size * SENSOR_STEP)
    name = str(rng.choice(list(engine.monitored)))
    if engine.parameters[name].wear < 0:
        sign = -1.0  # no fault makes a part better
    return Cause(name, first), float(sign * size * HEALTH_FAULT * (abs(engine.parameters[name].nominal) or 1.0))


def _random_telegraph(n: int, dwell: float, rng: np.random.Generator) -> np.ndarray:
    """States (n,) that change with probability 1/dwell from one record to the next."""
    switched = rng.random(n) < 1.0 / dwell
    return np.asarray((rng.integers(0, 2) + np.cumsum(switched)) % 2, float)


def _draw_noise(engine: Engine, variant: str, rng: np.random.Generator) -> RealisedNoise:
    if variant == kinds.CORRELATED_NOISE:
        return RealisedNoise(rho=float(rng.uniform(*RHO)))
    if variant == kinds.UNKNOWN_NOISE:
        return RealisedNoise(factor=float(np.exp(rng.uniform(*np.log(NOISE_FACTOR)))))
    if variant == kinds.INPUT_NOISE:
        known = {c: INPUT_SIGMA[c] for c in engine.inputs if c in INPUT_SIGMA}
        return RealisedNoise(inputs=known, input_shares={engine.power_setting: POWER_SIGMA})
    return RealisedNoise()


@dataclass(frozen=True)
class TrialFlights:
    """Flights with noise, and without, both of the same records.

    `used_records` (N,): their positions among those drawn; `failed`: how many the truth engine could not compute.
    """

    noisy: tuple[Flight, ...]
    clean: tuple[Flight, ...]
    used_records: np.ndarray
    failed: int

    def place_cause(self, cause: Cause) -> Cause:
        """The cause with its step counted among the kept records."""
        return cause if not cause.is_step else Cause(cause.name, int(np.searchsorted(self.used_records, cause.first)))


def true_flight_readings(engine: Engine, concealed: ConcealedTruth, *, exact_model: bool) -> np.ndarray:
    """What the sensors read without noise, (N, m), NaN where the truth engine has no solution. `exact_model`: the
    truth without its map errors and on the model's own maps."""
    u = stack_flights(concealed.flights)
    n = len(u["time_s"])
    errors = None if exact_model else concealed.map_errors
    base = engine if exact_model or concealed.realistic is None else realistic_engine(engine, concealed.realistic, u)
    truth = base.replace_effects((*engine.effects, *concealed.effects, *(errors.effects if errors else ())))
    theta: dict[str, float | np.ndarray] = {**concealed.health, **concealed.values}
    for cause in concealed.causes:
        if cause.is_step:
            change = concealed.changes.get(cause.name, concealed.change)
            theta[cause.name] = concealed.health[cause.name] + change * (np.arange(n) >= cause.first)
    if concealed.states is not None:
        for e in concealed.effects:
            for c in e.term.amplitudes():
                name = e.parameter_name(c.name)
                theta[name] = c.absent + (concealed.values[name] - c.absent) * concealed.states
    inputs = {c: u[c] for c in (*truth.inputs, *truth.optional_inputs) if c in u}
    if kinds.is_dynamic(concealed.kind):
        # the truth remembers what it was told, not what was read of it
        drawn = [{c: f[c] for c in ("time_s", *truth.inputs)} for f in concealed.flights]
        inputs[MOMENT] = np.concatenate([truth.tapes.add(f) for f in drawn])
    if errors:
        theta.update(errors.parameters)
        inputs["humidity_kg_kg"] = np.full(n, errors.water)
    p = truth.predict(inputs, theta)
    return np.asarray(np.where(p.ok[:, None], p.y, np.nan))


def record_trial(engine: Engine, concealed: ConcealedTruth) -> TrialFlights:
    """Fly the trial and record it."""
    rng = np.random.default_rng(concealed.noise_seed)
    true = true_flight_readings(engine, concealed, exact_model=False)
    same = concealed.map_errors is None and concealed.realistic is None
    clean = true if same else true_flight_readings(engine, concealed, exact_model=True)
    kept = np.isfinite(true).all(axis=1) & np.isfinite(clean).all(axis=1)
    sensors = concealed.recorded_sensors(engine)
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()]) * concealed.noise.factor
    noisy_flights, clean_flights, start = [], [], 0
    for k, flight in enumerate(concealed.flights):
        n = len(flight["time_s"])
        rows = slice(start, start + n)
        good = kept[rows]
        label = f"flight_{k + 1}"
        if concealed.realistic is not None:
            read = concealed.realistic.read(k, {**flight, **dict(zip(engine.sensors, true[rows].T, strict=True))})
            read = concealed.realistic.write(engine, read, rng)
        else:
            noise = sigma * correlated_noise(rng.standard_normal((n, len(sigma))), concealed.noise.rho)
            read = _add_input_noise(flight, concealed, rng)
            read |= dict(zip(engine.sensors, (true[rows] + noise).T, strict=True))
        exact = {**flight, **dict(zip(engine.sensors, clean[rows].T, strict=True))}
        noisy_flights.append(_flight(engine, label, read, sensors, good))
        clean_flights.append(_flight(engine, label, exact, sensors, good))
        start += n
    return TrialFlights(tuple(noisy_flights), tuple(clean_flights), np.flatnonzero(kept), int((~kept).sum()))


def write_trial_files(folder: Path, engine: Engine, recorded: TrialFlights, training: int) -> tuple[Path, list[Path]]:
    """The open folder: the engine file and its maps as they are, and the flights that are not held back."""
    paths = []
    for flight in recorded.noisy[:training]:
        path = folder / f"{flight.label}.csv"
        write_recording(path, flight.columns)
        paths.append(path)
    return copy_engine_file(folder, engine), paths


def write_recording(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns (N,) as a recording."""
    with open_output(path) as stream:
        CsvWriter(stream).write(Recording(dict(columns)))


def copy_engine_file(folder: Path, engine: Engine) -> Path:
    """The engine file and its maps as they are, copied into the folder; the engine file there."""
    given = Path(engine.path)
    tables = [c.values["table"]["file"] for c in engine.network.components if c.values.get("table")]
    for name in dict.fromkeys((given.name, *tables)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(given.parent / name, folder / name)
    return folder / given.name


def _flight(
    engine: Engine, label: str, read: Mapping[str, np.ndarray], sensors: Sequence[str], good: np.ndarray
) -> Flight:
    return Flight(label, "", {c: read[c][good] for c in ("time_s", *engine.inputs, *hour_columns(), *sensors)})


def _add_input_noise(
    flight: Mapping[str, np.ndarray], concealed: ConcealedTruth, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    found = dict(flight)
    for c, s in (concealed.noise.inputs or {}).items():
        found[c] = flight[c] + s * rng.standard_normal(len(flight[c]))
    for c, s in (concealed.noise.input_shares or {}).items():
        found[c] = flight[c] * (1.0 + s * rng.standard_normal(len(flight[c])))
    return found
