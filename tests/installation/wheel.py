"""The wheel of this checkout, and environments in which nothing but it is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILT_FROM = ("enginediag_cli", "configs", "pyproject.toml", "README.md", "LICENSE")
PACKAGES = ("numpy", "scipy", "click", "yaml", "rich")


class NotInstallableError(RuntimeError):
    """An environment that could not be made, with what pip said last."""


def build_wheel(folder: Path) -> Path:
    """Build the wheel from a copy, so that the checkout holds nothing that it did not hold before."""
    copy = folder / "checkout"
    copy.mkdir(parents=True)
    for name in BUILT_FROM:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, copy / name)
    before = set(os.listdir(copy))
    # pip brings the build's own packages from an index where they are not installed
    apart = [] if find_spec("hatchling") is None else ["--no-build-isolation"]
    pip(Path(sys.executable), "wheel", "-q", "--no-deps", *apart, "-w", str(folder), str(copy))
    assert set(os.listdir(copy)) == before, "the build left something in the checkout"
    (wheel,) = folder.glob("enginediag-*.whl")
    return wheel


def pip(python: Path, *arguments: str) -> None:
    """Run pip of an environment. Raises NotInstallableError."""
    done = subprocess.run(
        [str(python), "-m", "pip", "--disable-pip-version-check", *arguments], capture_output=True, text=True
    )
    if done.returncode:
        raise NotInstallableError("\n".join(done.stderr.splitlines()[-5:]))


def environment_beside(wheel: Path, folder: Path) -> Path:
    """An environment of this interpreter with the wheel, and all packages but enginediag that this one has: its folder
    of programs."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    python = folder / "bin" / "python"
    pip(Path(sys.executable), "--python", str(python), "install", "-q", "--no-deps", "--no-index", str(wheel))
    specs = [find_spec(name) for name in PACKAGES]
    paths = dict.fromkeys(str(Path(spec.origin).parents[1]) for spec in specs if spec is not None and spec.origin)
    (site,) = (folder / "lib").glob("python*/site-packages")
    # lines of a .pth file are searched after the environment itself, and .pth files there (an editable install) are not
    (site / "packages.pth").write_text("\n".join(paths) + "\n", encoding="utf-8")
    return folder / "bin"
