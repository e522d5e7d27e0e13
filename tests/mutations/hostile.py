"""What a ground station meets: files that are none, names of any bytes, bombs, deep YAML, slow patterns, bad laws.

    python tests/mutations/hostile.py --cases 300 --seed 1

A case is a seed, as in campaign.py. The program runs as a process of its own, with `MEMORY` of address space and
`CPU_S` of processor time. Asked of each: exit code 0, 1, 2 or 3; no traceback, no internal error, no warning of Python;
a word where something is refused; and where a good recording is named beside a bad one, that the good one is judged.
"""

from __future__ import annotations

import argparse
import gzip
import io
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "identification"), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from healthy_files import make  # noqa: E402

MEMORY = 1_200_000_000
"""Bytes of address space, libraries included, which are a third of it."""
CPU_S, WALL_S = 40, 400
"""Seconds of processor time, and of the clock on a busy machine, after which a case counts as hanging."""
Word = str | bytes


@dataclass(frozen=True)
class Hostile:
    """A command (its words) in a folder that was made hostile; judged: the recording that must be judged all the same;
    out: where the result goes."""

    name: str
    words: Sequence[Word]
    judged: str = ""
    out: str = "out.csv"


Maker = Callable[[Path, np.random.Generator], Hostile]
MAKERS: list[Maker] = []


def maker(function: Maker) -> Maker:
    """Register a class of cases."""
    MAKERS.append(function)
    return function


def pick(rng: np.random.Generator, choices: Sequence[object]):  # type: ignore[no-untyped-def]
    return choices[int(rng.integers(len(choices)))]


JUDGING = (("detect",), ("residual",), ("isolate", "--nonlinear", "never"), ("trend",), ("report",), ("check",))


def judging(rng: np.random.Generator, *files: Word, name: str, judged: str = "") -> Hostile:
    """A command that judges files; only the first two promise a row of each file."""
    command = pick(rng, JUDGING)
    words: list[Word] = [*command, "-n", "nominal.yaml", *files]
    out = "" if command[0] == "check" else "out.html" if command[0] == "report" else "out.csv"
    return Hostile(f"{name} ({command[0]})", words, judged if command[0] in ("detect", "residual") else "", out)


@maker
def name_of_any_bytes(folder: Path, rng: np.random.Generator) -> Hostile:
    odd = (b"E\xe9.csv", b"\xff\xfe.csv", b"a\nb.csv", b"\x1b[31mred.csv", b"-n.csv", "=1+1 \u202e.csv".encode())
    name = b"./" + pick(rng, odd)
    shutil.copyfile(folder / "flight.csv", os.path.join(os.fsencode(folder), name))
    return judging(rng, name, "faulty.csv", name="name of any bytes", judged="faulty.csv")


@maker
def no_recording(folder: Path, rng: np.random.Generator) -> Hostile:
    kinds = {
        "empty": b"",
        "newlines": b"\n" * 5000,
        "garbage": rng.integers(256, size=4000, dtype=np.uint8).tobytes(),
        "zeros": bytes(100_000),
        "header": (folder / "flight.csv").read_bytes().splitlines()[-1][:0] + b"time_s,N1_rpm\n",
        "parquet by name": b"PAR1" + bytes(400) + b"PAR1",
        "workbook by name": b"PK\x03\x04" + bytes(400),
        "hdf": b"\x89HDF\r\n\x1a\n" + bytes(400),
        "picture": b"\x89PNG\r\n\x1a\n" + bytes(400),
        "utf-16": (folder / "flight.csv").read_text().encode("utf-16")[:-7],
        "bracket": b"{" * 50_000,
    }
    kind = pick(rng, sorted(kinds))
    name = f"bad{pick(rng, ('.csv', '.csv.gz', '.parquet', '.xlsx', '', '.txt'))}"
    (folder / name).write_bytes(kinds[kind])
    return judging(rng, name, "flight.csv", name=f"{kind} as {name}", judged="flight.csv")


@maker
def no_file(folder: Path, rng: np.random.Generator) -> Hostile:
    kind, bad = pick(rng, ("dangling", "loop", "pipe", "folder", "null", "missing")), folder / "bad.csv"
    if kind == "dangling":
        bad.symlink_to("nowhere.csv")
    elif kind == "loop":
        bad.symlink_to("bad.csv")
    elif kind == "pipe":
        os.mkfifo(bad)
    elif kind == "folder":
        bad.mkdir()
    files = ("/dev/null" if kind == "null" else "bad.csv", "flight.csv")
    return judging(rng, *files, name=f"{kind} for a file", judged="flight.csv")


