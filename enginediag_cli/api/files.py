"""`check` and `draft_recorder` look at files before anything is judged; listings show what engine files are made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import EngineLike, NominalLike, load_engine, resolve_baseline, resolve_engine
from enginediag_cli.api.results import DocumentResult, MessageLog, Result, Row
from enginediag_cli.errors import ConfigError, DataError, EngineDiagError, UsageError
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.term import Site, Term
    from enginediag_cli.intake.acceptance import CheckedFile, CheckReference
    from enginediag_cli.recordings.draft import Draft
    from enginediag_cli.recordings.recorder_file import EngineColumns

__all__ = [
    "CheckResult",
    "Description",
    "Listing",
    "RecorderDraft",
    "check",
    "describe_component",
    "describe_effect",
    "draft_recorder",
    "list_components",
    "list_effects",
    "list_law_variables",
]


YAML_SUFFIXES = (".yaml", ".yml")

BEYOND_ENVELOPE = 0.2
"""Share of the envelope that an engine file states by which inputs may lie beyond it: files state it roughly."""


@dataclass(frozen=True)
class FileCheck:
    """What is known about one file.

    Attributes
    ----------
    file : str
        Its name; "" for what concerns several.
    rows : tuple of dict
        One row per fact.
    lines : tuple of (str, str)
        The same in words: level (``"note"``, ``"warning"`` or ``"error"``) and text.
    error : ConfigError or None
        Problems of a YAML file, with their places.
    """

    file: str
    rows: tuple[Row, ...]
    lines: tuple[tuple[str, str], ...] = ()
    error: ConfigError | None = None

    @property
    def ok(self) -> bool:
        """Whether it can be used."""
        return all(row["ok"] for row in self.rows)


class CheckResult(Result):
    """What is known about files; see `check`. `findings` counts unusable files, `judged` usable ones."""

    def __init__(self, files: Sequence[str], against: CheckReference, messages: Messages):
        from enginediag_cli.report.tables.recordings import CHECK

        self._paths, self._against = files, against
        self._checks: list[FileCheck] = []
        self._coming = self._checked()
        super().__init__(columns=CHECK.names, summary_columns=CHECK.terminal, messages=messages)

    def files(self) -> Iterator[FileCheck]:
        """Check the files in turn, each when it is requested; the last result is about identical files.

        Yields
        ------
        FileCheck
        """
        yield from self._checks
        for one in self._coming:
            self._checks.append(one)
            if one.file:
                self.judged += one.ok
                self.findings += not one.ok
            yield one

    @property
    def ok(self) -> bool:
        """Whether every file can be used."""
        return all(one.ok for one in self.files())

    def _compute(self) -> Iterator[Row]:
        for one in self.files():
            yield from one.rows

    def _checked(self) -> Iterator[FileCheck]:
        from enginediag_cli.intake.loader import refuse_silent_pipe

        recordings = recordings_among(self._paths)
        for file in self._paths:
            try:
                if len(self._paths) > 1:
                    refuse_silent_pipe(file)
                one = _recording(file, self._against) if file in recordings else _yaml(file)
            except EngineDiagError as error:
                one = _unusable(file, error)
            yield one
        yield from _repeated(recordings)

    def summary(self) -> str:
        """Return what the command prints about the files, a line each."""
        marks = {"note": "", "warning": "warning: ", "error": "error: "}
        return "\n".join(marks[level] + text for one in self.files() for level, text in one.lines)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain Python objects: ``ok``, ``provenance`` and ``rows``."""
        return {"ok": self.ok, **super().to_dict()}


