"""Trials of the account of change over flights, from the seed to the marks, and their sheet.

A story has none to three events of different components and instruments, each a course per flight times a change of
parameters. The engine is flown through it; `identify` gets healthy flights, `trend` the others, as files.
Marks, where e is a true event and v a reported one whose suspect or ambiguity group has e's owner:

    false_finding  something is reported where nothing happened
    named          every e: whether there is a v
    extra          every v: whether it is of no e; a story may be told right and another change beside it wrong
    shape          v is of e's family, or irregular
    onset          v's 95 % set has the first affected flight
    size           of every changed parameter, whether v's 95 % interval has what it is off by in the last flight; of an
                   intermittent fault, by how much while it lasts
    wash           growth is reported before a wash, and the wash where it was
    stated         probability of the leading suspect of each v, and whether it changed
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import (
    copy_engine_file,
    draw_engine_file,
    draw_health,
    random_stream,
    write_recording,
)
from enginediag_cli.validation.isolation_trials import FIELD_STEP_S, field_flights
from enginediag_cli.validation.trial_flights import stack_flights, true_readings
from enginediag_cli.validation.trials import Record, TrialPlan, diagnoser, rate, short, versions
from enginediag_cli.validation.truth_instruments import (
    RealisticErrors,
    add_sensor_noise,
    draw_realistic,
    realistic_engine,
)

FOULING, FOULING_WASHED, OBJECT_DAMAGE, EROSION = "fouling", "fouling and wash", "object damage", "erosion"
DRIFT, SENSOR_STEP, SENSOR_INTERMITTENT = "sensor drift", "sensor step", "intermittent sensor"
REPAIRED, OFF_FROM_START = "fault that is repaired", "off nominal from the start"
EVENTS = (
    FOULING,
    FOULING_WASHED,
    OBJECT_DAMAGE,
    EROSION,
    DRIFT,
    SENSOR_STEP,
    SENSOR_INTERMITTENT,
    REPAIRED,
    OFF_FROM_START,
)
"""Kinds of events, each as often as the others."""
HEALTHY_SHARE = 0.25
"""Share of histories in which nothing happens: a hundred of four hundred, so that one false finding is one per cent."""
COUNTS = (0.6, 0.3, 0.1)
"""Probabilities of one, two and three events where there are any."""
FLIGHTS = (20, 200)
"""Flights of a history, from and to, uniform in the logarithm."""
COMPRESSORS, TURBINES = ("booster", "hpc"), ("hpt", "lpt")
FOULED, WASHED = (0.01, 0.04), (0.5, 1.0)
"""Loss of flow capacity by fouling at its largest, and share of it that a wash brings back."""
FOULED_RATIO = (1 / 3, 1.0)
"""Loss of efficiency for that of flow capacity (Mathioudakis et al. 2024)."""
DAMAGE = (0.006, 0.03)
"""Loss of efficiency by foreign objects; flow capacity by half of it to all of it."""
ERODED = (0.006, 0.03)
"""Loss of turbine efficiency by erosion; flow capacity rises by as much to twice as much."""
INSTRUMENT = (1.0, 5.0)
"""Error of an instrument, in standard deviations of one reading."""
FEWEST_TO_RETURN = 4
"""Flights in which what comes and goes can be seen twice."""
EARLIEST, LATEST = 0.15, 0.8
"""Shares of the history between which events begin: something before, and something after."""


@dataclass(frozen=True)
class StoryEvent:
    """One event: kind, owner (component of parameters), onset: first flight with an effect, from 0; end: first without,
    −1; changes: parameter → its change (T,) over the flights, in its unit."""

    kind: str
    owner: str
    onset: int
    end: int
    changes: Mapping[str, np.ndarray]

    @property
    def shape(self) -> str:
        """Family of its course, as a scorer compares it."""
        return {
            FOULING: "growth",
            EROSION: "growth",
            DRIFT: "growth",
            FOULING_WASHED: "growth and end",
            REPAIRED: "pulse",
            OBJECT_DAMAGE: "step",
            SENSOR_STEP: "step",
            SENSOR_INTERMITTENT: "intermittent",
            OFF_FROM_START: "from start",
        }[self.kind]


@dataclass(frozen=True)
class Story:
    """Flights, and what happened in them."""

    flights: int
    events: tuple[StoryEvent, ...] = ()
    maintenance: tuple[int, ...] = field(default=())


def draw_story(rng: np.random.Generator, sensors: Mapping[str, float], components: Sequence[str]) -> Story:
    """sensors: component of a column ("sensor.T3") → standard deviation of one reading; components: the engine's."""
    low, high = np.log(FLIGHTS)
    T = round(float(np.exp(rng.uniform(low, high))))
    if rng.random() < HEALTHY_SHARE:
        return Story(T)
    count = 1 + int(rng.choice(3, p=COUNTS))
    events: list[StoryEvent] = []
    for kind in rng.permutation(EVENTS)[:count]:
        taken = {e.owner for e in events}
        drawn = _draw_event(str(kind), T, rng, sensors, components, taken)
        events.append(drawn)
    washes = tuple(sorted({e.end for e in events if e.kind == FOULING_WASHED}))
    return Story(T, tuple(events), washes if rng.random() < 0.5 else ())


