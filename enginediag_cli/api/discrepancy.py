"""`locate` and `explain`: whether model and recordings differ, where, and what physics the model lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import EngineLike, NominalLike, RecordingsLike, resolve_baseline, resolve_recordings
from enginediag_cli.api.results import DocumentResult, MessageLog, Picture, Result, Row
from enginediag_cli.errors import DataError, NoVerdictError, UsageError
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.fit.evidence import Dataset
    from enginediag_cli.mismatch.fit.load import LoadedCase, RecordedCase
    from enginediag_cli.mismatch.locate.locate import Located, Place
    from enginediag_cli.mismatch.unrecorded.per_record import PerRecord

__all__ = [
    "ExplainResult",
    "LocateResult",
    "PerRecordResult",
    "SearchOptions",
    "effect_names",
    "explain",
    "locate",
    "locate_per_record",
]


@dataclass(frozen=True)
class SearchOptions:
    """What counts as missing physics, and what it may depend on.

    Attributes
    ----------
    model_error : float, optional
        Relative accuracy of the component maps [1], in the place of what the engine file or the nominal state has.
    false_finding : float
        Probability of finding something where nothing is missing [1].
    drivers : sequence of str
        Further recorded columns that the missing physics may depend on.
    noise : {"specified", "estimate"}, optional
        Sensor noise as stated, or estimated from the residuals. Default: the engine file's choice; for `explain`, that
        of the flights.
    seed : int
        Seed of all random numbers.
    accept_changed_engine : bool
        Use an engine file although it is no longer the one that was identified.
    """

    model_error: float | None = None
    false_finding: float = 0.05
    drivers: Sequence[str] = ()
    noise: str | None = None
    seed: int = 0
    accept_changed_engine: bool = False


@dataclass(frozen=True)
class Inquiry:
    """Inputs of a search: engine, recordings and nominal state as a case, and where messages go."""

    case: RecordedCase
    messages: Messages
    scratch: tuple[Any, ...] = ()  # keeps the files of what was given as objects alive

    def report_loading(self, loaded: LoadedCase) -> None:
        """Report doubts about the nominal state, and excluded data."""
        from enginediag_cli.report.tables.recordings import (
            report_baseline,
            report_excluded,
            report_mismatches,
            report_thinning,
        )

        if loaded.baseline is not None:
            report_baseline(self.messages, loaded.baseline, self.case.source.engine_instance)
        report_mismatches(self.messages, loaded.intake.mismatches)
        report_thinning(self.messages, loaded.thinning)
        report_excluded(self.messages, loaded.intake.excluded)

    def head(self, command: str, inherited: Sequence[str], **notes: str) -> Callable[[], tuple[str, ...]]:
        """Make the header of a result: files, choices other than the default, and the headers of the recordings."""
        from enginediag_cli.recordings.source import header_lines

        case, asked = self.case, self.case.asked
        made = {
            **case.source.notes,
            "model_error": "" if asked.model_error is None else f"{asked.model_error:g}",
            "false_finding": f"{asked.false_alarm:g}",
            "drivers": ", ".join(asked.drivers),
            "noise": asked.noise or "",
            **notes,
        }
        lines = header_lines(
            command,
            seed=asked.seed,
            configs=[path for path in (case.engine, case.nominal, *case.source.configs) if path],
            notes={name: text for name, text in made.items() if text},
            inherited=tuple(inherited),
        )
        return lambda: lines


def inquire(
    engine: EngineLike,
    recordings: RecordingsLike,
    nominal: NominalLike,
    search: Mapping[str, Any],
    messages: Messages | None,
) -> Inquiry:
    """Interpret the arguments of a search. Raises UsageError, DataError."""
    from enginediag_cli.mismatch.fit.load import MismatchQuery, RecordedCase

    options = SearchOptions(**search)
    if not 0.0 < options.false_finding < 1.0:
        raise UsageError(f"--false-finding: {options.false_finding:g} is no probability between 0 and 1")
    if options.noise not in (None, "specified", "estimate"):
        raise UsageError(f"--noise: there is no {options.noise!r}, but specified and estimate")
    asked = MismatchQuery(
        options.model_error, options.false_finding, tuple(options.drivers), options.noise, options.seed
    )
    source = resolve_recordings(recordings)
    path, scratch = _nominal_file(nominal)
    case = RecordedCase(_engine_file(engine), source, path, options.accept_changed_engine, asked)
    return Inquiry(case, messages if messages is not None else MessageLog(), (source, *scratch))


def _engine_file(engine: EngineLike) -> str:
    """Path of an engine file. Raises DataError."""
    if isinstance(engine, (str, Path)):
        return str(own_or_shipped(engine))
    from enginediag_cli.physics.engine_file import load_engine

    path = getattr(engine, "path", None)
    if not path:
        raise DataError(f"no engine file: {type(engine).__name__}; give a path, or what load_engine gives")
    in_file = [effect.label for effect in load_engine(path).effects]
    if in_file != [effect.label for effect in engine.effects]:
        raise DataError(f"{path} does not carry the effects of this engine: give the path of a file that does")
    return str(path)


def _nominal_file(nominal: NominalLike) -> tuple[str | None, tuple[Any, ...]]:
    """Path of a nominal file, and what keeps it there: a state that has no file is written to one first."""
    if nominal is None or isinstance(nominal, (str, Path)):
        return None if nominal is None else str(nominal), ()
    state = resolve_baseline(nominal)
    assert state is not None
    if state.path and Path(state.path).is_file():
        return state.path, ()
    import tempfile

    from enginediag_cli.identification.nominal_file import write_nominal

    folder = tempfile.TemporaryDirectory(prefix="enginediag_")
    path = Path(folder.name) / "nominal.yaml"
    write_nominal(state.nominal, path)
    return str(path), (folder,)


def effect_names() -> tuple[str, ...]:
    """Names of the physics terms that an engine file can carry and that a search considers.

    Returns
    -------
    tuple of str
        Such as ``"reynolds_efficiency"``; a site is written behind it, ``reynolds_efficiency@hpc``.

    Examples
    --------
    >>> from enginediag_cli import effect_names
    >>> "reynolds_efficiency" in effect_names()
    True
    """
    from enginediag_cli.physics.registry import term_names

    return tuple(term_names())


def check_effects(option: str, labels: Sequence[str]) -> None:
    """Raise UsageError for an unknown term, or term@site."""
    from enginediag_cli.config.fields import near

    known = effect_names() if labels else ()
    for label in labels:
        name = label.partition("@")[0]
        if name not in known:
            raise UsageError(f"{option}: there is no physics term {label!r} ({near(name, known)})")


class LocateResult(Result):
    """Where model and recordings differ: one row per place; see `locate`.

    Attributes
    ----------
    located : Located
        Tests, places and resamples behind the rows.
    evidence : Evidence
        Flights, as arrays by column, with the noise and the priors that were assumed.
    converged : bool
        False where the model could not be fitted, so that there is no verdict and no row.
    found, judged : int
        1 where model and recordings differ; 1 where there is a verdict.
    """

    def __init__(self, inquiry: Inquiry, every_place: bool):
        from enginediag_cli.mismatch.fit.load import load_case
        from enginediag_cli.mismatch.locate.locate import locate as run
        from enginediag_cli.mismatch.locate.verdict_kind import classify_verdict
        from enginediag_cli.report.tables.location import LOCATE as DECLARED

        loaded = load_case(inquiry.case)
        inquiry.report_loading(loaded)
        self.evidence: Dataset = loaded.evidence
        self.located: Located = run(loaded.evidence)
        self.converged = self.located.converged
        self._kind, self._every_place = classify_verdict(self.located), every_place
        notes = {**DECLARED.notes, "map accuracy": f"{loaded.evidence.settings.map_accuracy:g}"}
        super().__init__(
            table=DECLARED,
            head=inquiry.head("locate", loaded.intake.provenance, **notes),
            columns=DECLARED.names,
            messages=inquiry.messages,
        )
        self.findings, self.judged = int(self.converged and self.located.mismatch), int(self.converged)

    @property
    def verdict(self) -> str:
        """The kind of mismatch, or that there is none; "" without a verdict."""
        from enginediag_cli.report.tables.location import kind_words

        return kind_words(self._kind) if self.converged else ""

    @property
    def places(self) -> Sequence[Place]:
        """Plausible places, best first."""
        return tuple(self.located.within) if self.converged else ()

    @property
    def sentences(self) -> list[str]:
        """The findings in words."""
        from enginediag_cli.report.tables.location import sentences

        return list(sentences(self.located, self._kind, self.evidence.engine))

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.location import located_rows

        if not self.converged:
            self.messages.error(self.sentences[0])
            return
        yield from located_rows(self.located, self._kind, self._every_place)
        for line in self.sentences:
            self.messages.note(line)

    def plot(self) -> Picture:
        """Draw the map of places and drivers, and the residuals at the best place. Raises NoVerdictError."""
        from enginediag_cli.report.tables.location import picture

        if not self.converged:
            raise NoVerdictError(self.sentences[0])
        title = f"{self.evidence.engine.name}: where model and recordings differ"
        return Picture(picture(self.located, self._kind, title, self.sentences[:3]))


def locate(
    engine: EngineLike,
    recordings: RecordingsLike,
    *,
    nominal: NominalLike = None,
    every_place: bool = False,
    messages: Messages | None = None,
    **search: Any,
) -> LocateResult:
    """Locate a mismatch between the model of an engine and recordings of healthy flights.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or the name of one that comes with enginediag.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine to start from, with its noise.
    every_place : bool
        Rows of every place of the map, not only of the plausible ones.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    **search
        Attributes of `SearchOptions`: ``drivers=("hours",)``, ``noise="estimate"`` and so on.

    Returns
    -------
    LocateResult

    Raises
    ------
    UsageError, ConfigError, DataError

    References
    ----------
    Score test of a free-form correction at each location × driver; see `enginediag_cli.mismatch.locate`.
    """
    return LocateResult(inquire(engine, recordings, nominal, search, messages), every_place).complete()


class PerRecordResult(Result):
    """Places with a free amplitude in every record, best first; see `locate_per_record`.

    Attributes
    ----------
    fits : sequence of PerRecord
        The fits behind the rows, with the amplitudes as arrays of shape (records,).
    evidence : Evidence
        The records that were used.
    judged : int
        1 where a place could be fitted.
    """

    def __init__(self, inquiry: Inquiry, every: int):
        from enginediag_cli.mismatch.fit.freeform import list_locations
        from enginediag_cli.mismatch.fit.identified import nuisance
        from enginediag_cli.mismatch.fit.load import load_case
        from enginediag_cli.mismatch.unrecorded.per_record import scan, thin_records
        from enginediag_cli.report.tables.location import PER_RECORD as DECLARED

        if every < 1:
            raise UsageError(f"--per-record: {every} is no number of records")
        loaded = load_case(inquiry.case)
        inquiry.report_loading(loaded)
        self.evidence: Dataset = thin_records(loaded.evidence, every)
        self._along = nuisance(self.evidence)
        places = list_locations(self.evidence.engine, tuple(self.evidence.noise.sigma))
        self.fits: Sequence[PerRecord] = scan(self.evidence, places, self._along)
        accuracy = f"{self.evidence.settings.map_accuracy:g}"
        notes = {**DECLARED.notes, "map accuracy": accuracy, "per-record": f"{every}"}
        super().__init__(
            table=DECLARED,
            head=inquiry.head("locate", loaded.intake.provenance, **notes),
            columns=DECLARED.names,
            messages=inquiry.messages,
        )
        self.judged = int(self.fits[0].location is not None and self.fits[0].converged)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.mismatch.unrecorded.control_law import find_stop, held_readings
        from enginediag_cli.mismatch.unrecorded.per_record import inlet_temperature
        from enginediag_cli.mismatch.unrecorded.per_record_effects import similar_effects
        from enginediag_cli.physics.registry import candidate_effects
        from enginediag_cli.report.tables.location import per_record_rows, per_record_sentences

        yield from per_record_rows(self.fits)
        best, evidence = self.fits[0], self.evidence
        if not self.judged:
            self.messages.error("no verdict: no place with an amplitude of its own in every record could be fitted")
            return
        stop = find_stop(best, inlet_temperature(evidence, best))
        acting = similar_effects(evidence, best, list(candidate_effects(evidence.engine)))
        standing = held_readings(evidence, best, self._along, stop) if stop.bands else []
        for line in per_record_sentences(self.fits, stop, standing, acting):
            self.messages.note(line)


def locate_per_record(
    engine: EngineLike,
    recordings: RecordingsLike,
    *,
    every: int = 1,
    nominal: NominalLike = None,
    messages: Messages | None = None,
    **search: Any,
) -> PerRecordResult:
    """Fit a free amplitude in every record at each place, for large effects without a recorded driver.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or the name of one that comes with enginediag.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    every : int
        Use every so-many-th record.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine to start from, with its noise.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    **search
        Attributes of `SearchOptions`.

    Returns
    -------
    PerRecordResult

    Raises
    ------
    UsageError, ConfigError, DataError
    """
    return PerRecordResult(inquire(engine, recordings, nominal, search, messages), every).complete()


class ExplainResult(DocumentResult):
    """What physics a model lacks: one row per coefficient, and a document; see `explain`.

    Attributes
    ----------
    story : Story
        The answer with all details: explanations, curves, advice.
    evidence : Evidence
        Flights, as arrays by column, with the noise that the answer rests on.
    found, judged : int
        1 where something is missing; 1 where there is an answer.
    """

    def __init__(self, inquiry: Inquiry, without: Sequence[str], advice: bool, every_plan: bool):
        from enginediag_cli.mismatch.explain.answer import NOT_CONVERGED
        from enginediag_cli.mismatch.explain.story import explain_mismatch
        from enginediag_cli.mismatch.fit.load import load_case
        from enginediag_cli.physics.registry import candidate_effects
        from enginediag_cli.report.tables.explanation import EXPLAIN

        loaded = load_case(inquiry.case, identified=True, controls=True)
        inquiry.report_loading(loaded)
        effects = list(candidate_effects(loaded.evidence.engine, tuple(without)))
        story = explain_mismatch(loaded.evidence, effects, advise=advice, intake=loaded.intake)
        self.story: ExplanationResult = replace(story, control=loaded.control, planned=every_plan)
        asked = {"without": ", ".join(without)} if without else {}
        super().__init__(
            head=inquiry.head("explain", loaded.intake.provenance, **asked),
            columns=EXPLAIN.names,
            summary_columns=EXPLAIN.terminal,
            messages=inquiry.messages,
        )
        self.judged = int(self.story.answer.status != NOT_CONVERGED or self.story.control is not None)
        self.findings = int(bool(self.judged) and not self.story.found_nothing)

    @property
    def evidence(self) -> Dataset:
        """Flights with noise and priors."""
        return self.story.evidence

    @property
    def status(self) -> str:
        """The kind of answer, as in the column of this name."""
        return self.story.answer.status

    @property
    def sentences(self) -> list[str]:
        """The answer in words."""
        from enginediag_cli.report.tables.explanation_text import sentences

        return list(sentences(self.story))

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.explanation import rows

        yield from rows(self.story)
        for line in self.sentences:
            self.messages.note(line)

    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        from enginediag_cli.report.tables.explanation import document

        return document(self.story, tuple(provenance))

    @property
    def curves(self) -> list[Row]:
        """The unexplained part as points of curves over its driver, with units and standard errors."""
        from enginediag_cli.report.tables.explanation import curve_rows

        return list(curve_rows(self.story.curves))

    @property
    def amplitudes(self) -> list[Row]:
        """Amplitude of an effect without a recorded driver, record by record, with unit and standard error."""
        from enginediag_cli.report.tables.explanation import amplitude_rows

        return list(amplitude_rows(self.story))

    def save_curves(self, path: str | Path) -> None:
        """Write `curves` as CSV or, by its name, Parquet; a note if there is none. Raises OSError."""
        self._save(path, self.curves, "free-form curve")

    def save_amplitudes(self, path: str | Path) -> None:
        """Write `amplitudes` as CSV or, by its name, Parquet; a note if there is none. Raises OSError."""
        self._save(path, self.amplitudes, "effect with an unrecorded driver")

    def _save(self, path: str | Path, rows: Sequence[Row], what: str) -> None:
        from enginediag_cli.report.output import Output

        if not Output(str(path)).write_rows(rows, provenance=self.provenance):
            self.messages.note(f"{path}: no {what} was found, the file has no rows")

    def save_plan(self, path: str | Path) -> bool:
        """Write the flight that separates the alternative explanations soonest, as a flight file for `simulate`.

        Parameters
        ----------
        path : str or Path
            YAML file.

        Returns
        -------
        bool
            False where there is no such flight and nothing is written; a note gives the reason.

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        from enginediag_cli.config.document import dump
        from enginediag_cli.recordings.write import open_output

        advice = self.story.advice
        flight = advice.best_flight if advice is not None else None
        if flight is None:
            why = "no alternatives remain" if advice is None else "no flight separates the alternatives"
            self.messages.note(f"{path}: not written, {why}")
            return False
        with open_output(Path(path)) as stream:
            stream.write(dump(flight.flight_file(self.story.evidence.engine)))
        self.messages.note(f"{path}: {flight.words}, {flight.records} records")
        return True

    def plot(self) -> Picture:
        """Draw the unexplained part as a formula or a free curve, with its band. Raises NoVerdictError without one."""
        from enginediag_cli.report.plotting.discrepancy import explanation_picture

        try:
            return Picture(explanation_picture(self.story))
        except ValueError as nothing:
            raise NoVerdictError(str(nothing)) from None


def explain(
    engine: EngineLike,
    recordings: RecordingsLike,
    *,
    nominal: NominalLike = None,
    without: Sequence[str] = (),
    advice: bool = True,
    every_plan: bool = False,
    messages: Messages | None = None,
    **search: Any,
) -> ExplainResult:
    """Name the physics that the model of an engine lacks, from recordings of healthy engines.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or the name of one that comes with enginediag.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine to start from; the flights are identified when not given.
    without : sequence of str
        Effects to exclude, as term or term@site; see `effect_names`.
    advice : bool
        Search for recordings that separate the alternative explanations.
    every_plan : bool
        Report the best recording of every kind, not only the best of all.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    **search
        Attributes of `SearchOptions`: ``drivers=("hours",)``, ``model_error=0.003`` and so on.

    Returns
    -------
    ExplainResult

    Raises
    ------
    UsageError, ConfigError, DataError
    """
    if every_plan and not advice:
        raise UsageError("--plan asks for what --no-advice leaves out")
    check_effects("--without", without)
    inquiry = inquire(engine, recordings, nominal, search, messages)
    return ExplainResult(inquiry, without, advice, every_plan).complete()
