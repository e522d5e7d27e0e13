"""Runs of a micro gas turbine: what `explain` names from some of them, and how well each model predicts the others.

    python tests/real_runs/micro_gas_turbine.py [--train FILE ... --test FILE ...] [--format json]

Nothing but set-point voltage and electrical power is recorded. Of the test runs nothing is fitted: rms_W is of the
reading less the prediction of the model as it is (static), with the best lag of the load controller (lag), with what
explain names from the training runs (found), and with that and one unrecorded offset of each run (found_with_offset).
Without --test each of the six public runs is left out in turn, and the rest train.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from ground_recordings import CONFIGS, public_data

from enginediag_cli.engine.term import Effect
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.story import explain_mismatch, named_effects
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import nuisance
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.mismatch.refine.refine import fit_both
from enginediag_cli.mismatch.refine.switch import judged_by_trained_noise
from enginediag_cli.mismatch.refine.unseen import concealed, predicted
from enginediag_cli.physics.registry import effect

ENGINE = CONFIGS / "micro_gas_turbine.yaml"
RECORDER = CONFIGS / "recorders" / "micro_gas_turbine.yaml"
LAG = ("load_control_lag", "generator")


def evidence_of(files: Sequence[str], tests: Sequence[str]) -> tuple[Dataset, list[int]]:
    """The runs as `refine` reads them, and the positions of those to judge by."""
    source = RecordingSource((*files, *tests), recorder=str(RECORDER))
    loaded = load_case(RecordedCase(str(ENGINE), source), lambda flights: [f for f in flights if f.file not in tests])
    unseen = [k for k, f in enumerate(loaded.evidence.flights) if f.file in tests]
    return judged_by_trained_noise(loaded.evidence, unseen), unseen


def named(files: Sequence[str]) -> tuple[tuple[Effect, ...], dict[str, list[float]]]:
    """What `explain` names from these runs, and 95 % intervals of its coefficients."""
    evidence = load_case(
        RecordedCase(str(ENGINE), RecordingSource(tuple(files), recorder=str(RECORDER))), identified=True
    ).evidence
    story = explain_mismatch(evidence, advise=False)
    found = story.answer.explanations[:1]
    return named_effects(story), {c.name: [c.low, c.high] for x in found for c in x.coefficients}


def left(evidence: Dataset, unseen: list[int], effects: Sequence[Effect]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Residuals in W of each test run, without and with the effects, which are fitted to the others."""
    along = nuisance(concealed(evidence, unseen))
    trials = fit_both(concealed(evidence, unseen), effects, along)
    residuals = []
    for trial in trials:
        if not trial.converged:
            raise SystemExit(f"the fit of {trial.label} did not converge: {trial.found.reason}")
        there = predicted(evidence, unseen, trial, along)
        e, run = there.fit.equations.residual[:, 0], there.problem.recording
        residuals.append([e[(run == k) & np.isfinite(e)] for k in range(len(there.problem.labels))])
    return residuals[0], residuals[1]


def judged(
    train: Sequence[str], test: Sequence[str]
) -> tuple[str, dict[str, list[float]], dict[str, list[np.ndarray]]]:
    """Label of what is named, its intervals, and residuals of the test runs by model."""
    effects, intervals = named(train)
    evidence, unseen = evidence_of(train, test)
    static, lag = left(evidence, unseen, [effect(evidence.engine, *LAG)])
    found = left(evidence, unseen, effects)[1] if effects else static
    models = {"static": static, "lag": lag, "found": found}
    models["found_with_offset"] = [e - e.mean() for e in found]
    return " + ".join(e.label for e in effects), intervals, models


def rms(runs: Sequence[np.ndarray]) -> float:
    return round(float(np.sqrt(np.mean(np.concatenate(runs) ** 2))), 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--train", nargs="+", metavar="FILE", default=[])
    parser.add_argument("--test", nargs="+", metavar="FILE", default=[])
    parser.add_argument("--format", choices=("text", "json"), default="text")
    given = parser.parse_args()
    runs = [str(f) for f in sorted(public_data("micro_gas_turbine").glob("*.csv"))] if not given.train else given.train
    splits = [(runs, given.test)] if given.test else [([r for r in runs if r != out], [out]) for out in runs]
    labels: list[str] = []
    models: dict[str, list[np.ndarray]] = {}
    each = {}
    for train, test in splits:
        train = [f for f in train if Path(f).resolve() not in {Path(t).resolve() for t in test}]
        label, intervals, residuals = judged(train, test)
        labels.append(label)
        for model, of_runs in residuals.items():
            models.setdefault(model, []).extend(of_runs)
        each[" ".join(Path(t).name for t in test)] = {
            "named": label,
            "intervals": intervals,
            "rms_W": {m: rms(r) for m, r in residuals.items()},
        }
    told = {
        "named": labels[0] if len(set(labels)) == 1 else sorted(set(labels)),
        "rms_W": {m: rms(r) for m, r in models.items()},
        "by_test": each,
    }
    if given.format == "json":
        print(json.dumps(told, indent=2))
        return
    for test, of in {**each, "together": {"named": told["named"], "rms_W": told["rms_W"]}}.items():
        print(f"{test:12}  {of['named'] or 'nothing'}  " + "  ".join(f"{m} {v:.1f} W" for m, v in of["rms_W"].items()))


if __name__ == "__main__":
    main()
