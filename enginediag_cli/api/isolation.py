"""`isolate`: which parameters changed, by how much, how surely, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import SENTENCES, Comparison, NominalLike, RecordingsLike, compare, report_exclusions
from enginediag_cli.api.results import Picture, Result, Row
from enginediag_cli.errors import UsageError
from enginediag_cli.parameters import INSTRUMENT, PARAMETER
from enginediag_cli.progress import each
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    from enginediag_cli.fleets.work_scope import WorkScope, WorkScopeEstimator
    from enginediag_cli.isolation.diagnosis import DiagnosisOptions
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.windows import IsolatedWindow, WindowIsolation
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.residuals.long_windows import RecentRecords
    from enginediag_cli.residuals.monitor import Monitor

__all__ = ["IsolationResult", "isolate"]

METHODS = ("posterior", "incremental", "sensitivity", "minmax")
FORMS = ("nested", "cell", "sentences", "")
"""How an addition to an answer is written: as objects, as text in a cell, in messages alone, or not computed."""


@dataclass(frozen=True)
class IsolationChoices:
    """Arguments of `isolate` other than what it reads."""

    method: str = "posterior"
    by: str = "parameter"
    sensors: bool | None = None
    one_sided: bool = False
    catalogue: Sequence[str] = ()
    nonlinear: str = "auto"
    advise: bool = False
    extra_sensors: Mapping[str, float] = field(default_factory=dict)
    flips: str = "nested"
    work_scope: str = "nested"
    pool: int = 0

    def check(self, comparison: Comparison) -> None:
        """Raise UsageError for choices that exclude each other."""
        nominal, reference = comparison.given, comparison.judging.reference
        by_component = self.by == "component"
        if self.pool:
            self._check_pool(comparison)
        refused = {
            f"--method: there is no {self.method!r}, but {', '.join(METHODS)}": self.method not in METHODS,
            "--one-sided, --catalogue, --nonlinear and --advise go with --by parameter": by_component
            and (self.one_sided or bool(self.catalogue) or self.advise or self.nonlinear == "always"),
            "--one-sided and --nonlinear always go with --method posterior": self.method != "posterior"
            and (self.one_sided or self.nonlinear == "always"),
            "--sensors needs --nominal; to statistics they come by residual --sensors": not nominal
            and bool(self.sensors),
            "--advise and --nonlinear always need --nominal": not nominal
            and (self.advise or self.nonlinear == "always"),
            "--nonlinear always does not go with --reference": bool(reference) and self.nonlinear == "always",
            "--extra-sensor goes with --advise": bool(self.extra_sensors) and not self.advise,
        }
        for reason, wrong in refused.items():
            if wrong:
                raise UsageError(reason)

    def _check_pool(self, comparison: Comparison) -> None:
        judging, patterns = comparison.judging, comparison.options.monitor
        refused = {
            "--pool counts flights, from 1 on": self.pool < 1,
            "--pool takes whole flights: --window and --step cut them": not judging.plan.is_whole_flight,
            "--pool compares with nominal; for changes since an engine's first flights use trend --reference": bool(
                judging.reference
            ),
            "--pool learns what instruments are off by from flight to flight: they must be among the suspects "
            "(without --monitor, --no-sensors and tests of --method)": not self.sensors_watched(patterns),
            "--pool judges sums over flights, of which no records are kept: it does not go with --nonlinear always": (
                self.nonlinear == "always"
            ),
        }
        for reason, wrong in refused.items():
            if wrong:
                raise UsageError(reason)

    @property
    def notes(self) -> dict[str, str]:
        """Choices that the result depends on, for its provenance."""
        shown = {"one_sided": "yes"} if self.one_sided else {}
        if self.pool:
            shown["pooled"] = f"last {self.pool} flights of each engine"
        if self.nonlinear != "auto":
            shown["nonlinear"] = self.nonlinear
        if self.sensors is not None:
            shown["sensors"] = "yes" if self.sensors else "no"
        return shown

    def files(self) -> list[str]:
        """Return the files of the catalogue; of a folder, its YAML files."""
        found: list[str] = []
        for name in self.catalogue:
            path = own_or_shipped(name)
            here = sorted(map(str, path.glob("*.yaml"))) if path.is_dir() else [str(path)]
            if not here:
                raise UsageError(f"--catalogue: no YAML file in {name}")
            found += here
        return found

    def keeps_records(self, linearise: str) -> bool:
        """Return whether the records may be needed: for advice, and for fits with the full model."""
        return not self.pool and (self.advise or self._full_model(linearise))

    def _full_model(self, linearise: str) -> bool:
        wanted = self.nonlinear == "always" or (self.nonlinear == "auto" and linearise == "estimate")
        if self.pool:  # sums over flights, of which no records are kept
            return False
        return self.method == "posterior" and wanted

    def diagnosis_options(self, linearise: str, isolation: IsolationOptions) -> DiagnosisOptions:
        """Collect the options of the diagnosis of a window; reads the catalogue."""
        from enginediag_cli.faults.catalogue import FaultSet, load_faults
        from enginediag_cli.isolation.diagnosis import DiagnosisOptions

        # a fault that several files hold is described best by the one that holds the fewest others
        parts = sorted((load_faults(file) for file in self.files()), key=lambda part: len(part.names))
        components = tuple(fault for part in parts for fault in part.components)
        catalogue = FaultSet(components, tuple(fault for part in parts for fault in part.sensors))
        nonlinear = self.nonlinear if self._full_model(linearise) else "never"
        return DiagnosisOptions(self.method, isolation, self.one_sided, nonlinear, catalogue if parts else None)

    def sensors_watched(self, patterns: Sequence[str]) -> bool:
        """Return whether every sensor in use may be wrong, too.

        Not if the monitored parameters are named, or the method is a test of the local approach, or sensors are taken
        as right.
        """
        return (self.method == "posterior" and not patterns) if self.sensors is None else self.sensors

    def warn_of_sensors(self, messages: Messages, parameters: Iterable[Parameter]) -> None:
        """Warn that statistics without sensor errors attribute a wrong sensor to the engine."""
        if self.sensors is None and not any(p.belongs_to_sensor for p in parameters):
            messages.warning(
                "these statistics hold no errors of sensors: a wrong sensor would be taken for a change of the engine; "
                "`residual --sensors` writes statistics that hold them"
            )


class IsolationResult(Result):
    """A row for every window and isolated parameter, or component; see `isolate`.

    `findings` counts windows with an isolated change.
    """

    def __init__(self, comparison: Comparison, choices: IsolationChoices, options: IsolationOptions):
        from enginediag_cli.isolation.windows import WindowIsolation
        from enginediag_cli.report.tables.isolation import COMPONENTS, ISOLATE

        choices.check(comparison)
        self._quiet = comparison.messages.quiet
        judging, by_component = comparison.judging, choices.by == "component"
        if by_component and (choices.method != "posterior" or options.faults):
            raise UsageError("--by component goes with --method posterior and without --faults")
        self._choices, self._options = choices, options
        watched = choices.sensors_watched(comparison.options.monitor)
        # a drift begins anew with each flight: of several flights it is no suspect
        self._monitor = monitor = comparison.monitor(sensors=watched, drifts=not choices.pool)
        self._files = files = comparison.files(monitor, drifts=not choices.pool)
        if choices.pool:
            from enginediag_cli.history.engines import PooledWindows

            self._files = files = PooledWindows.from_reader(files, choices.pool)
        self._diagnosis = choices.diagnosis_options(judging.linearise, options)
        kept = _record_history(comparison, choices, monitor)
        flips = self._addition_filter(choices.flips)
        self._isolating: WindowIsolation = WindowIsolation(
            files,
            self._diagnosis,
            options.false_alarm,
            by_component,
            kept,
            choices.advise,
            dict(choices.extra_sensors),
            flips,
        )
        self._drawn: list[IsolatedWindow] = []
        table = COMPONENTS if by_component else ISOLATE
        notes = {"method": choices.method, "false_alarm": str(options.false_alarm)}
        head = comparison.head("isolate", table, files.intake, notes, configs=choices.files(), last=choices.notes)
        super().__init__(table=table, head=head, messages=comparison.messages)
        self.unread = files.intake.unread

    def _addition_filter(self, form: str) -> Any:
        """Return a function: whether an addition to the answer is computed for a window.

        It depends on the number of the window, from 1, and on whether a change was isolated in it.
        """
        if form not in FORMS:
            raise UsageError(f"`flips` and `work_scope` must be one of {', '.join(map(repr, FORMS))}, not {form!r}")
        in_words = form != "" and not self._quiet
        return lambda number, named: form in ("nested", "cell") or (in_words and named and number <= SENTENCES)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.isolation import isolated_rows, report_isolation, report_pooled

        choices = self._choices
        shown = {"flips": choices.flips, "work_scope": choices.work_scope}
        forms = {name: "" if form == "sentences" else form for name, form in shown.items()}
        for number, found in enumerate(each(self._isolating.windows(), "windows isolated"), start=1):
            if number == 1 and found.verdict.window.statistics is not None and self._monitor is None:
                choices.warn_of_sensors(self.messages, found.meaning.values())
            self.judged += found.judged
            self.findings += found.named
            scope = self._work_scope(number, found)
            self._drawn[:] = [*(w for w in self._drawn if w.named and not found.named), found]
            if number <= SENTENCES:
                report_pooled(self.messages, found, getattr(self._files, "agreement", {}))
                report_isolation(self.messages, found, scope)
            catalogue = self._diagnosis.catalogue is not None
            yield from isolated_rows(found, catalogue, advice=choices.advise, scope=scope, forms=forms)
        report_exclusions(self.messages, self._files)

    @cached_property
    def _scoping(self) -> WorkScopeEstimator | None:
        """Work scope of the nominal engine, computed once."""
        from enginediag_cli.fleets.work_scope import WorkScopeEstimator

        return None if self._monitor is None else WorkScopeEstimator(self._monitor)

    def _work_scope(self, number: int, found: IsolatedWindow) -> WorkScope | None:
        if self._scoping is None or not self._addition_filter(self._choices.work_scope)(number, found.named):
            return None
        return self._scoping.window_scope(found, self._options.prior, self._options.largest)

    def plot(self) -> Picture:
        """Draw the fingerprint of the last window with an isolated change. Raises NoVerdictError, also by component."""
        from enginediag_cli.report.plotting.models import chart_svg, isolation_chart

        _ = self.rows
        return Picture(chart_svg(isolation_chart(self._drawn)))


def _record_history(comparison: Comparison, choices: IsolationChoices, monitor: Monitor | None) -> RecentRecords | None:
    from enginediag_cli.residuals.long_windows import RecentRecords

    judging = comparison.judging
    plain = not judging.reference  # otherwise the score knows more than the records tell
    if monitor is None or not plain or choices.by == "component" or not choices.keeps_records(judging.linearise):
        return None
    return RecentRecords(monitor, short_windows=not judging.plan.is_whole_flight)


def isolate(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    method: str = "posterior",
    by: str = "parameter",
    faults: int | None = None,
    largest: int | None = None,
    false_alarm: float = 0.01,
    inclusion: float = PARAMETER,
    sensor_inclusion: float = INSTRUMENT,
    coverage: float = 0.98,
    confidence: float = 0.95,
    sensors: bool | None = None,
    one_sided: bool = False,
    catalogue: Sequence[str] = (),
    nonlinear: str = "auto",
    advise: bool = False,
    extra_sensors: Mapping[str, float] | None = None,
    flips: str = "nested",
    work_scope: str = "nested",
    pool: int = 0,
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> IsolationResult:
    """Isolate the parameters, or the components, that changed.

    Parameters
    ----------
    nominal : str, Path, Baseline, IdentificationResult or None
        Nominal engine; None where the recordings are statistics that `residual` made.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    method : {"posterior", "incremental", "sensitivity", "minmax"}
        Posterior of all sets of changes, or a test of the local approach.
    by : {"parameter", "component"}
        One row per parameter, or one per window with the components that changed.
    faults, largest : int, optional
        Number of changed parameters, if known; largest number that changed together.
    false_alarm : float
        Probability of a false alarm of the test [1].
    inclusion, sensor_inclusion : float
        Prior probability that a parameter of the engine changed, that a sensor is wrong [1].
    coverage, confidence : float
        Probability that the answer and its alternatives cover together [1]; level of intervals [1].
    sensors : bool, optional
        Whether every sensor may be wrong, too; by default yes, unless ``monitor`` names parameters.
    one_sided : bool
        Changes have known signs: efficiencies fall.
    catalogue : sequence of str
        Fault files, or folders of them: the faults that fit are named.
    nonlinear : {"auto", "always", "never"}
        When leading sets are fitted with the full model.
    advise : bool
        Recommend the next recording; ``extra_sensors`` maps further columns to their noise, in the column's unit.
    flips, work_scope : {"nested", "cell", "sentences", ""}
        How the sensitivity of the conclusion, and the work scope, are written into the rows.
    pool : int
        Judge the last so many flights of each engine together, as one window; changes are means over these flights. 0:
        every flight by itself.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read, in bounded memory.
    **windows
        Attributes of `WindowOptions`.

    Returns
    -------
    IsolationResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError

    References
    ----------
    Equations (13) and (14) of the local approach; posterior of sets: see `enginediag_cli.isolation.posterior`.
    """
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.prior import SetPrior

    extra = dict(extra_sensors or {})
    choices = IsolationChoices(
        method, by, sensors, one_sided, tuple(catalogue), nonlinear, advise, extra, flips, work_scope, pool
    )
    prior = SetPrior(inclusion=inclusion, sensor=sensor_inclusion)
    options = IsolationOptions(
        faults=faults, false_alarm=false_alarm, prior=prior, coverage=coverage, confidence=confidence, largest=largest
    )
    comparison = compare(nominal, recordings, windows, messages)
    return IsolationResult(comparison, choices, options).complete(stream)
