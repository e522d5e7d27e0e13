"""`identify`: the nominal state of an engine, its parameters and sensor noise, from healthy recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import EngineLike, RecordingsLike, resolve_engine, resolve_recordings
from enginediag_cli.api.results import MessageLog, Picture, Result, Row
from enginediag_cli.errors import NoVerdictError, UsageError
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.load import EngineDescription
    from enginediag_cli.identification.covariance import ActiveBound
    from enginediag_cli.identification.identify import Identification
    from enginediag_cli.identification.nominal import Estimate, Nominal
    from enginediag_cli.identification.problem import TrainingRecording
    from enginediag_cli.intake.selection import NominalBaseline, RecordingSource

__all__ = ["IdentificationResult", "identify"]

NOMINAL_FILE = "nominal.yaml"
"""Name under which results call a nominal state that was not read from a file."""


@dataclass(frozen=True)
class TrainingChoices:
    """Which records are fitted: the first so many of each recording, and which are held out to judge the fit by."""

    first: int | None = None
    holdout: float | None = None
    holdout_last: bool = False
    keep_probes: bool = False
    allow_bounds: bool = False

    def check(self) -> None:
        """Raise UsageError for choices that exclude each other or are out of range."""
        if self.holdout is not None and self.holdout_last:
            raise UsageError("--holdout and --holdout-last exclude each other")
        if self.holdout is not None and not 0.0 < self.holdout <= 0.9:
            raise UsageError(f"--holdout: {self.holdout:g} is not a share above 0, up to 0.9")
        if self.first is not None and self.first < 1:
            raise UsageError(f"--first: {self.first} is not a number of records, from 1 on")

    def divided(self, training: list[TrainingRecording]) -> tuple[list[TrainingRecording], list[TrainingRecording]]:
        """Divide records into those to fit and those held out. Raises UsageError for too few recordings."""
        from enginediag_cli.identification.problem import first_records, hold_out_end

        if self.first is not None:
            training = first_records(training, self.first)
        if self.holdout is not None:
            return hold_out_end(training, self.holdout)
        if self.holdout_last:
            if len(training) < 2:
                raise UsageError("--holdout-last needs at least two recordings")
            return training[:-1], training[-1:]
        return training, []

    def notes(self, probes_left_out: Sequence[str]) -> dict[str, str]:
        """Choices that the result depends on, for its provenance."""
        notes = {} if self.first is None else {"first records": str(self.first)}
        if self.holdout is not None or self.holdout_last:
            notes["held out"] = (
                "the last recording" if self.holdout_last else f"last {self.holdout:g} of each recording"
            )
        if probes_left_out:
            notes["contradicted by heat balances, not fitted"] = ", ".join(probes_left_out)
        return notes


class IdentificationResult(Result):
    """The identified engine; see `identify`. Verbs that need a nominal engine accept it.

    Rows are the estimates of parameters, each in its unit.

    Attributes
    ----------
    converged : bool
        Whether the fit converged; `reason` says why, or why not.
    bounds : tuple of AtBound
        Parameters at a bound: the model lacks something.
    far_off : tuple of Estimate
        Parameters five standard deviations of their priors, or more, from what was expected.
    unexplained : tuple of (str, float)
        Sensors with residuals far above their stated noise, with the ratio [1].
    refusal : str
        Why there is no nominal state; "" where there is one.
    fit : Identification
        Everything else: quality of fit by sensor, cross-validation, envelope, map errors.
    """

    def __init__(
        self,
        engine: Engine,
        described: EngineDescription,
        fit: Identification,
        provenance: Mapping[str, str],
        refusal: str,
        messages: Messages,
    ):
        made = tuple(f"{key}: {text}" for key, text in provenance.items())
        super().__init__(head=lambda: made, messages=messages)
        self._engine, self._described, self._made = engine, described, provenance
        self.fit, self.refusal = fit, refusal
        self.judged = int(not refusal)

    def _compute(self) -> Iterator[Row]:
        yield from map(asdict, self.fit.estimates)

    @property
    def converged(self) -> bool:
        """Whether the fit converged."""
        return self.fit.converged

    @property
    def reason(self) -> str:
        """Why the fit ended."""
        return self.fit.reason

    @property
    def bounds(self) -> tuple[ActiveBound, ...]:
        """Parameters at a bound."""
        return self.fit.bounds

    @property
    def far_off(self) -> tuple[Estimate, ...]:
        """Parameters five standard deviations of their priors, or more, from the expected value."""
        return self.fit.implausible_estimates

    @property
    def unexplained(self) -> tuple[tuple[str, float], ...]:
        """Sensors with residuals far above their stated noise, with the ratio [1]."""
        return self.fit.unexplained_sensors

    @cached_property
    def nominal(self) -> Nominal:
        """Nominal state: estimates with covariance, noise, envelope. Raises NoVerdictError, with the reason."""
        from enginediag_cli.residuals.monitor import monitor_from_nominal
        from enginediag_cli.residuals.reduced import is_smooth

        if self.refusal:
            raise NoVerdictError(self.refusal)
        nominal = self.fit.nominal(self._engine_reference("-"), self._described.sha256, self._made)
        smooth = is_smooth(monitor_from_nominal(self._engine, nominal))
        return replace(nominal, smooth=smooth, description=self._described)

    def _engine_reference(self, path: str) -> str:
        """Return the path of the engine file as seen from the nominal file, with forward slashes."""
        import os

        folder = "." if path == "-" else os.path.dirname(path) or "."
        return Path(os.path.relpath(self._described.file, folder)).as_posix()

    def baseline(self) -> NominalBaseline:
        """Nominal state and engine, as other verbs read them from the nominal file.

        Returns
        -------
        Baseline

        Raises
        ------
        NoVerdictError
            Where there is no nominal state, with the reason.
        """
        return self._baseline

    @cached_property
    def _baseline(self) -> NominalBaseline:
        import tempfile

        from enginediag_cli.identification.nominal_file import write_nominal
        from enginediag_cli.intake.selection import open_baseline

        self._scratch = tempfile.TemporaryDirectory(prefix="enginediag_")  # lives as long as this
        path = Path(self._scratch.name) / NOMINAL_FILE
        write_nominal(self.nominal, path)
        return open_baseline(path)

    def save(self, path: str | Path, format: str = "auto") -> None:
        """Write the nominal file as the command's ``-o`` does, completely or not at all.

        Parameters
        ----------
        path : str or Path
            Nominal YAML; ``-`` is standard output.
        format : {"auto", "yaml"}
            It is always YAML; `to_frame` and `to_dict` give the estimates otherwise.

        Raises
        ------
        NoVerdictError
            Where there is no nominal state, with the reason.
        OSError
            Where the file cannot be written.
        """
        from enginediag_cli.identification.nominal_file import write_nominal

        if format not in ("auto", "yaml"):
            raise UsageError(f"a nominal file is YAML, not {format}")
        write_nominal(replace(self.nominal, engine_path=self._engine_reference(str(path))), str(path))

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome and the estimates as plain Python objects, ready for ``json.dump``.

        Returns
        -------
        dict
            ``converged``, ``reason``, ``refusal``, ``records`` (used, and excluded by reason), ``provenance`` and
            ``rows`` (estimates).
        """
        fit = self.fit
        outcome = {"converged": fit.converged, "reason": fit.reason, "refusal": self.refusal}
        return {**outcome, "records": dict(fit.records), **super().to_dict()}

    def plot(self) -> Picture:
        """Draw how well each reading is fitted.

        Returns
        -------
        Picture
        """
        from enginediag_cli.report.plotting.models import chart_svg, identification_chart

        return Picture(chart_svg(identification_chart(self.fit)))