@maker
def fleet_of_bad_items(folder: Path, rng: np.random.Generator) -> Hostile:
    recordings = folder / "fl"
    recordings.mkdir()
    for k in range(3):
        shutil.copyfile(folder / "flights.csv", recordings / f"e_{k}.csv")
    (recordings / "e_3.csv").symlink_to("gone.csv")
    (recordings / "e_4.csv").mkdir()
    os.mkfifo(recordings / "e_5.csv")
    (recordings / "e_6.csv").write_bytes(pick(rng, (b"", b"\0" * 999, b"a,b\n1,2\n", b"\xff\xfe")))
    os.close(os.open(os.path.join(os.fsencode(recordings), b"e_7\xe9.csv"), os.O_CREAT))
    where = pick(rng, ("fl/*.csv", "../**/*", "/**/*", "fl/**/**/**/**/*", "[", "fl/e_[!0-2]*", "../secret*", "\\"))
    pattern = pick(rng, (r"e_(\d+)", r"(e+)+$", r"((a|a)+)+!", "(", r"e_(\d+)|", r"(.*)*(.*)*x"))
    (folder / ("e" * 40 + "!.csv")).touch()
    text = "kind: fleet\nengine: engine.yaml\nnominal: nominal.yaml\nbaseline: {flights: 2}\n"
    text += f"recordings: ['{where}']\n"
    (folder / "fleet.yaml").write_text(f"{text}engines: {{serial_from: file, pattern: '{pattern}'}}\n")
    return Hostile(f"fleet of {where} by {pattern}", ("fleet", "fleet.yaml"), out="out.json")


@maker
def bomb(folder: Path, rng: np.random.Generator) -> Hostile:
    block = {"zeros": bytes(1 << 20), "line": b"a" * (1 << 20), "commas": b"," * (1 << 20), "blank": b"\n" * (1 << 20)}
    block |= {"quote": b'"' + b"b" * (1 << 20), "comments": b"#\n" * (1 << 19), "cells": b"1," * (1 << 19)}
    kind = pick(rng, sorted(block))
    with gzip.open(folder / "bomb.csv.gz", "wb", compresslevel=1) as out:
        if rng.random() < 0.5:
            out.write((folder / "flight.csv").read_bytes())
        for _ in range(300):
            out.write(block[kind])
    return judging(rng, "bomb.csv.gz", "flight.csv", name=f"bomb of {kind}", judged="flight.csv")