def _draw_event(
    kind: str,
    T: int,
    rng: np.random.Generator,
    sensors: Mapping[str, float],
    components: Sequence[str],
    taken: set[str],
) -> StoryEvent:
    onset = int(rng.integers(max(int(EARLIEST * T), 3), int(LATEST * T)))
    since = np.arange(T) - onset + 1.0
    on = since > 0
    if kind in (DRIFT, SENSOR_STEP, SENSOR_INTERMITTENT):
        owner = str(rng.choice(sorted(set(sensors) - taken)))
        size = sensors[owner] * rng.uniform(*INSTRUMENT) * rng.choice((-1.0, 1.0))
        course = _instrument_course(kind, since, on, rng)
        first = int(np.flatnonzero(course)[0])
        return StoryEvent(kind, owner, first, -1, {f"{owner}.bias": size * course})
    if kind == OFF_FROM_START:
        return _draw_off_from_start(T, rng, sensors, components, taken)
    kinds = {FOULING: COMPRESSORS, FOULING_WASHED: COMPRESSORS, EROSION: TURBINES}.get(kind, tuple(components))
    owner = str(rng.choice(sorted((set(kinds) & set(components)) - taken) or sorted(set(components) - taken)))
    efficiency, flow = _component_size(kind, owner, rng)
    course, end = _component_course(kind, T, since, on, rng)
    changes = {f"{owner}.efficiency": efficiency * course, f"{owner}.flow_capacity": flow * course}
    return StoryEvent(kind, owner, int(np.flatnonzero(course)[0]), end, changes)