def identify(
    engine: EngineLike,
    recordings: RecordingsLike,
    *,
    first: int | None = None,
    holdout: float | None = None,
    holdout_last: bool = False,
    cross_validation: bool = True,
    keep_probes: bool = False,
    model_error: float | None = None,
    allow_bounds: bool = False,
    messages: Messages | None = None,
) -> IdentificationResult:
    """Identify the nominal engine from recordings of healthy flights.

    The ``identification:`` block of the engine file lists the parameters to estimate and their prior sizes.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or a loaded engine.
    recordings
        Paths, `Recordings`, arrays, a DataFrame or a result of `simulate`; see `read_recordings`.
    first : int, optional
        Use only so many records of each recording, for an engine's early life.
    holdout : float, optional
        Share of each recording, at its end, that is kept out of the fit and judges it [1].
    holdout_last : bool
        Keep the last recording out of the fit and judge by it.
    cross_validation : bool
        Fit again without each block of records, to see how well it is predicted.
    keep_probes : bool
        Fit probes, too, that the heat balances of the others contradict.
    model_error : float, optional
        Relative accuracy of the component maps [1]; that of the engine file when not given.
    allow_bounds : bool
        Accept parameters at their bounds, or far from their priors.
    messages : Messages, optional
        Receives the report and warnings; they are collected when not given, and `summary` gives them.

    Returns
    -------
    IdentificationResult
        Check ``refusal`` first: a fit without a nominal state is a result, too.

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError

    References
    ----------
    Regularised Gauss–Newton with robust loss and noise in turn; see `enginediag_cli.identification.identify`.
    """
    from enginediag_cli.engine.load import EngineDescription
    from enginediag_cli.engine.overview import heating_value_doubts
    from enginediag_cli.identification.identify import identify as run
    from enginediag_cli.report.tables.identification import doubt_lines, report_lines

    messages = messages if messages is not None else MessageLog()
    choices = TrainingChoices(first, holdout, holdout_last, keep_probes, allow_bounds)
    choices.check()
    path = str(own_or_shipped(engine)) if isinstance(engine, (str, Path)) else engine.path
    model, source = resolve_engine(engine), resolve_recordings(recordings)
    for doubt in heating_value_doubts(model) if hasattr(model, "network") else ():
        messages.warning(f"{path}: {doubt}")
    described = EngineDescription.from_engine_file(path, model.declared)
    training, left_out = _training(model, source, choices, messages)
    training, held_out = choices.divided(training)
    fit = run(model, training, held_out=held_out, cross_validation=cross_validation, map_accuracy=model_error)
    for line in report_lines(fit):
        messages.note(line)
    for line in doubt_lines(fit):
        messages.warning(line)
    refusal = _refusal(fit, allow_bounds, source.accept_mismatch)
    if refusal:
        messages.error(refusal)
    provenance = _provenance(source, choices.notes(left_out))
    return IdentificationResult(model, described, fit, provenance, refusal, messages)


