"""The whole result of `prove` as one JSON object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from enginediag_cli import __version__
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.presentation.outputs.prove import PROVE
from enginediag_cli.trials.blind import kinds
from enginediag_cli.trials.blind.power import detectable_sizes
from enginediag_cli.trials.blind.sheet import bins, sheet, truths_of
from enginediag_cli.trials.blind.trial import Plan


def document(plan: Plan, records: Sequence[Mapping[str, Any]], sizes: bool) -> dict[str, Any]:
    """Scores by name, then bins, detectable sizes, counts and what was run."""
    scores, truths = sheet(records), truths_of(records)
    found: dict[str, Any] = {
        "schema": PROVE.id,
        **scores,
        "scores": list(scores),
        "bins": bins(records),
        "held_out_misfit": {t: _held_out(records, t) for t in truths},
        "trials": len(records),
        "trials_by_kind": {
            t: dict(sorted(Counter(r["kind"] for r in records if r["truth"] == t).items())) for t in truths
        },
        "unscored": sum(not r["scorer_converged"] for r in records),
        "failed_records": sum(r["failed_records"] for r in records),
        "seed": plan.seed,
        "truths": list(plan.truths),
        "kinds": list(plan.kinds),
        "model_error": {t: kinds.MODEL_ERROR[t] for t in truths},
        "false_alarm": plan.false_alarm,
        "engine": Path(plan.engine).name,
        "versions": {"enginediag": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
    }
    if len(plan.engines) > 1:
        found["engines"] = [Path(e).name for e in plan.engines]
    if sizes:
        found["detectable_size"] = detectable_sizes(load_engine(plan.engine), plan.seed)
    return found


def _held_out(records: Sequence[Mapping[str, Any]], truth: str) -> dict[str, Any]:
    """Mean χ² per reading of the held-back flights of single trials: before, after, with the true effect."""
    own = [
        r["held_out"]
        for r in records
        if r["truth"] == truth and kinds.base(r["kind"]) == kinds.SINGLE and "held_out" in r
    ]
    values = {
        what: [x for h in own for x in h[what] if x is not None and np.isfinite(x)]
        for what in ("before", "after", "true")
    }
    return {what: float(np.mean(v)) if v else None for what, v in values.items()} | {"trials": len(own)}
