"""Damaged files, thousands of them, given to the program: it may refuse them, and must do so as it says it does.

    python tests/mutations/campaign.py --cases 1000 --seed 1

A case is a seed: the same seed damages the same file in the same way and gives it to the same command. What is asked of
each: exit code 0, 1, 2 or 3; no traceback, no internal error, no warning of Python on the way; an end within a minute;
and every record that was read stands in the rows as judged, outside, incomplete or failed, or is told on stderr; what
stands in a file that is none of its business is never told; a recorder that it drafts is one that it accepts.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import os
import re
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "identification"), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from damage import PATHS, TABLE, YAML, Damage  # noqa: E402
from healthy_files import Files, make  # noqa: E402

from enginediag_cli.__main__ import main  # noqa: E402

LONGEST_S = 60
"""After which a case counts as hanging."""
JUDGING = (
    ("detect",),
    ("detect", "--window", "8"),
    ("detect", "--linearise", "nominal", "--detectable"),
    ("detect", "--follow", "--idle", "0"),
    ("detect", "--follow", "--idle", "0", "--window", "5"),
    ("isolate", "--nonlinear", "never"),
    ("isolate",),
    ("isolate", "--method", "incremental"),
    ("detect", "--reference", "8", "--model-error", "0.1"),
    ("residual",),
    ("residual", "--what", "records"),
    ("trend",),
)
FROM_STATISTICS = (("detect",), ("isolate",), ("isolate", "--method", "sensitivity"), ("trend", "--what", "flights"))
FITTING = (
    ("identify", "engine.yaml", "--no-cross-validation"),
    ("locate", "engine.yaml"),
    ("explain", "engine.yaml"),
    ("refine", "engine.yaml", "--holdout-last", "1"),
)
"""Commands that fit the engine, a second each even on these files: chosen for one case in twenty."""
OPTIONS = (
    ("--false-alarm", "{x}"),
    ("--model-error", "{x}"),
    ("--power", "{x}", "--detectable"),
    ("--idle", "{x}", "--follow"),
    ("--window", "{x}"),
    ("--reference", "{x}"),
    ("--recorder", "{path}"),
    ("-n", "{path}"),
    ("--columns", "{path}"),
    ("-o", "{path}"),
    ("{path}",),
)
"""Options with a number or a path that cannot be, behind a sound command."""
IMPOSSIBLE = ("nan", "-nan", "inf", "-inf", "-1", "1e308", "", "0x10", "１", "\x1b[31m")
SECRET = "hunter2"
"""What stands in a file beside the folder, and is nobody's business."""


@dataclass(frozen=True)
class Case:
    """`content` is written to `file`, and the command run in its folder; damage: its name, for reports; closed: nobody
    holds standard output."""

    seed: int
    damage: str
    file: str
    content: bytes
    command: tuple[str, ...]
    closed: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `wrong` says what should not have happened, '' when all is as it must be."""

    case: Case
    code: int
    seconds: float
    stderr: str
    wrong: str


class Hanging(BaseException):
    """Raised by the alarm; no handler of the program's takes it for an error of its own."""


def prepared(folder: Path) -> Files:
    """The sound files, and statistics made of them by the program itself."""
    folder.mkdir(exist_ok=True)
    files = make(folder)
    (folder.parent / "secret.txt").write_text(f"token: {SECRET}\n", encoding="utf-8")
    with contextlib.chdir(folder):
        for name, recording, extra in (("statistics", "faulty", ["--sensors"]), ("series", "flights", [])):
            code = main(
                [
                    "residual",
                    "-n",
                    "nominal.yaml",
                    *extra,
                    "--window",
                    "8",
                    f"{recording}.csv",
                    "-o",
                    f"{name}.csv",
                    "-q",
                ]
            )
            assert code == 0, code
    texts = {**files.texts, **{f"{n}.csv": (folder / f"{n}.csv").read_text("utf-8") for n in ("statistics", "series")}}
    return Files(folder, texts)


