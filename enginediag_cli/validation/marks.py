"""The scorer: opens a trial's sealed answer and marks what the explainer said.

A mark is True or False where the trial counts for a score, a list of shares or sizes where it has one, and absent
where the trial is not in the score's denominator. Definitions, with t the truth, A the answer's alias set, C(t) the
unavoidable aliases (λ_sep < 11), visible: λ ≥ 25 (of each of two causes, given the other):

    exact        A's first = t                    visible, λ_sep ≥ 22      (exact_no_alias: C(t) empty)
    covered      t ∈ A                            visible
    tight        |A| ≤ 1 + |C(t)|                 visible and covered
    set_score    [t ∈ A] min(1, (1 + |C|)/|A|)    visible
    false_name   named, A ∩ ({t} ∪ C(t)) = ∅ and no part of t alone; on null data any name
    none_right   "none of these", or a law        effect outside the library, λ_out ≥ 25
    wrongly_none "none of these", or a law        effect in the library, visible

What an explanation is worth on the flights that were held back, beside the true one.

Everything identified is fitted to the training flights alone; the readings of the held-back flights are then
predicted, their χ² per reading compared flight by flight with that of the model as it was.

A trial's sealed answer opened: what the explainer said, held against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.tape import MOMENT
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    HIDDEN_STATE,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    UNEXPLAINED,
)
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    nuisance,
    stack_column,
)
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.fit.options import FAULT, SENSOR_FAULT
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import VISIBLE, Begun, Cause, Key, components, hypothesis, key
from enginediag_cli.validation.concealed_effects import Recorded, Sealed, readings
from enginediag_cli.validation.separability import ALIAS, Separability, driver_is_right, separability
from enginediag_cli.validation.trial_flights import hour_columns

SILENT, SEPARATE = 5.0, 22.0
"""λ below which nothing can be told, and λ_sep from which the truth stands alone: twice the 11 at which it wins 19
times out of 20."""
LOCATABLE, GAINING = 40.0, 40.0
"""λ from which a place is asked for, and from which unseen flights are asked to gain: there chance no longer
decides."""
CLEAR = 2.0  # signal to noise of one record
LEAST_PROBABILITY = 1e-3
"""A truth that was called impossible costs as much as one of this probability, 6.9 nats, not infinity."""

Marks = dict[str, Any]


@dataclass(frozen=True)
class Said:
    """An explainer's answer, its alias set as sets of causes."""

    status: str
    aliases: tuple[Key, ...]
    probabilities: tuple[float, ...]
    raw: Mapping[str, Any]

    @staticmethod
    def of(answer: Mapping[str, Any]) -> Said:
        if "error" in answer:
            return Said(NOT_CONVERGED, (), (), answer)
        # explanations told beside a hidden amplitude are the second choice, not the answer
        found = answer["explanations"] if answer["status"] == IDENTIFIED else []
        sets = tuple(key([Cause.from_json(c) for c in x["causes"]]) for x in found)
        return Said(answer["status"], sets, tuple(x["probability"] for x in found), answer)


def marks(sealed: Sealed, far: Separability | None, said: Said) -> Marks:
    """All marks of a trial but those that need further fits. `far` is None for null trials and hidden switches."""
    found: Marks = {"no_verdict": said.status == NOT_CONVERGED}
    kind = kinds.base(sealed.kind)
    if said.status == NOT_CONVERGED:
        return found
    if sealed.realistic is not None:
        found |= _answered(sealed, far, said)
    if kind == kinds.NULL:
        return found | {
            "false_name": said.status in (IDENTIFIED, FORMULA, HIDDEN_STATE),
            "false_finding": said.status != NO_DISCREPANCY,
        }
    if far is None or not far.ok:
        return found
    t = key(sealed.causes)
    allowed = {t, *far.aliases}
    false = said.status == IDENTIFIED and not any(a in allowed or a < t for a in said.aliases)
    found["false_name"] = bool(false)
    if far.total < SILENT:  # every name is as good as another, so only the truth's own is not false
        found["false_name"] = said.status == IDENTIFIED and t not in said.aliases
    if min(far.given) >= VISIBLE:
        found["found"] = said.status != NO_DISCREPANCY
        if kind == kinds.WITHHELD:
            if far.nearest >= VISIBLE:
                found["none_right"] = said.status in (UNEXPLAINED, FORMULA)
        else:
            found |= _naming(t, far, said)
            found["wrongly_none"] = said.status in (UNEXPLAINED, FORMULA)
        if kind in (kinds.FAULT, kinds.SINGLE) and said.status == IDENTIFIED:
            first = said.raw["explanations"][0]["kinds"]
            fault = all(k in (FAULT, SENSOR_FAULT) for k in first)
            found["fault_called_fault" if kind == kinds.FAULT else "effect_called_fault"] = fault
    return found


