"""The plan of the house: rooms in one order, no circle between them, none too large.

Read from the source as text, function-level imports included; nothing is imported.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "enginediag_cli"

ORDER = (
    "__init__",
    "errors",
    "units",
    "glossary",
    "probability",
    "progress",
    "safe_text",
    "file_lock",
    "shipped",
    "config",
    "parallel",
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
    "isolation",
    "history",
    "mismatch",
    "discrepancy",
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
    "glossary",
    "progress",
    "safe_text",
    "file_lock",
    "shipped",
    "config",
    "parallel",
    "report",
    "api",
    "cli",
)
"""What a command may import: the library, what is shown, and what speaks of no engine."""

VALIDATION = {name: ("validation",) for name in ("validation",)}
"""Commands that run trials and demonstrations, which are no part of the library."""

LARGEST_FILE = 750
"""Lines of a file: a topic that a reader can name usually takes 150 to 600; a family of near relatives takes more."""

MOST_FILES, MOST_FILES_IN_ALL = 40, 230 + 40
"""Files of a package, and of all packages: what a newcomer can survey; 40 are for what replaces `mismatch`."""

LARGEST_SHARE_OF_IMPORTS = 0.04
"""Share of lines that only connect other lines; well-kept packages of this kind have 1 to 3 %."""

LONGEST_FUNCTION = 60
"""Lines of a function without its docstring; ruff holds its cyclomatic complexity (C901)."""

PLUG_INS = frozenset({("methods", "filters"), ("methods", "residual_tests")})
"""Modules that a registry finds, so that nothing need import them."""

BANNED_NAME = re.compile(
    r"(?i:told|said|says?|tells?|heard|handed|handing|begun|along|held|of|at|found|brought|owed|settled|beside|foreseen"
    r"|unseen|weighed|needed|unmet|few|within|elsewhere|alike|carried|doubtful|lawful|on_all|in_part|worth_fitting|among_all"
    r"|among|(?:told|said|handed|owed|foreseen|among|begun|of|at|beside)_\w+|\w+_(?:told|said|of|at|owed|foreseen|handed))"
)
"""Names that say nothing to a reader: particles, participles and the private words of earlier years."""


OPEN = pytest.mark.xfail(reason="the house is being rebuilt to this rule", strict=False)


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


def length(file: Path) -> int:
    return file.read_text(encoding="utf-8").count("\n")


def test_no_file_is_larger_than_a_room_should_be() -> None:
    large = {name_of(f): n for f in files() if (n := length(f)) > LARGEST_FILE}
    assert large == {}


def modules() -> dict[tuple[str, ...], Path]:
    """Every module by its dotted path within the package; a package goes by the name of its folder."""
    found = {}
    for file in files():
        parts = file.relative_to(PACKAGE).with_suffix("").parts
        found[parts[:-1] if parts[-1] == "__init__" else parts] = file
    return found


def target(parts: tuple[str, ...], known: dict[tuple[str, ...], Path]) -> tuple[str, ...]:
    """The module that an import leads to: `from room.module import name` leads to room.module."""
    return parts if parts in known else parts[:-1]


def rebuilt_later(file: Path) -> bool:
    """The search for missing physics is rebuilt as a whole; until then only its place in the order is checked."""
    return file.relative_to(PACKAGE).parts[0] == "mismatch"


def test_no_circle_of_imports_at_the_top_of_files() -> None:
    known = modules()
    arrows = {
        name: {
            target(tuple(f"{node.module}.{alias.name}".split(".")[1:]), known)
            for node in tree(file).body
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == PACKAGE.name
            for alias in node.names
        }
        - {name}
        for name, file in known.items()
        if name  # the front door opens what stands highest
    }
    while free := [name for name in arrows if not arrows[name] & arrows.keys()]:
        for name in free:
            del arrows[name]
    assert sorted(map(".".join, arrows)) == []


def test_the_number_of_files_stays_in_bounds() -> None:
    by_package: dict[str, int] = defaultdict(int)
    for file in files():
        if not rebuilt_later(file):
            by_package[file.relative_to(PACKAGE).parts[0] if file.parent != PACKAGE else "."] += 1
    assert {name: n for name, n in by_package.items() if n > MOST_FILES} == {}
    assert sum(by_package.values()) <= MOST_FILES_IN_ALL


def test_no_module_is_imported_by_a_single_neighbour_alone() -> None:
    """Unless a registry finds it, or the two together were larger than a room should be."""
    known = modules()
    importers: dict[tuple[str, ...], set[tuple[str, ...]]] = defaultdict(set)
    for name, file in known.items():
        for _, parts in imported(file):
            importers[target(parts, known)].add(name)
    alone = [
        f"{'.'.join(name)} belongs inside {'.'.join(*by)}"
        for name, by in importers.items()
        if len(by) == 1
        and name
        and not rebuilt_later(known[name])
        and known[name].parent == known[next(iter(by))].parent
        and length(known[name]) + length(known[next(iter(by))]) <= LARGEST_FILE
        and name not in PLUG_INS
    ]
    assert alone == []


@OPEN
def test_few_lines_are_imports() -> None:
    lines = imports = 0
    for file in files():
        if not rebuilt_later(file):
            lines += file.read_text(encoding="utf-8").count("\n")
            nodes = [n for n in ast.walk(tree(file)) if isinstance(n, ast.Import | ast.ImportFrom)]
            imports += sum((n.end_lineno or n.lineno) - n.lineno + 1 for n in nodes)
    assert imports / lines <= LARGEST_SHARE_OF_IMPORTS


def test_validation_is_imported_by_the_commands_alone() -> None:
    assert [
        f"{name_of(file)}:{line}"
        for file in files()
        for line, parts in imported(file)
        if room(parts) == "validation" and file.relative_to(PACKAGE).parts[0] not in ("validation", "cli")
    ] == []


def functions(file: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def code_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without its docstring."""
    first = function.body[0]
    documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    docstring = (first.end_lineno or first.lineno) - first.lineno + 1 if documented else 0
    return (function.end_lineno or function.lineno) - function.lineno + 1 - docstring


