"""Trials of `isolate`: concealed changes, recordings, marks, and the score sheet.

T are the locations that have changed, A those of the answer and R its alternatives (sets of locations each).

    false_alarm   the verdict is a fault where nothing has changed
    right         A = T. Of physics, which isolation does not know: A is where the effect acts
    covered       T ∈ {A} ∪ R, or the reported class contains T; not for physics
    false_name    a name where nothing has changed
    false_sensor  A names an output sensor that reads right; false_input: an input channel
    stated        probability that A changed and nothing else that matters, and whether it is so: A is within T, and
                  the rest of T is below `least_relevant_change`; stated_changed: of each location of A the probability
                  that it changed, whatever else did, and whether it is in T (of physics: where the effect acts)
    interval      of every reported size, whether its interval contains the true change, 0 of what did not change

An instrument is right by its column, whether the error is reported as a bias or as a scale. A size is marked only where
it is reported in the form in which the error was made.

What is concealed is drawn from the trial's own seed, and is never shown to the process that isolates.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.detection.verdict import FAULT as VERDICT_FAULT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import DataError
from enginediag_cli.isolation.posterior import least_relevant_change
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.tables.trials import ISOLATED
from enginediag_cli.simulation.flights import default_plan, generate_flights
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import EFFECT_SIZE as SIZE
from enginediag_cli.validation.concealed_effects import (
    copy_engine_file,
    draw_engine_file,
    draw_health,
    random_stream,
    write_recording,
)
from enginediag_cli.validation.score_sheet import PROBABLE, PROBABLE_TARGET, SURE, SURE_TARGET, right_less_stated
from enginediag_cli.validation.trial_flights import (
    SELDOM,
    Cause,
    cause_components,
    draw_flights,
    draw_weights,
    drawable_effects,
    instrument_place,
    stack_flights,
    true_readings,
)
from enginediag_cli.validation.trials import (
    ISOLATE,
    Record,
    TrialPlan,
    cell,
    diagnoser,
    numbers,
    rate,
    reliability_bin,
    short,
    target_met,
    target_words,
    versions,
)
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


NAMED, NOTHING, CANNOT_TELL = "named", "nothing", "cannot tell"
NO_VERDICT, NOT_IDENTIFIED, FAILED = "no verdict", "not identified", "failed"
OUTCOMES = (NAMED, NOTHING, CANNOT_TELL, NO_VERDICT, NOT_IDENTIFIED, FAILED)
JUDGED = (NAMED, NOTHING, CANNOT_TELL)
"""Outcomes that are an answer."""

OF_ALL_FAULTS = {"exact_fault": "exact", "exact_instrument": "exact", "covered_fault": "covered"}
"""Marks of every trial with a fault, judged or not, and those of judged trials that they repeat."""

Marks = dict[str, Any]


def outcome(answer: Mapping[str, Any]) -> str:
    """What kind of answer the isolator gave."""
    if "error" in answer:
        return FAILED
    if not answer["identified"]:
        return NOT_IDENTIFIED
    window = _window(answer)
    if "sets" not in window:
        return NO_VERDICT
    if window["named"]:
        return CANNOT_TELL if "class" in window else NAMED
    return CANNOT_TELL if window["sets"][0] else NOTHING


def marks(engine: Engine, concealed: ConcealedChanges, answer: Mapping[str, Any]) -> Marks:
    """All marks of a trial."""
    came = outcome(answer)
    found: Marks = {"judged": came in JUDGED, "cannot_tell": came == CANNOT_TELL}
    found |= {"no_verdict": came in (NO_VERDICT, FAILED), "not_identified": came == NOT_IDENTIFIED}
    window = _window(answer)
    if concealed.kind == kinds.NULL:
        found["false_alarm"] = window.get("verdict") == VERDICT_FAULT
    elif not concealed.effects:
        found |= {"exact_fault": False, "covered_fault": False}
        if concealed.kind in kinds.INSTRUMENTS:
            found["exact_instrument"] = False
    if came not in JUDGED:
        return found
    truth = frozenset(c.place for c in concealed.changes)
    named = frozenset(window["sets"][0]) if came == NAMED else frozenset()
    outputs, inputs = ({instrument_place(c) for c in columns} for columns in (engine.sensors, engine.inputs))
    found["false_sensor"] = bool((named & outputs) - truth)
    found["false_input"] = bool((named & inputs) - truth)
    if concealed.kind == kinds.NULL:
        found["false_name"] = window["named"]  # a class, too, says that something is wrong
    else:
        found["found"] = came != NOTHING
    acting = _acting_places(engine, concealed) if concealed.effects else truth
    right = named <= acting if concealed.effects else named == truth
    as_stated = (
        right if concealed.effects else named <= truth and not (truth - named) & _relevant_places(engine, concealed)
    )
    if window["named"] and "class" in window and not concealed.effects:
        one_of = [frozenset(s) for s in window["class"]]
        found["stated_class"] = [float(window["class_probability"] or 0.0), truth in one_of]
    if came == NAMED:
        found["stated"] = [float(window["probabilities"][0] or 0.0), as_stated]
        each = zip(window["sets"][0], window.get("changed", ()), strict=False)
        found["stated_changed"] = [[float(p or 0.0), place in acting] for place, p in each]
        found["right_name"] = right
    elif came == NOTHING:
        found["stated_nothing"] = [float(window["probabilities"][0] or 0.0), as_stated and not concealed.effects]
    if not concealed.effects:
        found["exact"] = came != CANNOT_TELL and right
        sets = [frozenset(s) for s in (*window["sets"], *window.get("class", ()))]
        found["covered"] = truth in sets
        found |= {name: found[of] for name, of in OF_ALL_FAULTS.items() if name in found}
        if came == NAMED:
            inside = _intervals(concealed, window["sizes"])
            found |= {"interval": inside} if inside else {}
    return found


def _window(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    """A recording of one flight is one window."""
    windows: Sequence[Mapping[str, Any]] = answer.get("windows") or ({},)
    return windows[0]


def _intervals(concealed: ConcealedChanges, sizes: Sequence[Sequence[Any]]) -> list[float]:
    by_place = {c.place: c for c in concealed.changes}
    found = []
    for place, quantity, _, low, high in sizes:
        change = by_place.get(place)
        if change is not None and change.instrument and change.share != (quantity == "scale"):
            continue
        true = change.size if change is not None else 0.0
        found.append(float((low is None or low <= true) and (high is None or true <= high)))
    return found


def _relevant_places(engine: Engine, concealed: ConcealedChanges) -> frozenset[str]:
    """Places of the changes that are as large as what matters beside others."""
    found = {c.place for c in concealed.changes if c.instrument}
    for c in concealed.changes:
        if not c.instrument and c.place in engine.parameters:
            p = engine.parameters[c.place]
            if abs(c.size) >= least_relevant_change([p], np.array([p.prior_sigma]))[0]:
                found.add(c.place)
    return frozenset(found)


def _acting_places(engine: Engine, concealed: ConcealedChanges) -> frozenset[str]:
    """Places of the components through which the effects act, and of the readings that they falsify."""
    acting = frozenset().union(*(cause_components(engine, Cause(e.label)) for e in concealed.effects))
    places = {n for n, p in engine.parameters.items() if p.component in acting and not p.belongs_to_sensor}
    places |= {
        instrument_place(c) for c, s in engine.sensors.items() if {s.quantity, c, f"sensor.{s.quantity}"} & acting
    }
    if acting & {c.name for c in engine.network.components if c.TYPE == "ambient"}:
        places |= {instrument_place(c) for c in engine.inputs if c != engine.power_setting}
    return frozenset(places)


KEPT = 10
"""Sets that a trial's record keeps; the last ones are hardly possible."""


