"""`refine`: an engine file that carries what its model lacks, if flights that were not fitted gain by it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.discrepancy import Inquiry, check_effects, inquire
from enginediag_cli.api.inputs import EngineLike, NominalLike, RecordingsLike, resolve_recordings
from enginediag_cli.api.results import DocumentResult, Picture, Row
from enginediag_cli.errors import NoVerdictError, UsageError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.term import Effect
    from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
    from enginediag_cli.mismatch.fit.load import LoadedCase
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement
    from enginediag_cli.mismatch.refine.refine import Refinement
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding

__all__ = ["RefineResult", "refine"]

SHORTEST_WINDOW = 5
"""Records: of fewer, a window's statistic hardly tells whether detect would cry wolf."""


@dataclass(frozen=True)
class RefineChoices:
    """Arguments of `refine` other than what it reads.

    `test`: files of flights to judge by; `command`: origin that the engine file names.
    """

    terms: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    switched: bool = False
    holdout_last: int | None = None
    test: tuple[str, ...] = ()
    window: int = 30
    command: str = "refine"

    def check(self) -> None:
        """Raise UsageError for choices that exclude each other."""
        if (self.holdout_last is None) == (not self.test):
            raise UsageError("name the flights to judge by: either --holdout-last K or --test FILE")
        if self.holdout_last is not None and self.holdout_last < 1:
            raise UsageError(f"--holdout-last: {self.holdout_last} is no number of flights")
        if self.window < SHORTEST_WINDOW:
            raise UsageError(f"--window: {self.window} records are fewer than {SHORTEST_WINDOW}")
        if self.switched and len(self.terms) != 1:
            raise UsageError("--switched goes with one --term")
        check_effects("--without", self.without)

    def test_positions(self, flights: Sequence[Flight]) -> list[int]:
        """Positions of the flights to judge by."""
        from enginediag_cli.mismatch.refine.refine import last_flights

        if self.holdout_last is not None:
            return last_flights(flights, self.holdout_last)
        return [k for k, flight in enumerate(flights) if flight.file in self.test]

    def training_flights(self, flights: Sequence[Flight]) -> list[Flight]:
        """Return the flights to fit; all, if none are held out."""
        unseen = set(self.test_positions(flights))
        return [f for k, f in enumerate(flights) if k not in unseen] or list(flights)