def _training(
    engine: Engine, source: RecordingSource, choices: TrainingChoices, messages: Messages
) -> tuple[list[TrainingRecording], tuple[str, ...]]:
    """Read the recordings to fit; return them with the columns of excluded probes."""
    from enginediag_cli.identification.probes import drop_probes, wrong_probes
    from enginediag_cli.identification.problem import drop_repeats
    from enginediag_cli.intake.agreement import check_against_engine
    from enginediag_cli.intake.loader import MOST, RecordingLoader, Thinning, load_flights
    from enginediag_cli.intake.selection import required_columns
    from enginediag_cli.report.tables.identification import probe_lines, repeat_lines
    from enginediag_cli.report.tables.recordings import report_excluded, report_mismatches, report_thinning

    agreement = check_against_engine(engine)
    intake = RecordingLoader(source, required_columns(engine, past=True), agreement=agreement)
    thinning = Thinning(0 if choices.first else MOST)
    training = [flight.recording for flight in load_flights(intake, thinning)]
    report_thinning(messages, thinning)
    report_excluded(messages, intake.excluded)
    report_mismatches(messages, intake.mismatches)
    training, repeats = drop_repeats(training, (*engine.inputs, *engine.sensors))
    for line in repeat_lines(repeats):
        messages.warning(line)
    probes = wrong_probes(engine, training)
    for line in probe_lines(probes, kept=choices.keep_probes):
        messages.warning(line)
    if choices.keep_probes:
        return training, ()
    left_out = tuple(w.columns[0] for w in probes if w.is_unique and w.columns[0] in engine.sensors)
    return drop_probes(training, left_out), left_out


def _refusal(fit: Identification, allow_bounds: bool, accept_mismatch: bool) -> str:
    """Return why a fit gives no nominal state; "" if it gives one."""
    from enginediag_cli.report.tables.identification import bounds_line

    if not fit.converged:
        return f"no nominal state: {fit.reason}; nothing is written"
    if fit.bounds and not allow_bounds:
        return bounds_line(fit.bounds)
    if fit.implausible_estimates and not (allow_bounds or accept_mismatch):
        named = ", ".join(e.name for e in fit.implausible_estimates)
        return f"no nominal state: {named} where no engine of this kind is; --allow-bounds writes it as it is"
    return ""


def _provenance(source: RecordingSource, notes: Mapping[str, str]) -> dict[str, str]:
    """Return the version and every choice behind a nominal file, files by name and hash but without folder."""
    import os

    from enginediag_cli import __version__
    from enginediag_cli.recordings.source import current_notes, file_sha256

    made = {"enginediag": __version__}
    for number, path in enumerate(source.files, start=1):
        made[f"recording {number}"] = (
            "stdin" if path == "-" else f"{os.path.basename(path)} sha256:{file_sha256(path)[:16]}"
        )
    if source.recorder:
        made["recorder"] = f"{os.path.basename(source.recorder)} sha256:{file_sha256(source.recorder)[:16]}"
    return {**made, **current_notes(), **source.notes, **notes}