def case_of(seed: int, files: Files) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng([20, seed])

    def one(choices):
        return choices[int(rng.integers(len(choices)))]

    kind = one(
        ("engine", "recorder", "nominal", "nominal", "recording", "recording", "recording", "statistics", "statistics")
    )
    if rng.random() < 0.05:
        kind = "option"
    file = {"engine": "engine.yaml", "recorder": "recorder.yaml", "nominal": "nominal.yaml"}.get(kind, "")
    file = file or one(
        ("statistics.csv", "series.csv")
        if kind == "statistics"
        else ("flight.csv", "faulty.csv", "flights.csv", "foreign.csv")
    )
    if kind == "option":
        return _option_case(seed, file, files, rng)
    nominal, mapped = ("-n", "nominal.yaml"), ("--recorder", "recorder.yaml") if file == "foreign.csv" else ()
    fitting, foreign = rng.random() < 0.05, ("--recorder", "recorder.yaml", "foreign.csv")
    command = {
        "engine": (("check", file), ("simulate", file, "--records", "4"), ("detect", *nominal, "flight.csv"),
                   ("check", "--engine", file, "flight.csv")),
        "recorder": (("detect", *nominal, *foreign), ("check", file), ("check", *nominal, *foreign),
                     ("residual", *nominal, *foreign), ("detect", "--follow", "--idle", "0", *nominal, *foreign)),
        "nominal": (("check", file), ("check", *nominal, "flight.csv"),
                    *((*words, *nominal, "flight.csv") for words in JUDGING[:8])),
        "recording": (*((*words, *nominal, *mapped, file) for words in JUDGING), ("check", *nominal, *mapped, file),
                      ("check", file), ("recorder", file), ("recorder", file, "--engine", "engine.yaml")),
        "statistics": tuple((*words, file) for words in FROM_STATISTICS),
    }[kind]  # fmt: skip
    if fitting and kind in ("engine", "recorder", "recording"):
        read = {"engine": ("flights.csv",), "recorder": foreign, "recording": (*mapped, file)}[kind]
        command = tuple((*words, *read) for words in FITTING)
    text, damages = files.texts[file], YAML if file.endswith(".yaml") else TABLE
    names: list[str] = []
    content: bytes | str = text
    for _ in range(1 if rng.random() < 0.7 else 2):
        damage: Damage = one(damages)
        if isinstance(content, str):
            try:
                content = damage(content, rng)
            except (IndexError, ValueError):  # too little is left to be damaged in this way
                continue
            names.append(damage.__name__)
    if isinstance(content, str):
        # a careful forger: what the checksums would catch is to be refused for what it is
        if kind == "nominal" and rng.random() < 0.6:
            content = "\n".join(line for line in content.split("\n") if not line.startswith("checksum:"))
            names.append("unsealed")
        if kind == "statistics" and rng.random() < 0.6:
            content = resealed(content)
            names.append("resealed")
        content = content.encode("utf-8", "surrogatepass")
    return Case(seed, " and ".join(names), file, content, tuple(map(str, one(command))), rng.random() < 0.02)


def _option_case(seed: int, file: str, files: Files, rng: np.random.Generator) -> Case:
    """Sound files, and an option with a value that cannot be."""
    mapped = ("--recorder", "recorder.yaml") if file == "foreign.csv" else ()
    words = ("detect", "isolate", "residual", "trend", "check")[int(rng.integers(5))]
    option = OPTIONS[int(rng.integers(len(OPTIONS)))]
    x, path = (many[int(rng.integers(len(many)))] for many in (IMPOSSIBLE, PATHS))
    given = tuple(word.format(x=x, path=path.replace("\\0", "")) for word in option)
    command = (words, "-n", "nominal.yaml", *mapped, file, *given)
    return Case(seed, "an option", file, files.texts[file].encode("utf-8"), command)


def resealed(text: str) -> str:
    """Statistics whose checksums fit whatever their rows hold, as far as they are still a table."""
    from enginediag_cli.residuals.flat import CHECKSUM, checksum

    lines = [line for line in text.split("\n") if line]
    head = [line for line in lines if line.startswith("#")]
    try:
        rows = list(csv.DictReader([line for line in lines if not line.startswith("#")], strict=True))
        for row in rows:
            if CHECKSUM not in row or None in row or None in row.values():
                return text
            row[CHECKSUM] = checksum(row)
    except csv.Error:
        return text
    if not rows:
        return text
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return "\n".join([*head, stream.getvalue()])