def check(
    files: str | Path | Sequence[str | Path],
    *,
    nominal: NominalLike = None,
    engine: EngineLike | None = None,
    recorder: str | Path | None = None,
    engine_instance: str = "",
    accept_changed_engine: bool = False,
    messages: Messages | None = None,
    stream: bool = False,
) -> CheckResult:
    """Check YAML files and recordings before they are used.

    Parameters
    ----------
    files : path or sequence of paths
        Files ending in ``.yaml`` or ``.yml`` are validated by the kind that they name; anything else is a recording.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine with which the recordings are compared.
    engine : str, Path or Engine, optional
        Engine of the recordings, where none is identified.
    recorder : str or Path, optional
        Recorder YAML of foreign recordings.
    engine_instance : str
        Use only this engine of the recordings.
    accept_changed_engine : bool
        Use an engine file although it is no longer the one that was identified.
    messages : Messages, optional
        Receives warnings about nominal state and recorder; they are collected when not given.
    stream : bool
        Check files only as they are read from the result.

    Returns
    -------
    CheckResult
        ``ok`` is True if every file can be used; ``rows`` has the facts. An unusable file is no error.

    Raises
    ------
    UsageError, ConfigError, DataError
        For `nominal`, `engine` and `recorder`.
    """
    several = [files] if isinstance(files, (str, Path)) else files
    paths = tuple(map(str, several))
    messages = messages if messages is not None else MessageLog()
    against = _check_reference(paths, nominal, engine, recorder, engine_instance, accept_changed_engine, messages)
    return CheckResult(paths, against, messages).complete(stream)


def recordings_among(files: Sequence[str]) -> list[str]:
    """Return those of the files that are no YAML."""
    return [file for file in files if not file.lower().endswith(YAML_SUFFIXES)]


def _check_reference(
    files: Sequence[str],
    nominal: NominalLike,
    engine: EngineLike | None,
    recorder: str | Path | None,
    instance: str,
    accept_changed_engine: bool,
    messages: Messages,
) -> CheckReference:
    """Open what the recordings are compared with. Raises UsageError, ConfigError."""
    from enginediag_cli.intake.acceptance import CheckReference

    if nominal is not None and engine is not None:
        raise UsageError("--nominal names its engine; give either that or --engine")
    if not recordings_among(files):
        return CheckReference()  # what a folder's options give is for its recordings
    mapped = None
    if recorder is not None:
        from enginediag_cli.recordings.recorder_file import load_recorder
        from enginediag_cli.report.tables.recordings import undecided_lines

        mapped = load_recorder(str(own_or_shipped(recorder)))
        for text in undecided_lines(mapped.undecided):
            messages.warning(text)
    baseline = resolve_baseline(nominal, accept_changed_engine=accept_changed_engine)
    if baseline is not None:
        from enginediag_cli.report.tables.recordings import report_baseline

        report_baseline(messages, baseline, instance)
        return CheckReference(baseline.engine, baseline.nominal, mapped, instance)
    return CheckReference(None if engine is None else resolve_engine(engine), None, mapped, instance)


def _display_name(file: str) -> str:
    return "<stdin>" if file == "-" else file


def _recording(file: str, against: CheckReference) -> FileCheck:
    """Check a recording, for each engine in it. Raises DataError."""
    from enginediag_cli.intake.acceptance import check_file
    from enginediag_cli.report.tables.recordings import acceptance_rows

    rows: list[Row] = []
    lines: list[tuple[str, str]] = []
    for report in check_file(file, against):
        rows += acceptance_rows(report)
        lines += _page(report)
    return FileCheck(_display_name(file), tuple(rows), tuple(lines))


def _page(report: CheckedFile) -> Iterator[tuple[str, str]]:
    """Describe a recording in words; what prevents its judgement is an error."""
    from enginediag_cli.report.tables.recordings import PROBLEM, headline, remarks

    yield "note", headline(report)
    for remark in remarks(report):
        if remark.level == PROBLEM:
            yield "error", f"{_display_name(report.file)}: {remark.text_with_hint}"
        else:
            yield "note", f"  {remark.line}"


