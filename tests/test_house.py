"""The plan of the house: rooms in one order, no circle between them, none too large.

Read from the source as text, function-level imports included; nothing is imported.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "enginediag_cli"

ORDER = (
    "__init__",
    "errors",
    "units",
    "intervals",
    "progress",
    "side_by_side",
    "safe_text",
    "file_lock",
    "shipped",
    "parent_process",
    "config",
    "worker_pool",
    "parameters",
    "recordings",
    "engine",
    "drivers",
    "physics",
    "faults",
    "simulation",
    "error_model",
    "identification",
    "intake",
    "residuals",
    "detection",
    "planning",
    "isolation",
    "mismatch",
    "methods",
    "fleets",
    "report",
    "api",
    "validation",
    "cli",
    "__main__",
)
"""Each room may import those before it, never those after it."""

MISMATCH_ORDER = ("controlled", "fit", "unrecorded", "laws", "locate", "explain", "refine")
"""The rooms of the search for missing physics, in the same way."""

FOR_COMMANDS = (
    "__init__",
    "errors",
    "progress",
    "side_by_side",
    "safe_text",
    "file_lock",
    "shipped",
    "config",
    "report",
    "api",
    "cli",
)
"""What a command may import: the library, what is shown, and what speaks of no engine."""

VALIDATION = {
    name: ("validation", "worker_pool") for name in ("study", "prove", "proving", "demo", "demo_missing", "demo_steps")
}
"""Commands that run trials and demonstrations, which are no part of the library."""

LARGEST_FILE = 600
"""Lines of a file: a topic that a reader can name usually takes 150 to 600."""


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def name_of(file: Path) -> str:
    return str(file.relative_to(PACKAGE))


def imported(file: Path) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Line, and dotted path within the package, of everything that a file imports from it."""
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"{name_of(file)}:{node.lineno}: imports are absolute here")
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == PACKAGE.name:
                yield node.lineno, tuple(parts[1:])


def room(parts: tuple[str, ...]) -> str:
    """The room that an imported path leads to; `__version__` stands in the package itself."""
    return "__init__" if not parts or parts[0].startswith("__version") else parts[0]


def wrong_arrows(order: tuple[str, ...], within: str = "") -> list[str]:
    found = []
    folder = PACKAGE / within if within else PACKAGE
    for file in sorted(folder.rglob("*.py")):
        if file == PACKAGE / "__init__.py":  # the front door: it opens what stands highest, when it is used
            continue
        own = file.relative_to(folder).parts[0].removesuffix(".py")
        for line, parts in imported(file):
            if within:
                if parts[:1] != (within,) or len(parts) < 2:
                    continue
                parts = parts[1:]
            other = room(parts)
            if own == "__init__" and within:
                continue
            if other not in order or own not in order:
                found.append(f"{name_of(file)}:{line}: the room {other if other not in order else own} has no place")
            elif order.index(other) > order.index(own):
                found.append(f"{name_of(file)}:{line}: {own} imports {other}, which stands above it")
    return found


def test_every_room_imports_only_rooms_below_it() -> None:
    assert wrong_arrows(ORDER) == []


def test_the_rooms_of_the_search_for_missing_physics_stand_on_each_other_in_order() -> None:
    assert wrong_arrows(MISMATCH_ORDER, "mismatch") == []


def test_commands_import_nothing_deeper_than_the_library() -> None:
    deeper = [
        f"{name_of(file)}:{line}: {'.'.join(parts)}"
        for file in sorted((PACKAGE / "cli").glob("*.py"))
        for line, parts in imported(file)
        if room(parts) not in FOR_COMMANDS + VALIDATION.get(file.stem, ())
    ]
    assert deeper == []


def test_every_room_has_a_place_in_the_order() -> None:
    rooms = {p.name.removesuffix(".py") for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert rooms <= set(ORDER)


def test_no_file_is_larger_than_a_room_should_be() -> None:
    large = {name_of(f): n for f in files() if (n := f.read_text(encoding="utf-8").count("\n")) > LARGEST_FILE}
    assert large == {}


CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")


def of_numbers(node: ast.expr | None) -> bool:
    """Whether a value is written as a number, or as a group, a table or a formula of numbers."""
    match node:
        case ast.Constant(value=value):
            return type(value) in (int, float)
        case ast.UnaryOp(operand=inside):
            return of_numbers(inside)
        case ast.BinOp(left=left, right=right):
            return of_numbers(left) or of_numbers(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Set(elts=parts) | ast.Dict(values=parts):
            return bool(parts) and all(of_numbers(part) for part in parts)
        case ast.Call(args=parts):
            return bool(parts) and all(of_numbers(part) for part in parts)
    return False


def constants(file: Path) -> Iterator[tuple[ast.stmt, list[str], bool]]:
    """Constants of numbers at the head of a file: the assignment, its names, and whether a reason stands with it (a
    string below it, or a comment on its lines or directly above)."""
    body, lines = tree(file).body, file.read_text(encoding="utf-8").splitlines()
    for node, below in zip(body, [*body[1:], ast.Pass()], strict=False):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not of_numbers(node.value):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)]
        if all(CONSTANT.fullmatch(name) for name in names):
            told = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
            own = lines[node.lineno - 1 : node.end_lineno]
            above = lines[node.lineno - 2].startswith("#") if node.lineno > 1 else False
            yield node, names, told or above or any("  # " in line for line in own)


def test_every_constant_of_numbers_says_why() -> None:
    bare = [
        f"{name_of(file)}:{node.lineno}: {', '.join(names)}"
        for file in files()
        for node, names, reason in constants(file)
        if not reason
    ]
    assert bare == []


def test_the_reach_of_a_95_percent_interval_is_written_once() -> None:
    found = [
        name_of(file)
        for file in files()
        for node in ast.walk(tree(file))
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and abs(node.value - 1.96) < 1e-3
    ]
    assert found == ["intervals.py"]


@pytest.mark.parametrize("word", ["utils", "helpers", "misc", "common"])
def test_no_room_is_a_drawer(word: str) -> None:
    assert [name_of(f) for f in files() if f.stem == word or word in f.parts] == []


READS_MEANING = re.compile(
    r"""startswith\((f?["']sensor|["']χ²|["']refused)|(?:end|start)swith\([^)]*["']\.|endswith\(\(?["']_"""
    r"""|partition\(["']\.["']\)|\.split\(["']\.["']\)|fnmatch"""
)
"""What reads meaning back out of a name or a sentence: a parameter, a driver and a reason say what they are."""

MATCHED_PATTERNS = (
    "config/patterns.py",
    "detection/glr.py",
    "identification/problem.py",
    "mismatch/fit/load.py",
    "residuals/monitor.py",
    "validation/studies/cases.py",
)
"""Files that match the patterns which a user gives against names."""

FILE_ENDINGS = re.compile(r"""endswith\(\(?["']\.(gz|csv|json|yaml|yml)["']""")


def test_nothing_is_read_back_out_of_names_or_sentences() -> None:
    found = [
        f"{name_of(file)}:{number}: {line.strip()}"
        for file in files()
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1)
        if READS_MEANING.search(line)
        and not FILE_ENDINGS.search(line)
        and not ("fnmatch" in line and name_of(file) in MATCHED_PATTERNS)
    ]
    assert found == []