class RefineResult(DocumentResult):
    """An engine file with what its model lacked, and how unseen flights are predicted before and after; see `refine`.

    Attributes
    ----------
    refinement : Refinement, ControlRefinement or None
        What was fitted and judged, an effect or a control; None where there was nothing to fit.
    accepted : bool
        Whether unseen flights gain, so that `save` writes the engine file.
    reason : str
        Why it is not accepted; "" where it is.
    evidence : Evidence
        All flights, as arrays by column.
    judged : int
        1 where it is accepted.
    """

    def __init__(self, inquiry: Inquiry, choices: RefineChoices):
        from enginediag_cli.mismatch.fit.load import load_case
        from enginediag_cli.report.tables.identification import CONTROL, REFINE

        choices.check()
        case, self._inquiry, self._choices = inquiry.case, inquiry, choices
        source = replace(case.source, files=(*case.source.files, *choices.test))
        loaded = load_case(replace(case, source=source), choices.training_flights, controls=not choices.terms)
        inquiry.report_loading(loaded)
        self.messages, self.evidence = inquiry.messages, loaded.evidence
        self._test_positions = choices.test_positions(loaded.evidence.flights)
        if len(self._test_positions) == len(loaded.evidence.flights):
            raise UsageError("no flight is left to fit the effects to")
        self._control, self._refinement, self.reason = None, None, ""
        if loaded.control is not None:
            self._control = self._fit_control(loaded)
        else:
            self._refinement = self._fit_effects()
        self.reason = self.reason or self._refusal()
        self.accepted = not self.reason
        labels = ", ".join(loaded.evidence.flights[k].label for k in self._test_positions)
        super().__init__(
            table=REFINE if self._control is None else CONTROL,
            head=inquiry.head("refine", loaded.intake.provenance, unseen=labels),
            columns=(REFINE if self._control is None else CONTROL).names,
            summary_columns=REFINE.terminal,
            messages=inquiry.messages,
        )
        self.judged = int(self.accepted)

    @property
    def refinement(self) -> Refinement | ControlRefinement | None:
        """What was fitted and judged."""
        return self._refinement if self._control is None else self._control

    def _fit_control(self, loaded: LoadedCase) -> ControlRefinement:
        """Fit and judge the control that the engine lacks."""
        from enginediag_cli.mismatch.fit.evidence import as_recordings as recordings_of
        from enginediag_cli.mismatch.refine.controlled import refine_control
        from enginediag_cli.report.tables.explanation_text import control_sentences

        assert loaded.control is not None and loaded.as_described is not None
        described, engine = self._described = loaded.as_described
        flights = recordings_of(loaded.evidence.flights)
        training = [f for k, f in enumerate(flights) if k not in self._test_positions]
        found = refine_control(loaded.control, described, engine, training, [flights[k] for k in self._test_positions])
        for line in control_sentences(loaded.control):
            self.messages.note(line)
        return found

    def _fit_effects(self) -> Refinement | None:
        """Effects, fitted and judged; None, with the reason, where there are none. Raises UsageError."""
        from enginediag_cli.mismatch.refine.refine import refine as run
        from enginediag_cli.mismatch.refine.switch import find_switch, judged_by_trained_noise

        choices, hidden = self._choices, None
        self.evidence = evidence = judged_by_trained_noise(self.evidence, self._test_positions)
        training = evidence.only([k for k in range(len(evidence.flights)) if k not in self._test_positions])
        if choices.terms:
            effects = _requested_effects(evidence, choices.terms)
            if choices.switched:
                hidden = find_switch(training, effects[0])
                if hidden is None:
                    self.reason = f"no switch was found where {effects[0].label} acts"
                    return None
        else:
            effects, hidden = self._explained(training)
            if not effects:
                self.reason = "explain names no effect that a model could carry"
                return None
        try:
            return run(evidence, self._test_positions, effects, hidden=hidden, window=choices.window)
        except ValueError as error:
            raise UsageError(str(error)) from None

    def _explained(self, training: Dataset) -> tuple[list[Effect], HiddenFinding | None]:
        """Return the effects that `explain` names from the fitted flights, and its finding of a switch."""
        from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE
        from enginediag_cli.mismatch.explain.story import explain_mismatch, named_effects
        from enginediag_cli.physics.registry import candidate_effects
        from enginediag_cli.report.tables.explanation_text import sentences

        effects = list(candidate_effects(training.engine, self._choices.without))
        story = explain_mismatch(training, effects, advise=False, every_record=True)
        for line in sentences(story):
            self.messages.note(line)
        if story.answer.status == HIDDEN_STATE and story.hidden[0].is_switch and story.hidden_effects[0]:
            return list(story.hidden_effects[0][:1]), story.hidden[0]
        return list(named_effects(story)), None

    def _refusal(self) -> str:
        from enginediag_cli.report.tables.identification import control_refinement_refusal, refinement_refusal

        if self._control is not None:
            return "" if self._control.accepted else control_refinement_refusal(self._control)
        return "" if self._refinement is None else refinement_refusal(self._refinement)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.identification import (
            comparison_lines,
            control_refinement_rows,
            control_refinement_sentences,
            refinement_rows,
            refinement_sentences,
        )

        lines: list[str] = []
        if self._control is not None:
            yield from control_refinement_rows(self._control)
            lines = list(control_refinement_sentences(self._control))
        elif self._refinement is not None:
            rows = list(refinement_rows(self._refinement))
            yield from rows
            lines = [*comparison_lines(rows), *refinement_sentences(self._refinement)]
        for line in lines:
            self.messages.note(line)

    def summary(self) -> str:
        """Sentences and warnings, and why the engine file is not accepted, where it is not.

        Returns
        -------
        str
            One line each.
        """
        return super().summary() + ("" if self.accepted else f"\nnot accepted: {self.reason}")

    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        from enginediag_cli.report.tables.identification import control_refinement_document, refinement_document

        if self._control is not None:
            return control_refinement_document(self._control, tuple(provenance))
        if self._refinement is None:
            raise NoVerdictError(self.reason)
        return refinement_document(self._refinement, tuple(provenance))

    @property
    def engine(self) -> Engine:
        """The engine with what was fitted. Raises NoVerdictError where it is not accepted."""
        self._need_acceptance("there is no refined engine")
        if self._control is not None:
            described, engine = self._described
            return self._control.law.engine(described, engine.power_setting)
        assert self._refinement is not None
        engine = self.evidence.engine
        return engine.replace_effects((*engine.effects, *self._refinement.effects))

    def text(self, path: str | Path = "refined.yaml") -> str:
        """Return the refined engine file.

        Parameters
        ----------
        path : str or Path
            Where it is to stand: tables of maps are named as seen from its folder.

        Returns
        -------
        str
            YAML: the text of the engine file, comments and all, with what was fitted.

        Raises
        ------
        NoVerdictError
            Where it is not accepted.
        """
        from enginediag_cli.mismatch.refine.file import refined_text, relocated_text

        self._need_acceptance(f"{path} is not written")
        old, source = self._inquiry.case.engine, self._origin()
        if self._control is not None:
            return self._control.law.written(relocated_text(old, str(path)), old, source, self._control.standard_errors)
        assert self._refinement is not None
        return refined_text(old, self._refinement.effects, self._refinement.standard_errors, source, str(path))

    def save(self, path: str | Path, format: str = "yaml") -> None:
        """Write the refined engine file, completely or not at all.

        It is first read back and must give the engine that was fitted.

        Parameters
        ----------
        path : str or Path
            YAML file; ``-`` is standard output.
        format : {"yaml"}
            There is no other; `save_report` writes the rows.

        Raises
        ------
        NoVerdictError
            Where it is not accepted: why.
        DataError, OSError
        """
        from enginediag_cli.mismatch.refine.file import write_refined

        if format != "yaml":
            raise UsageError(f"an engine file is yaml, not {format}; save_report writes the rows")
        write_refined(self.text(path), str(path), self.engine)

    def _need_acceptance(self, lost: str) -> None:
        if not self.accepted:
            raise NoVerdictError(f"{self.reason}; {'nothing is written' if self.refinement is None else lost}")

    def _origin(self) -> str:
        """Return data and command, files by name and hash but without folder."""
        import os

        from enginediag_cli import __version__
        from enginediag_cli.recordings.source import current_notes, file_sha256

        data = ", ".join(
            "standard input" if p == "-" else f"{os.path.basename(p)} sha256:{file_sha256(p)[:16]}"
            for p in self._inquiry.case.source.files
        )
        command = self._choices.command + "".join(f", {key} {text}" for key, text in current_notes().items())
        fitted = len(self.evidence.flights) - len(self._test_positions)
        return (
            f"enginediag {__version__} {command}; fitted to {fitted} flights of {data}, "
            f"judged by {len(self._test_positions)} that were not fitted"
        )

    def save_report(self, path: str | Path) -> None:
        """Write the comparison before and after as a text table, ``.csv``, ``.json`` or ``.parquet``.

        A note says if nothing was fitted. Raises OSError.
        """
        from enginediag_cli.report.output import SUFFIX_FORMATS, Output, table_suffix

        if self.refinement is None:
            self.messages.note(f"{path}: not written, nothing was fitted")
            return
        self.write(Output(str(path), "auto" if table_suffix(str(path)) in SUFFIX_FORMATS else "table"))

    def save_states(self, path: str | Path) -> None:
        """Write the states of a switched effect, record by record, as CSV or, by its name, Parquet.

        A note says if there are none. Raises OSError.
        """
        from enginediag_cli.report.output import Output
        from enginediag_cli.report.tables.identification import state_rows

        if self._control is not None:
            self.messages.note(f"{path}: not written; what a control does in a record is in active_limit of simulate")
            return
        rows = [] if self._refinement is None else state_rows(self._refinement)
        if not Output(str(path)).write_rows(rows, provenance=self.provenance):
            self.messages.note(f"{path}: no effect is switched, the file has no rows")

    def plot(self) -> Picture:
        """Draw the prediction of unseen flights before and after. Raises NoVerdictError where it was not judged."""
        if self._control is not None and self._control.after:
            from enginediag_cli.report.plotting.discrepancy import control_picture

            return Picture(control_picture(self._control))
        if self._refinement is not None and self._refinement.unseen is not None:
            from enginediag_cli.report.plotting.discrepancy import picture

            return Picture(picture(self._refinement))
        raise NoVerdictError("no unseen flight was predicted before and after")


