"""A fleet from its file to its findings: nominal states, statistics of recordings, engines by serial number, judged and
ranked.

Sums are taken by a fixed binary tree: the same to the last digit in whatever order the parts come. Node (level, i) is
the sum of leaves i·2^level … (i + 1)·2^level − 1 in their order; where the right half of a node has no leaves it is its
left half. Memory holds the nodes whose other half has not come: as many as there are levels when the leaves come in
order.

The judgement of a fleet: which engines are flagged, their order by severity, how long they last, and what they have in
common, a random-effects mean of each parameter's change.

Engine e reads off by r_e (m,) after its baseline, with scatter S_e and mean r̄ over the fleet, of covariance

    R = cov(r_e)/n + diag (h r̄)²

the second part what wrong slopes of the maps make of it in all engines alike, which no number of them averages out. One
component, or instrument, with effects J (m, k) of one prior standard deviation, or nothing, is what all have in common:

    C = (Jᵀ R⁻¹ J + 1)⁻¹,   μ = C Jᵀ R⁻¹ r̄,   ln P(r̄ | component)/P(r̄ | nothing) = ½ μᵀ C⁻¹ μ + ½ ln |C|

Its changes in each engine, by the same map with S_e in the place of R, have a spread τ, by moments (R. DerSimonian, N.
Laird, Controlled Clin. Trials 7 (1986) 177–188); the error of their mean is that of its weighted scatter (J. Hartung,
G. Knapp, Stat. Med. 20 (2001) 3875–3889) and C. What most engines have alike is no fault of one: physics that the model
lacks, an error of the recorder or of a kind of instrument, or wear that all share.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Generic, Protocol, TypeVar

import numpy as np

from enginediag_cli.detection.series import Series, build_series
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError
from enginediag_cli.fleets.engine_judgement import judge_with_account
from enginediag_cli.fleets.findings import (
    CHANGED,
    HEALTHY,
    NO_VERDICT,
    CommonChange,
    EngineFinding,
    EngineHistory,
    FinalReadings,
    FlaggedEngines,
    FleetFinding,
    FleetSettings,
    IntervalEstimate,
    MaintenanceEvent,
    apply_acknowledgements,
)
from enginediag_cli.fleets.fleet_file import Fleet, FleetBaseline, FleetRecording, natural_order
from enginediag_cli.fleets.margin import (
    MarginScale,
    add_forecasts,
    available_power,
    check_limits,
    learn_removal_limit,
    margin_scale,
)
from enginediag_cli.fleets.models import BuildModel, Runner, build_model
from enginediag_cli.fleets.store import (
    CondensedReader,
    CondenseOutcome,
    CondenseTask,
    FleetStore,
    condense,
    whole_monitor,
)
from enginediag_cli.fleets.work_scope import WorkScopeEstimator
from enginediag_cli.history.engines import HistoryWindows
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.probability import NORMAL_95, normalized_weights
from enginediag_cli.progress import each
from enginediag_cli.residuals.files import Window
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import Extrapolation

GENERIC = 0.1
"""Share to which a large change is known, where maps are not the engine's own: their slopes may be wrong by it."""
FEWEST_ENGINES = 5
"""Engines of which it is said what they have in common, at least."""
MOST = 0.9
"""Share of the engines that have a change the same way, where it is called alike."""
NOTHING = 0.5
"""Probability beforehand that engines have nothing in common."""
RATE_SPREAD = float(np.log(3.0))
"""How well the rates of changes are known before a fleet is seen: to a factor of three, in logarithms."""
RATES, FARTHEST = 161, 5.0
"""Rates that are averaged over, and up to how many of these standard deviations."""
SURE = 1e-12
"""Probability that no change, and no health, is surer than: rounding is of this size."""
CLASS = 0.95
"""Probability that the components reported as common hold together."""


def random_effects(x: np.ndarray, v: np.ndarray) -> tuple[float, float, float]:
    """Mean, its standard error, and standard deviation τ between engines, of changes x (n,) with variances v (n,)."""
    w = 1 / v
    fixed = float(w @ x / w.sum())
    Q = float(w @ (x - fixed) ** 2)
    scale = float(w.sum() - (w**2).sum() / w.sum())
    between = max((Q - (len(x) - 1)) / scale, 0.0) if scale > 0 else 0.0
    w = 1 / (v + between)
    mean = float(w @ x / w.sum())
    q = float(w @ (x - mean) ** 2) / (len(x) - 1)
    return mean, float(np.sqrt(max(q, 1.0) / w.sum())), float(np.sqrt(between))


