"""What the floor for map errors costs: python tests/validation/floor_costs.py [--all]

The size from which an effect is visible (λ = 25) in flights of the default engine, without and with the floor; median
over sets of flights, drawn as in the blind trials of seed 41. Markdown table of some places, or of all.
"""

from __future__ import annotations

import sys
from pathlib import Path

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.score_sheet import detectable_sizes

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
SEED = 41
TOLD = (
    "reynolds_efficiency@hpc",
    "reynolds_turbine_efficiency@hpt",
    "power_offtake@hp",
    "customer_bleed@hpc",
    "turbine_tip_clearance@hpt",
    "guide_vanes@hpc",
    "nozzle_thermal_growth@core_nozzle",
    "humidity@ambient",
)


def size(value: float | None, unit: str) -> str:
    return "never within its bounds" if value is None else f"{value:.3g} {unit if unit != '1' else ''}".strip()


def main() -> None:
    sizes = detectable_sizes(load_engine(ENGINE), SEED)
    print("| effect | visible from, without the floor | with it |\n|---|---|---|")
    for label in sizes if "--all" in sys.argv else TOLD:
        e = sizes[label]
        print(f"| {label} | {size(e['without_floor'], e['unit'])} | {size(e['with_floor'], e['unit'])} |")
    never = sum(e["without_floor"] is None and e["with_floor"] is None for e in sizes.values())
    print(f"| of all {len(sizes)} places, those that cannot be seen whatever the size | | {never} |")


if __name__ == "__main__":
    main()
