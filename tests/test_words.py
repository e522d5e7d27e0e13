"""The field's words in everything that a user reads: messages, help, column descriptions, documents."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from enginediag_cli.glossary import GLOSSARY

TOP = Path(__file__).resolve().parents[1]
PACKAGE = TOP / "enginediag_cli"

REBUILT_LATER = ("mismatch",)
"""The search for missing physics is rebuilt as a whole, and its messages with it."""

INSTEAD = {
    r"\btold\b|\btells\b": "reported, shown, printed",
    r"\b(?:was|were|is|are) asked\b": "target, required, requested",
    r"\bnothing stands out\b": "no significant change",
    r"\brivals?\b": "alternative hypotheses, ambiguity group",
    r"\bcannot be told\b": "is indistinguishable from",
    r"\bremembers?\b|\bremembering\b": "dynamic effect (with memory)",
    r"\bcondensed\b": "reduced to sufficient statistics",
    r"\bleft out\b": "excluded",
    r"(?<![-`_])\bflips?\b": "sensitivity of the conclusion",
    r"\bdiscoveries\b": "engines flagged",
    r"\bcries wolf\b": "false alarm",
    r"\bno library holds\b": "empirical correction, not in the library",
    r"\btaken off\b": "removed from wing",
    r"\bwhat (?:it leaves|is left)\b": "residual, unexplained part",
    r"\bmend(?:ed|s|ing)?\b": "fix",
    r"\bforeseen\b": "predicted",
    r"\bworth fitting\b": "screened",
    r"\bowed\b": "pending",
}
"""Words of earlier years, and what the field says instead."""

LONGEST_MEAN_SENTENCE = 22
"""Words: a sentence of that length is still understood at first reading."""


def strings(file: Path) -> Iterator[tuple[int, str]]:
    """Line and text of the strings of a module that hold words; docstrings are its readers', not its users'."""
    found = ast.parse(file.read_text(encoding="utf-8"))
    docstrings = {id(n.value) for n in ast.walk(found) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
    for node in ast.walk(found):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            if " " in node.value.strip():
                yield node.lineno, node.value


def helps(file: Path) -> Iterator[tuple[int, str]]:
    """Docstrings of commands, which click shows as help."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.decorator_list and (text := ast.get_docstring(node)):
            yield node.lineno, text


def modules() -> list[Path]:
    return [f for f in sorted(PACKAGE.rglob("*.py")) if f.relative_to(PACKAGE).parts[0] not in REBUILT_LATER]


def documents() -> list[Path]:
    folders = (TOP, TOP / "enginediag_cli", TOP / "configs", TOP / "tests", TOP / "sample_data")
    found = {f for folder in folders for f in (folder.glob("*.md") if folder == TOP else folder.rglob("*.md"))}
    return sorted(f for f in found if ".pytest_cache" not in f.parts)


def user_text() -> Iterator[tuple[str, str]]:
    """Everything that a user reads, piece by piece, with its place; names in code spans are not words."""
    for file in modules():
        if file.name == "glossary.py":  # its entries follow below; it also lists other words and names of columns
            continue
        for line, text in [*strings(file), *(helps(file) if file.parent.name == "cli" else ())]:
            yield f"{file.relative_to(TOP)}:{line}", without_code(text)
    for entry in GLOSSARY:
        yield f"glossary, {entry.word}", f"{entry.word}: {entry.meaning}"
    for file in documents():
        if file.name in ("CHANGELOG.md", "GLOSSARY.md"):  # what earlier versions said of themselves; the glossary again
            continue
        for number, text in enumerate(without_code(file.read_text(encoding="utf-8")).splitlines(), start=1):
            yield f"{file.relative_to(TOP)}:{number}", text


def without_code(text: str) -> str:
    """A document without fenced blocks, comments and code spans, its lines where they were."""
    text = re.sub(r"^```.*?^```|<!--.*?-->", lambda m: "\n" * m[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "``", text)


@pytest.mark.parametrize("word", INSTEAD)
def test_words_of_earlier_years_do_not_come_back(word: str) -> None:
    banned = re.compile(word, re.IGNORECASE)
    found = [f"{where}: {text.strip()[:90]!r}" for where, text in user_text() if banned.search(text)]
    assert found == [], f"say instead: {INSTEAD[word]}"


def prose(text: str) -> str:
    """A document without code, tables, headings, pictures and addresses."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines = [line for line in text.splitlines() if not re.match(r"\s*(\||#|<|!|\[[^\]]+\]:|    )", line)]
    return re.sub(r"\]\([^)]*\)", "]", "\n".join(lines))


def sentence_lengths(text: str) -> list[int]:
    """Words of each sentence of a text; list items and paragraphs end one as well."""
    parts = re.split(r"(?<=[.!?:;])\s+|\n\s*\n|\n\s*[-*] ", text)
    return [n for part in parts if (n := len(re.findall(r"[\w’'%°/.-]+", part))) > 2]


def test_sentences_of_the_readme_are_short() -> None:
    lengths = sentence_lengths(prose((TOP / "README.md").read_text(encoding="utf-8")))
    assert sum(lengths) / len(lengths) <= LONGEST_MEAN_SENTENCE


def test_sentences_of_messages_and_help_are_short() -> None:
    texts = [text for file in modules() for _, text in [*strings(file), *helps(file)]]
    lengths = [n for text in texts for n in sentence_lengths(text)]
    assert sum(lengths) / len(lengths) <= LONGEST_MEAN_SENTENCE
