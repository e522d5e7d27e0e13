"""Shows a problem with the line of the file it stands in and a caret under the place."""

from __future__ import annotations

import re
from pathlib import Path

from enginediag_cli.errors import ConfigError, Mark, Problem

WORD = re.compile(r"'[^']*'|\"[^\"]*\"|[^\s,:\[\]{}#]+")


def render(problem: Problem) -> str:
    """`file:line:col: error: …`, then the source line and a caret where the file can still be read."""
    line = _source_line(problem.mark)
    if line is None:
        return str(problem)
    column = min(problem.mark.column, len(line) + 1) - 1
    token = WORD.match(line, column)
    underline = "^" + "~" * (len(token.group()) - 1 if token else 0)
    # tabs are kept so that the caret stays under its character
    lead = "".join("\t" if character == "\t" else " " for character in line[:column])
    number = f"{problem.mark.line:>5}"
    return f"{problem}\n{number} | {line}\n{' ' * len(number)} | {lead}{underline}"


def render_all(error: ConfigError) -> str:
    """Every problem of a file, one after the other."""
    return "\n".join(render(problem) for problem in error.problems)


def _source_line(mark: Mark) -> str | None:
    if mark.line < 1 or mark.column < 1:
        return None
    try:
        text = Path(mark.file).read_text(encoding="utf-8-sig", errors="replace")
    except (OSError, ValueError):
        return None
    lines = text.split("\n")
    line = lines[mark.line - 1].rstrip("\r") if mark.line <= len(lines) else ""
    return line if line.strip() else None