def common_changes(
    findings: Sequence[EngineFinding], known: Mapping[str, Parameter] | None = None
) -> tuple[CommonChange, ...]:
    """What engines have in common, of each parameter, those that are alike first, surest first; known: what the
    parameters are."""
    by_kind: dict[tuple[tuple[str, ...], int], list[FinalReadings]] = {}
    for finding in findings:
        if finding.state is not None:
            state = finding.state
            by_kind.setdefault((state.parameters, len(state.deviation)), []).append(state)
    told: list[tuple[float, CommonChange]] = []
    for (names, _), states in by_kind.items():
        if len(states) >= FEWEST_ENGINES:
            told += _common_to_states(states, tuple(meanings(known or {}, names).values()))
    return tuple(change for _, change in sorted(told, key=lambda pair: (not pair[1].common, pair[0])))


def _common_to_states(
    states: Sequence[FinalReadings], described: Sequence[Parameter]
) -> list[tuple[float, CommonChange]]:
    from scipy.special import ndtr

    off, S = np.stack([s.deviation for s in states]), np.stack([s.covariance for s in states])
    effect, unit, n = np.mean([s.effect for s in states], axis=0), states[0].unit, len(states)
    mean = off.mean(axis=0)
    wrong = np.diag((GENERIC * mean) ** 2)
    # fewer engines than readings do not tell how these go together: what flights scatter by is the least
    between = np.cov(off.T) * (n - 1) / (n + len(mean)) + S.mean(axis=0)
    W, W1 = np.linalg.inv(between / n + wrong), np.linalg.inv(S.mean(axis=0) + wrong)
    groups: dict[str, list[int]] = {}
    for k, p in enumerate(described):
        if np.abs(effect[:, k]).max() > 0:
            groups.setdefault(p.component, []).append(k)
    log = {"": np.log(NOTHING)}
    told = {}
    for component, at in groups.items():
        J = effect[:, at]
        C = np.linalg.inv(J.T @ W @ J + np.eye(len(at)))
        middle = C @ (J.T @ W @ mean)
        odds = 0.5 * middle @ np.linalg.solve(C, middle) + 0.5 * np.linalg.slogdet(C)[1]
        log[component] = float(odds + np.log((1 - NOTHING) / len(groups)))
        G = np.linalg.solve(J.T @ W1 @ J + np.eye(len(at)), J.T @ W1)
        told[component] = off @ G.T, np.einsum("pm,nmk,pk->np", G, S, G), np.diag(C)
    total = np.logaddexp.reduce(list(log.values()))
    chance = {c: float(np.exp(x - total)) for c, x in log.items()}
    named = _credible_components(chance)
    found = []
    for component, at in groups.items():
        x, v, left = told[component]
        for k, i in enumerate(at):
            p = described[i]
            average, error, spread = random_effects(x[:, k], v[:, k])
            half = float(NORMAL_95 * unit[i] * np.hypot(error, np.sqrt(left[k])))
            alike = float(ndtr(abs(average) / spread)) if spread > 0 else 1.0
            common = component in named and alike >= MOST
            value = float(unit[i] * average)
            found.append(
                (
                    -chance[component],
                    CommonChange(
                        p.name,
                        component,
                        p.words or p.name,
                        p.shown_unit,
                        IntervalEstimate(value, value - half, value + half),
                        float(unit[i] * spread),
                        n,
                        alike,
                        chance[component],
                        common,
                        _interpretation(average, p, len(named)) if common else "",
                    ),
                )
            )
    return found


def _credible_components(chance: Mapping[str, float]) -> tuple[str, ...]:
    """Components, likeliest first, that hold CLASS of the probability; none where nothing in common is among them."""
    told: list[str] = []
    for component in sorted(chance, key=lambda c: -chance[c]):
        told.append(component)
        if sum(chance[c] for c in told) >= CLASS:
            break
    return () if "" in told else tuple(told)


