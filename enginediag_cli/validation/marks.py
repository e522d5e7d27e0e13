"""The scorer of `explain`: compares an answer with the concealed truth.

A mark is True or False where the trial counts for a score, a list of shares or sizes where it has one, and absent
where the trial is not in the score's denominator. t is the truth, A the set of answered alternatives, C(t) the
unavoidable aliases (λ_sep < 11). Visible: λ ≥ 25 (of each of two causes, given the other).

    exact        A's first = t                    visible, λ_sep ≥ 22      (exact_no_alias: C(t) empty)
    covered      t ∈ A                            visible
    tight        |A| ≤ 1 + |C(t)|                 visible and covered
    set_score    [t ∈ A] min(1, (1 + |C|)/|A|)    visible
    false_name   named, A ∩ ({t} ∪ C(t)) = ∅ and no part of t alone; on null data any name
    none_right   "none of these", or a formula    effect outside the library, λ_out ≥ 25
    wrongly_none "none of these", or a formula    effect in the library, visible

The held-out gain compares χ² per reading of the held-back flights, flight by flight, with that of the unchanged model.
Everything identified is fitted to the training flights alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
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
from enginediag_cli.validation.concealed_effects import ConcealedTruth, TrialFlights, true_flight_readings
from enginediag_cli.validation.separability import ALIAS, Separability, driver_is_right, separability
from enginediag_cli.validation.trial_flights import (
    VISIBLE,
    Cause,
    CauseNames,
    FittedCauses,
    cause_components,
    cause_names,
    causes_hypothesis,
    hour_columns,
)
from enginediag_cli.validation.trials import short

SILENT, SEPARATE = 5.0, 22.0
"""λ below which nothing can be concluded, and λ_sep from which the truth is resolved: twice the 11 at which it wins 19
times out of 20."""
LOCATABLE, GAINING = 40.0, 40.0
"""λ from which a location is required, and from which unseen flights must gain: there chance no longer
decides."""
CLEAR = 2.0  # signal to noise of one record
LEAST_PROBABILITY = 1e-3
"""A truth that was called impossible costs as much as one of this probability, 6.9 nats, not infinity."""

Marks = dict[str, Any]


@dataclass(frozen=True)
class ExplainAnswer:
    """The answer to a trial; its alternatives as sets of causes."""

    status: str
    aliases: tuple[CauseNames, ...]
    probabilities: tuple[float, ...]
    raw: Mapping[str, Any]

    @staticmethod
    def from_json(answer: Mapping[str, Any]) -> ExplainAnswer:
        if "error" in answer:
            return ExplainAnswer(NOT_CONVERGED, (), (), answer)
        # explanations beside a hidden amplitude are the second choice, not the answer
        found = answer["explanations"] if answer["status"] == IDENTIFIED else []
        sets = tuple(cause_names([Cause.from_json(c) for c in x["causes"]]) for x in found)
        return ExplainAnswer(answer["status"], sets, tuple(x["probability"] for x in found), answer)


def marks(concealed: ConcealedTruth, separation: Separability | None, answer: ExplainAnswer) -> Marks:
    """All marks of a trial but those that need further fits. `far` is None for null trials and hidden switches."""
    found: Marks = {"no_verdict": answer.status == NOT_CONVERGED}
    kind = kinds.base_kind(concealed.kind)
    if answer.status == NOT_CONVERGED:
        return found
    if concealed.realistic is not None:
        found |= _stated_marks(concealed, separation, answer)
    if kind == kinds.NULL:
        return found | {
            "false_name": answer.status in (IDENTIFIED, FORMULA, HIDDEN_STATE),
            "false_finding": answer.status != NO_DISCREPANCY,
        }
    if separation is None or not separation.ok:
        return found
    t = cause_names(concealed.causes)
    allowed = {t, *separation.aliases}
    false = answer.status == IDENTIFIED and not any(a in allowed or a < t for a in answer.aliases)
    found["false_name"] = bool(false)
    if separation.total < SILENT:  # every name is as good as another, so only the truth's own is not false
        found["false_name"] = answer.status == IDENTIFIED and t not in answer.aliases
    if min(separation.conditional) >= VISIBLE:
        found["found"] = answer.status != NO_DISCREPANCY
        if kind == kinds.WITHHELD:
            if separation.nearest >= VISIBLE:
                found["none_right"] = answer.status in (UNEXPLAINED, FORMULA)
        else:
            found |= _naming_marks(t, separation, answer)
            found["wrongly_none"] = answer.status in (UNEXPLAINED, FORMULA)
        if kind in (kinds.FAULT, kinds.SINGLE) and answer.status == IDENTIFIED:
            first = answer.raw["explanations"][0]["kinds"]
            fault = all(k in (FAULT, SENSOR_FAULT) for k in first)
            found["fault_called_fault" if kind == kinds.FAULT else "effect_called_fault"] = fault
    return found


def _stated_marks(concealed: ConcealedTruth, separation: Separability | None, answer: ExplainAnswer) -> Marks:
    """Marks of every reported name, visible or not: stated probability and whether it is right, and whether
    a correct instrument is named."""
    t = cause_names(concealed.causes)
    if answer.status != IDENTIFIED:
        return {"false_sensor": False}
    first = answer.raw["explanations"][0]
    right = answer.aliases[0] == t or (
        separation is not None and separation.ok and answer.aliases[0] in separation.aliases
    )
    return {
        "answered": [float(answer.probabilities[0]), bool(right and t)],
        "false_sensor": bool(set(first["sensors"]) - t),
    }


def _naming_marks(t: CauseNames, separation: Separability, answer: ExplainAnswer) -> Marks:
    """Marks of a visible truth that the library has."""
    first, size = (answer.aliases[0] if answer.aliases else frozenset()), len(answer.aliases)
    covered, others = t in answer.aliases, len(separation.aliases)
    found: Marks = {"covered": covered}
    if separation.nearest >= SEPARATE:
        found["exact"] = first == t
    if separation.nearest >= ALIAS:
        found["exact_no_alias"] = first == t
    if size:
        found["alias_set_size"] = [float(size)]
    if covered:
        found["tight"] = size <= 1 + others
    found["set_score"] = [min(1.0, (1 + others) / size) if covered else 0.0]
    p = sum(q for a, q in zip(answer.aliases, answer.probabilities, strict=True) if a == t or a in separation.aliases)
    found["log_score"] = [float(-np.log(max(p, LEAST_PROBABILITY)))]
    if size:
        found["stated"] = [float(answer.probabilities[0]), first == t or first in separation.aliases]
    return found


def interval_marks(concealed: ConcealedTruth, answer: ExplainAnswer) -> Marks:
    """Whether each true coefficient lies in its 95 % interval, of the explanation that is the truth."""
    t = cause_names(concealed.causes)
    if t not in answer.aliases or not concealed.effects or concealed.states is not None:
        return {}
    stated = answer.raw["explanations"][answer.aliases.index(t)]["coefficients"]
    inside = [float(stated[n][1] <= v <= stated[n][2]) for n, v in concealed.values.items() if n in stated]
    return {"interval": inside} if inside else {}


def hidden_marks(components: Set[str], states: np.ndarray, signal_to_noise: np.ndarray, answer: ExplainAnswer) -> Marks:
    """Marks of a hidden switch: `states` (N,), 0 or 1, and signal to noise (N,) of the training records. A complement
    counts as right where physics does not say which state is on. Of a switch that most records show clearly, states
    are marked in the records that do; marks of any other are apart, `…_weak`, with the states of all records."""
    if answer.status == NOT_CONVERGED:
        return {}
    clear = signal_to_noise >= CLEAR
    weak = float(np.median(signal_to_noise)) < CLEAR
    judged = np.ones(len(states), bool) if weak else clear
    found: Marks = {"hidden_found": answer.status != NO_DISCREPANCY}
    first: Mapping[str, Any] = answer.raw["hidden"][0] if answer.status == HIDDEN_STATE else {}
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


def location_marks(
    cells: Sequence[Mapping[str, Any]], components: Set[str], right_drivers: Sequence[bool | None] | None
) -> Marks:
    """Whether the free-form map's first cell is of the true component, and whether the true driver is the first
    reported one, is among those reported, and how many there are; none where nothing is located. None: it varies with
    nothing."""
    found: Marks = {"locate_component": bool(cells) and cells[0]["component"] in components}
    if right_drivers is None:
        return found
    found["locate_driver"] = bool(right_drivers) and bool(right_drivers[0])
    found["locate_driver_told"] = any(right_drivers)
    if right_drivers:
        found["drivers_told"] = [float(len(right_drivers))]
    return found


@dataclass(frozen=True)
class HeldOutFlights:
    """Flights that nothing is fitted to. `extended`: the fitted recordings, and behind them these flights without their
    readings; `base`: the fit without a hypothesis; `readings` (n, m): of the fitted sensors, in these flights."""

    extended: Dataset
    nuisance: Nuisance
    base: IdentifiedHypothesis
    readings: np.ndarray

    @staticmethod
    def from_flights(fitted: Dataset, flights: Sequence[Flight]) -> HeldOutFlights:
        """Behind the recordings `fitted`; `flights` have their readings."""
        sensors = list(fitted.noise.sigma)
        blank = [
            replace(f, columns={c: np.full_like(v, np.nan) if c in sensors else v for c, v in f.columns.items()})
            for f in flights
        ]
        both = replace(fitted, flights=(*fitted.flights, *blank))
        free = nuisance(both)
        base = identify_with(both, NULL_HYPOTHESIS, free)
        readings = [np.column_stack([f.columns[c] for c in base.problem.sensors]) for f in flights]
        return HeldOutFlights(both, free, base, np.concatenate(readings))

    def squared_errors(self, fit: IdentifiedHypothesis) -> np.ndarray:
        """((ŷ − y)/σ)² (n, m) of a fit, NaN without a prediction or where the fit did not converge."""
        if not fit.converged:
            return np.full_like(self.readings, np.nan)
        curves = {**self.nuisance.curves, **fit.hypothesis.curves}
        inputs = {c: stack_column(self.extended, c) for c in fit.model.inputs}
        inputs |= {
            c: stack_column(self.extended, c, d) for c, d in fit.model.optional_inputs.items() if c not in curves
        }
        now = {c: v[-len(self.readings) :] for c, v in {**inputs, **curves}.items()}
        p = fit.model.predict(now, fit.theta, sensors=fit.problem.sensors)
        return np.asarray(np.where(p.ok[:, None], ((p.y - self.readings) / fit.problem.sigma) ** 2, np.nan))


def held_out_misfit(
    fitted: Dataset, flights: Sequence[Flight], named: FittedCauses, truth: FittedCauses
) -> dict[str, list[float]]:
    """χ² per reading of each held-back flight: `before`, with the model as it is; `after`, with what was named; `true`,
    with the truth. Everything identified is fitted to the training flights alone; NaN where a fit does not converge."""
    unseen = HeldOutFlights.from_flights(fitted, flights)
    ends = np.cumsum([len(f) for f in flights])[:-1]

    def misfit(fit: IdentifiedHypothesis) -> list[float]:
        if not fit.converged:
            return [np.nan] * len(flights)
        return [float(np.nanmean(e2)) for e2 in np.split(unseen.squared_errors(fit), ends)]

    found = {cause_names(()): misfit(unseen.base)}
    for causes, values in (named, truth):
        if cause_names(causes) not in found:
            sought = causes_hypothesis(unseen.extended.engine, causes, unseen.extended.records, values)
            found[cause_names(causes)] = misfit(identify_with(unseen.extended, sought, unseen.nuisance, unseen.base))
    return {
        "before": found[cause_names(())],
        "after": found[cause_names(named[0])],
        "true": found[cause_names(truth[0])],
    }


Cells = Sequence[Mapping[str, Any]]
"""Locations of the map, best first."""


def trial_dataset(engine: Engine, concealed: ConcealedTruth, recorded: TrialFlights, *, clean: bool) -> Dataset:
    """The training flights as the diagnosing process has them, or without noise, with the noise that they really
    have."""
    flights = add_history(engine, concealed, recorded.clean if clean else recorded.noisy)[: concealed.training]
    model_error, drawn = kinds.MODEL_ERROR[concealed.truth], concealed.realistic
    if clean and drawn is not None:  # what can be told at all is judged by how wrong the maps really are
        model_error = drawn.shape
    evidence = build_dataset(engine, flights, MismatchQuery(model_error=model_error, drivers=hour_columns()))
    if clean and drawn is not None:
        spread = {c: s for c, s in drawn.instruments.spread.items() if c in drawn.sensors}
        offsets, scales = ({c: s[k] for c, s in spread.items()} for k in (1, 0))
        evidence = replace(evidence, settings=replace(evidence.settings, offsets=offsets, scale_offsets=scales))
    sigma = {c: s * concealed.noise.factor for c, s in evidence.noise.sigma.items()}
    noise = Noise(
        sigma,
        dict.fromkeys(sigma, concealed.noise.rho),
        concealed.noise.inputs or {},
        concealed.noise.input_shares or {},
    )
    return replace(evidence, noise=noise)


def add_history(engine: Engine, concealed: ConcealedTruth, flights: Sequence[Flight]) -> Sequence[Flight]:
    """The flights, on tapes of the engine where they move: as whoever reads the recordings has them."""
    if not kinds.is_dynamic(concealed.kind):
        return flights
    return [replace(f, columns={**f.columns, MOMENT: engine.tapes.add(f.columns)}) for f in flights]


def mark_trial(
    engine: Engine,
    concealed: ConcealedTruth,
    recorded: TrialFlights,
    answer: ExplainAnswer,
    ask_located: Callable[[], Mapping[str, Any]],
) -> dict[str, Any]:
    """The trial's record: truth, answer, separability, marks. `ask_located` asks for the map of `locate`, which only
    trials that are strong enough are marked for."""
    kind = kinds.base_kind(concealed.kind)
    truth = tuple(recorded.place_cause(c) for c in concealed.causes)
    separation, snr = None, np.array([np.nan])
    cells: Cells = ()
    clean = trial_dataset(engine, concealed, recorded, clean=True)
    if kind == kinds.HIDDEN_SWITCH:
        snr = _signal_to_noise(engine, concealed)
    elif truth:
        separation = separability(
            clean, truth, dict(concealed.health), concealed.withheld_terms, concealed.values, _first_causes(answer)
        )
    found = marks(concealed, separation, answer)
    held: dict[str, Any] = {}
    if kind == kinds.HIDDEN_SWITCH and concealed.states is not None:
        kept = recorded.used_records[recorded.used_records < int(concealed.records[: concealed.training].sum())]
        snr = snr[kept]
        found |= hidden_marks(cause_components(engine, truth[0]), concealed.states[kept], snr, answer)
    elif separation is not None and separation.ok and min(separation.conditional) >= VISIBLE:
        found |= interval_marks(concealed, answer)
        if (
            kind in (kinds.SINGLE, kinds.WITHHELD)
            and not kinds.is_dynamic(concealed.kind)
            and separation.total >= LOCATABLE
        ):
            reported = ask_located()
            cells, drivers = tuple(reported.get("cells", ())), reported.get("drivers", ())
            driver = concealed.effects[0].term.DRIVER
            right = [driver_is_right(clean, concealed.health, driver, named) for named in (*drivers, "")]
            varies = None not in right
            found |= location_marks(cells, cause_components(engine, truth[0]), right[:-1] if varies else None)
        if answer.status == IDENTIFIED and kind != kinds.WITHHELD:
            fitted = trial_dataset(engine, concealed, recorded, clean=False)
            unseen = add_history(engine, concealed, recorded.noisy)[concealed.training :]
            held = held_out_misfit(fitted, unseen, _first_causes(answer), (truth, concealed.values))
            if separation.total >= GAINING and np.all(np.isfinite([held["before"], held["after"]])):
                gains = np.array(held["before"]) - np.array(held["after"])
                found["held_out_gain"] = bool(gains.sum() > 0)
                found["held_out_flights"] = [float(np.mean(gains > 0))]
    kept_held = {"held_out": held} if held else {}
    return trial_record(concealed, recorded, separation, float(np.median(snr)), answer, found, cells) | kept_held


def _first_causes(answer: ExplainAnswer) -> FittedCauses:
    """Causes and coefficients of the first explanation; none where nothing was named."""
    if answer.status != IDENTIFIED:
        return (), {}
    first = answer.raw["explanations"][0]
    return [Cause.from_json(c) for c in first["causes"]], {n: c[0] for n, c in first["coefficients"].items()}


def _signal_to_noise(engine: Engine, concealed: ConcealedTruth) -> np.ndarray:
    """The switch's effect on the readings of each record (N,), over their noise."""
    on, off = (
        true_flight_readings(engine, replace(concealed, states=np.full_like(concealed.states, s)), exact_model=True)
        for s in (1.0, 0.0)
    )
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()]) * concealed.noise.factor
    recorded = [c in concealed.recorded_sensors(engine) for c in engine.sensors]
    return np.asarray(np.linalg.norm(((on - off) / sigma)[:, recorded], axis=1))