def test_functions_are_short() -> None:
    assert [
        f"{name_of(file)}:{f.lineno}: {f.name} has {code_lines(f)} lines"
        for file in files()
        if not rebuilt_later(file)
        for f in functions(file)
        if code_lines(f) > LONGEST_FUNCTION
    ] == []


def definitions(file: Path) -> Iterator[tuple[int, str]]:
    """Line and name of every class and function."""
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.lineno, node.name


def test_names_are_the_fields() -> None:
    assert [
        f"{name_of(file)}:{line}: {name}"
        for file in files()
        if not rebuilt_later(file)
        for line, name in definitions(file)
        if not name.startswith("__") and BANNED_NAME.fullmatch(name.strip("_"))
    ] == []


def test_a_class_has_a_name_of_its_own() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for file in files():
        if not rebuilt_later(file):
            for node in ast.walk(tree(file)):
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(f"{name_of(file)}:{node.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


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
    assert found == ["probability.py"]


@pytest.mark.parametrize("word", ["utils", "helpers", "misc", "common"])
def test_no_room_is_a_drawer(word: str) -> None:
    assert [name_of(f) for f in files() if f.stem == word or word in f.parts] == []


READS_MEANING = re.compile(
    r"""startswith\((f?["']sensor|["']χ²|["']refused)|(?:end|start)swith\([^)]*["']\.|endswith\(\(?["']_"""
    r"""|partition\(["']\.["']\)|\.split\(["']\.["']\)|fnmatch"""
)
"""What reads meaning back out of a name or a sentence: a parameter, a driver and a reason say what they are."""

MATCHED_PATTERNS = (
    "config/files.py",
    "detection/verdict.py",
    "identification/problem.py",
    "mismatch/fit/load.py",
    "residuals/monitor.py",
    "validation/studies.py",
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