def _interpretation(mean: float, parameter: Parameter, among: int) -> str:
    """What a common change may be."""
    if parameter.belongs_to_instrument:
        what = "an error of the recorder or of this kind of instrument, or physics that the model lacks"
    elif parameter.wear and np.sign(mean) == parameter.wear:
        what = "wear that all engines share, or physics that the model lacks"
    else:
        what = "physics that the model lacks, or an error of the recorder; no wear of single engines"
    return f"{what}{'; it, or another of those reported with it' if among > 1 else ''}: see locate and explain"


def judge_fleet(
    findings: Sequence[EngineFinding], settings: FleetSettings, known: Mapping[str, Parameter] | None = None
) -> FleetFinding:
    """The fleet of these engines. known: what the parameters are, as a series knows them."""
    level = settings.false_discovery
    names, expected = flag_engines(findings, level)
    found = set(names)
    forecast = add_forecasts([_mark_flagged(f, f.serial in found) for f in findings], settings)
    ranked = sorted(forecast, key=lambda f: -np.nan_to_num(f.severity.value, nan=-np.inf))
    return FleetFinding(
        tuple(ranked),
        FlaggedEngines(names, level, expected, flagged_words(len(names), level, expected)),
        common_changes(findings, known),
        tuple((f.serial, f.reason) for f in findings if f.verdict == NO_VERDICT),
    )


def flag_engines(findings: Sequence[EngineFinding], level: float) -> tuple[tuple[str, ...], float]:
    """Flag engines at a false discovery rate, by their probabilities of a change in this fleet.

    Of the engines that changed, in falling order of the probability p_e by `fleet_probabilities`, as many as there are
    with

        Σ (1 − p_e) / number ≤ level,

    the expected share of healthy engines among them.

    Parameters
    ----------
    findings : sequence of EngineFinding
        Engines without a verdict, and those called healthy, are not flagged.
    level : float
        False discovery rate.

    Returns
    -------
    tuple of str, float
        Serial numbers, most probable first; the expected share of healthy engines among them, 0 of none.

    References
    ----------
    M. A. Newton, A. Noueiry, D. Sarkar, P. Ahlquist (2004) Biostatistics 5, 155–176.
    P. Müller, G. Parmigiani, K. Rice (2007) FDR and Bayesian multiple comparisons rules, Bayesian Statistics 8,
    Oxford University Press, 349–370.
    """
    judged = [f for f in findings if f.verdict in (CHANGED, HEALTHY)]
    chances = fleet_probabilities(np.array([f.probability for f in judged]), np.array([f.prior for f in judged]))
    changed = ((p, f.serial) for p, f in zip(chances.tolist(), judged, strict=True) if f.verdict == CHANGED)
    ranked = sorted(changed, key=lambda item: -item[0])
    share = np.cumsum([1 - p for p, _ in ranked]) / np.arange(1, len(ranked) + 1)
    count = int(np.sum(share <= level))  # it rises along the list
    return tuple(serial for _, serial in ranked[:count]), float(share[count - 1]) if count else 0.0


