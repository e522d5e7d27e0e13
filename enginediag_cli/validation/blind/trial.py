"""One blind trial from its seed to its marks."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from enginediag_cli.mismatch.explain.answer import HIDDEN, LAW, NAMED
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.correspondent import EXPLAIN, LOCATE, Correspondent
from enginediag_cli.validation.blind.flights import hour_columns
from enginediag_cli.validation.blind.laws.opened import opened_law
from enginediag_cli.validation.blind.opened import opened
from enginediag_cli.validation.blind.planned import run_planned
from enginediag_cli.validation.blind.recorded import record, write_open
from enginediag_cli.validation.blind.score import Said
from enginediag_cli.validation.blind.sealed import Sealed, draw, engine_of
from enginediag_cli.validation.blind.several.opened import opened_several

OPENED = {kinds.LAW: opened_law, kinds.SEVERAL: opened_several}
"""How trials are marked that are not marked by names alone."""


@dataclass(frozen=True)
class Plan:
    """What is asked for: trials of these truths and kinds on one engine, or each on one of `engines`; the explainer's
    nominal false-alarm rate."""

    engine: str
    seed: int
    truths: tuple[str, ...]
    kinds: tuple[str, ...]
    false_alarm: float = 0.05
    engines: tuple[str, ...] = ()


def run_trial(plan: Plan, trial: int, explainer: Correspondent) -> dict[str, Any]:
    """Draw, record, ask, open the answer and mark it."""
    begun = process_time()
    path_of_model = engine_of(plan.engines or (plan.engine,), plan.seed, trial)
    engine = load_engine(path_of_model)
    sealed = draw(engine, plan.seed, trial, plan.truths, plan.kinds)
    if sealed.kind == kinds.PLANNED:
        asking = partial(_question, plan)
        return run_planned(path_of_model, plan.seed, trial, sealed.truth, explainer, asking)
    recorded = record(engine, sealed)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        path, files = write_open(Path(folder), engine, recorded, sealed.training)
        question = _question(plan, sealed, path, files)
        told = [explainer.ask(question)]

        def located() -> Mapping[str, Any]:
            told.append(explainer.ask(question | {"task": LOCATE}))
            return told[-1]

        # what a trial finds must not depend on what was done before it
        fresh, said = load_engine(path_of_model), Said.of(told[0])
        if kinds.choice(sealed.kind) in OPENED:
            scored = OPENED[kinds.choice(sealed.kind)](fresh, sealed, recorded, said)
        else:
            scored = opened(fresh, sealed, recorded, said, located)
        stands = not kinds.choice(sealed.kind)
        if stands and kinds.base(sealed.kind) == kinds.NULL and sealed.truth == kinds.MAP_ERROR:
            told.append(explainer.ask(question | {"model_error": 0.0}))
            if "error" not in told[-1]:
                scored["marks"]["false_name_without_floor"] = told[-1]["status"] in (NAMED, LAW, HIDDEN)
    if sealed.realistic is not None:
        scored |= {"engine": engine.name, "shape": sealed.realistic.shape, "airline": sealed.realistic.airline}
    if kinds.choice(sealed.kind):
        scored |= {"engine": engine.name}
    explaining = sum(t.get("seconds", 0.0) for t in told)
    return scored | {"seconds": round(process_time() - begun, 3), "explainer_seconds": round(explaining, 3)}


def _question(plan: Plan, sealed: Sealed, engine: Path, files: Sequence[Path]) -> dict[str, Any]:
    """All that the explainer is told."""
    told = sealed.realistic is None  # of realistic truths nothing is known but what the engine file says
    unknown = kinds.variant(sealed.kind) == kinds.UNKNOWN_NOISE
    return {
        "task": EXPLAIN,
        "engine": str(engine),
        "recordings": [str(f) for f in files],
        "model_error": kinds.MODEL_ERROR[sealed.truth],
        "without": list(sealed.without),
        "noise": ("estimate" if unknown else "specified") if told else None,
        "rho": sealed.noise.rho if told else 0.0,
        "input_noise": dict(sealed.noise.inputs or {}),
        "input_noise_share": dict(sealed.noise.input_shares or {}),
        "false_alarm": plan.false_alarm,
        "drivers": list(hour_columns()),
        "seed": plan.seed,
    }
