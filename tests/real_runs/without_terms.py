"""What the search says of real machines once its library does not hold what explains them.

    python tests/real_runs/without_terms.py [vanes] [ramp] [lags]

vanes   the power plant of 2011, humidity withheld, engine file without guide vanes and control, library without the
        terms that close vanes: right is the compressor's flow along what moves the vanes, or none
ramp    the micro gas turbine's six runs, library without the rate limit of the load controller
lags    the same without any of the load controller's terms: nothing that is left remembers what was asked of it

Prints the answer: its status, what is named with the share of the mismatch that stays, or places of a free form.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ground_recordings import CONFIGS, public_data

from enginediag_cli.engine.term import Effect
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.answer import Answer
from enginediag_cli.mismatch.explain.story import explain_mismatch
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.physics.registry import candidate_effects

VANES = ("guide_vanes", "guide_vanes_load")
RATE, LOAD = (
    ("load_rate_limit",),
    ("load_rate_limit", "load_control_lag", "load_second_order_lag", "load_control_delay"),
)
TOLD = 4
"""Places, variables and reasons that are printed, likeliest first."""


def searched(engine: Path, files: list[Path], recorder: Path, without: tuple[str, ...]) -> Answer:
    """The answer of `explain` with a library that lacks these terms."""
    case = RecordedCase(str(engine), RecordingSource(tuple(map(str, files)), recorder=str(recorder)))
    evidence = load_case(case, identified=True).evidence
    left: list[Effect] = [e for e in candidate_effects(evidence.engine) if e.term.NAME not in without]
    return explain_mismatch(evidence, left, advise=False).answer


def vanes() -> Answer:
    given = (CONFIGS / "recorders" / "uci_gas_turbine.yaml").read_text(encoding="utf-8").splitlines()
    dry = [line for line in given if "humidity" not in line and not line.startswith("derived:")]
    with tempfile.TemporaryDirectory() as scratch:
        recorder = Path(scratch) / "dry.yaml"
        recorder.write_text("\n".join(dry) + "\n", encoding="utf-8")
        year = public_data("uci_gas_turbine") / "gt_2011.csv"
        return searched(CONFIGS / "power_plant.yaml", [year], recorder, VANES)


def ramp(without: tuple[str, ...]) -> Answer:
    runs = sorted(public_data("micro_gas_turbine").glob("*.csv"))
    recorder = CONFIGS / "recorders" / "micro_gas_turbine.yaml"
    return searched(CONFIGS / "micro_gas_turbine.yaml", runs, recorder, without)


MACHINES: dict[str, Callable[[], Answer]] = {"vanes": vanes, "ramp": lambda: ramp(RATE), "lags": lambda: ramp(LOAD)}


def report(name: str, answer: Answer) -> str:
    part = " in part" if answer.in_part else ""
    lines = [f"{name}: {answer.status}{part}. {answer.reason}".rstrip(" .") + "."]
    for x in answer.explanations[:TOLD]:
        stays = f"{100 * answer.unexplained:.0f} % of the mismatch stays" if answer.unexplained is not None else ""
        lines.append(f"  {x.probability:.2f} {x.label}: χ² falls by {x.gain:.0f}; {stays}".rstrip("; "))
        lines += [f"    {c.name} = {c.value:.3g}, {c.low:.3g} to {c.high:.3g} {c.unit}" for c in x.coefficients]
    if answer.law is not None:
        lines += [f"  law at {where.name}: {p:.2f}" for where, p in answer.law.places[:TOLD]]
        for groups, p in answer.law.drivers[:TOLD]:
            lines.append("  law along " + " and ".join("/".join(v.name for v in g[:3]) for g in groups) + f": {p:.2f}")
    lines += [f"  free form at {c.location.name} along {c.driver.name}" for c in answer.cells[:TOLD]]
    lines += [f"  rejected: {label} ({why.reason.name})" for label, why in list(answer.rejected.items())[:TOLD]]
    return "\n".join(lines)


def main() -> None:
    for name in sys.argv[1:] or MACHINES:
        print(report(name, MACHINES[name]()), flush=True)


if __name__ == "__main__":
    main()
