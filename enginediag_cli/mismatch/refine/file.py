"""A new engine file that carries further effects: the text of the old one, comments and all, with entries added to its
`physics:` block, and with paths of map tables that still lead to the same files from the new place.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.document import Node, appended, dump, load_document
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import DataError
from enginediag_cli.physics.engine_file import law_entry
from enginediag_cli.physics.law import Law
from enginediag_cli.recordings.write import open_output

DIGITS = 6
"""Significant digits of coefficients; their standard errors have three."""


def refined_text(path: str, effects: Sequence[Effect], errors: Mapping[str, float], source: str, place: str) -> str:
    """Text of the engine file at `path` with the effects carried, as it is to stand in the folder of `place`.

    `errors`: standard errors by parameter name; `source`: data and command. Raises ConfigError for a file that cannot
    be read, DataError for one whose text cannot be edited.
    """
    return appended(relocated_text(path, place), path, "physics", [_entry(e, errors, source) for e in effects])


def relocated_text(path: str, place: str) -> str:
    """Text of the engine file at `path` as it is to stand in the folder of `place`. Raises ConfigError for a file that
    cannot be read."""
    root = load_document(path)
    lines = Path(path).read_bytes().decode("utf-8-sig").replace("\r\n", "\n").splitlines()
    _move_tables(lines, root, Path(path).parent, _folder(place))
    return "\n".join(lines) + "\n"


def write_refined(text: str, place: str, wanted: Engine) -> None:
    """Write the text to `place`, completely or not at all, once it has been loaded and gives the `wanted` engine.

    Raises DataError when it does not, OSError when it cannot be written.
    """
    handle, temporary = tempfile.mkstemp(prefix=".refined-", suffix=".yaml", dir=_folder(place))
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
        _check(temporary, wanted)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
    with open_output(place) as stream:
        stream.write(text)


def _check(path: str, wanted: Engine) -> None:
    """The file's engine carries the same effects and predicts the same at its design point."""
    from enginediag_cli.physics.engine_file import load_engine

    found = load_engine(path)
    if [e.label for e in found.effects] != [e.label for e in wanted.effects]:
        raise DataError("the refined file does not carry the effects that were fitted; it was not written")
    design = wanted.declared["design"]
    inputs: dict[str, Any] = {c: np.array([design.get(c, 0.0)]) for c in found.inputs if c != found.power_setting}
    if found.power_range is None:
        return
    inputs[found.power_setting] = found.power_from_fraction(np.array([1.0]), inputs)
    values = {n: p.nominal for e in wanted.effects for p in e.parameters() for n in [p.name]}
    one, other = found.predict(inputs), wanted.predict(inputs, values)
    if not np.allclose(one.y, other.y, rtol=1e-5, equal_nan=True):
        raise DataError("the refined file does not give the engine that was fitted; it was not written")


def _entry(e: Effect, errors: Mapping[str, float], source: str) -> list[str]:
    """Lines of one effect, as an item of a list indented by two."""
    if isinstance(e.term, Law):
        block = law_entry(e, errors, source)
    else:
        amplitudes = {c.name for c in e.term.amplitudes()}
        block = {"term": e.term.NAME, "at": e.site.name}
        if e.switch:
            block["switch"] = e.switch
        block["coefficients"] = {n: float(f"{v:.{DIGITS}g}") for n, v in e.values.items()}
        block["standard_errors"] = {n: float(f"{errors[e.parameter_name(n)]:.3g}") for n in e.values if n in amplitudes}
        block["source"] = source
    text = dump(block, width=100).splitlines()
    return [("  - " if k == 0 else "    ") + line for k, line in enumerate(text)]


def _move_tables(lines: list[str], root: Node, old: Path, new: Path) -> None:
    """Paths of map tables, in place, as seen from the new folder."""
    components = root.value.get("components")
    for component in components.value if components is not None and components.is_list else ():
        table = component.value.get("table") if component.is_mapping else None
        file = table.value.get("file") if table is not None and table.is_mapping else None
        if file is None or os.path.isabs(str(file.value)):
            continue
        moved = Path(os.path.relpath(old / str(file.value), new)).as_posix()
        k, column = file.mark.line - 1, file.mark.column - 1
        if moved != file.value:
            before, rest = lines[k][:column], lines[k][column:]
            lines[k] = before + rest.replace(file.text, moved, 1)


def _folder(place: str) -> Path:
    return Path("." if place == "-" else os.path.dirname(place) or ".")
