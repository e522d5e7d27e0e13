"""Outputs of every command on small inputs, kept and compared: what a change of the inside must not change.

    python tests/golden/golden.py keep FOLDER       run `commands.sh`, keep all that it writes in FOLDER
    python tests/golden/golden.py compare FOLDER    run it again and say what differs; exit code 1 if data differ

Of each step its standard output (`STEP.out`), messages (`STEP.err`), exit code (`codes.json`) and the files that it
made or changed (`STEP/`) are kept. Standard output, files and exit codes are compared byte by byte, messages only with
`--messages`. Bytes of floating-point numbers belong to one machine and one set of packages, so that both runs are made
on the same.
"""

from __future__ import annotations

import argparse
import difflib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).parent
TOP = HERE.parents[1]
STEP = re.compile(r"([a-z_]+): (.+)")
LINES = 12
"""Of a difference that are shown: enough to see what kind it is."""
STEP_S = 600
"""No step takes a tenth of it on an idle machine."""


def steps() -> Iterator[tuple[str, str]]:
    """Name and shell line of every step of `commands.sh`."""
    for line in (HERE / "commands.sh").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            found = STEP.fullmatch(line)
            if found is None:
                raise SystemExit(f"commands.sh: not a step: {line}")
            yield found[1], found[2]


def run(folder: Path) -> None:
    """Run all steps in a scratch folder and keep what they write in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    codes = {}
    with tempfile.TemporaryDirectory() as name:
        work = Path(name) / "work"
        work.mkdir()
        for shipped in ("configs", "sample_data"):
            shutil.copytree(TOP / shipped, work / shipped)
        seen = contents(work)
        for step, line in steps():
            done = subprocess.run(
                ["bash", "-c", line], cwd=work, env=environment(Path(name)), capture_output=True, timeout=STEP_S
            )
            codes[step] = done.returncode
            (folder / f"{step}.out").write_bytes(done.stdout.replace(bytes(work), b"WORK"))
            (folder / f"{step}.err").write_bytes(done.stderr.replace(bytes(work), b"WORK"))
            now = contents(work)
            for path in sorted(path for path in now if seen.get(path) != now[path]):
                kept = folder / step / path
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_bytes(now[path].replace(bytes(work), b"WORK"))
            seen = now
            print(step, done.returncode, file=sys.stderr, flush=True)
    (folder / "codes.json").write_text(json.dumps(codes, indent=1) + "\n", encoding="utf-8")


def environment(home: Path) -> dict[str, str]:
    """One thread and no settings of whoever runs this; `enginediag` is that of the interpreter."""
    bare = {k: v for k, v in os.environ.items() if not k.startswith("ENGINEDIAG_")}
    path = f"{Path(sys.executable).parent}{os.pathsep}{bare['PATH']}"
    return bare | {"PATH": path, "HOME": str(home), "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100", "NO_COLOR": "1"}


def contents(folder: Path) -> dict[str, bytes]:
    """Bytes of every file under `folder` that a step may have made, by its path in it."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def differences(before: Path, after: Path, messages: bool) -> Iterator[str]:
    """What differs between two kept folders, a text for each file."""
    old, new = contents(before), contents(after)
    for path in sorted({*old, *new}):
        if path.endswith(".err") and "/" not in path and not messages:
            continue
        if path not in old or path not in new:
            yield f"{path}: only {'after' if path in new else 'before'}"
        elif old[path] != new[path]:
            lines = [part[path].decode("utf-8", "replace").splitlines() for part in (old, new)]
            shown = [line[:200] for line in difflib.unified_diff(*lines, "before", "after", lineterm="", n=0)]
            yield "\n".join([f"{path}: differs", *(f"    {line}" for line in shown[2 : LINES + 2])])


def main() -> int:
    """Keep or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=("keep", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--messages", action="store_true", help="compare standard error, too")
    choice = parser.parse_args()
    if choice.work == "keep":
        run(choice.folder)
        return 0
    with tempfile.TemporaryDirectory() as name:
        run(Path(name) / "now")
        found = list(differences(choice.folder, Path(name) / "now", choice.messages))
    print("\n".join(found) if found else "no difference")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
