"""Monte-Carlo studies: the study file, its batches of diagnoses, and the counts as rows.

Fault cases are changes of parameters that are given, or drawn for every diagnosis. The monitor knows nominal state and
noise exactly, as in the published experiment. A study is cut into batches that do not depend on each other. Each is
flown by the full nonlinear model and recorded with noise. Tallies of two batches add up, so batches may run anywhere
and in any order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli import __version__
from enginediag_cli.config.fields import Field, Section, Variants, near
from enginediag_cli.config.files import named_file
from enginediag_cli.config.validate import load_checked
from enginediag_cli.errors import ConfigError, DataError, Problem
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior
from enginediag_cli.methods.base import PARAMETERS, FittedMethod, RecordWindows, Verdicts
from enginediag_cli.methods.estimation import ScoredWindows
from enginediag_cli.methods.registry import SECTIONS, chosen_method
from enginediag_cli.parameters import meanings
from enginediag_cli.report.tables.trials import STUDY
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor, match_parameters
from enginediag_cli.simulation.flights import (
    MISSION,
    NOISE,
    ColumnNoise,
    engine_inputs,
    generate_flights,
    noise_sources,
)
from enginediag_cli.validation.trials import Journal, JournalFormat, content_hash, design_effect, exact_rate

if TYPE_CHECKING:
    from enginediag_cli.methods.base import Method


SIGNS = {"both": (-1.0, 1.0), "fall": (-1.0,), "rise": (1.0,)}
"""Directions to draw from."""

DRAW = Section(
    "draw",
    "faults at random",
    (
        Field(
            "faults",
            "range",
            "least and largest number of changed parameters; from the prior of the posterior method where absent",
            None,
            minimum=0,
        ),
        Field(
            "size",
            "range",
            "least and largest change: relative where nominal is not 0, else in the parameter's unit; "
            "from the prior of the posterior method where absent",
            None,
            minimum=0.0,
        ),
        Field(
            "sigmas",
            "range",
            "least and largest change in the parameter's prior standard deviations, instead of size",
            None,
            minimum=0.0,
        ),
        Field("sign", "choice", "direction of changes whose size is given", "both", choices=tuple(SIGNS)),
        Field(
            "among", "texts", "parameters that may change, names or patterns; all that are monitored where absent", ()
        ),
    ),
)

CASE = Section(
    "case",
    "what is wrong with the engine; nothing where neither changes nor draw are given",
    (
        Field("description", "text", "in words", ""),
        Field("repetitions", "integer", "diagnoses of this case", minimum=1),
        Field(
            "changes",
            "number_map",
            "change of each parameter, relative where nominal is not 0, else in the parameter's unit",
            {},
        ),
        Field("draw", "section", "faults drawn anew for every diagnosis, instead of changes", None, section=DRAW),
    ),
)


@dataclass(frozen=True)
class FaultCase:
    """A case over p monitored parameters: `changes` (p,) in their units, or `draw` among the candidates (p,) bool."""

    name: str
    repetitions: int
    changes: np.ndarray
    draw: Mapping[str, Any] | None
    candidates: np.ndarray

    def draw_changes(self, monitor: Monitor, count: int, rng: np.random.Generator) -> np.ndarray:
        """Changes (count, p), in parameter units, zero where a parameter has not changed."""
        if self.draw is None:
            return np.tile(self.changes, (count, 1))
        among = np.flatnonzero(self.candidates)
        prior, sigma = SetPrior(), monitor.prior_sigma[among]
        monitored = list(meanings(monitor.meaning, [monitor.names[i] for i in among]).values())
        wear = np.array([p.wear for p in monitored])
        changed, size = prior.draw(rng, count, len(among), InstrumentForms.from_parameters(monitored), wear)
        if self.draw["faults"] is not None:
            low, high = self.draw["faults"]
            number = rng.integers(int(low), int(high) + 1, size=count)
            rank = np.argsort(np.argsort(rng.random(changed.shape), axis=1), axis=1)
            changed = rank < number[:, None]
            size = rng.choice(np.asarray(prior.slabs), size=(count, 1)) * rng.standard_normal(changed.shape)
            size *= prior.widths(monitored)
        unit = sigma
        if self.draw["size"] is not None or self.draw["sigmas"] is not None:
            given = "size" if self.draw["size"] is not None else "sigmas"
            if given == "size":
                nominal = np.abs(monitor.theta0[among])
                unit = np.where(nominal > 0, nominal, 1.0)
            low, high = self.draw[given]
            sign = rng.choice(SIGNS[self.draw["sign"]], size=changed.shape)
            size = sign * rng.uniform(low, high, size=changed.shape)
        changes = np.zeros((count, len(monitor.names)))
        changes[:, among] = np.where(changed, size * unit, 0.0)
        return changes


def build_case(values: Mapping[str, Any], monitor: Monitor) -> FaultCase:
    """Case from the values of its section. DataError for parameters that the study does not monitor."""
    unknown = [name for name in values["changes"] if name not in monitor.names]
    if unknown:
        raise DataError(f"the study does not monitor {unknown[0]!r} ({near(unknown[0], monitor.names)})")
    draw = values["draw"]
    if draw is not None and values["changes"]:
        raise DataError("a case has changes or draws them, not both")
    candidates = np.ones(len(monitor.names), bool)
    if draw is not None:
        if draw["size"] is not None and draw["sigmas"] is not None:
            raise DataError("sizes are given by size or by sigmas, not both")
        patterns = draw["among"] or ["*"]
        idle = [q for q in patterns if not any(fnmatchcase(name, q) for name in monitor.names)]
        if idle:
            raise DataError(f"the study monitors nothing that matches {idle[0]!r} ({near(idle[0], monitor.names)})")
        candidates = np.array([any(fnmatchcase(name, q) for q in patterns) for name in monitor.names])
        if draw["faults"] is not None and draw["faults"][1] > candidates.sum():
            raise DataError(f"more faults than the {candidates.sum()} parameters that may change")
    scale = np.where(monitor.theta0 != 0, monitor.theta0, 1.0)
    relative = np.array([values["changes"].get(name, 0.0) for name in monitor.names])
    changed = monitor.theta0 + relative * scale
    beyond = [
        n
        for n, x, low, high in zip(monitor.names, changed, monitor.lower, monitor.upper, strict=True)
        if not low <= x <= high
    ]
    if beyond:
        raise DataError(f"the change of {beyond[0]} leaves its bounds")
    return FaultCase(values["name"], values["repetitions"], relative * scale, draw, candidates)


def healthy_case(monitor: Monitor, repetitions: int) -> FaultCase:
    """Nothing is wrong."""
    p = len(monitor.names)
    return FaultCase("healthy", repetitions, np.zeros(p), None, np.ones(p, bool))


STUDY_FILE = Section(
    "study",
    "a Monte-Carlo study of diagnosis",
    (
        Field("kind", "choice", "kind of file", "study", choices=("study",)),
        Field("description", "text", "what the study is to show", ""),
        Field("source", "text", "where cases and numbers come from", ""),
        Field("engine", "text", "engine file, relative to this file; or one that comes with the program"),
        Field(
            "monitor",
            "texts",
            "parameters that may have changed, names or patterns such as 'sensor.*.bias'; those "
            "that the engine file monitors where absent",
            (),
        ),
        Field("records", "integer", "records of one diagnosis", minimum=1),
        Field(
            "mission",
            "section",
            "operating conditions, drawn anew for every diagnosis",
            section=MISSION,
        ),
        Field("constants", "number_map", "further inputs of the engine, each constant", {}),
        Field("noise", "section", "sensor noise; its size is known to the methods", {}, section=NOISE),
        Field("cases", "named_sections", "what is wrong with the engine", section=CASE),
        Field("methods", "named_sections", "who diagnoses", section=Variants("method", "kind of method", SECTIONS)),
        Field(
            "false_alarm",
            "number",
            "false-alarm probability of detection, and level of rejection tests",
            0.01,
            minimum=1e-6,
            maximum=0.5,
        ),
        Field("reliability", "boolean", "ask how often answers of a stated probability are right", False),
        Field("seed", "integer", "seed of everything random", 0, minimum=0),
    ),
)


@dataclass(frozen=True)
class Study:
    """A study ready to run. `missions` are the values of the section; `methods` by the names that the study gives."""

    path: Path
    monitor: Monitor
    records: int
    plan: Mapping[str, Any]
    noise: Mapping[str, ColumnNoise]
    cases: tuple[FaultCase, ...]
    methods: Mapping[str, Method]
    false_alarm: float
    reliability: bool
    seed: int


def load_study(path: str | Path) -> Study:
    """Read a study and its engine; raises ConfigError with every problem that can be seen before it runs."""
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.simulation.flights import column_noise

    checked = load_checked(path, "study")
    values = checked.values
    engine = load_engine(named_file(Path(path), values["engine"], "engine file", checked.mark(("engine",))))
    noise = column_noise(values["noise"], engine, checked.mark(("noise",)))
    try:
        monitor = known_nominal(engine, values["monitor"], noise)
    except DataError as error:
        raise ConfigError([Problem(checked.mark(("monitor",)), str(error))]) from None
    problems = [
        checked.problem((key,), f"there are no {key}; one is needed") for key in ("cases", "methods") if not values[key]
    ]
    cases = []
    for k, case in enumerate(values["cases"]):
        try:
            cases.append(build_case(case, monitor))
        except DataError as error:
            problems.append(checked.problem(("cases", k), str(error)))
    if problems:
        raise ConfigError(problems)
    plan = {"flights": 1, "mission": values["mission"], "constants": values["constants"]}
    methods = {m["name"]: chosen_method(m) for m in values["methods"]}
    return Study(
        Path(path),
        monitor,
        values["records"],
        plan,
        noise,
        tuple(cases),
        methods,
        values["false_alarm"],
        values["reliability"],
        values["seed"],
    )


def known_nominal(engine: Any, patterns: Sequence[str], noise: Mapping[str, ColumnNoise]) -> Monitor:
    """Monitor of the parameters that `patterns` name, nothing about nominal being uncertain."""
    sensors = tuple(engine.sensors)
    names = match_parameters(engine, patterns)
    parameters = [engine.parameters[name] for name in names]
    silent = [column for column in sensors if standard_deviation(noise[column]) == 0]
    if silent:
        raise DataError(f"{', '.join(silent)}: sensors without noise cannot be weighed against each other")
    return Monitor(
        engine=engine,
        sensors=sensors,
        base={},
        names=names,
        monitored=names,
        meaning={p.name: p for p in parameters},
        offsets=(),
        theta0=np.array([p.nominal for p in parameters], float),
        prior_sigma=np.array([p.prior_sigma for p in parameters], float),
        lower=np.array([p.lower for p in parameters], float),
        upper=np.array([p.upper for p in parameters], float),
        uncertainty=np.zeros((len(names), len(names))),
        noise=NoiseModel(
            np.array([standard_deviation(noise[column]) for column in sensors]),
            np.array([noise[column].correlation for column in sensors]),
        ),
    )


def standard_deviation(noise: ColumnNoise) -> float:
    """Of the noise of one column, gross errors excluded; uniform noise of range w, and rounding, have w/√12."""
    size = {"gaussian": noise.sigma, "uniform": noise.width / 12**0.5, "none": 0.0}[noise.distribution]
    return float(np.hypot(size, noise.quantum / 12**0.5))


@dataclass(frozen=True)
class MethodAnswers:
    """On W windows: judged (W,): there is a verdict; detected (W,); isolated (W, p) bool, None for a method that
    names no parameters; probability (W,) that the answer is right, NaN for a method that states none."""

    judged: np.ndarray
    detected: np.ndarray
    isolated: np.ndarray | None
    probability: np.ndarray


def answers_from_verdicts(verdicts: Verdicts, parameters: Sequence[str]) -> MethodAnswers:
    """Methods that name sensors, not parameters, or nothing, are judged on detection only.

    The likeliest answer of a method that has one without an alarm counts on every window.
    """
    named = verdicts.isolated if verdicts.likeliest is None else verdicts.likeliest
    W = len(verdicts.converged)
    isolated = None
    if named is not None and verdicts.kind == PARAMETERS:
        isolated = np.zeros((W, len(parameters)), bool)
        isolated[:, [list(parameters).index(name) for name in verdicts.names]] = named
    probability = np.full(W, np.nan) if verdicts.probability is None else verdicts.probability
    return MethodAnswers(verdicts.judged, verdicts.alarm, isolated, probability)


@dataclass(frozen=True)
class StudyTrials:
    """W windows of n records with the changes (W, p) that made them; failed: records that the engine could not
    compute, which have no reading."""

    windows: RecordWindows
    changes: np.ndarray
    failed: int


def make_trials(
    monitor: Monitor,
    case: FaultCase,
    count: int,
    records: int,
    plan: Mapping[str, Any],
    noise: Mapping[str, ColumnNoise],
    rng: np.random.Generator,
) -> StudyTrials:
    """`count` trials of one case, all in one call of the engine."""
    engine = monitor.engine
    changes = case.draw_changes(monitor, count, rng)
    changes = np.clip(monitor.theta0 + changes, monitor.lower, monitor.upper) - monitor.theta0
    inputs = _conditions(engine, count, records, plan, rng)
    values = {
        name: np.repeat(monitor.theta0[i] + changes[:, i], records)
        for i, name in enumerate(monitor.names)
        if np.any(changes[:, i])
    }
    prediction = engine.predict(inputs, values, sensors=monitor.sensors)
    true = np.asarray(prediction.y).reshape(count, records, -1)
    readings = {column: true[:, :, j] for j, column in enumerate(monitor.sensors)}
    readings.update({c: v.reshape(count, records) for c, v in inputs.items()})
    read = _add_noise(readings, noise, count, rng)
    y = np.stack([read[column] for column in monitor.sensors], axis=2)
    return StudyTrials(RecordWindows({c: read[c] for c in inputs}, y), changes, int(np.sum(~np.asarray(prediction.ok))))


def _conditions(
    engine: Any, count: int, records: int, plan: Mapping[str, Any], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Engine inputs (count · records,). Missions whose points are independent are drawn at once."""
    if plan["mission"]["type"] in ("sweep", "snapshots"):
        return engine_inputs(engine, generate_flights(plan, engine, rng, records=count * records))
    parts = [engine_inputs(engine, generate_flights(plan, engine, rng, records=records)) for _ in range(count)]
    return {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}


