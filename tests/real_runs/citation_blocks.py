"""How the Citation's cross-validated error depends on where the blocks fall: python tests/real_runs/citation_blocks.py

The whole reference flight, both engines, eleven lengths of the blocks that are left out in turn. Markdown table of the
smallest and the largest RMS. About two minutes of one core.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from citation_mismatch import ENGINE, N2_POINT_RPM, RECORDER, REF, SIDES
from ground_recordings import enginediag, public_data

from enginediag_cli.identification.nominal_file import read_nominal

LENGTHS = (15, 18, 20, 25, 30, 35, 40, 45, 50, 55, 60)
KEY = "cross_validation_block:"


def errors(folder: Path, flight: Path, side: str, length: int) -> tuple[float, float, float]:
    """RMS of N2 in points, ITT in K, fuel flow in per cent, each record predicted from the blocks without it."""
    text = ENGINE.read_text(encoding="utf-8")
    given = [line for line in text.splitlines() if line.lstrip().startswith(KEY)]
    changed = (
        text.replace(given[0], given[0].partition(KEY)[0] + f"{KEY} {length}")
        if given
        else text.replace("\nidentification:\n", f"\nidentification:\n  {KEY} {length}\n")
    )
    assert f"{KEY} {length}" in changed
    engine, nominal = folder / "engine.yaml", folder / "nominal.yaml"
    engine.write_text(changed, encoding="utf-8")
    enginediag("identify", engine, flight, "--recorder", RECORDER, "--engine-instance", side, "-o", nominal)
    rms = {q.sensor: q.rms for q in read_nominal(nominal).cross_validated if q.regime == "all"}
    return rms["N2_rpm"] / N2_POINT_RPM, rms["ITT_K"], rms["Wf_kg_s"]


def main() -> None:
    flight = public_data("c550_jt15d") / REF
    print("| engine | N2, points | ITT, K | fuel flow, % |\n|---|---|---|---|")
    for side in SIDES:
        with tempfile.TemporaryDirectory() as folder:
            found = [errors(Path(folder), flight, side, length) for length in LENGTHS]
        cells = [f"{min(c):.2g} to {max(c):.2g}" for c in zip(*found, strict=True)]
        print(f"| {side}, blocks of {LENGTHS[0]} to {LENGTHS[-1]} records | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