def _yaml(file: str) -> FileCheck:
    """Check a YAML file, with the design table of an engine. Raises ConfigError."""
    from enginediag_cli.config.validate import check_file

    kind, remarks = check_file(file).name, []
    undecided: tuple[str, ...] = ()
    if kind == "recorder":
        from enginediag_cli.recordings.recorder_file import load_recorder

        undecided = load_recorder(file).undecided
    if kind == "engine":
        from enginediag_cli.physics.engine_file import load_engine
        from enginediag_cli.report.tables.recordings import overview_rows

        remarks = list(overview_rows(load_engine(file)))
    more = "".join(f"\n  open: {text}" for text in undecided)
    found = f"a file of kind {kind}" + (f", a draft with decisions left open:{more}" if undecided else "")
    lines = [("note", f"{file}: ok, {found}")]
    for row in remarks:
        if row["level"] == "warning":
            lines.append(("warning", f"{file}: {row['problem']} ({row['hint']})"))
        else:
            lines.append(("note", f"  {row['name']}: {row['found']}"))
    rows = ({"file": file, "ok": True, "found": found}, *({**row, "file": file, "ok": True} for row in remarks))
    return FileCheck(file, rows, tuple(lines))


def _unusable(file: str, error: EngineDiagError) -> FileCheck:
    """Make a row per problem, with its place if known; for a recording it is in the text."""
    if not isinstance(error, ConfigError):
        row = {"file": _display_name(file), "ok": False, "level": "problem", "problem": str(error)}
        return FileCheck(_display_name(file), (row,), (("error", str(error)),))
    rows = tuple(
        {
            "file": problem.mark.file,
            "ok": False,
            "level": "problem",
            "line": problem.mark.line or None,
            "column": problem.mark.column or None,
            "problem": problem.message,
            "hint": problem.hint,
        }
        for problem in error.problems
    )
    return FileCheck(_display_name(file), rows, (("error", str(error)),), error)


def _repeated(recordings: Sequence[str]) -> Iterator[FileCheck]:
    """Warn about identical files, which every other verb refuses together."""
    from enginediag_cli.intake.selection import refuse_duplicates

    try:
        refuse_duplicates(recordings)
    except DataError as error:
        row = {"file": recordings[0], "ok": True, "level": "warning", "about": "repeated", "problem": str(error)}
        yield FileCheck("", (row,), (("warning", str(error)),))


class RecorderDraft:
    """The draft of a recorder YAML; see `draft_recorder`.

    Attributes
    ----------
    text : str
        Complete YAML; comments mark guesses and open decisions.
    decisions : tuple of str
        What the user must decide, a sentence each.
    missing : dict of str to str
        Required columns that nothing gives, with what may be done.
    unused : dict of str to str
        Columns that were not recognised, or are of no use, with the reason.
    """

    def __init__(self, found: Draft, engine: str = ""):
        from enginediag_cli.recordings.draft import draft_yaml

        self._found, self._engine = found, engine
        self.text = draft_yaml(found, engine)
        self.decisions, self.missing, self.unused = tuple(found.decisions), dict(found.missing), dict(found.unused)

    def summary(self) -> str:
        """Return how much was recognised, in one line."""
        return (
            f"{len(self._found.columns)} columns recognised, {len(self.decisions)} decisions left to you, "
            f"{len(self.unused)} columns not used"
            + (f", {len(self.missing)} required columns not found" if self._engine else "")
        )

    def save(self, path: str | Path) -> None:
        """Write the YAML, completely or not at all; ``-`` is standard output. Raises DataError."""
        from enginediag_cli.recordings.write import open_output

        try:
            with open_output(str(path)) as stream:
                stream.write(self.text)
        except OSError as error:
            raise DataError(f"{path}: {error.strerror or error}") from error