def _add_noise(
    true: Mapping[str, np.ndarray], noise: Mapping[str, ColumnNoise], count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Readings (count, n) by column; every window has noise of its own, also where noise is correlated."""
    read = {column: np.array(values) for column, values in true.items()}
    for k in range(count):
        for column, source in noise_sources(noise, rng).items():
            read[column][k] = source.apply(true[column][k])
    return read


EDGES = np.array([0.0, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.0 + 1e-9])
"""Bins of stated probability, centred at 0.2, 0.3 … 0.9, with one below and one above."""

BLOCK = ("repetitions", "unchanged", "detected", "false_alarms", "exact", "contained")
"""Counts that every batch keeps of its own."""


@dataclass(frozen=True)
class Tally:
    """What became of `repetitions` diagnoses.

    judged: had a verdict; unchanged: nothing was wrong; false_alarms: of these, detected; exact: exactly the
    changed parameters isolated; contained: all of them and perhaps more; right_size: as many isolated as changed;
    isolated: parameters isolated in total; counts (p,): in how many answers each parameter is; counts_contained
    (p,): the same among the answers that contain all changed parameters; failed_records: not computed by the
    engine; seconds: CPU time of diagnosis; bins (bins, 3): answers, right answers and sum of stated probabilities;
    blocks (B, 6): counts of each batch that was added, as BLOCK names them, whose operating points were drawn together.
    `isolates`: the method names parameters.
    """

    repetitions: int
    judged: int
    unchanged: int
    detected: int
    false_alarms: int
    exact: int
    contained: int
    right_size: int
    isolated: int
    counts: np.ndarray
    counts_contained: np.ndarray
    failed_records: int
    seconds: float
    bins: np.ndarray
    isolates: bool
    blocks: np.ndarray

    def __add__(self, other: Tally) -> Tally:
        both: dict[str, Any] = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)[:-1]}
        both["isolates"] = self.isolates and other.isolates
        return Tally(**both, blocks=np.concatenate([self.blocks, other.blocks]))

    def counts_by_batch(self, name: str) -> np.ndarray:
        """Counts (B,) of each batch."""
        return np.asarray(self.blocks[:, BLOCK.index(name)])

    def to_json(self) -> dict[str, Any]:
        """Plain numbers and lists."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Tally:
        """Inverse of `to_json`; raises TypeError or KeyError for something else."""
        given: dict[str, Any] = {f.name: values[f.name] for f in fields(cls)}
        given |= {name: np.array(x) for name, x in given.items() if isinstance(x, list)}
        return cls(**given)


def tally(changes: np.ndarray, answers: MethodAnswers, seconds: float, failed_records: int) -> Tally:
    """Count the answers on windows with true `changes` (W, p)."""
    truth = changes != 0
    W, p = truth.shape
    found = np.zeros((W, p), bool) if answers.isolated is None else answers.isolated
    named = np.full(W, answers.isolated is not None) & answers.judged
    exact = named & np.all(found == truth, axis=1)
    contained = named & np.all(found | ~truth, axis=1)
    unchanged = ~truth.any(axis=1)
    detected = answers.judged & answers.detected
    bins = np.zeros((len(EDGES) - 1, 3))
    stated = named & np.isfinite(answers.probability)
    place = np.digitize(answers.probability[stated], EDGES) - 1
    np.add.at(bins, place, np.column_stack([np.ones(stated.sum()), exact[stated], answers.probability[stated]]))
    false_alarms = detected & unchanged
    block = [W, *(int(x.sum()) for x in (unchanged, detected, false_alarms, exact, contained))]
    return Tally(
        W,
        int(answers.judged.sum()),
        int(unchanged.sum()),
        int(detected.sum()),
        int(false_alarms.sum()),
        int(exact.sum()),
        int(contained.sum()),
        int((named & (found.sum(axis=1) == truth.sum(axis=1))).sum()),
        int(found[named].sum()),
        found[named].sum(axis=0),
        found[contained].sum(axis=0),
        failed_records,
        seconds,
        bins,
        answers.isolated is not None,
        np.array([block]),
    )


BATCH_RECORDS = 10_000
"""Records of a batch: one call of the engine for all of them hides the overhead of calls."""
TRAINING_RECORDS = 6_000
"""Healthy records that methods learn from."""
TRAINING_KEY = 2**31
"""Key of the random stream of these records, apart from those of all cases."""


@dataclass(frozen=True, order=True)
class StudyBatch:
    """Repetitions `first` … `first + count − 1` of case number `case`."""

    case: int
    first: int
    count: int


def batches(study: Study, repetitions: int | None = None) -> tuple[StudyBatch, ...]:
    """The whole study; `repetitions` replaces those of every case. Does not depend on who does the work."""
    size = max(BATCH_RECORDS // study.records, 1)
    found = []
    for k, case in enumerate(study.cases):
        total = repetitions or case.repetitions
        found += [StudyBatch(k, first, min(size, total - first)) for first in range(0, total, size)]
    return tuple(found)


class StudyRunner:
    """A study with its engine, and its methods once they are trained."""

    def __init__(self, study: Study, seed: int):
        self.study, self._seed = study, seed
        self._trained: dict[str, FittedMethod] = {}

    def run(self, batch: StudyBatch) -> dict[str, Tally]:
        """Tally of every method, by its name."""
        study, case = self.study, self.study.cases[batch.case]
        trained = self.trained()  # learning is not part of a diagnosis
        self._forget()
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(batch.case, batch.first)))
        trials = make_trials(study.monitor, case, batch.count, study.records, study.plan, study.noise, rng)
        faults = np.count_nonzero(trials.changes, axis=1)
        evidence = ScoredWindows(trials.windows.inputs, trials.windows.y, study.monitor, faults)
        result = {}
        for name, method in trained.items():
            evidence.used.clear()
            before, begun = sum(evidence.cost.values()), process_time()
            verdicts = method.diagnose(evidence, study.false_alarm)
            own = process_time() - begun - (sum(evidence.cost.values()) - before)
            seconds = own + sum(evidence.cost[what] for what in evidence.used)
            answers = answers_from_verdicts(verdicts, study.monitor.names)
            result[name] = tally(trials.changes, answers, seconds, trials.failed)
        return result

    def trained(self) -> dict[str, FittedMethod]:
        """Every method by its name in the study, trained once on healthy windows of the study."""
        if not self._trained:
            methods = self.study.methods
            healthy = self._healthy() if any(method.learns for method in methods.values()) else None
            self._trained = {name: method.train(self.study.monitor, healthy) for name, method in methods.items()}
        return self._trained

    def _healthy(self) -> RecordWindows:

        study = self.study
        count = max(TRAINING_RECORDS // study.records, 2)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(TRAINING_KEY,)))
        case = healthy_case(study.monitor, count)
        return make_trials(study.monitor, case, count, study.records, study.plan, study.noise, rng).windows

    def _forget(self) -> None:
        """The engine begins every batch as if newly loaded, so that no result depends on what was done before."""
        self.study.monitor.engine.forget_start()  # type: ignore[attr-defined]


@lru_cache(maxsize=1)
def study_runner(path: Path, seed: int) -> StudyRunner:
    """The laboratory of this process."""
    return StudyRunner(load_study(path), seed)


def run_batch(path: Path, seed: int, batch: StudyBatch) -> dict[str, Tally]:
    """One batch of the study at `path`; the task of a worker process."""
    return study_runner(path, seed).run(batch)


Tallies = dict[str, Tally]
"""Tally of every method, by its name."""
Finished = dict[StudyBatch, Tallies]


def study_journal(path: Path, study: Study, seed: int, repetitions: int | None) -> Journal[StudyBatch, Tallies]:
    """The journal of a study's finished batches. It belongs to the program version, the content of the study file and
    of the engine file, the seed and the repetitions."""
    files = (study.path, Path(study.monitor.engine.path))  # type: ignore[attr-defined]
    return Journal(path, content_hash(f"{__version__} {seed} {repetitions}", files), _BATCHES)


_BATCHES = JournalFormat[StudyBatch, Tallies](
    "study",
    "the journal of a study",
    "the journal of another study, or of this one before it was changed",
    "--journal",
    lambda batch, tallies: {
        "batch": [batch.case, batch.first, batch.count],
        "methods": {name: one.to_json() for name, one in tallies.items()},
    },
    lambda line: (StudyBatch(*line["batch"]), {name: Tally.from_json(one) for name, one in line["methods"].items()}),
)


Results = Mapping[tuple[str, str], Tally]


def totals(study: Study, finished: Finished) -> dict[tuple[str, str], Tally]:
    """Tally of every (case, method), added up in the order of the batches whoever finished first."""
    found: dict[tuple[str, str], Tally] = {}
    for batch in sorted(finished):
        for method in study.methods:
            key, one = (study.cases[batch.case].name, method), finished[batch][method]
            found[key] = found[key] + one if key in found else one
    return found


def study_document(study: Study, results: Results, seed: int) -> dict[str, Any]:
    """Everything, with counts that a script can check; `timings` alone differ from one run to the next."""
    names = study.monitor.names
    return {
        "schema": STUDY.id,
        "cases": [_entry(case, method, one, names, study.reliability) for (case, method), one in results.items()],
        "study": study.path.name,
        "engine": study.monitor.engine.name,
        "records": study.records,
        "seed": seed,
        "parameters": list(names),
        "timings": [
            {"case": case, "method": method, "seconds_per_diagnosis": _seconds(one)}
            for (case, method), one in results.items()
        ],
    }


def _seconds(x: Tally) -> float:
    """CPU time of one diagnosis."""
    return x.seconds / x.repetitions


def _entry(case: str, method: str, x: Tally, names: tuple[str, ...], reliability: bool) -> dict[str, Any]:
    named = x.isolates
    per = {name: x.counts_by_batch(name) for name in BLOCK}
    per["changed"], per["seen"] = per["repetitions"] - per["unchanged"], per["detected"] - per["false_alarms"]

    def exact_share(hits: str, of: str) -> dict[str, float] | None:
        return exact_rate(int(per[hits].sum()), int(per[of].sum()), design_effect(per[hits], per[of]))

    entry: dict[str, Any] = {
        "case": case,
        "method": method,
        "repetitions": x.repetitions,
        "no_verdict": x.repetitions - x.judged,
        "detected": x.detected,
        "exact": x.exact if named else None,
        "contained": x.contained if named else None,
        "right_size": x.right_size if named else None,
        "mean_size": x.isolated / x.judged if named and x.judged else None,
        "parameter_counts": dict(zip(names, map(int, x.counts), strict=True)) if named else None,
        "parameter_counts_contained": dict(zip(names, map(int, x.counts_contained), strict=True)) if named else None,
        "unchanged": x.unchanged,
        "false_alarms": x.false_alarms,
        "false_alarm_rate": exact_share("false_alarms", "unchanged"),
        "detected_rate": exact_share("seen", "changed"),
        "exact_rate": exact_share("exact", "repetitions") if named else None,
        "contained_rate": exact_share("contained", "repetitions") if named else None,
        "failed_records": x.failed_records,
    }
    if reliability and x.bins[:, 0].any():
        entry["reliability"] = reliability_rows(x)
    return entry


def reliability_rows(x: Tally) -> list[dict[str, Any]]:
    """Per bin of stated probability: answers, mean stated probability, how many were right, the rate."""
    study_rows = []
    for low, high, (count, right, stated) in zip(EDGES[:-1], EDGES[1:], x.bins, strict=True):
        if count:
            realised = exact_rate(int(right), int(count)) or {}
            study_rows.append(
                {
                    "from": float(low),
                    "to": min(float(high), 1.0),
                    "answers": int(count),
                    "stated": stated / count,
                    "right": int(right),
                    **realised,
                }
            )
    return study_rows


def study_rows(study: Study, results: Results, show: str) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Rows and columns of one table: "rates", "counts" per parameter as in the paper, or "reliability"."""
    found: list[dict[str, Any]] = []
    for (case, method), x in results.items():
        entry = _entry(case, method, x, study.monitor.names, False)
        place = {"case": case, "method": method}
        if show == "rates":
            found.append(STUDY.row(place | _rates(entry) | {"seconds_per_diagnosis": _seconds(x)}))
        elif show == "counts":
            found.append(place | {"repetitions": x.repetitions} | (entry["parameter_counts"] or {}))
        else:
            found += [place | row for row in reliability_rows(x)]
    columns = ("case", "method", "repetitions", *study.monitor.names) if show == "counts" else ()
    return found, columns or tuple(found[0]) if found else ()


def _rates(entry: Mapping[str, Any]) -> dict[str, Any]:
    row = {"repetitions": entry["repetitions"], "no_verdict": entry["no_verdict"]}
    for what in ("detected", "false_alarm", "exact", "contained"):
        found = entry[f"{what}_rate"]
        row[what] = found["rate"] if found else None
        row[f"{what}_low"], row[f"{what}_high"] = (found["low"], found["high"]) if found else (None, None)
    return row | {"mean_size": entry["mean_size"]}


def short_rates(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of rates for people: rate and interval in one cell, in per cent."""
    short: dict[str, Any] = {}
    ends = {f"{name}_{end}" for name in row for end in ("low", "high")}
    for name, value in row.items():
        if name in ends:
            continue
        if f"{name}_low" in row:
            value = (
                f"{100 * value:.1f} ({100 * row[f'{name}_low']:.1f}–{100 * row[f'{name}_high']:.1f})"
                if (value is not None)
                else ""
            )
            name = f"{name}_%"
        elif isinstance(value, float):
            value = float(f"{value:.3g}")
        short[name] = value
    return short
