"""The engine that travels in a nominal file, built; what is wrong with it is told at its lines of that file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from enginediag_cli.config.reading import refuse_other_kind
from enginediag_cli.engine.description import EngineDescription
from enginediag_cli.errors import ConfigError, Mark, Problem

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine

SECTION = "engine_description"
"""Key of the nominal file."""


def described_engine(
    described: EngineDescription, nominal_path: str | Path, power_setting: str | None = None
) -> Engine:
    """The engine of a description; `power_setting` replaces its own. Raises ConfigError at places in the nominal
    file."""
    from enginediag_cli.physics.engine_file import load_engine

    try:
        return load_engine(described, power_setting)
    except ConfigError as error:
        raise ConfigError([_moved(p, described, nominal_path) for p in error.problems]) from error


def changed_beside(described: EngineDescription, nominal_path: str | Path) -> str:
    """The engine file that was identified where it is there and says something else now, or its maps do; else ''. A
    file that is gone, cannot be read or is none of an engine is nobody's concern: it is not needed."""
    try:
        refuse_other_kind(described.file, "engine", Mark(str(nominal_path)))
        return described.file if described.differs_from(described.file) else ""
    except ConfigError:
        return ""


def _moved(problem: Problem, described: EngineDescription, nominal_path: str | Path) -> Problem:
    """The problem at its line of the nominal file, in which every line of a text is a line."""
    from enginediag_cli.config.checked import Checked
    from enginediag_cli.config.document import load_document

    mark = problem.mark
    folder = Path(described.file).parent
    places: dict[str, tuple[tuple[str, ...], str]] = {described.file: ((SECTION, "text"), described.text)}
    places.update({str(folder / name): ((SECTION, "tables", name), text) for name, text in described.tables.items()})
    if mark.file not in places:
        return problem
    place, text = places[mark.file]
    start = Checked({}, load_document(nominal_path)).mark(place)
    lines, own = Path(nominal_path).read_text(encoding="utf-8-sig").split("\n"), text.split("\n")
    at = start.line + max(mark.line, 1)
    if not mark.line or at > len(lines) or mark.line > len(own) or not lines[at - 1].endswith(own[mark.line - 1]):
        # written by hand in another style: the place of the text, and the line within it
        within = f" in line {mark.line} of {mark.file} as it travels here" if mark.line else ""
        return problem._replace(mark=start, message=problem.message + within)
    indent = len(lines[at - 1]) - len(own[mark.line - 1])
    return problem._replace(mark=Mark(str(nominal_path), at, mark.column + indent if mark.column else 0))
