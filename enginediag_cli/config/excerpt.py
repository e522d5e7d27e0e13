"""Shows a problem with the line of the file it stands in and a caret under the place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from enginediag_cli.config.reading import MOST_YAML_BYTES, refuse_irregular
from enginediag_cli.errors import ConfigError, Mark, Problem

WORD = re.compile(r"'[^']*'|\"[^\"]*\"|[^\s,:\[\]{}#]+")

MOST_COLUMNS = 160
"""Characters of a source line that are shown; a file may be a single line of megabytes."""

Lines = dict[str, Sequence[str]]
"""Lines of the files read so far."""


def render(problem: Problem, files: Lines | None = None) -> str:
    """`file:line:col: error: …`, then the source line and a caret where the file can still be read."""
    line = _source_line(problem.mark, {} if files is None else files)
    if line is None:
        return str(problem)
    column = min(problem.mark.column, len(line) + 1) - 1
    begin = max(0, column - MOST_COLUMNS // 2) if len(line) > MOST_COLUMNS else 0
    line, column = line[begin : begin + MOST_COLUMNS], column - begin
    token = WORD.match(line, column)
    underline = "^" + "~" * (len(token.group()) - 1 if token else 0)
    # tabs are kept so that the caret stays under its character
    lead = "".join("\t" if character == "\t" else " " for character in line[:column])
    number = f"{problem.mark.line:>5}"
    return f"{problem}\n{number} | {line}\n{' ' * len(number)} | {lead}{underline}"


def render_all(error: ConfigError) -> str:
    """The problems of a file, one after the other, and how many more there are."""
    files: Lines = {}
    return "\n".join([*(render(problem, files) for problem in error.told), *([error.rest] if error.rest else [])])


def _source_line(mark: Mark, files: Lines) -> str | None:
    if mark.line < 1 or mark.column < 1:
        return None
    if mark.file not in files:
        try:
            refuse_irregular(mark.file, MOST_YAML_BYTES)
            files[mark.file] = Path(mark.file).read_text(encoding="utf-8-sig", errors="replace").split("\n")
        except (OSError, ValueError):
            files[mark.file] = ()
    lines = files[mark.file]
    line = lines[mark.line - 1].rstrip("\r") if mark.line <= len(lines) else ""
    return line if line.strip() else None
