"""Every version of Python that the package declares, each with the lowest and the newest versions of its packages.

    python tests/installation/versions.py [--python 3.10 --python 3.13] [--own] [--keep FOLDER]

Makes the environments that it can, installs the wheel of this checkout, runs a chain of all commands in an empty folder
and a part of the test-suite, and prints a line for each. An interpreter that this machine lacks (python3.X on the path,
or of pyenv), or whose packages cannot be fetched, is skipped with a message; with --own there is only the interpreter
that runs this, and nothing is skipped. Ends with 1 when something failed.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from wheel import ROOT, NotInstallableError, build_wheel, pip

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
FIRST_WHEELS: Mapping[str, Mapping[str, str]] = {
    "3.12": {"numpy": "1.26.0", "scipy": "1.11.2", "pyyaml": "6.0.1"},
    "3.13": {"numpy": "2.1.0", "scipy": "1.14.1", "pyyaml": "6.0.2"},
}
"""The first releases that were built for an interpreter, where those are later than what the package declares."""

TESTED = ("tests/config", "tests/physics", "tests/recordings", "tests/cli/test_general.py", "tests/test_units.py")
"""Tests of the part that versions change most: YAML, numbers, tables, terms and the command line."""

LIMIT_S = 600.0
"""For a command, or the tests: many times what they take."""

COMMANDS = """\
enginediag --version
enginediag simulate turbojet.yaml --flight flights/sweep.yaml --flights 2 --seed 1 -o healthy.csv
enginediag identify turbojet.yaml healthy.csv --no-cross-validation -o nominal.yaml
enginediag check nominal.yaml study.yaml fleet.yaml
enginediag check -n nominal.yaml healthy.csv
enginediag simulate turbojet.yaml --flight flights/sweep.yaml --flights 3 --seed 2 -o series.csv
enginediag detect -n nominal.yaml series.csv --picture detect.svg -o detect.json
enginediag detect -n nominal.yaml --follow --idle 0 series.csv -o followed.csv
enginediag isolate -n nominal.yaml series.csv -o isolate.json
enginediag residual -n nominal.yaml series.csv -o statistics.csv
enginediag trend statistics.csv -n nominal.yaml -o trend.json
enginediag trend -n nominal.yaml series.csv --what margin --limit T5_K 1200
enginediag locate turbojet.yaml healthy.csv -o located.json
enginediag explain turbojet.yaml healthy.csv -o explained.json
enginediag refine turbojet.yaml healthy.csv --holdout-last 1 --term customer_bleed@compressor -o refined.yaml
enginediag study study.yaml --processes 1
enginediag prove turbojet.yaml --trials 1 --kind null --truth same_model --no-sizes --jobs 1 --format json
enginediag fleet fleet.yaml --jobs 2 -o fleet.json
enginediag report detect.json isolate.json trend.json fleet.json -o report.html --static
enginediag recorder series.csv
enginediag schema engine
enginediag physics
enginediag components
enginediag man detect
"""

FILES = {
    "study.yaml": """\
kind: study
engine: turbojet.yaml
records: 60
mission: {type: sweep, altitude_m: [1500, 9000], mach: [0.3, 0.8], power: [0.6, 1.0]}
noise: {type: uniform, range_fraction: 0.01}
cases: [{name: healthy, repetitions: 2}, {name: worn, repetitions: 2, changes: {compressor.efficiency: -0.01}}]
methods: [{name: posterior, type: posterior}]
seed: 1
""",
    "fleet.yaml": """\
kind: fleet
nominal: nominal.yaml
recordings: [series.csv]
engines: {serial_from: file, pattern: '(series)'}
baseline: {flights: 2}
""",
}


def lowest(version: str) -> list[str]:
    """The lowest release of each package that the package declares and that exists for this version of Python."""
    declared = re.search(r"^dependencies = \[(.*)\]$", (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)
    assert declared is not None
    found = []
    for name, least in re.findall(r'"(\w+)>=([\d.]+)"', declared[1]):
        found.append(f"{name}=={FIRST_WHEELS.get(version, {}).get(name, least)}")
    return found


def interpreter(version: str) -> Path | None:
    """python3.X of the path, or of pyenv; this one for its own version."""
    if version == "{}.{}".format(*sys.version_info):
        return Path(sys.executable)
    there = shutil.which(f"python{version}")
    if there is not None and subprocess.run([there, "-c", ""], capture_output=True).returncode == 0:
        return Path(there)
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    return next(iter(sorted(root.glob(f"{version}.*/bin/python"))), None)


def environments(versions: list[str]) -> Iterator[tuple[str, Path | None, list[str]]]:
    """Name, interpreter and packages of each."""
    for version in versions:
        python = interpreter(version)
        yield f"Python {version}, lowest", python, lowest(version)
        yield f"Python {version}, newest", python, []


def made(python: Path, folder: Path, wheel: Path, packages: list[str]) -> Path:
    """The programs of a new environment with the wheel and pytest. Raises NotInstallableError."""
    subprocess.run([str(python), "-m", "venv", str(folder)], check=True)
    tests = ["pytest>=7.4", "pytest-xdist>=3.3"]
    pip(folder / "bin" / "python", "install", "-q", "--prefer-binary", str(wheel), *packages, *tests)
    return folder / "bin"


def failures(programs: Path, folder: Path) -> Iterator[str]:
    """What fails in an environment: commands in an empty folder, then tests from a copy without the package."""
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    environment = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    for line in COMMANDS.splitlines():
        yield from failure(shlex.split(line), folder, environment)
    copy = folder / "copy"
    copy.mkdir()
    for name in ("tests", "configs", "sample_data"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "CHANGELOG.md"):
        shutil.copy(ROOT / name, copy)
    yield from failure(["python", "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", *TESTED], copy, environment)


def failure(words: list[str], folder: Path, environment: Mapping[str, str]) -> Iterator[str]:
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        yield f"{shlex.join(words)}: did not end within {LIMIT_S:g} s"
        return
    # 3 is no verdict: two flights hold too little for some questions
    if done.returncode not in (0, 3):
        said = (done.stdout + done.stderr if words[0] == "python" else done.stderr).splitlines()[-12:]
        yield "\n    ".join([f"{shlex.join(words)}: ended with {done.returncode}", *said])
    elif "Warning:" in done.stderr:
        yield f"{shlex.join(words)}: {done.stderr.strip()}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", choices=PYTHONS, help="only this version; may be repeated")
    parser.add_argument("--own", action="store_true", help="only the interpreter that runs this")
    parser.add_argument("--keep", type=Path, help="folder of the environments, which is not removed")
    options = parser.parse_args()
    versions = ["{}.{}".format(*sys.version_info)] if options.own else options.python or list(PYTHONS)
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        wheel = build_wheel(folder / "wheel")
        for name, python, packages in environments(versions):
            if python is None:
                print(f"{name}: skipped, this machine has no such interpreter")
                continue
            begun, place = time.monotonic(), folder / re.sub(r"\W+", "_", name)
            try:
                programs = made(python, place, wheel, packages)
            except NotInstallableError as error:
                failed += options.own
                print(f"{name}: {'failed' if options.own else 'skipped'}, cannot be installed: {error}")
                continue
            found = list(failures(programs, place / "work"))
            failed += len(found)
            print(f"{name}: {len(found)} failed in {time.monotonic() - begun:.0f} s", *found, sep="\n  ", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
