"""The second half of an error message: how to fix it, and the line of the file with a caret under the place."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from enginediag_cli.config.fields import Field
from enginediag_cli.config.reading import MOST_YAML_BYTES, refuse_irregular
from enginediag_cli.errors import ConfigError, Mark, Problem
from enginediag_cli.safe_text import SHORT

SHOWN = 20
"""Names listed in a hint before the rest is only counted."""

SUPERSCRIPTS = str.maketrans(
    {"²": "2", "³": "3", "°": "", "(": "", ")": "", "^": "", "·": "_", "/": "_", "*": "_", " ": "_"}
)


def near(word: str, known: Iterable[str]) -> str:
    """Hint for a name that does not exist: the nearest known one, otherwise the list of all of them."""
    names = list(known)
    close = closest(word, names)
    if close:
        return f"did you mean '{close}'?"
    if not names:
        return "there are none"
    rest = f", … ({len(names)} in all)" if len(names) > SHOWN else ""
    return ("one of: " if len(names) > 1 else "the only one is ") + ", ".join(names[:SHOWN]) + rest


def closest(word: str, names: Sequence[str]) -> str | None:
    """The known name nearest to a misspelt one, or None if nothing is near. Case does not count."""
    import difflib

    if len(word) > SHORT:
        return None
    folded = {name.casefold(): name for name in reversed(names)}
    match = difflib.get_close_matches(word.casefold(), list(folded), n=1, cutoff=0.6)
    return folded[match[0]] if match else None


def same_quantity(key: str, fields: Sequence[Field]) -> Field | None:
    """The field that holds the same quantity in another unit: `area_in2` or `area` for `area_m2`."""
    best: tuple[int, Field] | None = None
    for field in fields:
        stem = _stem(field)
        if stem and _is_stem_with_unit(key, stem) and (best is None or len(stem) > best[0]):
            best = (len(stem), field)
    return best[1] if best else None


def _stem(field: Field) -> str:
    """The name without its unit: `fuel_flow_kg_s` [kg/s] → `fuel_flow`; empty if it carries none."""
    if not field.unit:
        return ""
    suffix = "_" + field.unit.translate(SUPERSCRIPTS)
    if field.name.casefold().endswith(suffix.casefold()):
        return field.name[: -len(suffix)]
    return field.name.rpartition("_")[0]


def _is_stem_with_unit(key: str, stem: str) -> bool:
    folded, stem = key.casefold(), stem.casefold()
    if folded == stem:
        return True
    # unit symbols are short: in2, ft, lb_s, psi, degC, kPa, inHg
    return folded.startswith(stem + "_") and all(0 < len(part) <= 5 for part in folded[len(stem) + 1 :].split("_"))


def unknown_key(key: str, value: object, fields: Sequence[Field], known: Sequence[str]) -> tuple[str, str | None]:
    """(hint, the key that was probably meant or None) for a key that the section does not have.

    `known` are the declared keys that the file does not give yet: what is given already was not meant.
    """
    field = same_quantity(key, [field for field in fields if field.name in known])
    if field is not None:
        converted = _converted(key, value, field.name)
        return f"did you mean '{field.name}{converted}'? this key wants {field.unit}", field.name
    close = closest(key, known)
    if close is None:
        inside = next((f.name for f in fields if key in _keys_inside(f)), None)
        if inside is not None:
            return f"it belongs under '{inside}:'; indent it further", None
    return near(key, known), close


def _converted(key: str, value: object, name: str) -> str:
    """ ": 10668" for `altitude_ft: 35000` where `altitude_m` is wanted; empty where units are not known."""
    from enginediag_cli.units import UnitError, convert, find_unit, split_column

    given, wanted = split_column(key)[1], split_column(name)[1]
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not given or not wanted:
        return ""
    try:
        # a temperature may be a point or a difference; only the reader knows which
        if find_unit(wanted).dimension == "temperature":
            return ""
        return f": {convert(float(value), given, wanted):.6g}"
    except UnitError:
        return ""


def _keys_inside(field: Field) -> tuple[str, ...]:
    from enginediag_cli.config.fields import Section

    if field.kind == "section" and isinstance(field.section, Section):
        return tuple(inner.name for inner in field.section.fields)
    return ()


LONGEST_NUMBER = 60
"""Characters beyond which nobody has meant a number: a float has 17 digits, sign, point and exponent."""


def not_a_number(text: str, unit: str) -> str:
    """Why a text is not a number: decimal comma, unit after the number, percent sign, digit groups."""
    import re

    plain = text.strip()
    if len(plain) > LONGEST_NUMBER:  # the patterns below take quadratic time, and say nothing about such a text
        return f"give a number{_unit_phrase(unit)}"
    if re.fullmatch(r"[-+]?\d+,\d+", plain):
        return "write a decimal point instead of the comma"
    if re.fullmatch(r"[-+]?[\d.]+\s*%", plain):
        return f"write it without '%'{_unit_phrase(unit)}"
    if re.fullmatch(r"[-+]?\d{1,3}([_' ]\d{3})+(\.\d*)?", plain):
        return "write the digits without separators"
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", plain):
        return "remove the quotes"
    if re.match(r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[A-Za-z°/]", plain):
        return f"write the number alone{_unit_phrase(unit)}; the key says the unit"
    return f"give a number{_unit_phrase(unit)}"


def _unit_phrase(unit: str) -> str:
    return f", in {unit}" if unit else ""


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
    return "\n".join(
        [*(render(problem, files) for problem in error.shown_problems), *([error.rest] if error.rest else [])]
    )


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