@maker
def workbook_bomb(folder: Path, rng: np.random.Generator) -> Hostile:
    with zipfile.ZipFile(folder / "bomb.xlsx", "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("[Content_Types].xml", "<Types/>")
        out.writestr("xl/workbook.xml", "<workbook><sheets><sheet name='a' sheetId='1'/></sheets></workbook>")
        with out.open("xl/worksheets/sheet1.xml", "w") as sheet:
            for _ in range(300):
                sheet.write(b"<row><c><v>1</v></c></row>" * 40_000)
    return judging(rng, "bomb.xlsx", "flight.csv", name="workbook bomb", judged="flight.csv")


@maker
def wide_table(folder: Path, rng: np.random.Generator) -> Hostile:
    n = int(rng.integers(2_000, 100_000))
    head, cells = ",".join(f"c{k}" for k in range(n)), ",".join("1" for _ in range(n))
    (folder / "wide.csv").write_text(f"{head}\n" + f"{cells}\n" * 3)
    if rng.random() < 0.5:
        return Hostile("wide table", ("recorder", "wide.csv"), out="out.yaml")
    return judging(rng, "wide.csv", "flight.csv", name="wide table", judged="flight.csv")


@maker
def many_flights(folder: Path, rng: np.random.Generator) -> Hostile:
    lines = [x.split(",") for x in (folder / "flights.csv").read_text().splitlines() if not x.startswith("#")]
    place, column = lines[0].index("flight"), pick(rng, ("flight", "engine"))
    rows = [row[:place] + row[place + 1 :] for row in lines[1:]]
    head = ",".join([str(column), *lines[0][:place], *lines[0][place + 1 :]])
    text = "\n".join(f"L{k},{','.join(rows[k % len(rows)])}" for k in range(100))
    (folder / "many.csv").write_text(f"{head}\n{text}\n")
    return judging(rng, "many.csv", name=f"100 of column {column}")


def yaml_bomb(rng: np.random.Generator) -> tuple[str, str]:
    """Name and text."""
    n = int(rng.integers(1_000, 200_000))
    laughs = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    laughs += "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
    kinds = {
        "brackets": "kind: engine\nx: " + "[" * n,
        "braces": "kind: engine\nx: " + "{a: " * n,
        "indents": "".join(" " * min(k, 900) + f"k{k}:\n" for k in range(min(n, 3_000))),
        "dashes": "x:\n" + "- " * n + "1\n",
        "laughs": "kind: engine\n" + laughs,
        "cycle": "kind: engine\nx: &x [*x]\n",
        "keys": "kind: engine\n" + "".join(f"k{k}: 1\n" for k in range(10 * n)),
        "one long word": "kind: engine\nx: " + "a" * 100 * n,
        "tag": "kind: engine\nx: !!python/object/apply:os.system [ls]\n",
        "documents": "kind: engine\n---\n" * min(n, 5_000),
        "merge": "kind: engine\nx: &x {<<: *x}\n",
        "digits": "kind: engine\nx: " + "9" * min(n, 20_000) + "\n",
        "sexagesimal": "kind: engine\nx: " + "1:" * min(n, 20_000) + "1\n",
    }
    kind = pick(rng, sorted(kinds))
    return kind, kinds[kind]


@maker
def hostile_yaml(folder: Path, rng: np.random.Generator) -> Hostile:
    kind, text = yaml_bomb(rng)
    (folder / "bomb.yaml").write_text(text)
    if rng.random() < 0.5:  # at the end of a sound file
        (folder / "bomb.yaml").write_text((folder / "engine.yaml").read_text() + text.replace("kind: engine\n", ""))
    words = pick(
        rng,
        (
            ("check", "bomb.yaml"),
            ("detect", "-n", "bomb.yaml", "flight.csv"),
            ("detect", "-n", "nominal.yaml", "--recorder", "bomb.yaml", "foreign.csv"),
            ("detect", "-n", "nominal.yaml", "--config", "bomb.yaml", "flight.csv"),
            ("simulate", "bomb.yaml", "--records", "3"),
            ("simulate", "engine.yaml", "--fault", "bomb.yaml", "--records", "3"),
            ("simulate", "engine.yaml", "--flight", "bomb.yaml", "--records", "3"),
            ("fleet", "bomb.yaml"),
            ("study", "bomb.yaml"),
            ("identify", "bomb.yaml", "flights.csv"),
        ),
    )
    out = "" if words[0] == "check" else "out.yaml" if words[0] == "identify" else "out.csv"
    return Hostile(f"YAML of {kind}", words, out=out)


VARIABLES = ("altitude_m", "mach", "Wf_kg_s", "N1_rpm", "a", "0", "1", "1e308", "-1", "0.5", "burner_temperature", "x")
FUNCTIONS = ("sqrt", "log", "exp", "tanh", "sin", "abs", "max", "lagged", "backlash", "limited", "eval", "gamma")


def formula(rng: np.random.Generator, depth: int) -> str:
    """A formula, hardly ever one that makes sense."""
    if depth == 0 or rng.random() < 0.2:
        return str(pick(rng, VARIABLES))
    x, y = formula(rng, depth - 1), formula(rng, depth - 1)
    forms = (f"({x} + {y})", f"({x} - {x})", f"({x}) / ({y})", f"({x}) ** ({y})", f"-({x})", f"({x}) * ({y})")
    return str(
        pick(rng, (*forms, f"{pick(rng, FUNCTIONS)}({x})", f"{pick(rng, FUNCTIONS)}({x}, {y})", f"1 / ({x} - {x})"))
    )


@maker
def bad_law(folder: Path, rng: np.random.Generator) -> Hostile:
    special = (
        "1 / (mach - mach)",
        "a * " + "(" * 4_000 + "mach" + ")" * 4_000,
        "a ** " * 50 + "2",
        "10 ** 10 ** 10 ** 10",
        "9" * 5_000 + " * a",
        "+".join(["mach"] * 3_000),
        "a * (-mach) ** 0.5",
        "a * log(mach - 2)",
        "a * mach / 0",
        "a * 1e308 * 1e308",
        "__import__('os').system('true')",
        "a if mach else 0",
        "a[0]",
        "lambda: a",
    )
    text = pick(rng, special) if rng.random() < 0.3 else formula(rng, int(rng.integers(1, 6)))
    quoted = text.replace("'", "''")
    where = pick(rng, ("compressor.efficiency", "turbine.flow_capacity", "sensor.T3.bias", "nowhere", "P3_Pa"))
    law = (
        f"\nphysics:\n  - law: made_up\n    at: {where}\n    expression: '{quoted}'\n"
        "    coefficients:\n      a: {value: 0.01, absent: 0, prior_sigma: 0.02, description: size}\n"
        "    statement: A law that nobody needs.\n"
    )
    (folder / "law.yaml").write_text((folder / "engine.yaml").read_text() + law)
    words = pick(rng, (("check", "law.yaml"), ("simulate", "law.yaml", "--records", "3")))
    return Hostile(f"law {text[:60]} at {where}", words, out="" if words[0] == "check" else "out.csv")


@maker
def nowhere_to_write(folder: Path, rng: np.random.Generator) -> Hostile:
    (folder / "there").mkdir()
    out = pick(rng, ("/dev/full", "there", "nowhere/out.csv", "there/out.csv/x", "", "a" * 300 + ".csv", "/proc/x.csv"))
    command = pick(rng, (("detect",), ("residual",), ("trend",), ("isolate", "--nonlinear", "never")))
    return Hostile(f"output {out[:20]!r}", (*command, "-n", "nominal.yaml", "flights.csv", "-o", out), out="")


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `wrong`: what should not have happened, '' when all is as it must be."""

    seed: int
    case: Hostile
    code: int
    stderr: str
    wrong: str
    used: Counter[str] = field(default_factory=Counter)


def _limits() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 5))
    os.setsid()


def run(seed: int, sound: Path) -> Outcome:
    """Make the case of a seed in a folder of its own, and run it."""
    rng = np.random.default_rng([41, seed])
    with tempfile.TemporaryDirectory(dir=sound.parent) as name:
        folder = Path(name) / "station"
        shutil.copytree(sound, folder)
        case: Hostile = MAKERS[seed % len(MAKERS)](folder, rng)
        words = [sys.executable, "-W", "always", "-m", "enginediag_cli", *case.words]
        words += ["-o", case.out] if case.out else []
        environment = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
        child = subprocess.Popen(
            words,
            cwd=folder,
            env=environment,
            preexec_fn=_limits,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        try:
            text = child.communicate(timeout=WALL_S)[1]
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            text = child.communicate()[1]
        stderr = text.decode("utf-8", "replace")
        return Outcome(seed, case, child.returncode, stderr, _wrong(case, child.returncode, stderr, folder))


def _wrong(case: Hostile, code: int, stderr: str, folder: Path) -> str:
    if code == -signal.SIGXCPU:
        return f"more than {CPU_S} s of CPU"
    if code not in (0, 1, 2, 3):
        return f"exit code {code}"
    for trace in ("Traceback (most recent", "internal error", "Warning:", "MemoryError", "Cannot allocate"):
        if trace in stderr:
            return f"{trace} on stderr"
    if code == 2 and not stderr.strip():
        return "exit code 2 without a word"
    if re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202a-\u202e]", stderr):
        return "control characters on stderr"
    if case.judged and case.out:
        result = folder / case.out
        if not result.exists() or case.judged not in result.read_text("utf-8", "replace"):
            return f"{case.judged} was not judged"
    return ""


def prepared(folder: Path) -> Path:
    """The sound files."""
    folder.mkdir()
    make(folder)
    return folder


def campaign(first: int, cases: int, folder: Path) -> Iterator[Outcome]:
    """The outcomes of the seeds from `first` on."""
    sound = prepared(folder / "sound")
    for seed in range(first, first + cases):
        yield run(seed, sound)


def told(outcome: Outcome) -> str:
    """A case in words, with what reproduces it."""
    words = " ".join(os.fsdecode(w) for w in outcome.case.words).encode("utf-8", "backslashreplace").decode()
    return f"seed {outcome.seed}: {outcome.case.name}: {words}: {outcome.wrong}\n  {outcome.stderr[-500:].strip()}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first case; the others follow it")
    asked = parser.parse_args()
    codes: Counter[int] = Counter()
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        for outcome in campaign(asked.seed, asked.cases, Path(name)):
            codes[outcome.code] += 1
            if outcome.wrong:
                bad += 1
                print(told(outcome), flush=True)
    print(f"{asked.cases} cases: exit codes {dict(sorted(codes.items()))}, {bad} not as they must be")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    io.TextIOWrapper.reconfigure(sys.stdout, errors="backslashreplace")  # type: ignore[arg-type]
    main()