def fleet_probabilities(probability: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Probability of a change of each of n engines, with changes as frequent as the fleet shows them.

    The rates of the account of one engine are a judgement. With odds of λ times these, ln λ ~ N(0, `RATE_SPREAD`²), and
    odds O_e after and o_e before the flights were seen,

        p(λ | fleet) ∝ p(λ) Π_e (1 + λ O_e)/(1 + λ o_e),     p_e = ∫ λ O_e/(1 + λ O_e) p(λ | fleet) dλ

    Parameters
    ----------
    probability, prior : (n,) array
        Of a change by the account of each engine, after and before its flights were seen.

    Returns
    -------
    (n,) array
    """
    inside = SURE, 1 - SURE
    after, before = (np.log(p) - np.log1p(-p) for p in (np.clip(probability, *inside), np.clip(prior, *inside)))
    rate = RATE_SPREAD * np.linspace(-FARTHEST, FARTHEST, RATES)[:, None]
    gain = np.logaddexp(0.0, rate + after) - np.logaddexp(0.0, rate + before)
    weight = normalized_weights(gain.sum(axis=1) - 0.5 * (rate[:, 0] / RATE_SPREAD) ** 2)
    return np.asarray(weight @ (1 / (1 + np.exp(-rate - after))))


def _mark_flagged(finding: EngineFinding, flagged: bool) -> EngineFinding:
    """The finding with whether it is flagged, and why it is not where it has changed."""
    if flagged or finding.verdict != CHANGED:
        return replace(finding, discovery=flagged)
    why = f"not flagged: the probability of its change, {finding.probability:.2f}, is too small beside those flagged"
    return replace(finding, reason="; ".join(filter(None, [finding.reason, why])))


def flagged_words(count: int, level: float, expected: float) -> str:
    """How many engines are flagged, and how many of them are healthy on average."""
    rate = f"false discovery rate ≤ {100 * level:g} %"
    if not count:
        return f"no engine is flagged ({rate})"
    share = f"{100 * expected:.2g} %" if expected >= 1e-4 else "less than 0.01 %"
    return f"engines flagged: {count} ({rate}); by their probabilities {share} of them are healthy on average"


class Adds(Protocol):
    """What can be added up."""

    def __add__(self: Sum, other: Sum, /) -> Sum: ...


Sum = TypeVar("Sum", bound=Adds)


class TreeSum(Generic[Sum]):
    """The sum of `leaves` values that `add` brings in any order; None stands for a leaf without a value."""

    def __init__(self, leaves: int):
        self._leaves, self._waiting = leaves, dict[tuple[int, int], Sum | None]()
        self._done: Sum | None = None

    def add(self, number: int, value: Sum | None) -> None:
        """Bring leaf `number`, from 0, once."""
        level, size = 0, 1
        while size < self._leaves:
            sibling = number ^ 1
            if sibling * size < self._leaves:  # else there is no right half
                key = (level, sibling)
                if key not in self._waiting:
                    self._waiting[level, number] = value
                    return
                other = self._waiting.pop(key)
                left, right = (value, other) if number < sibling else (other, value)
                value = right if left is None else left if right is None else left + right
            number, level, size = number // 2, level + 1, 2 * size
        self._done = value

    @property
    def total(self) -> Sum | None:
        """The sum, once all leaves have come; None where none has a value."""
        return self._done


def tree_sum(values: list[Sum]) -> Sum | None:
    """The sum of values that are there already, by the same tree."""
    tree = TreeSum[Sum](len(values))
    for number, value in enumerate(values):
        tree.add(number, value)
    return tree.total


@dataclass(frozen=True)
class RecordingParts:
    """Parts of the statistics of one recording that are of one engine: its file, its parts, and how the recording is
    called."""

    file: str
    parts: tuple[int, ...]
    name: str


@dataclass(frozen=True)
class EngineTask:
    """An engine to judge: its pieces in order, and the nominal file with which they are compared."""

    serial: str
    build: str
    pieces: tuple[RecordingParts, ...]
    nominal: str
    fingerprint: str
    whole: bool
    baseline: FleetBaseline
    events: tuple[MaintenanceEvent, ...]
    settings: FleetSettings


@dataclass(frozen=True)
class EngineOutcome:
    """What was found, the sum of the engine's statistics, and how many records lie where training has not been."""

    finding: EngineFinding
    total: LocalStatistics | None
    outside_training: Counter[Extrapolation] = field(default_factory=Counter)


@dataclass
class _StoredWindows:
    """Windows of an engine as `build_series` reads them."""

    task: EngineTask
    monitor: Monitor
    outside_training: Counter[Extrapolation] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)

    @property
    def summed(self) -> bool:
        return self.task.whole

    def windows(self) -> Iterator[Window]:
        for piece in self.task.pieces:
            with CondensedReader(piece.file) as reader:
                for part in piece.parts:
                    for window in reader.windows(part, piece.name, self.task.serial, self.monitor.meaning):
                        self.outside_training.update(window.extrapolation)
                        self.reasons.update([window.reason] if window.statistics is None else [])
                        yield window, self.monitor.meaning


def judge_task(task: EngineTask) -> EngineOutcome:
    """What the history of an engine says; the same wherever it runs. What cannot be judged is a finding without a
    verdict, no error."""
    try:
        return _judge_windows(task)
    except EngineDiagError as error:
        return EngineOutcome(EngineFinding(task.serial, task.build, 0, 0, NO_VERDICT, str(error)), None)


