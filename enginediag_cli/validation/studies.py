"""The file of a Monte-Carlo study: its declaration, its fault cases, and the monitor that it judges by.

Fault cases are changes of parameters that are given, or drawn for every diagnosis. The monitor knows nominal state and
noise exactly, as in the published experiment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.config.hints import near
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.config.reading import named_file
from enginediag_cli.errors import ConfigError, DataError, Problem
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior
from enginediag_cli.methods.registry import SECTIONS, chosen_method
from enginediag_cli.parameters import meanings
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import Monitor, match_parameters
from enginediag_cli.simulation.flights import MISSION
from enginediag_cli.simulation.noise import NOISE, ColumnNoise

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
        Field("constants", "number_map", "further inputs of the engine, each held at one value", {}),
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
    from enginediag_cli.simulation.noise import column_noise

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
