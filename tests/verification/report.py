"""Prints how the engine model agrees with answers that nobody here computed: python tests/verification/report.py"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import jt9d_npss
import numpy as np
import pycycle_hbtf
import shared_data


def table(title: str, deviations: dict[str, np.ndarray]) -> None:
    solved = int(np.isfinite(deviations["T3_K"]).sum())
    print(f"\n{title}: {solved} of {len(deviations['T3_K'])} points solved; |calculated/published − 1| in %")
    print(f"{'column':>10} {'median':>8} {'largest':>8}")
    for column, d in deviations.items():
        if not np.all(d == 0.0):
            print(f"{column:>10} {np.nanmedian(d):8.3f} {np.nanmax(d):8.3f}")


def main() -> int:
    missing = [f for f in ("jt9d", "pycycle_hbtf") if not shared_data.available(f)]
    for folder in missing:
        print(shared_data.reason(folder), file=sys.stderr)
    with tempfile.TemporaryDirectory() as scratch:
        if "jt9d" not in missing:
            for setting in ("Wf_kg_s", "N1_rpm"):
                table(
                    f"JT9D against NPSS 2.4, {setting} given",
                    jt9d_npss.compare(shared_data.DATA / "jt9d", Path(scratch), setting),
                )
        if "pycycle_hbtf" not in missing:
            table(
                "high-bypass turbofan against pyCycle 4.4, N1_rpm given",
                pycycle_hbtf.compare(shared_data.DATA / "pycycle_hbtf", Path(scratch)),
            )
    return 2 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
