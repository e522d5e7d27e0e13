"""Blind trials of isolation from their seed to their marks."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.blind.correspondent import Correspondent
from enginediag_cli.validation.blind.sealed import engine_of
from enginediag_cli.validation.isolated.recorded import record
from enginediag_cli.validation.isolated.score import marks, outcome
from enginediag_cli.validation.isolated.sealed import Sealed, draw, group_of

KEPT = 10
"""Sets that a trial's record keeps; the last ones are hardly possible."""


@dataclass(frozen=True)
class Plan:
    """What is asked for: trials of these truths and kinds, each on one of these engine files."""

    engines: tuple[str, ...]
    seed: int
    truths: tuple[str, ...]
    kinds: tuple[str, ...]


def run_group(plan: Plan, trials: Sequence[int], isolator: Correspondent) -> list[dict[str, Any]]:
    """Trials of one group of `group_of`: draw, record, ask, open the answer and mark it."""
    path = engine_of(plan.engines, plan.seed, group_of(trials[0], plan.kinds))
    engine = load_engine(path)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        return [_run_trial(plan, engine, trial, isolator, Path(folder)) for trial in trials]


def _run_trial(plan: Plan, engine: Engine, trial: int, isolator: Correspondent, folder: Path) -> dict[str, Any]:
    begun = process_time()
    sealed = draw(engine, plan.seed, trial, plan.truths, plan.kinds)
    files = record(engine, sealed, folder)
    told = isolator.ask(
        {"engine": str(files.engine), "healthy": [str(p) for p in files.healthy], "judged": str(files.judged)}
    )
    found = _record(sealed, told, marks(engine, sealed, told))
    return found | {
        "engine": engine.name,
        "group": group_of(trial, plan.kinds),
        "failed_records": files.failed,
        "seconds": round(process_time() - begun, 3),
        "isolator_seconds": round(told.get("seconds", 0.0), 3),
    }


def _record(sealed: Sealed, told: Mapping[str, Any], marked: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of the trial; numbers rounded, so that a line is short and the same on every machine."""
    window = (told.get("windows") or [{}])[0]
    drawn = sealed.realistic
    return {
        "trial": sealed.trial,
        "truth": sealed.truth,
        "kind": sealed.kind,
        "shape": None if drawn is None else _short(drawn.shape),
        "airline": drawn is not None and drawn.airline,
        "soaked": drawn is not None and drawn.soak is not None,
        "changes": [c.as_json() | {"size": _short(c.size)} for c in sealed.changes],
        "outcome": outcome(told),
        "reason": told.get("error") or window.get("why") or ("" if window else told.get("reason", "")),
        "fit": _short(window.get("fit")),
        "sets": window.get("sets", [])[:KEPT],
        "probabilities": [_short(p) for p in window.get("probabilities", [])[:KEPT]],
        "sizes": [[place, what, *map(_short, numbers)] for place, what, *numbers in window.get("sizes", [])],
        "marks": dict(marked),
    }


def _short(x: float | None) -> float | None:
    return float(f"{x:.6g}") if x is not None and np.isfinite(x) else None
