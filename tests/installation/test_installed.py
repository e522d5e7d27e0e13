"""The installed program, with nothing of the checkout on its path: what is shipped is there and is found, and the
command lines of the documents run at small size."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from blocks import steps
from wheel import ROOT, NotInstallableError, build_wheel, environment_beside

CONFIGS = ROOT / "configs"
SHARED = Path(os.environ.get("ENGINEDIAG_SHARED") or ROOT.parent / "shared")

LOAD = """
import sys
from enginediag_cli.config.validate import check_file
from enginediag_cli.cli.options import ConfigFile
for name in sys.argv[1:]:
    print(check_file(ConfigFile().convert(name, None, None)).name)
"""
"""Loads files as a command does that is given their names, with all that they name."""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory) -> Path:
    try:
        return build_wheel(tmp_path_factory.mktemp("wheel"))
    except NotInstallableError as error:
        pytest.skip(f"the wheel cannot be built here: {error}")


@pytest.fixture(scope="session")
def programs(wheel, tmp_path_factory) -> Path:
    """The folder of the installed programs."""
    return environment_beside(wheel, tmp_path_factory.mktemp("installed") / "environment")


@pytest.fixture
def checkout(tmp_path) -> Path:
    """What a checkout holds for a program that is installed elsewhere: its configs, as another commit may have them."""
    shutil.copytree(CONFIGS, tmp_path / "checkout" / "configs")
    return tmp_path / "checkout"


def run(programs: Path, script: str, folder: Path, timeout_s: float = 100.0) -> subprocess.CompletedProcess[str]:
    """Run lines of a shell; the first that fails ends them."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "ENGINEDIAG"))}
    environment |= {"PATH": f"{programs}{os.pathsep}{environment['PATH']}", "OPENBLAS_NUM_THREADS": "1"}
    words = ["bash", "-e", "-o", "pipefail", "-c", script]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=timeout_s)


def test_the_wheel_holds_the_package_its_marker_of_types_and_all_that_is_shipped(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    package = {p.relative_to(ROOT).as_posix() for p in (ROOT / "enginediag_cli").rglob("*.py")}
    assert package | {"enginediag_cli/py.typed"} <= names
    shipped = {p.relative_to(ROOT).as_posix() for p in CONFIGS.rglob("*") if p.is_file()}
    placed = {name.partition("/data/share/enginediag/")[2] for name in names}
    assert shipped == placed - {""}
    others = {name.partition("/")[0] for name in names}
    assert all(name == "enginediag_cli" or name.startswith("enginediag-") for name in others), others


@pytest.mark.parametrize("place", ["in a checkout", "in an empty folder", "by a path from elsewhere"])
def test_shipped_files_load_wherever_the_installed_program_runs(programs, checkout, tmp_path, place):
    kept = [p for p in sorted(CONFIGS.rglob("*.yaml")) if "laws" not in p.parts]  # laws are parts of engine files
    names = [p.relative_to(ROOT).as_posix() for p in kept]
    folder = tmp_path / "empty"
    folder.mkdir()
    if place == "in a checkout":
        folder = checkout
    elif place == "by a path from elsewhere":
        names = [str(checkout / name) for name in names]
    done = run(programs, f"python -c '{LOAD}' {' '.join(names)}", folder)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == len(names)
    assert {"engine", "fleet", "recorder", "study"} <= set(done.stdout.split())


SMALLER = (
    # how the documents say it, and how it is said here
    (r"--flights (?:5|6|10)\b", "--flights 4"),
    (r"--flights 40\b", "--flights 22"),
    (r"interval_s: (?:60|120)/' configs", "interval_s: 300/' configs"),
    (r"onset: 21", "onset: 17"),
    (r" -o vanes", " --term guide_vanes@compressor -o vanes"),
)
NOT_RUN = re.compile("pip install|many/|--folder many")
"""Setting up, which the fixture does, and a thousand engines."""

DATA = {
    "D": "cmapss",
    "train_FD001.csv.gz": "cmapss/train_FD001.csv.gz",
    "train_FD002.csv.gz": "cmapss/train_FD002.csv.gz",
    "gt_2011.csv": "uci_gas_turbine/gt_2011.csv",
    "gt_2012.csv": "uci_gas_turbine/gt_2012.csv",
    **{f"ex_{k}.csv": f"micro_gas_turbine/ex_{k}.csv" for k in (1, 9, 20)},
}
"""Public recordings as the documents call them, and where they lie in ../shared/data."""

SIMULATED = CONFIGS / "fleets" / "turbofans.yaml"
"""Its head makes the recordings of the fleet of guide/fleet.md, too."""

GUIDE = ROOT / "enginediag_cli" / "guide"
CONFIG_FILES = sorted(CONFIGS.rglob("*.yaml"))


def scripts(document: Path) -> list[str]:
    """The command lines of a document, block by block: indented, or after `$`; a YAML file has them in its head."""
    text = document.read_text(encoding="utf-8")
    if document.suffix == ".yaml":
        head = text.partition("\nkind:")[0]
        text = "\n".join(line.removeprefix("#").removeprefix(" ") for line in head.splitlines())
    found = [re.sub(r"^ {4}", "", block, flags=re.M) for block in re.findall(r"(?:^ {4}\S.*\n?)+", text, flags=re.M)]
    for console in re.findall(r"^```console\n(.*?)^```", text, flags=re.M | re.S):
        found.append("\n".join(command for command, _ in steps(console.splitlines())))
    kept = ("\n".join(line for line in block.splitlines() if not NOT_RUN.search(line)) for block in found)
    return [block for block in kept if "enginediag " in block]


def small(script: str) -> str:
    for said, here in SMALLER:
        script = re.sub(said, here, script)
    return script


def cases() -> Iterator[Any]:
    for document in [ROOT / "README.md", GUIDE / "missing_physics.md", GUIDE / "fleet.md", *CONFIG_FILES]:
        for number, script in enumerate(scripts(document), start=1):
            if document.name == "fleet.md" and "configs/fleets" not in script:
                continue  # needs files that the guide shows; tests/test_documents.py runs these
            simulated = small(script)
            if document.name == "fleet.md" and " engine_*.csv" in script:
                simulated = small("\n".join([*scripts(SIMULATED)[0].splitlines()[:-1], script]))
            needs = [name for name in DATA if re.search(rf"(?<![\w/]){re.escape(name)}\b", simulated)]
            marks = [pytest.mark.shared_data] if needs or "ex_*" in simulated else []
            yield pytest.param(simulated, id=f"{document.relative_to(ROOT)} {number}", marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize("script", list(cases()))
def test_the_command_lines_of_the_documents_run_as_installed(programs, checkout, script):
    for name, there in DATA.items():
        if (SHARED / "data" / there).exists():
            (checkout / name).symlink_to((SHARED / "data" / there).resolve())
        elif name in script:
            pytest.skip("public data not found beside the checkout; put it in ../shared or set ENGINEDIAG_SHARED")
    done = run(programs, script, checkout, 1800.0)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "internal error" not in done.stderr and "Warning" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("study", sorted((CONFIGS / "studies").glob("*.yaml")), ids=lambda p: p.stem)
def test_a_shipped_study_runs_as_installed(programs, checkout, study):
    name = study.relative_to(ROOT).as_posix()
    for folder in (checkout, checkout.parent):  # a checkout's own, and the shipped one
        done = run(programs, f"enginediag study {name} --repetitions 1 --processes 2 -o /dev/null", folder, 1800.0)
        assert done.returncode == 0, done.stderr