def run(case: Case, files: Files) -> Outcome:
    """Give the damaged file to the program, and put the sound one back."""
    out, err = io.StringIO(), io.StringIO()
    path, result = files.folder / case.file, files.folder / "out.csv"
    result.unlink(missing_ok=True)
    path.write_bytes(case.content)
    # check answers on standard output, the others in a file that is looked into, or on a closed standard output
    aside = case.command[0] == "check" or case.closed or "-o" in case.command
    result = result.with_suffix(".yaml") if case.command[0] in ("recorder", "identify", "refine") else result
    result.unlink(missing_ok=True)
    words = [*case.command, *(() if aside else ("-o", result.name))]
    began, wrong, code = time.perf_counter(), "", -1
    before = signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LONGEST_S)
    try:
        with (
            contextlib.chdir(files.folder),
            contextlib.redirect_stdout(None if case.closed else out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("always")
            code = int(main(words))
            if code == 0 and case.command[0] == "recorder" and not case.closed and main(["check", result.name]):
                wrong = "a draft that check does not accept"
    except Hanging:
        wrong = f"did not end within {LONGEST_S} s"
    except Exception as error:  # whatever gets out of main is a finding
        wrong = f"{type(error).__name__} got out of main: {error}"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        path.write_text(files.texts[case.file], encoding="utf-8")
    seconds = time.perf_counter() - began
    wrong = wrong or _wrong(case, code, err.getvalue(), result)
    return Outcome(case, code, seconds, err.getvalue(), wrong)


def _hang(number: int, frame: object) -> None:
    raise Hanging


def _wrong(case: Case, code: int, stderr: str, result: Path) -> str:
    if code not in (0, 1, 2, 3):
        return f"exit code {code}"
    for trace in ("Traceback (most recent", "internal error:", "Warning:"):
        if trace in stderr:
            return f"{trace} on stderr"
    asked_for = "../secret.txt" in case.command  # on the command line, by the user's own hand
    if (not asked_for and SECRET in stderr) or (result.exists() and SECRET in result.read_text("utf-8")):
        return "what stands in another file was told"
    if code == 2 and not stderr.strip():
        return "exit code 2 without a word"
    if code == 2 and result.exists() and "the other files are judged" not in stderr:
        return "a file was left by a run that was refused"
    if case.command[0] in ("detect", "isolate", "residual") and case.file.endswith(".csv") and result.exists():
        return _lost(case, result, stderr)
    return ""


WINDOW = ("source", "flight", "engine", "first_line", "last_line")
"""What tells windows apart: of what is isolated there may be several rows of one."""


def _lost(case: Case, result: Path, stderr: str) -> str:
    """Whether a record of the input stands neither in a row nor in what was told."""
    body = [line for line in io.StringIO(result.read_text("utf-8")) if not line.startswith("#")]
    rows = list(csv.DictReader(body))
    for row in rows:
        judged = "judged" if "judged" in row else ""
        parts = (judged, "outside", "incomplete", "failed", *(["repeated"] if "repeated" in row else []))
        told = sum(int(row[c]) for c in parts) if judged else 0
        if judged and not row["reason"] and told != int(row["records"]):
            return f"{row['records']} records in a row that accounts for {told}"
        if row.get("verdict") == "healthy" and int(row["sensors"]) < 2:
            return "healthy by less than two sensors"
        if row.get("alarm") == "true" and int(row["sensors"]) < 2 and "verdict" in row:
            return "an alarm by less than two sensors"
    if case.file in ("statistics.csv", "series.csv") or "--reference" in case.command:
        return ""  # rows, not records; a reference that is taken out
    there = _records(case, result.with_name("damaged.csv"))
    if "records" in case.command:  # of residuals: a row each
        found = len(rows)
    else:
        windows = {tuple(row[c] for c in WINDOW): int(row["records"]) for row in rows}
        found = sum(windows.values())
    missing = there - found - _told(stderr)
    return f"{missing} of {there} records are nowhere" if missing else ""


def _told(stderr: str) -> int:
    """Records that are told as left out, and so stand in no row: copies, and what a recorder's gate did not keep."""
    copies = re.findall(r"([\d,]+) records? that repeats? an earlier one", stderr)
    gates = re.findall(r"kept (\d+) of (\d+) records", stderr)
    return sum(int(n.replace(",", "")) for n in copies) + sum(int(n) - int(kept) for kept, n in gates)


def _records(case: Case, copy: Path) -> int:
    """Records of the damaged file, as they are read."""
    from enginediag_cli.recordings.read import read_all
    from enginediag_cli.recordings.recorder_file import load_recorder

    copy.write_bytes(case.content)
    if "--recorder" not in case.command:
        return len(read_all(copy))
    return len(read_all(copy, **load_recorder(copy.with_name("recorder.yaml")).reading))


def campaign(first: int, cases: int, folder: Path) -> Iterator[Outcome]:
    """The outcomes of the seeds from `first` on."""
    files = prepared(folder / "sound")
    for seed in range(first, first + cases):
        yield run(case_of(seed, files), files)


def told(outcome: Outcome) -> str:
    """A case in words, with what reproduces it."""
    c = outcome.case
    what = f"seed {c.seed}: {c.file} with {c.damage}: {' '.join(c.command)}: {outcome.wrong}"
    return f"{what}\n  {outcome.stderr[-600:].strip()}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first case; the others follow it")
    parser.add_argument("--keep", metavar="FOLDER", help="write the damaged file of --seed here and end")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if asked.keep:
            sound = prepared(Path(name) / "sound")
            case = case_of(asked.seed, sound)
            for file, text in sound.texts.items():
                (Path(asked.keep) / file).write_text(text, encoding="utf-8")
            (Path(asked.keep) / case.file).write_bytes(case.content)
            print(case.damage, json.dumps(case.command))
            sys.exit()
        codes: Counter[int] = Counter()
        bad, slowest = 0, 0.0
        for outcome in campaign(asked.seed, asked.cases, Path(name)):
            codes[outcome.code] += 1
            slowest = max(slowest, outcome.seconds)
            if outcome.wrong:
                bad += 1
                print(told(outcome), flush=True)
    print(f"seeds {asked.seed} to {asked.seed + asked.cases - 1}: exit codes {dict(sorted(codes.items()))}, "
          f"slowest {slowest:.1f} s, {bad} not as they must be")  # fmt: skip
    sys.exit(1 if bad else 0)