def draft_recorder(file: str | Path, *, engine: EngineLike | None = None) -> RecorderDraft:
    """Draft the recorder YAML that maps a foreign recording to the program's own columns.

    Delimiter, decimal mark, encoding, header, units, time stamps and engines are inferred.

    Parameters
    ----------
    file : str or Path
        Recording of a foreign logger; ``-`` is standard input.
    engine : str, Path or Engine, optional
        Engine whose inputs and sensors are looked for.

    Returns
    -------
    RecorderDraft

    Raises
    ------
    ConfigError, DataError
    """
    from enginediag_cli.recordings.draft import make_draft
    from enginediag_cli.recordings.sniff import sniff

    model = None if engine is None else resolve_engine(engine)
    found = make_draft(sniff(str(file)), None if model is None else _engine_columns(model))
    return RecorderDraft(found, "" if model is None else model.path)


def _engine_columns(model: Engine) -> EngineColumns:
    """Collect the columns that an engine needs, with the limits and design speeds of its file."""
    import os

    from enginediag_cli.recordings.recorder_file import EngineColumns

    limits = {}
    for column, (low, high) in model.envelope.items():
        room = BEYOND_ENVELOPE * (high - low)
        limits[column] = (low - room, high + room)
    limits |= {column: (0.0, sensor.maximum) for column, sensor in model.sensors.items() if sensor.maximum}
    shafts = model.network.shafts
    design = {column: shafts[name]["design_speed_rpm"] for column, name in model.network.speed_columns.items()}
    name, optional = os.path.basename(model.path), dict(model.optional_inputs)
    return EngineColumns(name, tuple(model.inputs), tuple(model.sensors), optional, limits, design)


class Listing(Result):
    """Things of one kind, a row each."""

    def __init__(self, rows: Sequence[Row], head: Sequence[str]):
        self._listed = rows
        super().__init__(head=lambda: tuple(head))

    def _compute(self) -> Iterator[Row]:
        yield from self._listed


class Description(DocumentResult):
    """One thing as a page, as rows and as one document.

    Attributes
    ----------
    page : str
        For a reader.
    document : dict
        All details; `to_dict` has it for ``json.dump``.
    """

    def __init__(self, page: str, document: dict[str, Any], rows: Sequence[Row], head: Sequence[str]):
        self.page, self.document, self._listed = page, document, rows
        super().__init__(head=lambda: tuple(head))

    def _compute(self) -> Iterator[Row]:
        yield from self._listed

    def _document(self, provenance: Sequence[str]) -> Mapping[str, Any]:
        return self.document

    def summary(self) -> str:
        """Return the page."""
        return self.page


def list_effects(engine: EngineLike | None = None) -> Listing:
    """List the physical effects that a model may carry or lack.

    Parameters
    ----------
    engine : str, Path or Engine, optional
        Gives a row for each place where one can act on this engine, and what its model carries there; without it, a row
        for each effect.

    Returns
    -------
    Listing

    Raises
    ------
    ConfigError, DataError
    """
    from enginediag_cli.physics.registry import term, term_names
    from enginediag_cli.report.reference import effect_blocks, site_row, term_row

    terms = [term(name) for name in term_names()]
    if engine is None:
        return Listing([term_row(t) for t in terms], _head("physics"))
    model = resolve_engine(engine)
    carried = effect_blocks(model)
    rows = [site_row(t, site, carried) for t in [*terms, *_laws(model)] for site in t.sites(model.network)]
    return Listing(rows, _head("physics", model))


