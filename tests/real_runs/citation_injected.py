"""A customer bleed that switches, put into the Citation's flight_ref at several sizes, and what the search finds.

    python tests/real_runs/citation_injected.py [--sizes 0,0.125,0.25,0.5,1] [--sides left,right]

prints a row for each engine and size. Size 1 takes 3.7 % of the core flow in two intervals, 28 K of ITT and 4.3 % of
fuel flow; size 0 is the untouched recording, the null. The last row of an engine is flight_b22 as it was recorded, in
which a bleed switches by itself. Each engine is identified on the untouched flight_ref first.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from citation_mismatch import BLEED, ENGINE, RECORDER, SIDES, nominal
from ground_recordings import public_data

from enginediag_cli.validation.injected import (
    HEADER,
    InjectedEffect,
    RealCase,
    injected_file,
    search_case,
    switched,
    table_row,
)

FULL_FRACTION = 0.037
INTERVALS_S = ((600.0, 1300.0), (3565.0, 4215.0))
BLEED_TERM = ("customer_bleed", BLEED[1])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", default="0,0.125,0.25,0.5,1")
    parser.add_argument("--sides", default=",".join(SIDES))
    asked = parser.parse_args()
    flights = public_data("c550_jt15d")
    print(HEADER, flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for side in asked.sides.split(","):
            known = nominal(folder, flights, side)
            case = RealCase(str(ENGINE), (str(flights / "flight_ref.csv"),), str(RECORDER), side, str(known))
            for size in map(float, asked.sizes.split(",")):
                effect = InjectedEffect(switched(size * FULL_FRACTION, INTERVALS_S), *BLEED_TERM)
                put_in = injected_file(case, [effect], folder) if size else case
                truth = f"customer bleed {size * FULL_FRACTION:.4f}" if size else "nothing"
                print(table_row(f"{side}, flight_ref, {truth}", search_case(put_in)), flush=True)
            other = RealCase(str(ENGINE), (str(flights / "flight_b22.csv"),), str(RECORDER), side, str(known))
            print(table_row(f"{side}, flight_b22", search_case(other)), flush=True)


if __name__ == "__main__":
    main()