def _answered(sealed: Sealed, far: Separability | None, said: Said) -> Marks:
    """Marks of every name that is told, whatever can be told at all: stated probability and whether it is right, and
    whether an instrument is named that reads right."""
    t = key(sealed.causes)
    if said.status != IDENTIFIED:
        return {"false_sensor": False}
    first = said.raw["explanations"][0]
    right = said.aliases[0] == t or (far is not None and far.ok and said.aliases[0] in far.aliases)
    return {
        "answered": [float(said.probabilities[0]), bool(right and t)],
        "false_sensor": bool(set(first["sensors"]) - t),
    }


def _naming(t: Key, far: Separability, said: Said) -> Marks:
    """Marks of a visible truth that the library has."""
    first, size = (said.aliases[0] if said.aliases else frozenset()), len(said.aliases)
    covered, others = t in said.aliases, len(far.aliases)
    found: Marks = {"covered": covered}
    if far.nearest >= SEPARATE:
        found["exact"] = first == t
    if far.nearest >= ALIAS:
        found["exact_no_alias"] = first == t
    if size:
        found["alias_set_size"] = [float(size)]
    if covered:
        found["tight"] = size <= 1 + others
    found["set_score"] = [min(1.0, (1 + others) / size) if covered else 0.0]
    p = sum(q for a, q in zip(said.aliases, said.probabilities, strict=True) if a == t or a in far.aliases)
    found["log_score"] = [float(-np.log(max(p, LEAST_PROBABILITY)))]
    if size:
        found["stated"] = [float(said.probabilities[0]), first == t or first in far.aliases]
    return found


def interval_marks(sealed: Sealed, said: Said) -> Marks:
    """Whether each true coefficient lies in its 95 % interval, of the explanation that is the truth."""
    t = key(sealed.causes)
    if t not in said.aliases or not sealed.effects or sealed.states is not None:
        return {}
    stated = said.raw["explanations"][said.aliases.index(t)]["coefficients"]
    inside = [float(stated[n][1] <= v <= stated[n][2]) for n, v in sealed.values.items() if n in stated]
    return {"interval": inside} if inside else {}


def hidden_marks(components: Set[str], states: np.ndarray, signal_to_noise: np.ndarray, said: Said) -> Marks:
    """Marks of a hidden switch: `states` (N,), 0 or 1, and signal to noise (N,) of the training records. A complement
    counts as right where physics does not say which state is on. Of a switch that most records show clearly, states
    are marked in the records that do; marks of any other are apart, `…_weak`, with the states of all records."""
    if said.status == NOT_CONVERGED:
        return {}
    clear = signal_to_noise >= CLEAR
    weak = float(np.median(signal_to_noise)) < CLEAR
    judged = np.ones(len(states), bool) if weak else clear
    found: Marks = {"hidden_found": said.status != NO_DISCREPANCY}
    first: Mapping[str, Any] = said.raw["hidden"][0] if said.status == HIDDEN_STATE else {}
    found["hidden_location"] = bool(first) and first["component"] in components
    share = 0.0
    if first and first["states"] is not None:
        number = np.asarray(first["number"], int)
        right = ((np.asarray(first["states"]) > 0.5) == (states[number] > 0.5))[judged[number]]
        share = float(np.mean(right))
        share = share if first["sign"] else max(share, 1.0 - share)
    found["hidden_states"] = [share]
    if weak:
        found = {f"{name}_weak": mark for name, mark in found.items()}
    return found


