"""Figure blocks of the documents: read, made again by their commands, compared, written.

    python tests/documents/blocks.py [--write] [--only TEXT] [--list] [DOCUMENT…]

A figure stands under the command that prints it. In a document

    <!-- made by: COMMAND -->                    the table, fenced block or paragraph below is what COMMAND prints
    <!-- transcript: NAME -->                    the fenced block below holds `$ command` lines and what they print;
                                                 transcripts of one NAME run in one folder, in their order

    <!-- made by (in NAME): COMMAND -->          as above, in the folder of the transcripts of that NAME
    <!-- file (in NAME): PATH -->                the fenced block below is written to PATH in that folder

Marks in brackets after `made by` or `transcript`, separated by `;`: `slow` (more than a few seconds; `long` says how
long if it is minutes), `public data` (needs ../shared/data), `timings …` (when and on what machine: not compared).
A line `[…]` stands for any lines left out. Commands run in a folder that looks like the top of the checkout, with
`enginediag` and `python` on the path; standard error is shown after standard output.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("ENGINEDIAG_SHARED") or ROOT.parent / "shared")
COMMENT = re.compile(
    r"^<!-- (?P<what>made by|transcript|file)(?: \((?P<marks>[^)]*)\))?(?:: (?P<text>.*?))? -->$",
)
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
ASSIGNMENTS = re.compile(r"""(?:\w+=(?:"[^"]*"|'[^']*'|[^\s"';|&]*)\s*(?:;\s*)?)+""")
LEFT_OUT = "[…]"
LINKED = ("configs", "tests", "sample_data", "README.md")
"""What of the checkout a command may read; what it writes stays in the scratch folder."""

LAST_DIGIT = 1.001
"""Other versions of the numerical libraries may move the last printed digit by one; whole numbers are counts and do not
move."""

LIMIT_S = 7200.0


@dataclass(frozen=True)
class Block:
    """One block: its document, the line of its comment (from 1), marks, and where its text lies (first and past the
    last index of the document's lines, fences left out). `session`: the name of a transcript, else "". `path`: where
    a file is written, else ""."""

    document: Path
    line: int
    marks: tuple[str, ...]
    command: str
    session: str
    path: str
    first: int
    last: int
    text: tuple[str, ...]

    @property
    def name(self) -> str:
        kind = "".join(f" ({m})" for m in self.marks if not m.startswith("timings"))
        return f"{self.document.relative_to(ROOT)}:{self.line}{kind}"

    @property
    def group(self) -> str:
        """What it runs together with."""
        own = next((m.removeprefix("in ") for m in self.marks if m.startswith("in ")), "")
        return self.session or own or f"line {self.line}"

    @property
    def compared(self) -> bool:
        return not any(m.startswith("timings") for m in self.marks)

    @property
    def slow(self) -> bool:
        return any(re.match(r"(slow|long)\b", m) for m in self.marks)

    @property
    def needs_data(self) -> bool:
        return "public data" in self.marks

    @property
    def commands(self) -> tuple[str, ...]:
        if self.path:
            return ()
        return tuple(c for c, _ in steps(self.text)) if self.session else (self.command,)


def documents() -> list[Path]:
    """Every document of the checkout."""
    return sorted(
        p
        for p in ROOT.rglob("*.md")
        if not any(part.startswith(".") or part == "build" for part in p.relative_to(ROOT).parts)
    )


def blocks(document: Path, unfinished: bool = False) -> list[Block]:
    """Blocks of a document in their order; raises ValueError where a comment has nothing below it, unless the document
    is `unfinished`."""
    lines, found = document.read_text(encoding="utf-8").splitlines(), []
    for i, line in enumerate(lines):
        at = COMMENT.match(line)
        if not at:
            continue
        first, last = _extent(lines, i + 1)
        if first == last and not unfinished:
            raise ValueError(f"{document}:{i + 1}: nothing below this comment")
        marks = tuple(m.strip() for m in (at["marks"] or "").split(";") if m.strip())
        text = at["text"] or ""
        kind = {"transcript": "session", "made by": "command", "file": "path"}[at["what"]]
        own = {"command": "", "session": "", "path": "", kind: text or f"line {i + 1}"}
        found.append(Block(document, i + 1, marks, first=first, last=last, text=tuple(lines[first:last]), **own))
    return found


def _extent(lines: Sequence[str], i: int) -> tuple[int, int]:
    """First and past the last line of what stands right below line i - 1; a blank line may precede fence or table."""
    if i < len(lines) and not lines[i].strip() and i + 1 < len(lines) and lines[i + 1].startswith(("```", "|")):
        i += 1
    if i < len(lines) and lines[i].startswith("```"):
        end = next((j for j in range(i + 1, len(lines)) if lines[j].startswith("```")), i + 1)
        return i + 1, end
    end = i
    while end < len(lines) and lines[end].strip():
        end += 1
    return i, end


def steps(text: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Commands of a transcript, each with what it prints."""
    found: list[tuple[str, list[str]]] = []
    more = False
    for line in text:
        if more or line.startswith("$ "):
            part = line[2:] if not more else line
            if more:
                command, printed = found.pop()
                found.append((command + "\n" + part, printed))
            else:
                found.append((part, []))
            more = line.endswith("\\")
        elif found:
            found[-1][1].append(line)
    return found


# making


class Workplace:
    """A folder that looks like the top of the checkout, in which commands run."""

    def __init__(self, folder: Path):
        self.top = folder / "checkout"
        self._given = ""
        shims = folder / "bin"
        for made in (self.top, shims):
            made.mkdir()
        for name in LINKED:
            (self.top / name).symlink_to(ROOT / name)
        if SHARED.is_dir():
            (folder / "shared").symlink_to(SHARED.resolve())
        for name, call in (("enginediag", " -m enginediag_cli"), ("python", "")):
            (shims / name).write_text(f'#!/bin/sh\nexec "{sys.executable}"{call} "$@"\n', encoding="utf-8")
            (shims / name).chmod(0o755)
        self._environment = {
            **os.environ,
            "PATH": f"{shims}{os.pathsep}{os.environ.get('PATH', '')}",
            "PYTHONPATH": str(ROOT),
            "PYTHONIOENCODING": "utf-8",
            "COLUMNS": "120",
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "ENGINEDIAG_SHARED": str(SHARED.resolve()),
        }

    def run(self, command: str) -> list[str]:
        """Lines of standard output, then of standard error; no lines that are empty. Variables that a line sets and
        nothing else are set for the lines after it, too."""
        if ASSIGNMENTS.fullmatch(command):
            self._given += f"{command}\n"
        done = subprocess.run(
            ["bash", "-c", self._given + command],
            cwd=self.top,
            env=self._environment,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=LIMIT_S,
            stdin=subprocess.DEVNULL,
        )
        return [line.rstrip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]


def output_of(block: Block, place: Workplace) -> list[str]:
    """The block as its commands make it now; of a transcript with its `$` lines. A file is written and is as it is."""
    if block.path:
        (place.top / block.path).write_text("".join(f"{line}\n" for line in block.text), encoding="utf-8")
        return list(block.text)
    if not block.session:
        return place.run(block.command)
    lines = []
    for command, _ in steps(block.text):
        lines += [f"$ {command.splitlines()[0]}", *command.splitlines()[1:], *place.run(command)]
    return lines


def sessions(found: Sequence[Block]) -> Iterator[list[Block]]:
    """Blocks that have to run together, in the folder of one name; every other block by itself."""
    own: dict[tuple[Path, str], list[Block]] = {}
    for b in found:
        own.setdefault((b.document, b.group), []).append(b)
    yield from own.values()


# comparing


def difference(stated: Sequence[str], printed: Sequence[str]) -> str:
    """Empty where the block is what was printed, else the first line that differs, and what was printed instead."""
    expected = [line.rstrip() for line in stated if line.strip()]
    actual = [line.rstrip() for line in printed if line.strip()]
    j, skipping = 0, False
    for line in expected:
        if line.strip() == LEFT_OUT:
            skipping = True
            continue
        while skipping and j < len(actual) and not matches(line, actual[j]):
            j += 1
        if j == len(actual):
            return f"not printed: {line}"
        if not matches(line, actual[j]):
            return f"stated:  {line}\nprinted: {actual[j]}"
        j, skipping = j + 1, False
    return "" if skipping or j == len(actual) else f"printed, too: {actual[j]}"


def matches(stated: str, printed: str) -> bool:
    """Same words, same counts, and other numbers the same but for one in the last digit."""
    if stated == printed:
        return True
    if NUMBER.sub("#", stated).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(stated), NUMBER.findall(printed), strict=True)
    return all(a == b or _close(a, b) for a, b in pairs)


def _close(a: str, b: str) -> bool:
    one, other = (_value(x) for x in (a, b))
    mantissa = a.lower().partition("e")
    digits = len(mantissa[0].partition(".")[2])
    if not digits:
        return False
    step = 10.0**-digits * 10.0 ** (int(mantissa[2]) if mantissa[2] else 0)
    return abs(one - other) <= LAST_DIGIT * step


def _value(text: str) -> float:
    return float(text.replace("−", "-").replace(",", ""))


# by hand


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("documents", nargs="*", type=Path)
    parser.add_argument("--write", action="store_true", help="put what was printed into the documents")
    parser.add_argument("--only", default="", help="blocks whose command or name holds this text")
    parser.add_argument("--timings", action="store_true", help="make the blocks of timings, too")
    parser.add_argument("--list", action="store_true", help="only list them")
    options = parser.parse_args(arguments)
    wrong = 0
    for document in [d.resolve() for d in options.documents] or documents():
        found = [
            b for b in blocks(document, options.write or options.list) if b.compared or options.timings or options.list
        ]
        for group in sessions(found):
            if not any(options.only in f"{b.name} {' '.join(b.commands)}" for b in group):
                continue
            if options.list:
                print(*(f"{b.name}: {'; '.join(b.commands)}" for b in group), sep="\n")
            else:
                wrong += _group(group, options.write)
    return 1 if wrong else 0


def refill(text: Sequence[str], printed: Sequence[str]) -> list[str]:
    """The block's lines with, for each, the printed line that is most like it; `[…]` stays where it is."""
    found, j = [], 0
    for line in text:
        if line.strip() == LEFT_OUT:
            found.append(line)
            continue
        likeness = [SequenceMatcher(None, line, other).ratio() for other in printed[j:]]
        if likeness:
            j += likeness.index(max(likeness)) + 1
            found.append(printed[j - 1])
    return found


def _write_block(block: Block, printed: Sequence[str]) -> None:
    """Writes what was printed into the document, which may have changed above the block since it was read."""
    if any(line.strip() == LEFT_OUT for line in block.text):
        printed = refill(block.text, printed)
        print(f"{block.name}: lines are left out; see that the right ones were kept")
    what = (block.marks, block.command, block.session, block.text)
    now = next(x for x in blocks(block.document, unfinished=True) if (x.marks, x.command, x.session, x.text) == what)
    if now.first == now.last and not all(line.startswith("|") for line in printed):
        printed = ["```", *printed, "```"]
    lines = block.document.read_text(encoding="utf-8").splitlines()
    lines[now.first : now.last] = ["", *printed] if now.first == now.last else printed
    block.document.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _group(group: Sequence[Block], write: bool) -> int:
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        place = Workplace(Path(folder))
        changed = []
        for b in group:
            printed = output_of(b, place)
            wrong_line = difference(b.text, printed)
            print(f"{b.name}: {'as printed' if not wrong_line else wrong_line}", flush=True)
            if wrong_line and write:
                changed.append((b, printed))
            wrong += bool(wrong_line)
    for b, printed in changed:
        _write_block(b, printed)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
