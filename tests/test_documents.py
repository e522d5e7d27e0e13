"""The documents say what is so: figures are what their commands print, links lead somewhere, commands exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
from blocks import ROOT, SHARED, Workplace, blocks, difference, documents, matches, output_of, sessions, steps

from enginediag_cli.cli.main import enginediag

MOST_LINES, WIDEST = 150, 120
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)|^\[[^\]]+\]: (\S+)$", re.M)
SPAN = re.compile(r"`(enginediag [^`]+)`")
DOCUMENTS = documents()
FOUND = [group for document in DOCUMENTS for group in sessions(blocks(document, unfinished=True))]


def marked(group):
    return pytest.param(
        group,
        id=group[0].name,
        marks=[pytest.mark.slow] * any(b.slow for b in group) + [pytest.mark.shared_data] * group[0].needs_data,
    )


@pytest.mark.parametrize("group", [marked(g) for g in FOUND if all(b.compared for b in g)])
def test_a_figure_is_what_the_command_above_it_prints(group, tmp_path):
    if any(b.needs_data for b in group) and not SHARED.is_dir():
        pytest.skip("public data not found beside the checkout; put it in ../shared or set ENGINEDIAG_SHARED")
    place = Workplace(tmp_path)
    wrong = [difference(b.text, output_of(b, place)) for b in group]
    assert not any(wrong), "\n".join(wrong) + "\n(python tests/documents/blocks.py --write puts it right)"


@pytest.mark.parametrize("group", [marked(g) for g in FOUND if not all(b.compared for b in g)])
def test_timings_name_when_and_where_and_a_script_with_these_options(group):
    for b in group:
        when = next(m for m in b.marks if m.startswith("timings "))
        assert re.search(r"\d{4}", when) and "core" in when
        for command in b.commands:
            words = [w for w in shlex.split(command) if w.endswith(".py") or w.startswith("--")]
            script = next(w for w in words if w.endswith(".py"))
            text = (ROOT / script).read_text(encoding="utf-8")
            assert all(w.split("=")[0] in text for w in words if w.startswith("--"))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: str(d.relative_to(ROOT)))
def test_no_figure_is_announced_and_missing(document):
    assert all(block.text for block in blocks(document))


def slug(heading: str) -> str:
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


def prose(document: Path) -> str:
    """Without fenced blocks."""
    return re.sub(r"^```.*?^```", "", document.read_text(encoding="utf-8"), flags=re.M | re.S)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: str(d.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(document):
    for target in (a or b for a, b in LINK.findall(prose(document))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, part = target.partition("#")
        there = (document.parent / path) if path else document
        assert there.exists(), target
        if part:
            headings = re.findall(r"^#+ (.*)$", prose(there), flags=re.M)
            assert part in [slug(h) for h in headings], target


def command_lines(document: Path) -> list[list[str]]:
    """Words of every `enginediag …` of a document, as a shell would call it."""
    text = document.read_text(encoding="utf-8")
    shell = []
    for fence, inside in re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.M | re.S):
        if fence == "console":
            shell += [c for c, _ in steps(inside.splitlines())]
        elif fence in ("sh", "bash"):
            shell += inside.replace("\\\n", " ").splitlines()
    shell += re.findall(r"^    (.*\benginediag .*)$", prose(document).replace("\\\n", " "), flags=re.M)
    shell += SPAN.findall(prose(document))
    return [words for line in shell for words in calls(line.replace("\\\n", " "))]


def calls(line: str) -> list[list[str]]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;<>()")
    lexer.whitespace_split, lexer.commenters = True, "#"
    found: list[list[str]] = []
    inside = False
    for word in lexer:
        if word.rpartition("/")[2] == "enginediag" and not inside:
            found.append([])
            inside = True
        elif set(word) <= set("|&;<>()"):
            inside = False
        elif inside:
            found[-1].append(word)
    return [words for words in found if words and re.fullmatch(r"[a-z-]+", words[0])]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: str(d.relative_to(ROOT)))
def test_every_command_in_a_document_exists_with_its_options(document):
    for words in command_lines(document):
        if words[0].startswith("-"):
            continue
        context = click.Context(enginediag)
        command = enginediag.get_command(context, words[0])
        assert command is not None, words
        command.make_parser(click.Context(command, info_name=words[0])).parse_args(words[1:])


def test_the_readme_is_one_that_is_read():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= MOST_LINES
    assert [line for line in lines if len(line) > WIDEST] == []


def test_the_citation_names_this_version():
    stated = [
        re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), flags=re.M)[1]
        for name, pattern in (("pyproject.toml", r'^version = "(.*)"$'), ("CITATION.cff", r"^version: (.*)$"))
    ]
    assert stated[0] == stated[1]


def test_no_document_names_a_folder_of_one_machine():
    for document in DOCUMENTS:
        assert not re.search(r"(?<![\w.])/(?:home|root|work|tmp)/", document.read_text(encoding="utf-8")), document


class TestTheComparison:
    def test_a_figure_that_changed_is_told_with_what_is_printed_instead(self):
        assert difference(["| a | 12 |"], ["| a | 13 |"]) == "stated:  | a | 12 |\nprinted: | a | 13 |"

    def test_the_last_digit_of_a_measured_number_may_move_by_one_and_a_count_may_not(self):
        assert matches("χ² 1.123, 4.9e-03", "χ² 1.124, 4.8e-03")
        assert not matches("χ² 1.123", "χ² 1.125")
        assert not matches("7 of 44", "8 of 44")

    def test_lines_left_out_are_marked(self):
        assert difference(["a", "[…]", "d"], ["a", "b", "c", "d"]) == ""
        assert difference(["a", "d"], ["a", "b", "c", "d"])
        assert difference(["a", "[…]"], ["a", "b"]) == ""

    def test_a_line_that_is_not_printed_and_one_that_is_not_stated_are_told(self):
        assert difference(["a", "b"], ["a"]) == "not printed: b"
        assert difference(["a"], ["a", "b"]) == "printed, too: b"

    def test_a_transcript_is_run_line_by_line_in_one_folder(self, tmp_path):
        text = "<!-- transcript: x -->\n\n```console\n$ echo 1 \\\n    2 >kept\n$ cat kept\n1 2\n```\n"
        document = tmp_path / "d.md"
        document.write_text(text, encoding="utf-8")
        (tmp_path / "place").mkdir()
        [b] = blocks(document)
        assert steps(b.text) == [("echo 1 \\\n    2 >kept", []), ("cat kept", ["1 2"])]
        assert difference(b.text, output_of(b, Workplace(tmp_path / "place"))) == ""

    def test_a_comment_with_nothing_below_it_is_a_mistake(self, tmp_path):
        document = tmp_path / "d.md"
        document.write_text("<!-- made by: true -->\n", encoding="utf-8")
        with pytest.raises(ValueError, match="nothing below"):
            blocks(document)