def _requested_effects(evidence: Dataset, terms: Sequence[str]) -> list[Effect]:
    """Find the effects that the user names. Raises UsageError for unknown ones and for those carried already."""
    from enginediag_cli.config.fields import near
    from enginediag_cli.physics.registry import candidate_effects, effect

    engine = evidence.engine
    known = [e.label for e in candidate_effects(engine)]
    carried = {e.label for e in engine.effects}
    found = []
    for label in dict.fromkeys(terms):
        if label in carried:
            raise UsageError(f"--term {label}: {engine.name} carries it already")
        if label not in known:
            raise UsageError(f"--term {label}: not an effect of {engine.name} ({near(label, known)})")
        name, _, site = label.partition("@")
        found.append(effect(engine, name, site))
    return found


def refine(
    engine: EngineLike,
    recordings: RecordingsLike,
    *,
    nominal: NominalLike = None,
    terms: Sequence[str] = (),
    without: Sequence[str] = (),
    switched: bool = False,
    holdout_last: int | None = None,
    test: RecordingsLike = (),
    window: int = 30,
    command: str = "refine",
    messages: Messages | None = None,
    **search: Any,
) -> RefineResult:
    """Fit what the model of an engine lacks, and judge it by flights that were not fitted.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or the name of one that comes with enginediag.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine to start from, with its noise.
    terms : sequence of str
        Effects to put in, as term@site, such as ``"reynolds_efficiency@hpc"``; what `explain` names when not given.
    without : sequence of str
        Effects that `explain` is not to consider.
    switched : bool
        The one effect of `terms` is on or off without any column showing it: find its states.
    holdout_last : int, optional
        Judge by the last so many flights of each engine, which are not fitted.
    test
        In its place: recordings whose flights are not fitted but judge, read as the others are.
    window : int
        Length of the windows in which `detect` is tried before and after, in records.
    command : str
        What the engine file names as its origin.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    **search
        Attributes of `SearchOptions`.

    Returns
    -------
    RefineResult
        ``save`` writes the engine file where it is accepted.

    Raises
    ------
    UsageError, ConfigError, DataError

    References
    ----------
    Accepted is what differs from nothing by the fitted flights and raises the log likelihood of the point prediction of
    unseen ones; see `enginediag_cli.mismatch.refine`.
    """
    judging = resolve_recordings(test)
    choices = RefineChoices(tuple(terms), tuple(without), switched, holdout_last, judging.files, window, command)
    inquiry = inquire(engine, recordings, nominal, search, messages)
    if judging.recorder not in (None, inquiry.case.source.recorder):
        raise UsageError("the recordings to judge by are read by the recorder of the others")
    return RefineResult(inquiry, choices).complete()