def trial_record(
    concealed: ConcealedTruth,
    recorded: TrialFlights,
    separation: Separability | None,
    snr: float,
    answer: ExplainAnswer,
    found: Marks,
    cells: Cells,
) -> dict[str, Any]:
    """What is kept of the trial; numbers rounded, so that a line is short and the same on every machine."""
    raw: Mapping[str, Any] = answer.raw
    return {
        "trial": concealed.trial,
        "truth": concealed.truth,
        "kind": concealed.kind,
        "causes": [c.to_json() for c in concealed.causes],
        "values": {n: short(v) for n, v in concealed.values.items()},
        "change": short(concealed.change),
        "records": int(concealed.records[: concealed.training].sum()),
        "failed_records": recorded.failed,
        "lambda": None if separation is None else short(separation.total),
        "given": [] if separation is None else [short(g) for g in separation.conditional],
        "lambda_sep": None if separation is None else short(separation.nearest),
        "rival": "" if separation is None else separation.nearest_name,
        "aliases": []
        if separation is None or separation.total < VISIBLE
        else sorted(" + ".join(sorted(a)) for a in separation.aliases),
        "scorer_converged": separation is None or separation.ok,
        "signal_to_noise": short(snr),
        "status": answer.status,
        "reason": raw.get("reason", ""),
        "error": raw.get("error", ""),
        "named": [" + ".join(sorted(a)) for a in answer.aliases],
        "probabilities": [short(p) for p in answer.probabilities],
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
