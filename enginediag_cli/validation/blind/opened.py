"""A trial's sealed answer opened: what the explainer said, held against it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.mismatch.explain.answer import NAMED
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight, Noise
from enginediag_cli.mismatch.fit.load import Asked, build_evidence
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.causes import Begun, Cause, components
from enginediag_cli.validation.blind.flights import hour_columns
from enginediag_cli.validation.blind.held_back import held_back
from enginediag_cli.validation.blind.recorded import Recorded, readings
from enginediag_cli.validation.blind.score import (
    GAINING,
    LOCATABLE,
    Marks,
    Said,
    hidden_marks,
    interval_marks,
    located,
    marks,
)
from enginediag_cli.validation.blind.sealed import Sealed
from enginediag_cli.validation.blind.separability import Separability, separability
from enginediag_cli.validation.blind.true_driver import driver_is_right
from enginediag_cli.validation.blind.visible import VISIBLE

Cells = Sequence[Mapping[str, Any]]
"""Places of the map, best first, as the explainer gives them."""


def evidence_of(engine: Engine, sealed: Sealed, recorded: Recorded, *, clean: bool) -> Evidence:
    """The training flights as the explainer has them, or without noise, with the noise that they really have."""
    flights = with_past(engine, sealed, recorded.clean if clean else recorded.noisy)[: sealed.training]
    model_error, drawn = kinds.MODEL_ERROR[sealed.truth], sealed.realistic
    if clean and drawn is not None:  # what can be told at all is judged by how wrong the maps really are
        model_error = drawn.shape
    evidence = build_evidence(engine, flights, Asked(model_error=model_error, drivers=hour_columns()))
    if clean and drawn is not None:
        spread = {c: s for c, s in drawn.instruments.spread.items() if c in drawn.sensors}
        offsets, scales = ({c: s[k] for c, s in spread.items()} for k in (1, 0))
        evidence = replace(evidence, settings=replace(evidence.settings, offsets=offsets, scale_offsets=scales))
    sigma = {c: s * sealed.noise.factor for c, s in evidence.noise.sigma.items()}
    noise = Noise(
        sigma, dict.fromkeys(sigma, sealed.noise.rho), sealed.noise.inputs or {}, sealed.noise.input_shares or {}
    )
    return replace(evidence, noise=noise)


def with_past(engine: Engine, sealed: Sealed, flights: Sequence[Flight]) -> Sequence[Flight]:
    """The flights, on tapes of the engine where they move: as whoever reads the recordings has them."""
    if not kinds.moves(sealed.kind):
        return flights
    return [replace(f, columns={**f.columns, MOMENT: engine.tapes.add(f.columns)}) for f in flights]


def opened(
    engine: Engine, sealed: Sealed, recorded: Recorded, said: Said, ask_located: Callable[[], Mapping[str, Any]]
) -> dict[str, Any]:
    """The trial's record: truth, answer, separability, marks. `ask_located` asks for the map of `locate`, which only
    trials that are strong enough are marked for."""
    kind = kinds.base(sealed.kind)
    truth = tuple(recorded.place(c) for c in sealed.causes)
    far, snr = None, np.array([np.nan])
    cells: Cells = ()
    clean = evidence_of(engine, sealed, recorded, clean=True)
    if kind == kinds.HIDDEN_SWITCH:
        snr = _signal_to_noise(engine, sealed)
    elif truth:
        far = separability(clean, truth, dict(sealed.health), sealed.without, sealed.values, _said(said))
    found = marks(sealed, far, said)
    held: dict[str, Any] = {}
    if kind == kinds.HIDDEN_SWITCH and sealed.states is not None:
        kept = recorded.kept[recorded.kept < int(sealed.records[: sealed.training].sum())]
        snr = snr[kept]
        found |= hidden_marks(components(engine, truth[0]), sealed.states[kept], snr, said)
    elif far is not None and far.ok and min(far.given) >= VISIBLE:
        found |= interval_marks(sealed, said)
        if kind in (kinds.SINGLE, kinds.WITHHELD) and not kinds.moves(sealed.kind) and far.total >= LOCATABLE:
            told = ask_located()
            cells, drivers = tuple(told.get("cells", ())), told.get("drivers", ())
            driver = sealed.effects[0].term.DRIVER
            right = [driver_is_right(clean, sealed.health, driver, named) for named in (*drivers, "")]
            varies = None not in right
            found |= located(cells, components(engine, truth[0]), right[:-1] if varies else None)
        if said.status == NAMED and kind != kinds.WITHHELD:
            held = _held_back(engine, sealed, recorded, truth, said)
            if far.total >= GAINING and np.all(np.isfinite([held["before"], held["after"]])):
                gains = np.array(held["before"]) - np.array(held["after"])
                found["held_out_gain"] = bool(gains.sum() > 0)
                found["held_out_flights"] = [float(np.mean(gains > 0))]
    kept_held = {"held_out": held} if held else {}
    return trial_record(sealed, recorded, far, float(np.median(snr)), said, found, cells) | kept_held


def _held_back(
    engine: Engine, sealed: Sealed, recorded: Recorded, truth: Sequence[Cause], said: Said
) -> dict[str, Any]:
    named = _said(said)
    evidence = evidence_of(engine, sealed, recorded, clean=False)
    held = with_past(engine, sealed, recorded.noisy)[sealed.training :]
    h = held_back(evidence, held, named, (truth, sealed.values))
    return {"before": h.before.tolist(), "after": h.after.tolist(), "true": h.true.tolist()}


def _said(said: Said) -> Begun:
    """Causes and coefficients of the first explanation; none where nothing was named."""
    if said.status != NAMED:
        return (), {}
    first = said.raw["explanations"][0]
    return [Cause.from_json(c) for c in first["causes"]], {n: c[0] for n, c in first["coefficients"].items()}


def _signal_to_noise(engine: Engine, sealed: Sealed) -> np.ndarray:
    """The switch's effect on the readings of each record (N,), over their noise."""
    on, off = (
        readings(engine, replace(sealed, states=np.full_like(sealed.states, s)), exact_model=True) for s in (1.0, 0.0)
    )
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()]) * sealed.noise.factor
    recorded = [c in sealed.recorded(engine) for c in engine.sensors]
    return np.asarray(np.linalg.norm(((on - off) / sigma)[:, recorded], axis=1))


