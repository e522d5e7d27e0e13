"""Isolation of the windows of recordings: verdict, what changed, and what to record next.

Advice: further sensors that would separate the members of an ambiguity group, had they been recorded in the same
window: sensors that the engine file describes and these records lack come first; where none of those separates them,
gas temperatures, pressures and shaft speeds that the model gives at other places, as well measured as such instruments
are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.detection.verdict import Verdict, judge
from enginediag_cli.engine.instrument_errors import DRIFT
from enginediag_cli.errors import DataError
from enginediag_cli.isolation.diagnosis import (
    ComponentIsolation,
    Diagnosis,
    DiagnosisOptions,
    diagnose,
    isolate_components,
)
from enginediag_cli.isolation.nonlinear import WindowModel
from enginediag_cli.isolation.planned_flights import Suggestion, best_of_each_kind, conditions_grid
from enginediag_cli.isolation.prior import SEPARATED, SetPrior
from enginediag_cli.isolation.results import (
    ODDS,
    Advice,
    AmbiguityGroup,
    advise,
    advise_flights,
    condition_options,
    noncentrality_gains,
    sensor_options,
    temper,
)
from enginediag_cli.isolation.sensitivity_analysis import (
    SensitivityAnalysis,
    component_sensitivity,
    parameter_sensitivity,
    window_errors,
)
from enginediag_cli.parallel import parallel_map, pieces_in_flight
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import Window, WindowReader
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.units import UNITS, split_column

MOST_COLUMNS = 2
"""Sensors named at most: the best, and one to choose instead."""
RECORDS = 8
"""Operating points of a window at which the sensors are tried: sensitivities hardly vary more within one."""
SPEED = "rotational speed"
ACCURACY = {"temperature": 0.002, "pressure": 0.003, SPEED: 0.001}
"""Standard deviation of one reading as a share of it: 1 K at 500 K, and what transducers and tachometers do."""
HOTTEST_K = 1300.0
"""Above it no probe is kept in an engine."""


def find_separating_sensors(
    monitor: Monitor, score: Score, found: AmbiguityGroup, inputs: Mapping[str, np.ndarray], records: int
) -> tuple[str, ...]:
    """Columns of sensors that would separate the two leading members of `found` in so many records, best first; empty
    where none would. inputs: column -> (N,), operating points like those of the window."""
    engine: Any = monitor.engine
    at = np.unique(np.linspace(0, len(next(iter(inputs.values()))) - 1, RECORDS).astype(int))
    here = {column: np.asarray(values)[at] for column, values in inputs.items()}
    known = {**monitor.base, **dict(zip(monitor.monitored, monitor.theta0.tolist(), strict=False))}
    for columns in (_unused_sensors(engine, monitor.sensors), _possible_columns(engine, monitor.sensors)):
        if not columns:
            continue
        values = {name: value for name, value in known.items() if name in engine.parameters}
        answer = engine.predict(here, values, sensors=columns, wrt=score.parameters)
        ok = np.asarray(answer.ok)
        if not ok.any():
            continue
        y, J = np.asarray(answer.y)[ok], np.asarray(answer.jacobian)[ok]
        sigma = np.array([_reading_sigma(engine, column, y[:, j]) for j, column in enumerate(columns)])
        G = J / sigma[:, None]
        informations = [records / len(G) * G[:, j].T @ G[:, j] for j in range(len(columns))]
        gained = noncentrality_gains(score, found.leading_pair, [np.nan_to_num(each) for each in informations])
        order = [int(j) for j in np.argsort(-gained, kind="stable") if gained[j] >= 2 * np.log(ODDS)]
        if order:
            return tuple(columns[j] for j in order[:MOST_COLUMNS])
    return ()


def _unused_sensors(engine: Any, used: tuple[str, ...]) -> tuple[str, ...]:
    """Sensors of the engine file that are not in use."""
    return tuple(column for column in engine.sensors if column not in used)


def _possible_columns(engine: Any, used: tuple[str, ...]) -> tuple[str, ...]:
    """Other columns of the model that an instrument could read."""
    given = {*used, *engine.sensors, *engine.inputs, *engine.optional_inputs}
    columns = getattr(engine, "model_columns", ())
    # of rotational speeds instruments read those of shafts; corrected ones are made of them
    speeds = getattr(getattr(engine, "network", None), "speed_columns", ())
    read = (c for c in columns if _dimension(c) != SPEED or c in speeds)
    return tuple(dict.fromkeys(c for c in read if c not in given and _dimension(c) in ACCURACY))


def _reading_sigma(engine: Any, column: str, readings: np.ndarray) -> float:
    """Standard deviation of one reading; infinite where no probe would last."""
    if column in engine.sensors:
        return float(engine.sensors[column].noise_sigma)
    usual, dimension = float(np.abs(np.mean(readings))), _dimension(column)
    if dimension == "temperature" and usual * UNITS[split_column(column)[1]].factor > HOTTEST_K:
        return float("inf")
    return ACCURACY[dimension] * usual


def _dimension(column: str) -> str:
    unit = split_column(column)[1]
    return UNITS[unit].dimension if unit in UNITS else ""


SHOWN = 4.0
"""Square of the score test of a drift, two standard deviations, from which it is compared with the other forms."""
ADVISED = 3
"""Operating conditions advised: the best few say which way to fly, a longer list only repeats it."""


@dataclass(frozen=True)
class NextRecording:
    """What to record next to separate the answer from its leading alternative.

    Attributes
    ----------
    alternatives : tuple of two tuples of str
        Both sets of parameters; `meaning` says what those are.
    conditions, sensors : sequence of Advice
        Operating conditions, and further sensors at the conditions of this window; None where its records are not kept.
    flights : sequence of Suggestion
        Whole flights, the best of each kind, that would separate all leading sets.
    """

    alternatives: tuple[tuple[str, ...], tuple[str, ...]]
    meaning: Mapping[str, Parameter]
    conditions: Sequence[Advice]
    sensors: Sequence[Advice] | None
    flights: Sequence[Suggestion] = ()


@dataclass(frozen=True)
class IsolatedWindow:
    """The isolation of one window.

    Attributes
    ----------
    verdict : Verdict
        Of detection.
    meaning : mapping of str to Parameter
        Meaning of the parameters.
    diagnosis : Diagnosis or None
        The answer by parameter; None without a verdict.
    components : ComponentIsolation or None
        The answer by component, if chosen; None without a verdict.
    advice : NextRecording or None
        What to record next.
    to_components : bool
        Whether the answer is by component.
    sensitivity : SensitivityAnalysis or None
        Of the conclusion to single errors; None where it was not computed.
    score : Score or None
        Of which the answer is.
    """

    verdict: Verdict
    meaning: Mapping[str, Parameter]
    diagnosis: Diagnosis | None = None
    components: ComponentIsolation | None = None
    advice: NextRecording | None = None
    to_components: bool = False
    sensitivity: SensitivityAnalysis | None = None
    score: Score | None = None

    @property
    def judged(self) -> bool:
        return self.diagnosis is not None or self.components is not None

    @property
    def instruments(self) -> tuple[InstrumentFault, ...]:
        """Instruments that are stuck or scatter, beside what the diagnosis names."""
        return self.verdict.window.instruments

    @property
    def named(self) -> bool:
        """Whether something was isolated, and stands."""
        if self.instruments:
            return True
        if self.components is not None:
            return bool(self.components.components) and self.components.adequacy.is_listed
        return self.diagnosis is not None and bool(self.diagnosis.result.isolated and self.diagnosis.adequacy.is_listed)


@dataclass
class WindowIsolation:
    """Isolates the windows of `files`.

    Attributes
    ----------
    files : WindowReader
        Recordings cut into windows.
    options : DiagnosisOptions
        Choices of the diagnosis.
    false_alarm : float
        Level of the detection test.
    to_components : bool
        Answer by component.
    kept_records : KeptRecords or None
        Records of windows, where they are needed for the full engine model.
    advise : bool
        Look for the next recording.
    extra : mapping of str to float
        Further sensors to consider: model column to noise, in the column's unit.
    wants_sensitivity : callable
        Given the number of a window, from 1, and whether something was named: whether to analyse the sensitivity of the
        conclusion.
    """

    files: WindowReader
    options: DiagnosisOptions
    false_alarm: float
    to_components: bool = False
    kept_records: RecentRecords | None = None
    advise: bool = False
    extra: Mapping[str, float] = field(default_factory=dict)
    wants_sensitivity: Callable[[int, bool], bool] = lambda number, named: False

    def __post_init__(self) -> None:
        monitor = self.files.monitor
        if monitor is not None and self.extra:
            engine: Any = monitor.engine
            columns = (*engine.sensors, *engine.model_columns)
            for column in self.extra:
                if column not in columns:
                    raise DataError(f"{engine.name} has no column {column!r} for a sensor; {near(column, columns)}")
        self.files.skip_doubtful = True
        if self.kept_records is not None:
            self.files.on_chunk = self.kept_records.record
            self.files.solutions = True

    def windows(self) -> Iterator[IsolatedWindow]:
        """All windows in turn. Raises DataError, NoVerdictError."""
        numbered = enumerate(self.files.windows(), start=1)
        while some := list(islice(numbered, pieces_in_flight())):
            yield from parallel_map(partial(self._isolate_numbered, some), len(some))
            if self.kept_records is not None:
                self.kept_records.discard_before(some[-1][1][0])

    def _isolate_numbered(self, some: Sequence[tuple[int, Window]], k: int) -> IsolatedWindow:
        number, (window, known) = some[k]
        found = self._isolate(window, known)
        return (
            replace(found, sensitivity=self._sensitivity(found))
            if self.wants_sensitivity(number, found.named)
            else found
        )

    def _sensitivity(self, found: IsolatedWindow) -> SensitivityAnalysis | None:
        window, monitor = found.verdict.window, self.files.monitor
        if found.diagnosis is not None:
            inference = found.diagnosis.inference
            if inference is None:
                return None
            return parameter_sensitivity(inference, window_errors(inference.score, window, monitor))
        if found.components is None or found.score is None:
            return None
        isolation, score = self.options.isolation, temper(found.score, found.components.adequacy.noise)
        return component_sensitivity(score, isolation.prior, window_errors(score, window, monitor), isolation.largest)

    def _isolate(self, judged: WindowStatistics, known: Mapping[str, Parameter]) -> IsolatedWindow:
        window = judged
        # whether anything changed is asked of the usual forms of instruments' errors: a drift shows as a bias
        drifts = tuple(p.name for p in known.values() if p.belongs_to_instrument and p.quantity == DRIFT)
        verdict = judge(window.drop_parameters(drifts), self.false_alarm)
        if verdict.score is None or window.statistics is None:
            return IsolatedWindow(verdict, known, to_components=self.to_components)
        shown = visible_drifts(window.drop_parameters(()).statistics, drifts) if drifts else set[str]()
        window, verdict, score = _score_suspects(window, verdict, [name for name in drifts if name not in shown])
        if self.to_components:
            components = isolate_components(
                score, self.options.isolation, verdict.window.statistics, window.disagreement
            )
            return IsolatedWindow(verdict, known, components=components, to_components=True, score=score)
        diagnosis, records = self._diagnose(judged, verdict, score)
        wrong = {known[n].component for n, p in diagnosis.result.inclusion.items() if p > 1 - SEPARATED and n in known}
        more = {name for name in drifts if known[name].component in wrong}
        if not more <= shown and not window.is_doubtful:  # which form it is, is open
            window, verdict, score = _score_suspects(
                judged, verdict, [name for name in drifts if name not in shown | more]
            )
            diagnosis, records = self._diagnose(judged, verdict, score)
        diagnosis = self._add_separating_sensors(diagnosis, window, records)
        advice = None
        if self.advise and self.files.monitor is not None:
            advice = self._advice(
                self.files.monitor.drop_parameters(window.silent), diagnosis, records() if records else None
            )
        return IsolatedWindow(verdict, known, diagnosis, advice=advice)

    def _diagnose(
        self, judged: WindowStatistics, verdict: Verdict, score: Score
    ) -> tuple[Diagnosis, _WindowRecords | None]:
        window = verdict.window
        records = None
        if self.kept_records is not None:
            records = _WindowRecords(self.files.monitor, self.kept_records, window, judged.statistics)
        return diagnose(score, self.options, records, window.statistics, window.disagreement), records

    def _add_separating_sensors(
        self, diagnosis: Diagnosis, window: WindowStatistics, records: Callable[[], WindowModel | None] | None
    ) -> Diagnosis:
        """The diagnosis with sensors that would separate its ambiguity group, where the engine is available."""
        found, monitor = diagnosis.result.ambiguity, self.files.monitor
        if found is None or monitor is None or window.statistics is None:
            return diagnosis
        model = records() if records else None
        inputs = _operating_conditions(monitor, model)
        if not inputs:
            return diagnosis
        monitor = monitor.drop_parameters(window.silent)
        told = found.add_separating_sensors(
            find_separating_sensors(monitor, diagnosis.score, found, inputs, window.statistics.n)
        )
        return replace(diagnosis, result=replace(diagnosis.result, ambiguity=told))

    def _advice(self, monitor: Monitor, diagnosis: Diagnosis, model: WindowModel | None) -> NextRecording | None:
        result = diagnosis.result
        if not result.alternatives:
            return None
        rivals = (tuple(result.isolated), tuple(result.alternatives[0].parameters))
        grid = conditions_grid(monitor.engine)
        options = condition_options(monitor, grid) if grid else []
        conditions = advise(diagnosis.score, rivals, options, monitor.uncertainty)[:ADVISED]
        sensors = None
        if model is not None:
            sensors = advise(
                diagnosis.score, rivals, sensor_options(monitor, model.inputs, self.extra), monitor.uncertainty
            )
        sets = [(result.isolated, result.probability), *((r.parameters, r.probability) for r in result.alternatives)]
        flights = best_of_each_kind(
            advise_flights(diagnosis.score, sets, monitor, _operating_conditions(monitor, model))
        )
        return NextRecording(rivals, monitor.meaning, conditions, sensors, flights)


def visible_drifts(statistics: LocalStatistics | None, drifts: Sequence[str]) -> set[str]:
    """Drifts that these records show, each by its score test beside all that does not drift, free within its prior:
    without one that shows less than SHOWN the search loses half of that in the log likelihood of sets with it, and is
    twice as fast."""
    if statistics is None:
        return set()
    score = fisher_score(statistics)
    prior = SetPrior()
    b, information = prior.scaled(score)
    drifting = np.isin(score.parameters, drifts)
    held = information + max(prior.slabs) ** -2 * np.eye(len(b))
    across = np.linalg.solve(held[np.ix_(~drifting, ~drifting)], held[np.ix_(~drifting, drifting)])
    pull = b[drifting] - b[~drifting] @ across
    variance = np.diag(held)[drifting] - np.sum(held[np.ix_(~drifting, drifting)] * across, axis=0)
    names = np.array(score.parameters, object)[drifting]
    return set(names[pull**2 > SHOWN * variance].tolist())


def _score_suspects(
    window: WindowStatistics, verdict: Verdict, dropped: Sequence[str]
) -> tuple[WindowStatistics, Verdict, Score]:
    """The window and its verdict without the `dropped` suspects, and the score for isolation."""
    every, window = window.statistics, window.drop_parameters(dropped)
    assert every is not None and window.statistics is not None
    # a test asks whether anything changed, these questions by what: wrong slopes of the maps matter to them alone. What
    # they do to parameters that are no suspects is part of what they do to the readings
    suspects = window.statistics.parameters
    certain = fisher_score(every, monitored=suspects)
    score = fisher_score(every, monitored=suspects, uncertainty=every.slopes)
    return window, replace(verdict, window=window), replace(score, doubt=certain.doubt)


def _operating_conditions(monitor: Monitor, model: WindowModel | None) -> Mapping[str, np.ndarray]:
    """Operating conditions of the window's records, or those that identification has seen; none where neither is
    held."""
    if model is not None:
        return model.inputs
    envelope = monitor.envelope
    if envelope is None:
        return {}
    return {column: np.asarray(envelope.points)[:, i] for i, column in enumerate(envelope.inputs)}


class _WindowRecords:
    """The records of a window with the full model, when they are required; None where they are no longer held.
    every: its statistics with all suspects, those that have been dropped, too."""

    def __init__(
        self, monitor: Monitor | None, kept: RecentRecords, window: WindowStatistics, every: LocalStatistics | None
    ):
        self._monitor, self._kept, self._window, self._every = monitor, kept, window, every
        kept.discard_before(window)

    def __call__(self) -> WindowModel | None:
        found = self._kept.recall(self._window)
        if found is None or self._monitor is None:
            return None
        inputs, y = found
        start = self._window.solution
        if start is not None and start.shape[1] != len(y):
            start = None
        weights = self._window.weights
        if weights is not None and len(weights) != len(y):
            return None
        monitor = _add_slope_errors(self._monitor, self._every).drop_parameters(self._window.silent)
        return WindowModel(monitor, inputs, y, start, weights)


def _add_slope_errors(monitor: Monitor, statistics: LocalStatistics | None) -> Monitor:
    """The monitor with what wrong slopes of the maps add to the change that the statistics speak of. What they add to
    one suspect makes up for what they add to others, so that all of them have to be there."""
    if statistics is None or statistics.slopes is None:
        return monitor
    place = {name: i for i, name in enumerate(monitor.names)}
    known = [k for k, name in enumerate(statistics.parameters) if name in place]
    at = [place[statistics.parameters[k]] for k in known]
    widened = monitor.uncertainty.copy()
    widened[np.ix_(at, at)] += statistics.slopes[np.ix_(known, known)]
    return replace(monitor, uncertainty=widened)