def run_group(plan: TrialPlan, trials: Sequence[int]) -> list[dict[str, Any]]:
    """Draw, record, ask and mark the trials of one group, which share an engine and its healthy flights."""
    engine = load_engine(draw_engine_file(plan.engines, plan.seed, plan.group(trials[0])))
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        return [_run_trial(plan, engine, trial, Path(folder)) for trial in trials]


def _run_trial(plan: TrialPlan, engine: Engine, trial: int, folder: Path) -> dict[str, Any]:
    start = process_time()
    truth = draw_changes(engine, plan.seed, trial, plan.truths, plan.kinds)
    files = record_trial(engine, truth, folder)
    question = {"engine": str(files.engine), "healthy": [str(p) for p in files.healthy], "judged": str(files.judged)}
    answer = diagnoser().ask({"task": ISOLATE, **question})
    return _record(truth, answer, marks(engine, truth, answer)) | {
        "engine": engine.name,
        "group": plan.group(trial),
        "failed_records": files.failed,
        "seconds": round(process_time() - start, 3),
        "isolator_seconds": round(answer.get("seconds", 0.0), 3),
    }


def _record(concealed: ConcealedChanges, answer: Mapping[str, Any], marked: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of the trial; numbers rounded, so that a line is short and the same on every machine."""
    window = (answer.get("windows") or [{}])[0]
    drawn = concealed.realistic
    return {
        "trial": concealed.trial,
        "truth": concealed.truth,
        "kind": concealed.kind,
        "shape": None if drawn is None else short(drawn.shape),
        "airline": drawn is not None and drawn.airline,
        "soaked": drawn is not None and drawn.soak is not None,
        "changes": [c.to_json() | {"size": short(c.size)} for c in concealed.changes],
        "outcome": outcome(answer),
        "reason": answer.get("error") or window.get("why") or ("" if window else answer.get("reason", "")),
        "fit": short(window.get("fit")),
        "sets": window.get("sets", [])[:KEPT],
        "probabilities": [short(p) for p in window.get("probabilities", [])[:KEPT]],
        "sizes": [[place, what, *map(short, numbers)] for place, what, *numbers in window.get("sizes", [])],
        "marks": dict(marked),
    }


PROBABILITY_BINS = (0.0, 0.5, 0.7, 0.9, 1.0)
"""Edges of the stated probabilities whose truth is counted: below even, doubtful, probable, sure."""
ALL = "all"
LEAST_NAMES = 10
"""Names in a bin below which its gap is chance: ten that are right three times in four have a standard error of 14
points, already more than the gap that is aimed at."""


@dataclass(frozen=True)
class IsolationScore:
    """A line of the sheet: what is counted over which records, its target in words ("" for none)."""

    rate: Callable[[Sequence[Record]], dict[str, Any]]
    target: str = ""


def mark_rate(name: str, kind: str = "") -> Callable[[Sequence[Record]], dict[str, Any]]:
    """Rate of a mark over the trials that have it, of one kind or of all; those of a group share an engine."""

    def counted(records: Sequence[Record]) -> dict[str, Any]:
        own = [r for r in records if name in r["marks"] and (not kind or r["kind"] == kind)]
        return rate((r["marks"][name] for r in own), (r.get("group", k) for k, r in enumerate(own)))

    return counted


def _sure(records: Sequence[Record]) -> dict[str, Any]:
    return rate(right for p, right in stated_probabilities(records) if p >= SURE)


def _probable(records: Sequence[Record]) -> dict[str, Any]:
    return right_less_stated(stated_probabilities(records), PROBABLE, SURE)


def _gap(records: Sequence[Record]) -> dict[str, Any]:
    """The bin of stated probability, of at least so many names, whose truth is furthest from what is stated: right less
    stated, with the interval of what is right."""
    rows = [b for b in _bins(stated_probabilities(records)) if b["of"] >= LEAST_NAMES]
    if not rows:
        return rate(())
    worst = max(rows, key=lambda b: abs(b["gap"]))
    low, high = worst["low"] - worst["stated"], worst["high"] - worst["stated"]
    return {"rate": worst["gap"], "count": worst["count"], "of": worst["of"], "low": low, "high": high}


SCORES: Mapping[str, IsolationScore] = {
    "false_alarm": IsolationScore(mark_rate("false_alarm"), "<= 0.0375"),
    "exact_fault": IsolationScore(mark_rate("exact_fault"), ">= 0.55"),
    "exact_instrument": IsolationScore(mark_rate("exact_instrument"), ">= 0.70"),
    "covered_fault": IsolationScore(mark_rate("covered_fault"), ">= 0.95"),
    "largest_gap": IsolationScore(_gap, "within 0.08"),
    "right_when_sure": IsolationScore(_sure, SURE_TARGET),
    "right_less_stated_when_probable": IsolationScore(_probable, PROBABLE_TARGET),
    "false_name": IsolationScore(mark_rate("false_name"), "<= 0.05"),
    "false_sensor": IsolationScore(mark_rate("false_sensor"), "<= 0.03"),
    "false_input": IsolationScore(mark_rate("false_input")),
    "interval": IsolationScore(mark_rate("interval"), ">= 0.90"),
    "covered": IsolationScore(mark_rate("covered"), ">= 0.95"),
    "exact": IsolationScore(mark_rate("exact")),
    "right_name": IsolationScore(mark_rate("right_name")),
    "found": IsolationScore(mark_rate("found")),
    "cannot_tell": IsolationScore(mark_rate("cannot_tell")),
    "no_verdict": IsolationScore(mark_rate("no_verdict")),
    "not_identified": IsolationScore(mark_rate("not_identified")),
}


def stated_probabilities(records: Sequence[Record], what: str = "stated") -> list[tuple[float, bool]]:
    """Stated probability of every name, and whether it is right."""
    return [(float(p), bool(right)) for p, right in (r["marks"][what] for r in records if what in r["marks"])]


def isolation_sheet(records: Sequence[Record]) -> dict[str, Any]:
    """Every score over all trials, and by truth."""
    found = {}
    for name, score in SCORES.items():
        by = {t: score.rate([r for r in records if r["truth"] == t]) for t in kinds.ISOLATION_TRUTHS}
        found[name] = score.rate(records) | {t: v for t, v in by.items() if v["of"]} | {"target": score.target or None}
    return found


def outcomes_by_kind(records: Sequence[Record]) -> dict[str, Any]:
    """Outcomes and rates of every kind of trials, and of all."""
    found: dict[str, Any] = {}
    for kind in (*kinds.ISOLATION_KINDS, ALL):
        own = [r for r in records if kind in (ALL, r["kind"])]
        if own:
            came = Counter(r["outcome"] for r in own)
            rates = {n: SCORES[n].rate(own) for n in ("right_name", "exact", "covered", "interval", "false_sensor")}
            found[kind] = {"trials": len(own), "outcomes": {o: came[o] for o in OUTCOMES}, **rates}
    return found


def reliability(records: Sequence[Record]) -> dict[str, list[dict[str, Any]]]:
    """Stated probability against how often it is right: of all names, of those of every kind of trials, of classes
    that hold the truth or not, of the answer that nothing has changed, and of every named place that it changed."""
    found = {ALL: _bins(stated_probabilities(records))}
    for kind in kinds.ISOLATION_KINDS:
        found[kind] = _bins(stated_probabilities([r for r in records if r["kind"] == kind]))
    found["class"] = _bins(stated_probabilities(records, "stated_class"))
    found["nothing"] = _bins(stated_probabilities(records, "stated_nothing"))
    found["changed"] = _bins([(p, right) for r in records for p, right in r["marks"].get("stated_changed", ())])
    return {kind: rows for kind, rows in found.items() if rows}


def _bins(stated: Sequence[tuple[float, bool]]) -> list[dict[str, Any]]:
    edges = list(pairwise(PROBABILITY_BINS))
    by_bin = [[(p, r) for p, r in stated if low <= p < high or (high == 1.0 and p >= 1.0)] for low, high in edges]
    return [reliability_bin(low, high, own) for (low, high), own in zip(edges, by_bin, strict=True) if own]


def isolation_document(plan: TrialPlan, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sheet, reliability tables and outcomes by kind, and what was run."""
    return {
        "schema": ISOLATED.id,
        "sheet": isolation_sheet(records),
        "reliability": reliability(records),
        "kinds": outcomes_by_kind(records),
        "engines": {e: outcomes_by_kind([r for r in records if r["engine"] == e])["all"] for e in _engines(records)},
        "trials": len(records),
        "failed_records": sum(r["failed_records"] for r in records),
        "seed": plan.seed,
        "truths": list(plan.truths),
        "chosen_kinds": list(plan.kinds),
        "engine_files": [Path(e).name for e in plan.engines],
        "versions": versions(),
    }


def _engines(records: Sequence[Mapping[str, Any]]) -> list[str]:
    return sorted({r["engine"] for r in records})


def isolation_sheet_rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row per score, then per bin of stated probability and kind, then per kind and outcome."""
    return [*_sheet_rows(found), *_bin_rows(found), *_outcome_rows(found)]


def _sheet_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for name, entry in found["sheet"].items():
        target = entry["target"] or ""
        yield {
            "table": "sheet",
            "score": name,
            **numbers(entry),
            "target": target,
            "met": target_met(entry["rate"], target),
        }


def _bin_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for kind, own in found["reliability"].items():
        for b in own:
            place = {"kind": kind, "bin": f"{b['from']:g} to {b['to']:g}", "stated": b["stated"], "gap": b["gap"]}
            yield {"table": "reliability", "score": "right", **place, **numbers(b)}


def _outcome_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for kind, own in found["kinds"].items():
        for name in OUTCOMES:
            yield {
                "table": "outcomes",
                "score": name,
                "kind": kind,
                "count": own["outcomes"][name],
                "of": own["trials"],
            }
        for name, entry in own.items():
            if isinstance(entry, Mapping) and "rate" in entry and entry["of"]:
                yield {"table": "kinds", "score": name, "kind": kind, **numbers(entry)}


def isolation_tables(found: Mapping[str, Any]) -> list[list[dict[str, Any]]]:
    """Sheet with targets, reliability, outcomes by kind and by engine."""
    scores = [
        {
            "score": name,
            "rate": cell(entry),
            "target": target_words(entry["target"]),
            "met": target_met(entry["rate"], entry["target"]),
        }
        for name, entry in found["sheet"].items()
        if entry["of"]
    ]
    bins = [
        {
            "names of": kind,
            "stated": f"{b['from']:g} to {b['to']:g}",
            "mean stated": f"{b['stated']:.3f}",
            "right": cell(b),
            "gap": f"{b['gap']:+.3f}",
        }
        for kind, own in found["reliability"].items()
        for b in own
    ]
    return [scores, bins, _outcomes(found["kinds"], "kind"), _outcomes(found["engines"], "engine")]


def _outcomes(groups: Mapping[str, Any], what: str) -> list[dict[str, Any]]:
    return [
        {
            what: group,
            "trials": own["trials"],
            **{name: own["outcomes"][name] for name in OUTCOMES},
            **{n: cell(own[n]) for n in ("right_name", "exact", "covered", "interval", "false_sensor")},
        }
        for group, own in groups.items()
    ]