def _judge_windows(task: EngineTask) -> EngineOutcome:
    monitor = whole_monitor(task.nominal, task.fingerprint)
    stored = _StoredWindows(task, monitor)
    windows = HistoryWindows(stored)
    series = build_series(windows, "covariance")
    stretches, instruments = series.stretches.get(task.serial, []), series.instruments.get(task.serial, ())
    if not stretches:
        nothing = replace(_no_statistics(task, stored, series), instruments=instruments)
        return EngineOutcome(nothing, None, stored.outside_training)
    baseline = task.baseline.count_stretches([x.window.records for x in stretches])
    sums = windows.engines[task.serial]
    history = EngineHistory(task.serial, task.build, stretches, sums, baseline, task.events)
    scale = _margin_scale(task.nominal, task.fingerprint)
    finding, account = judge_with_account(history, series, task.settings, scale)
    finding = replace(finding, instruments=instruments)
    if account is not None and task.settings.limits_K and not finding.margin.reason:
        scoping = _work_scope(task.nominal, task.fingerprint)
        power = available_power(account, scoping, scale, task.settings.limits_K, last=True)
        finding = replace(finding, power=power.now)
    return EngineOutcome(finding, tree_sum([x.statistics for x in stretches]), stored.outside_training)


@lru_cache(maxsize=4)
def _margin_scale(nominal: str, fingerprint: str) -> MarginScale:
    """Of the margin of all engines of a nominal file, which takes longer than an engine."""
    monitor = whole_monitor(nominal, fingerprint)
    return margin_scale(Series({}, monitor.meaning, 0, monitor=monitor))


@lru_cache(maxsize=4)
def _work_scope(nominal: str, fingerprint: str) -> WorkScopeEstimator:
    """Of all engines of a nominal file."""
    return WorkScopeEstimator(whole_monitor(nominal, fingerprint))


def _no_statistics(task: EngineTask, stored: _StoredWindows, series: Series) -> EngineFinding:
    most = stored.reasons.most_common(1)
    reason = f"no window has statistics: {most[0][0]}" if most else "no record"
    return replace(EngineFinding(task.serial, task.build, 0, 0, NO_VERDICT, reason), flights=series.skipped_windows)


BATCH_BYTES = 500_000
"""Recordings are reduced together up to this: some 3,000 records of a CSV file, as many as a call of the engine is
made with; a larger recording goes alone."""
BATCH_FILES = 200
"""And no more than so many files, all of which are open while their windows come."""

PACKED = 5
"""By how much less a packed recording weighs."""
SEEN_S = 10.0
"""Seconds after which a file that another machine has written is seen here, if it ever is: file servers keep for some
seconds what they believe is not there."""


@dataclass
class FleetRun:
    """Results of a run over a fleet.

    Attributes
    ----------
    fleet : Fleet
        The fleet file.
    models : mapping of str to BuildModel
        Build → its nominal state.
    recordings : sequence of (FleetRecording, CondenseOutcome)
        In order, with the outcome of each.
    finding : FleetFinding
        Findings of engines and of the fleet.
    excluded : sequence of (str, str)
        Recording, and why it is excluded.
    sums : mapping of str to LocalStatistics
        Build → sum of all its statistics.
    unknown_engines : sequence of str
        Engines that events name, and no recording.
    outside_training : Counter of Extrapolation
        Records outside the identified envelope.
    consumed_limit_K : tuple of float or None
        Margin that engines have used when they are removed from wing, and its standard deviation, K.
    """

    fleet: Fleet
    models: Mapping[str, BuildModel]
    recordings: Sequence[tuple[FleetRecording, CondenseOutcome]]
    finding: FleetFinding
    excluded: Sequence[tuple[str, str]] = ()
    sums: Mapping[str, LocalStatistics] = field(default_factory=dict)
    unknown_engines: Sequence[str] = ()
    outside_training: Counter[Extrapolation] = field(default_factory=Counter)
    consumed_limit_K: tuple[float, float] | None = None

    @property
    def counts(self) -> Counter[str]:
        """Of records and windows by what became of them, and of recordings: `fresh` were reduced by this run."""
        total: Counter[str] = Counter()
        left_out = {name for name, _ in self.excluded}
        for recorded, outcome in self.recordings:
            total.update(outcome.condensed.counts if outcome.condensed and recorded.name not in left_out else {})
            total.update(fresh=outcome.fresh)
        return total