def located(
    cells: Sequence[Mapping[str, Any]], components: Set[str], right_drivers: Sequence[bool | None] | None
) -> Marks:
    """Whether the free-form map's first cell is of the true component, and whether the true driver is the first that
    is told, is one of those, and how many those are; none is where nothing is located. None: it varies with nothing."""
    found: Marks = {"locate_component": bool(cells) and cells[0]["component"] in components}
    if right_drivers is None:
        return found
    found["locate_driver"] = bool(right_drivers) and bool(right_drivers[0])
    found["locate_driver_told"] = any(right_drivers)
    if right_drivers:
        found["drivers_told"] = [float(len(right_drivers))]
    return found


@dataclass(frozen=True)
class HeldBack:
    """χ² per reading of every held-back flight (F,) with the model as it was, with what was named, with the truth;
    NaN where a fit did not converge."""

    before: np.ndarray
    after: np.ndarray
    true: np.ndarray


def held_back(evidence: Dataset, held: Sequence[Flight], named: Begun, truth: Begun) -> HeldBack:
    """`evidence` are the training flights as the explainer had them, `held` the others."""
    sensors = list(evidence.noise.sigma)
    blind = [
        replace(f, columns={c: np.full_like(v, np.nan) if c in sensors else v for c, v in f.columns.items()})
        for f in held
    ]
    both = replace(evidence, flights=(*evidence.flights, *blind))
    records = sum(len(f.columns["time_s"]) for f in both.flights)
    along = nuisance(both)
    base = identify_with(both, NULL_HYPOTHESIS, along)
    before = _misfit(both, base, along, held)
    found = {key(()): before}
    for causes, values in (named, truth):
        if key(causes) not in found:
            fit = identify_with(both, hypothesis(both.engine, causes, records, values), along, base)
            found[key(causes)] = _misfit(both, fit, along, held)
    return HeldBack(before, found[key(named[0])], found[key(truth[0])])


def _misfit(both: Dataset, fit: IdentifiedHypothesis, along: Nuisance, held: Sequence[Flight]) -> np.ndarray:
    """χ² per reading of each held-back flight."""
    if not fit.converged:
        return np.full(len(held), np.nan)
    curves = {**along.curves, **fit.hypothesis.curves}
    inputs = {c: stack_column(both, c) for c in fit.model.inputs}
    inputs |= {c: stack_column(both, c, d) for c, d in fit.model.optional_inputs.items() if c not in curves}
    sizes = [len(f.columns["time_s"]) for f in held]
    last = sum(sizes)
    p = fit.model.predict(
        {c: v[-last:] for c, v in {**inputs, **curves}.items()}, fit.theta, sensors=fit.problem.sensors
    )
    y = np.where(p.ok[:, None], p.y, np.nan)
    result, start = [], 0
    for f, n in zip(held, sizes, strict=True):
        read = np.column_stack([f.columns[c] for c in fit.problem.sensors])
        e = (read - y[start : start + n]) / fit.problem.sigma
        result.append(float(np.nanmean(e**2)))
        start += n
    return np.array(result)


Cells = Sequence[Mapping[str, Any]]
"""Places of the map, best first, as the explainer gives them."""


def evidence_of(engine: Engine, sealed: Sealed, recorded: Recorded, *, clean: bool) -> Dataset:
    """The training flights as the explainer has them, or without noise, with the noise that they really have."""
    flights = with_past(engine, sealed, recorded.clean if clean else recorded.noisy)[: sealed.training]
    model_error, drawn = kinds.MODEL_ERROR[sealed.truth], sealed.realistic
    if clean and drawn is not None:  # what can be told at all is judged by how wrong the maps really are
        model_error = drawn.shape
    evidence = build_dataset(engine, flights, MismatchQuery(model_error=model_error, drivers=hour_columns()))
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
        if said.status == IDENTIFIED and kind != kinds.WITHHELD:
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
    if said.status != IDENTIFIED:
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