def trial_record(
    sealed: Sealed,
    recorded: Recorded,
    far: Separability | None,
    snr: float,
    said: Said,
    found: Marks,
    cells: Cells,
) -> dict[str, Any]:
    """What is kept of the trial; numbers rounded, so that a line is short and the same on every machine."""
    raw: Mapping[str, Any] = said.raw
    return {
        "trial": sealed.trial,
        "truth": sealed.truth,
        "kind": sealed.kind,
        "causes": [c.as_json() for c in sealed.causes],
        "values": {n: short(v) for n, v in sealed.values.items()},
        "change": short(sealed.change),
        "records": int(sealed.records[: sealed.training].sum()),
        "failed_records": recorded.failed,
        "lambda": None if far is None else short(far.total),
        "given": [] if far is None else [short(g) for g in far.given],
        "lambda_sep": None if far is None else short(far.nearest),
        "rival": "" if far is None else far.rival,
        "aliases": [] if far is None or far.total < VISIBLE else sorted(" + ".join(sorted(a)) for a in far.aliases),
        "scorer_converged": far is None or far.ok,
        "signal_to_noise": short(snr),
        "status": said.status,
        "reason": raw.get("reason", ""),
        "error": raw.get("error", ""),
        "named": [" + ".join(sorted(a)) for a in said.aliases],
        "probabilities": [short(p) for p in said.probabilities],
        "coefficients": raw["explanations"][0]["coefficients"] if raw.get("explanations") else {},
        "gains": [short(x["gain"]) for x in raw.get("explanations", ())],
        "left": [short(x["left"]) for x in raw.get("explanations", ())],
        "cells": [f"{c['location']} along {c['driver']}" for c in cells[:3]],
        "hidden": [f"{h['location']} lr {h['lr']:.1f}" for h in raw.get("hidden", ())[:3]],
        "gates": [short(g) for g in raw.get("gates", ())],
        "surprise": short(raw.get("surprise", np.nan)),
        "objective": short(raw.get("objective", np.nan)),
        "readings": raw.get("readings", 0),
        "rejected": raw.get("rejected", {}),
        "marks": found,
    }


def short(x: float) -> float | None:
    return float(f"{x:.6g}") if np.isfinite(x) else None