def condense_all(
    recordings: Sequence[FleetRecording], models: Mapping[str, BuildModel], store: FleetStore, runner: Runner
) -> list[CondenseOutcome]:
    """What became of each recording. Raises OSError when the store cannot be written."""
    tasks = list(_batches([r for r in recordings if not r.trouble], models, store))
    found = {r.path: CondenseOutcome(r.path, trouble=r.trouble) for r in recordings if r.trouble}
    for _, outcomes in each(runner.run(condense, tasks), "batches of recordings reduced", len(tasks)):
        found |= {outcome.path: outcome for outcome in outcomes}
    _check_there(store, found.values())
    return [found[r.path] for r in recordings]


def _check_there(store: FleetStore, outcomes: Iterable[CondenseOutcome]) -> None:
    """Raises DataError when what workers have written is not seen here."""
    until = time.monotonic() + SEEN_S
    for outcome in outcomes:
        while outcome.condensed is not None and not store.path(outcome.condensed.key).exists():
            if time.monotonic() > until:
                what = f"{store.path(outcome.condensed.key)}: written by a worker, and not there"
                raise DataError(f"{what}: --store has to name a folder that all workers share under this path")
            time.sleep(0.1)


def _read_bytes(path: str) -> int:
    """Of a recording as it is read: packed ones hold more than they weigh."""
    size = os.path.getsize(path) if os.path.exists(path) else 0
    return size * (PACKED if path.endswith((".gz", ".parquet")) else 1)


def _batches(
    recordings: Sequence[FleetRecording], models: Mapping[str, BuildModel], store: FleetStore
) -> Iterator[CondenseTask]:
    waiting: list[str] = []
    size, build = 0, ""
    for recorded in recordings:
        more = _read_bytes(recorded.path)
        if waiting and (recorded.build != build or size + more > BATCH_BYTES or len(waiting) >= BATCH_FILES):
            yield CondenseTask(tuple(waiting), models[build].settings, str(store.folder))
            waiting, size = [], 0
        waiting.append(recorded.path)
        size, build = size + more, recorded.build
    if waiting:
        yield CondenseTask(tuple(waiting), models[build].settings, str(store.folder))


def engine_tasks(
    fleet: Fleet,
    recordings: Sequence[tuple[FleetRecording, CondenseOutcome]],
    models: Mapping[str, BuildModel],
    store: FleetStore,
) -> tuple[list[EngineTask], list[tuple[str, str]]]:
    """The engines in order of their serial numbers, each with its pieces in order of the recordings, and which
    recordings are excluded and why."""
    pieces: dict[tuple[str, str], list[RecordingParts]] = {}
    left_out: list[tuple[str, str]] = []
    seen: dict[tuple[str, str], str] = {}
    for recorded, outcome in recordings:
        condensed = outcome.condensed
        if condensed is None:
            left_out.append((recorded.name, outcome.trouble))
            continue
        first = seen.setdefault((recorded.build, condensed.sha256), recorded.name)
        if first != recorded.name:
            left_out.append((recorded.name, f"holds the same bytes as {first}, which are counted once"))
            continue
        named = {part.engine for part in condensed.parts if part.engine}
        if recorded.serial and len(named) > 1:
            told = f"holds records of {len(named)} engines, but its name says that it is of {recorded.serial}"
            left_out.append((recorded.name, told))
            continue
        parts: dict[str, list[int]] = {}
        for number, part in enumerate(condensed.parts):
            parts.setdefault(recorded.serial or part.engine, []).append(number)
        if "" in parts:
            told = "has records that name no engine in a column `engine`; engines: serial_from: file takes its name"
            left_out.append((recorded.name, told))
        for serial, numbers in parts.items():
            if serial:
                piece = RecordingParts(str(store.path(condensed.key)), tuple(numbers), recorded.name)
                pieces.setdefault((recorded.build, serial), []).append(piece)
    settings = FleetSettings(
        false_discovery=fleet.judge["fdr"],
        sensors=fleet.judge["sensors"],
        limits_K=fleet.judge["limits_K"],
        consumed_limit_K=None if fleet.judge["consumed_limit_K"] is None else tuple(fleet.judge["consumed_limit_K"]),
    )
    tasks = []
    for build, serial in sorted(pieces, key=lambda k: (natural_order(k[1]), k[0])):
        model = models[build]
        events = tuple(e for e in fleet.events if e.engine == serial)
        tasks.append(
            EngineTask(
                serial,
                build,
                tuple(pieces[build, serial]),
                model.settings.nominal,
                model.settings.fingerprint,
                fleet.whole_flights,
                fleet.baseline,
                events,
                settings,
            )
        )
    return tasks, left_out