def describe_effect(name: str, engine: EngineLike | None = None) -> Description:
    """Describe one physical effect: what it is, its equation, coefficients, places and reference.

    Parameters
    ----------
    name : str
        As `list_effects` has it; with `engine`, a law of the engine's own, too.
    engine : str, Path or Engine, optional
        Its places on this engine, a row each; without it, rows are its coefficients, and places those on the engines
        that come with enginediag.

    Returns
    -------
    Description

    Raises
    ------
    UsageError
        For an effect that is not there; names the nearest.
    ConfigError, DataError

    Examples
    --------
    >>> from enginediag_cli import describe_effect
    >>> [row["coefficient"] for row in describe_effect("reynolds_efficiency", "turbofan.yaml").document["coefficients"]]
    ['exponent']
    """
    from enginediag_cli.physics.registry import term, term_names
    from enginediag_cli.report.reference import coefficient_rows, effect_blocks, physics_page, site_row, term_row

    model = None if engine is None else resolve_engine(engine)
    laws = {law.NAME: law for law in (_laws(model) if model is not None else ())}
    if name not in term_names() and name not in laws:
        from enginediag_cli.config.fields import near

        raise UsageError(f"no physics term {name!r}; {near(name, [*term_names(), *laws])}")
    engines = {model.name: model} if model is not None else _shipped_engines()
    shown: Term = laws[name] if name in laws else term(name)
    places: dict[str, list[Site]] = {n: list(shown.sites(e.network)) for n, e in engines.items()}
    carried = {n: effect_blocks(e) for n, e in engines.items()}
    sites = {n: [site_row(shown, s, carried[n]) for s in found] for n, found in places.items()}
    coefficients = list(coefficient_rows(shown))
    document = {**term_row(shown), "coefficients": coefficients, "places": sites}
    rows = coefficients if model is None else [row for found in sites.values() for row in found]
    return Description(physics_page(shown, places, carried), document, rows, _head("physics", model))


def list_law_variables(engine: EngineLike) -> Listing:
    """List the variables of a ``law:`` of an engine, with their values at the design point.

    Parameters
    ----------
    engine : str, Path or Engine
        Engine YAML, or a loaded engine.

    Returns
    -------
    Listing

    Raises
    ------
    ConfigError, DataError
    """
    from enginediag_cli.report.reference import variable_rows

    model = resolve_engine(engine)
    return Listing(list(variable_rows(model.network)), _head("physics", model))


def component_names() -> tuple[str, ...]:
    """Return the names of the component types."""
    from enginediag_cli.engine.components import COMPONENTS

    return tuple(COMPONENTS)


def list_components() -> Listing:
    """List the component types of which an engine file is made: keys, unknowns, balances, outputs.

    Returns
    -------
    Listing
    """
    from enginediag_cli.engine.components import COMPONENTS
    from enginediag_cli.engine.overview import component_example
    from enginediag_cli.report.reference import component_row

    rows = [component_row(kind, component_example(name)) for name, kind in COMPONENTS.items()]
    return Listing(rows, _head("components"))


def describe_component(name: str) -> Description:
    """Describe one component type: what it computes, its keys (rows), parameters and columns, with an example.

    Parameters
    ----------
    name : str
        As `list_components` has it.

    Returns
    -------
    Description

    Raises
    ------
    UsageError
        For a type that is not there; names the nearest.
    """
    from enginediag_cli.engine.components import COMPONENTS
    from enginediag_cli.engine.overview import component_example
    from enginediag_cli.report.reference import component_row, key_rows, page, parameter_rows

    if name not in COMPONENTS:
        from enginediag_cli.config.fields import near

        raise UsageError(f"no component {name!r}; {near(name, COMPONENTS)}")
    kind, found = COMPONENTS[name], component_example(name)
    keys = list(key_rows(kind))
    parts = {"keys": keys, "parameters": list(parameter_rows(found)), "example": found.text}
    return Description(page(kind, found), {**component_row(kind, found), **parts}, keys, _head("components"))


def _head(command: str, engine: Engine | None = None) -> tuple[str, ...]:
    from enginediag_cli.recordings.source import header_lines

    return header_lines(command, configs=[] if engine is None else [engine.path])


def _shipped_engines() -> Mapping[str, Engine]:
    """Load the shipped engines, by name."""
    from enginediag_cli.shipped import shipped_folder

    files = (p for p in sorted(shipped_folder().glob("*.yaml")) if "\nkind: engine" in p.read_text(encoding="utf-8"))
    return {engine.name: engine for engine in map(load_engine, files)}


def _laws(engine: Engine) -> list[Term]:
    """Return the effects that the engine file itself declares."""
    from enginediag_cli.physics.law import Law

    return [e.term for e in engine.effects if isinstance(e.term, Law)]
