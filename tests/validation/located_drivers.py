"""Whether `locate` finds what a concealed effect varies with, as JSON: python tests/validation/located_drivers.py
[--seed 7301] [--trials 14]

Blind trials of `prove --truth same_model --kind single`, of which only the map is asked: of effects that vary with
something and whose best place lowers χ² by 40 or more, in how many is the true driver in the group that is first, in
how many among the groups that are told together, how many groups are those, and in how many is the first place's
component right?
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.fit.evidence import Noise
from enginediag_cli.mismatch.fit.load import MismatchQuery, RecordedCase, load_case
from enginediag_cli.mismatch.locate.locate import Located, locate
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import (
    ConcealedTruth,
    TrialFlights,
    draw_truth,
    record_trial,
    write_trial_files,
)
from enginediag_cli.validation.marks import LOCATABLE, trial_dataset
from enginediag_cli.validation.separability import UNDRIVEN, driver_is_right
from enginediag_cli.validation.trial_flights import cause_components, hour_columns

ENGINE = shipped("turbofan.yaml")


def mapped(concealed: ConcealedTruth, recorded: TrialFlights, seed: int) -> Located:
    """What `locate` says of the concealed recordings."""
    with tempfile.TemporaryDirectory() as folder:
        path, files = write_trial_files(Path(folder), load_engine(ENGINE), recorded, concealed.training)
        asked = MismatchQuery(kinds.MODEL_ERROR[concealed.truth], drivers=hour_columns(), noise="specified", seed=seed)
        evidence = load_case(RecordedCase(str(path), RecordingSource(tuple(map(str, files))), asked=asked)).evidence
    known = Noise(
        evidence.noise.sigma, {}, dict(concealed.noise.inputs or {}), dict(concealed.noise.input_shares or {})
    )
    return locate(replace(evidence, noise=known))


def judged(seed: int, trial: int) -> dict[str, object] | None:
    """One trial; None where nothing that varies was concealed, or too little to be located."""
    engine = load_engine(ENGINE)
    concealed = draw_truth(engine, seed, trial, (kinds.SAME_MODEL,), (kinds.SINGLE,))
    if not concealed.effects or concealed.effects[0].term.DRIVER in UNDRIVEN:
        return None
    recorded = record_trial(engine, concealed)
    found, driver = mapped(concealed, recorded, seed), concealed.effects[0].term.DRIVER
    if max((p.statistic for p in found.places), default=0.0) < LOCATABLE:
        return None
    clean = trial_dataset(engine, concealed, recorded, clean=True)
    right = [driver_is_right(clean, concealed.health, driver, lead.driver) for lead in found.leads]
    told = [bool(r) for r, lead in zip(right, found.leads, strict=True) if lead.told]
    return {
        "trial": trial,
        "concealed": concealed.effects[0].label,
        "first": bool(right[0]),
        "told": any(told),
        "groups_told": len(told),
        "component": found.places[0].component in cause_components(engine, recorded.place_cause(concealed.causes[0])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=7301)
    parser.add_argument("--trials", type=int, default=14)
    options = parser.parse_args()
    found = [f for f in (judged(options.seed, k) for k in range(options.trials)) if f is not None]
    counts = {name: sum(bool(f[name]) for f in found) for name in ("first", "told", "component")}
    mean = sum(int(str(f["groups_told"])) for f in found) / max(len(found), 1)
    report = {
        "of": len(found),
        **counts,
        "groups_told": round(mean, 1),
        "not_first": [f for f in found if not f["first"]],
    }
    json.dump(report, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