def run_fleet(fleet: Fleet, recordings: Sequence[FleetRecording], store: FleetStore, runner: Runner) -> FleetRun:
    """Run a fleet: nominal states, statistics of recordings, judgement of engines and of the fleet.

    Parameters
    ----------
    fleet : Fleet
        The fleet file.
    recordings : sequence of FleetRecording
        As `find_recordings` gives them.
    store : FleetStore
        Keeps statistics and models.
    runner : Runner
        Where tasks run, see `open_runner`.

    Returns
    -------
    FleetRun

    Raises
    ------
    ConfigError, DataError, OSError
    NoVerdictError
        When there is no engine to judge.
    """
    builds = [b for b in fleet.builds if any(r.build == b.name and not r.trouble for r in recordings)]
    if not builds:
        raise NoVerdictError(f"{fleet.path}: no recording can be read: {recordings[0].name}: {recordings[0].trouble}")
    models = {build.name: build_model(fleet, build, recordings, store) for build in builds}
    for model in models.values():  # what is wrong with a nominal file is told before work begins
        engine = _work_scope(model.settings.nominal, model.settings.fingerprint).engine
        if engine is not None:
            check_limits(engine, fleet.judge["limits_K"], f"{fleet.path}: limits_K")
    outcomes = list(zip(recordings, condense_all(recordings, models, store, runner), strict=True))
    tasks, left_out = engine_tasks(fleet, outcomes, models, store)
    if not tasks:
        why = f": {left_out[0][0]}: {left_out[0][1]}" if left_out else ""
        raise NoVerdictError(f"{fleet.path}: no engine to judge{why}")
    findings, sums, elsewhere = _judge_all(tasks, runner)
    settings = learn_removal_limit(tasks[0].settings, findings, fleet.judge["taken_off"], f"{fleet.path}: taken_off")
    serials = {task.serial for task in tasks}
    known = whole_monitor(tasks[0].nominal, tasks[0].fingerprint).meaning
    return FleetRun(
        fleet,
        models,
        outcomes,
        apply_acknowledgements(judge_fleet(findings, settings, known), store.acknowledgements()),
        left_out,
        sums,
        sorted({e.engine for e in fleet.events} - serials, key=natural_order),
        elsewhere,
        settings.consumed_limit_K,
    )


def _judge_all(
    tasks: Sequence[EngineTask], runner: Runner
) -> tuple[list[EngineFinding], dict[str, LocalStatistics], Counter[Extrapolation]]:
    """Findings in the order of the tasks, the sum of all statistics of each build, and where records lie that training
    did not cover."""
    found: dict[int, EngineFinding] = {}
    elsewhere: Counter[Extrapolation] = Counter()
    place = {number: k for mine in _numbers_by_build(tasks).values() for k, number in enumerate(mine)}
    trees = {build: TreeSum[LocalStatistics](len(mine)) for build, mine in _numbers_by_build(tasks).items()}
    for number, judged in each(runner.run(judge_task, tasks), "engines judged", len(tasks)):
        found[number] = judged.finding
        trees[tasks[number].build].add(place[number], judged.total)
        elsewhere.update(judged.outside_training)
    sums = {build: tree.total for build, tree in trees.items() if tree.total is not None}
    return [found[k] for k in range(len(tasks))], sums, Counter(dict(sorted(elsewhere.items())))


def _numbers_by_build(tasks: Sequence[EngineTask]) -> dict[str, list[int]]:
    """Numbers of the tasks of each build."""
    numbers: dict[str, list[int]] = {}
    for number, task in enumerate(tasks):
        numbers.setdefault(task.build, []).append(number)
    return numbers