def _instrument_course(kind: str, since: np.ndarray, on: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    if kind == DRIFT:
        return np.where(on, since, 0.0) / since[-1]
    if kind == SENSOR_STEP:
        return on.astype(float)
    while True:  # a two-state chain: there for three flights and away for five, on the average; twice at least
        state, course = True, np.zeros(len(since))
        for t in np.flatnonzero(on):
            course[t] = state
            state = rng.random() < (0.67 if state else 0.2)
        if np.sum(np.diff(course, prepend=0.0) > 0) > 1 or on.sum() < FEWEST_TO_RETURN:
            return course


def _draw_off_from_start(
    T: int, rng: np.random.Generator, sensors: Mapping[str, float], components: Sequence[str], taken: set[str]
) -> StoryEvent:
    course = np.ones(T)
    if rng.random() < 0.5:
        owner = str(rng.choice(sorted(set(sensors) - taken)))
        size = sensors[owner] * rng.uniform(2.0, 2 * INSTRUMENT[1]) * rng.choice((-1.0, 1.0))
        return StoryEvent(OFF_FROM_START, owner, 0, -1, {f"{owner}.bias": size * course})
    owner = str(rng.choice(sorted(set(components) - taken)))
    efficiency, flow = (1.5 * x for x in _component_size(OBJECT_DAMAGE, owner, rng))
    return StoryEvent(
        OFF_FROM_START,
        owner,
        0,
        -1,
        {f"{owner}.efficiency": efficiency * course, f"{owner}.flow_capacity": flow * course},
    )


def _component_size(kind: str, owner: str, rng: np.random.Generator) -> tuple[float, float]:
    """Change of efficiency and of flow capacity at the largest."""
    if kind in (FOULING, FOULING_WASHED):
        flow = rng.uniform(*FOULED)
        return -flow * rng.uniform(*FOULED_RATIO), -flow
    if owner in TURBINES:
        loss = rng.uniform(*ERODED)
        return -loss, loss * rng.uniform(1.0, 2.0)
    loss = rng.uniform(*DAMAGE)
    return -loss, -loss * rng.uniform(0.5, 1.0)


def _component_course(
    kind: str, T: int, since: np.ndarray, on: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """Course (T,), and its end, −1 where there is none."""
    onset = int(np.argmax(on))
    later = int(rng.integers(min(onset + max(T // 8, 4), T - 2), T - 1)) if onset < T - 3 else -1
    if kind in (FOULING, FOULING_WASHED):
        tau = float(rng.uniform(0.08, 0.3) * T)
        linear = rng.random() < 0.5
        grown = np.where(on, since / since[-1] if linear else -np.expm1(-since / tau), 0.0)
        if kind == FOULING or later < 0:
            return grown, -1
        level = (1 - rng.uniform(*WASHED)) * grown[later - 1]
        again = grown[np.clip(np.arange(T) - later + onset, 0, T - 1)]
        washed = np.where(np.arange(T) >= later, level + (1.0 if linear else 1 - level) * again, grown)
        return washed / washed.max(), later
    if kind == EROSION:
        return np.where(on, since, 0.0) / since[-1], -1
    if kind == REPAIRED and later > 0:
        return np.where(np.arange(T) < later, on, False).astype(float), later
    return on.astype(float), -1


HEALTHY = 12
"""Healthy flights on which an engine is identified."""
RECORDED_EVERY_S = 120.0
"""Time between records: what airlines' monitoring keeps of a flight. Lags and clocks act on points closer by."""
HISTORY_STREAM, STORY_STREAM, ERRORS_STREAM = 20, 21, 22
"""Streams of random numbers that no other trials use."""
FAMILIES: Mapping[str, frozenset[str]] = {
    "growth": frozenset({"ramp", "saturating", "ramp, then steady", "accelerating"}),
    "growth and end": frozenset({"saturating, ended", "ramp, ended", "growing, restored, growing"}),
    "pulse": frozenset({"pulse"}),
    "step": frozenset({"step"}),
    "intermittent": frozenset({"intermittent"}),
    "from start": frozenset({"from start"}),
}
"""Family of a true course → shapes that are right."""
IRREGULAR = "irregular"
PROBABILITY_BINS = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges of stated probabilities whose truth is counted."""
LEAST_IN_BIN = 10
"""Statements in a bin below which its gap is chance."""


@dataclass(frozen=True)
class ConcealedHistory:
    """The answer of a trial. flights: inputs of every flight, `HEALTHY` healthy ones first; realistic: what else is
    wrong, None where nothing is; every: points of a flight for each that is recorded."""

    trial: int
    truth: str
    story: Story
    health: Mapping[str, float]
    flights: Sequence[Mapping[str, np.ndarray]]
    realistic: RealisticErrors | None
    noise_seed: int
    every: int


def sensor_columns(engine: Engine) -> dict[str, str]:
    """Component of a sensor's error → its column."""
    return {f"sensor.{s.quantity}": c for c, s in engine.sensors.items()}


def rotating_components(engine: Engine) -> list[str]:
    """Components with an efficiency and a flow capacity, which foul, erode and are damaged."""
    return [
        p.component
        for p in engine.parameters.values()
        if p.quantity == "efficiency"
        and p.name in engine.monitored
        and f"{p.component}.flow_capacity" in engine.monitored
    ]


def draw_history(engine: Engine, seed: int, trial: int, truths: Sequence[str]) -> ConcealedHistory:
    """Trial number `trial` of a seed, of one of these truths."""
    rng = random_stream(seed, trial, HISTORY_STREAM)
    truth = str(rng.choice(list(truths)))
    noise = {owner: float(engine.sensors[c].noise_sigma) for owner, c in sensor_columns(engine).items()}
    story = draw_story(random_stream(seed, trial, STORY_STREAM), noise, rotating_components(engine))
    flights = field_flights(engine, HEALTHY + story.flights, rng)
    health, every, realistic = draw_health(engine, rng), round(RECORDED_EVERY_S / FIELD_STEP_S), None
    if truth == kinds.REALISTIC:
        realistic = draw_realistic(engine, flights, random_stream(seed, trial, ERRORS_STREAM), airline=0.0)
    else:
        flights, every = [{c: v[::every] for c, v in flight.items()} for flight in flights], 1
    return ConcealedHistory(trial, truth, story, health, flights, realistic, int(rng.integers(2**62)), every)


def record_history(engine: Engine, concealed: ConcealedHistory, folder: Path) -> dict[str, Any]:
    """Fly the trial and write what is recorded into the open folder; the question of the diagnosing process."""
    rng, drawn = np.random.default_rng(concealed.noise_seed), concealed.realistic
    healthy = stack_flights(concealed.flights[:HEALTHY])
    truth = engine if drawn is None else realistic_engine(engine, drawn, healthy)
    sensors = drawn.sensors if drawn else tuple(engine.sensors)
    written: list[dict[str, np.ndarray]] = []
    for k, flight in enumerate(concealed.flights):
        columns = _read_flight(truth, concealed, k, flight)
        columns = {c: v[:: concealed.every] for c, v in columns.items()}
        good = np.isfinite(np.stack([columns[c] for c in sensors])).all(axis=0)
        columns = drawn.write(engine, columns, rng) if drawn else add_sensor_noise(engine, 0.0, columns, rng)
        kept = {c: columns[c][good] for c in ("time_s", *engine.inputs, *sensors)}
        written.append({"flight": np.full(int(good.sum()), k + 1), **kept})
    paths = [folder / "healthy.csv", folder / "judged.csv"]
    for path, part in zip(paths, (written[:HEALTHY], written[HEALTHY:]), strict=True):
        write_recording(path, {c: np.concatenate([flight[c] for flight in part]) for c in part[0]})
    engine_file = copy_engine_file(folder, engine)
    events = [str(HEALTHY + t + 1) for t in concealed.story.maintenance]
    return {"engine": str(engine_file), "healthy": [str(paths[0])], "judged": str(paths[1]), "maintenance": events}


def _read_flight(
    truth: Engine, concealed: ConcealedHistory, k: int, flight: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Columns (N,) of flight k as instruments show it, without noise."""
    theta, t = dict(concealed.health), k - HEALTHY
    changes: dict[str, float] = {}
    for event in concealed.story.events if t >= 0 else ():
        for name, course in event.changes.items():
            changes[name] = changes.get(name, 0.0) + float(course[t])
    read = [f"{owner}.bias" for owner in sensor_columns(truth)]  # added to what the instrument shows
    for name in sorted(changes.keys() - read):
        theta[name] = theta.get(name, truth.parameters[name].nominal) + changes[name]
    given = {c: flight[c] for c in ("time_s", *truth.inputs)}
    columns = given | dict(zip(truth.sensors, true_readings(truth, [flight], theta).T, strict=True))
    columns = concealed.realistic.read(k, columns) if concealed.realistic else columns
    for owner, column in sensor_columns(truth).items():
        columns[column] = columns[column] + changes.get(f"{owner}.bias", 0.0)
    return columns


def run_group(plan: TrialPlan, trials: Sequence[int]) -> list[dict[str, Any]]:
    """Draw, record, ask and mark the trials of one group."""
    return [_run_trial(plan, trial) for trial in trials]


def _run_trial(plan: TrialPlan, trial: int) -> dict[str, Any]:
    start = process_time()
    engine = load_engine(draw_engine_file(plan.engines, plan.seed, plan.group(trial)))
    concealed = draw_history(engine, plan.seed, trial, plan.truths)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        question = record_history(engine, concealed, Path(folder))
        answer = diagnoser().ask({"task": kinds.HISTORY, **question})
    return {
        "trial": trial,
        "truth": concealed.truth,
        "kind": kinds.HISTORY,
        "engine": engine.name,
        "group": plan.group(trial),
        "flights": concealed.story.flights,
        "events": [_event_json(e) for e in concealed.story.events],
        "answer": answer,
        "error": answer.get("error", ""),
        "marks": mark_history(concealed.story, answer),
        "seconds": round(process_time() - start, 3),
        "trend_seconds": round(answer.get("seconds", 0.0), 3),
    }


def _event_json(event: StoryEvent) -> dict[str, Any]:
    last = {name: short(float(course[-1])) for name, course in event.changes.items()}
    return {"kind": event.kind, "owner": event.owner, "onset": event.onset, "end": event.end, "last": last}


def mark_history(story: Story, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Marks of the answer, lists of 0 and 1; `answer` as `diagnoser.follow_history` gives it."""
    reported = answer.get("events", [])
    marks: dict[str, Any] = {"named": [], "shape": [], "onset": [], "size": [], "wash": []}
    if not story.events:
        marks["false_finding"] = [int(bool(reported))]
    owners = {event.owner for event in story.events}
    marks["extra"] = [int(not owners & set(v["group"])) for v in reported]
    leading = [(v["probability"] * v["suspects"][v["group"][0]], v["group"][0]) for v in reported]
    marks["stated"] = [[short(p), int(name in owners)] for p, name in leading]
    for event in story.events:
        own = [v for v in reported if event.owner in v["group"]]
        marks["named"].append(int(bool(own)))
        if own:
            _mark_event(marks, event, max(own, key=lambda v: v["probability"]))
        elif event.kind == FOULING_WASHED and event.end > 0:
            marks["wash"].append(0)
    return marks


def _mark_event(marks: dict[str, Any], event: StoryEvent, v: Mapping[str, Any]) -> None:
    shape = max(v["shapes"], key=lambda name: v["shapes"][name])
    marks["shape"].append(int(shape in FAMILIES[event.shape] or shape == IRREGULAR))
    marks["onset"].append(int(event.onset in v["onset_set"]))
    if event.kind == FOULING_WASHED and event.end > 0:
        marks["wash"].append(int(v["growing"] >= 0.5 and abs(v["end"] - event.end) <= 1))
    if v["group"][0] != event.owner:
        return
    lasting = event.shape == "intermittent" and shape == "intermittent"
    for name, course in event.changes.items():
        true = float(course[np.argmax(np.abs(course))] if lasting else course[-1])
        found = [x for x in v["changes"] if x["name"] == name]
        low, high = (found[0]["largest" if lasting else "now"] if found else (0.0, 0.0))[-2:]
        marks["size"].append(int(low - TINY <= true <= high + TINY))


TINY = 1e-12
"""What a size of zero may differ from zero by."""


@dataclass(frozen=True)
class HistoryScore:
    """A line of the sheet: which marks are counted, how they should come out for both truths, and whether in a band."""

    name: str
    words: str
    clean: tuple[float, float]
    realistic: tuple[float, float]


SCORES = (
    HistoryScore("false_finding", "false findings on healthy histories", (0.0, 0.01), (0.0, 0.02)),
    HistoryScore("named", "right component or instrument, or its ambiguity group", (0.97, 1.0), (0.88, 1.0)),
    HistoryScore("shape", "shape right, or irregular", (0.9, 1.0), (0.8, 1.0)),
    HistoryScore("onset", "95 % onset set holds", (0.92, 0.98), (0.9, 1.0)),
    HistoryScore("size", "95 % interval of the size now holds", (0.92, 0.98), (0.9, 1.0)),
    HistoryScore("wash", "growth before a wash, and the wash", (0.9, 1.0), (0.8, 1.0)),
    HistoryScore("extra", "reported events of what did not change", (0.0, 1.0), (0.0, 1.0)),
)
"""The table of targets; `extra` has none."""


def history_sheet(records: Sequence[Record]) -> list[dict[str, Any]]:
    """One row per truth and figure: rate with its 95 % interval, and its target."""
    rows = []
    for truth in dict.fromkeys(r["truth"] for r in records):
        own = [r for r in records if r["truth"] == truth]
        for score in SCORES:
            hits = [x for r in own for x in r["marks"].get(score.name, [])]
            low, high = score.realistic if truth == kinds.REALISTIC else score.clean
            if hits:
                rows.append(_row(truth, score.words, sum(hits), len(hits), low, high))
        rows += _reliability_rows(truth, own)
    return rows


def _row(truth: str, words: str, hits: int, count: int, low: float, high: float) -> dict[str, Any]:
    found = rate([True] * hits + [False] * (count - hits))
    return {
        "truth": truth,
        "figure": words,
        "hits": hits,
        "count": count,
        "rate": found["rate"],
        "low": found["low"],
        "high": found["high"],
        "target": f"{100 * low:.3g} to {100 * high:.3g} %" if (low, high) != (0.0, 1.0) else "",
        "met": low <= found["rate"] <= high,
    }


def _reliability_rows(truth: str, records: Sequence[Record]) -> Iterator[dict[str, Any]]:
    """How often leading suspects are right, by what was stated of them; then the largest gap between both, over bins
    with enough."""
    stated = np.array([x for r in records for x in r["marks"]["stated"]], float).reshape(-1, 2)
    limit = 0.08 if truth == kinds.REALISTIC else 0.05
    gaps = [0.0]
    for low, high in pairwise(PROBABILITY_BINS):
        here = stated[(stated[:, 0] >= low) & ((stated[:, 0] < high) | (high == 1.0))]
        if not len(here):
            continue
        mean, right = float(here[:, 0].mean()), int(here[:, 1].sum())
        words = f"leading suspect right where stated {low:g} to {high:g}, {100 * mean:.1f} % in the mean"
        yield _row(truth, words, right, len(here), max(mean - limit, 0.0), min(mean + limit, 1.0))
        if len(here) >= LEAST_IN_BIN:
            gaps.append(abs(mean - right / len(here)))
    yield {
        "truth": truth,
        "figure": f"largest gap of these, where {LEAST_IN_BIN} or more",
        "hits": None,
        "count": len(stated),
        "rate": max(gaps),
        "low": None,
        "high": None,
        "target": f"0 to {100 * limit:g} %",
        "met": max(gaps) <= limit,
    }


def history_document(plan: TrialPlan, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The sheet with what it was made from."""
    return {
        "seed": plan.seed,
        "trials": len(records),
        "failed": sum(bool(r["error"]) for r in records),
        "versions": versions(),
        "sheet": history_sheet(records),
    }
