"""Prints what switches on and off in the Citation's flight b22 without any column showing it, and when.

    python tests/real_runs/citation_mismatch.py

Each engine is identified on flight_ref (`identify`), in which nothing switches; then both flights are searched for an
amplitude without a recorded driver, and every rival is refitted with everything else at the states found, within its
physical bounds. No label exists: the checks are the other engine, the other flight, and the raw steps.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ground_recordings import CONFIGS, enginediag, public_data

from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.unrecorded_search import refit_noise_without_switches
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    nuisance,
    stack_column,
)
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.refine.refine import fit_both
from enginediag_cli.mismatch.refine.switch import inferred, switch_column
from enginediag_cli.mismatch.refine.unseen import concealed, predicted
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, hidden_amplitudes
from enginediag_cli.mismatch.unrecorded.switched import (
    effects_that_switch,
    states_of,
    switched_effect,
    switched_parameters,
    switched_trials,
)
from enginediag_cli.physics.registry import candidate_effects, effect
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder_file import load_recorder

ENGINE = CONFIGS / "citation_jt15d.yaml"
RECORDER = CONFIGS / "recorders" / "citation_jt15d.yaml"
SIDES = ("left", "right")
REF, B22 = "flight_ref.csv", "flight_b22.csv"
BLEED = ("anti_ice_bleed", "hpc")
N2_POINT_RPM = 327.6
FULL_N1_RPM = 15900.0
HIGH_POWER = 0.90
"""Above this share of N1 the step of fuel flow nearly vanishes: states there are told apart, but judged with doubt."""

RAW_STEPS_S = ((1476.0, False), (2337.0, True), (2626.0, False), (3660.0, True), (4051.0, False))
"""When fuel flow and ITT step in the raw 1 Hz recording of b22, and whether upwards."""

RIVALS = {
    "LPT efficiency": ("lpt", ("lpt.efficiency",)),
    "HPT flow capacity": ("hpt", ("hpt.flow_capacity",)),
    "HPC efficiency": ("hpc", ("hpc.efficiency",)),
    "core nozzle area": ("core_nozzle", ("core_nozzle.area",)),
    "fuel meter": ("sensor.Wf", ("sensor.Wf.scale",)),
    "thermocouples": ("sensor.ITT", ("sensor.ITT.bias",)),
    "fuel meter and thermocouples at once": ("sensors", ("sensor.Wf.scale", "sensor.ITT.bias")),
    "fuel meter, thermocouples and N2 at once": ("sensors", ("sensor.Wf.scale", "sensor.ITT.bias", "sensor.N2.scale")),
}
"""What cannot switch within seconds and back (parts), and what takes one or several instruments at the same time."""

Says = Callable[[str], None]
Errors = tuple[float, float, float]
"""N2 in points, ITT in K, fuel flow in per cent."""


@dataclass(frozen=True)
class Found:
    """One engine's search: the fit without any effect, hidden findings, likeliest place first, and the one of the
    listed effect that explains them best."""

    side: str
    evidence: Dataset
    along: Nuisance
    base: IdentifiedHypothesis
    findings: tuple[HiddenFinding, ...]
    first: HiddenFinding

    @property
    def states(self) -> np.ndarray:
        """1 for on, over all records of the evidence, (N,)."""
        return states_of(self.first, self.evidence)

    def of(self, flight: str) -> np.ndarray:
        """Records of the evidence that belong to a flight, (N,) bool."""
        sizes = [len(f.columns["time_s"]) for f in self.evidence.flights]
        return np.repeat([f.label.startswith(flight) for f in self.evidence.flights], sizes)


def nominal(folder: Path, flights: Path, side: str) -> Path:
    """Nominal state of one engine, identified on flight_ref."""
    path = folder / f"{side}.yaml"
    if not path.exists():
        enginediag("identify", ENGINE, flights / REF, "--recorder", RECORDER, "--engine-instance", side, "-o", path)
    return path


def load(flights: Path, names: Sequence[str], side: str, nominal_path: Path) -> Dataset:
    source = RecordingSource(tuple(str(flights / n) for n in names), str(RECORDER), side)
    return load_case(RecordedCase(str(ENGINE), source, str(nominal_path))).evidence


def search(evidence: Dataset, side: str) -> Found:
    """Fit without any effect, and the search for an amplitude that no column records."""
    evidence = refit_noise_without_switches(evidence)
    along = nuisance(evidence)
    base = identify_with(evidence, NULL_HYPOTHESIS, along)
    rng = np.random.default_rng(evidence.settings.seed)
    trial = HypothesisFit((), base, Projection(base))
    findings = hidden_amplitudes(base, trial.projection, level=0.01, rng=rng, along=along)
    listed = effects_that_switch(findings, list(candidate_effects(evidence.engine)), trial, along)
    return Found(side, evidence, along, base, tuple(findings), listed[0] if listed else findings[0])


def options(found: Found) -> dict[str, Option]:
    """Listed effects that may be on or off without a column showing it, and rivals that may not."""
    engine = found.evidence.engine
    result = {e.label: switched_effect(e) for e in candidate_effects(engine) if e.term.SWITCHES}
    own = {name: switched_parameters(name, place, targets, found.base) for name, (place, targets) in RIVALS.items()}
    return {**result, **own}


def refitted(found: Found) -> dict[str, HypothesisFit]:
    """Every rival refitted with everything else at the states found, lowest χ² first."""
    named = options(found)
    trials = switched_trials(list(named.values()), found.states, found.base, found.along)
    return {t.label: t for t in trials}


def two_state_rms(trial: HypothesisFit | None, found: Found) -> Mapping[str, Errors]:
    """RMS in b22 by state: N2 in points, ITT in K, fuel flow in per cent, at a fit of both flights."""
    fit = found.base if trial is None else trial.found
    e, y = fit.fit.equations.residual, fit.problem.measured
    here = found.of(B22)[fit.number]
    on = found.states[fit.number] > 0.5
    return {name: errors(e[here & rows], y[here & rows]) for name, rows in (("on", on), ("off", ~on))}


def errors(e: np.ndarray, y: np.ndarray) -> Errors:
    """RMS of N2 in points, ITT in K and fuel flow in per cent of residuals and readings (N, 3) in this order."""
    rms = np.sqrt(np.nanmean(e**2, axis=0))
    return float(rms[0]) / N2_POINT_RPM, float(rms[1]), 100.0 * float(np.sqrt(np.nanmean((e[:, 2] / y[:, 2]) ** 2)))


# switch times, from 1 Hz


@dataclass(frozen=True)
class Change:
    """A change of state at 1 Hz, bracketed by the records of 10 s: `time_s`, the T statistic of the step there, and
    N1 over full speed with its range within 25 s."""

    time_s: float
    on: bool
    statistic: float
    N1: float
    N1_range: float

    @property
    def steady(self) -> bool:
        return self.N1_range < 0.01


def changes(found: Found, trial: HypothesisFit, flights: Path, half_s: int = 25) -> list[Change]:
    """Time of each change of state between the last record of the old state and the first of the new one: where a
    step along the effect's own direction, beside a level and a drift of every reading, explains most at 1 Hz."""
    second = {m.engine: m.recording for m in load_recorder(RECORDER).map(read_all(flights / B22), steady=False)}
    recording = second[found.side]
    t = recording["time_s"]
    sensors, sigma = trial.found.problem.sensors, trial.found.problem.sigma
    inputs = {
        c: recording[c]
        for c in (*found.evidence.engine.inputs, *found.evidence.engine.optional_inputs)
        if c in recording.columns
    }
    column = trial.options[0].hypothesis.effects[0].switch
    theta = {n: v for n, v in trial.found.theta.items() if "|" not in n}
    off, on = (
        trial.found.model.engine.predict({**inputs, column: np.full(len(t), s)}, theta, sensors=sensors).y
        for s in (0.0, 1.0)
    )
    measured = np.column_stack([recording[s] for s in sensors])
    e, c = (measured - off) / sigma, (on - off) / sigma
    rows = found.of(B22)
    at, states = stack_column(found.evidence, "time_s")[rows], found.states[rows]
    result = []
    for k in np.flatnonzero(np.diff(states) != 0):
        low, high = at[k] - 5.0, at[k + 1] + 5.0
        sign = 1.0 if states[k + 1] > 0.5 else -1.0
        tried = [(step_statistic(t, e, c, s, half_s, sign), s) for s in np.arange(low, high + 1.0)]
        best, when = max(tried)
        near = np.abs(t - when) <= half_s
        N1 = recording["N1_rpm"][near] / FULL_N1_RPM
        result.append(Change(float(when), bool(sign > 0), best, float(np.nanmean(N1)), float(np.ptp(N1))))
    return result


def step_statistic(t: np.ndarray, e: np.ndarray, c: np.ndarray, at: float, half_s: float, sign: float) -> float:
    """T of a step of ±1 along c (n, m) at time `at` in residuals e (n, m), level and drift of each reading free; 0
    where the step has the wrong sign."""
    near = np.abs(t - at + 0.5) <= half_s
    near &= np.isfinite(e).all(axis=1) & np.isfinite(c).all(axis=1)
    if near.sum() < half_s:
        return 0.0
    x = t[near] - at
    A = np.linalg.qr(np.column_stack([np.ones(len(x)), x]))[0]
    column = c[near] * (x >= 0.0)[:, None] * sign
    column, left = (v - A @ (A.T @ v) for v in (column, e[near]))
    pull, length = float((column * left).sum()), float((column**2).sum())
    return pull * abs(pull) / length if pull > 0.0 else 0.0


# what has not been seen


@dataclass(frozen=True)
class Judged:
    """An unseen flight: time of each record and whether the effect is inferred on (n,), and RMS (N2 points, ITT K,
    fuel flow %) by state without and with the effect. `zeroed`: the same with each instrument set to zero, for both
    models alike, by its mean error in the off state of that flight (`off_error`)."""

    time_s: np.ndarray
    on: np.ndarray
    before: Mapping[str, Errors]
    after: Mapping[str, Errors]
    zeroed_before: Errors
    zeroed_after: Errors
    off_error: Errors


def judged(known: Dataset, states: np.ndarray, unseen: Flight, coefficient: float | None = None) -> Judged:
    """The model with and without the bleed, fitted to the `known` flights with their states (N,), put to an unseen one:
    its own offsets are not fitted, its states are inferred from its readings. `coefficient`: of the bleed, where the
    known flights do not show it."""
    bleed = effect(known.engine, *BLEED)
    column, name = switch_column(bleed), bleed.amplitudes[0]
    bleed = replace(bleed, switch=column)
    sizes = np.cumsum([len(f.columns["time_s"]) for f in known.flights])[:-1]
    flights = [_with(f, column, s) for f, s in zip(known.flights, np.split(states, sizes), strict=True)]
    joint = replace(known, flights=(*flights, _with(unseen, column, np.zeros(len(unseen.columns["time_s"])))))
    if coefficient is not None:
        means = {**joint.settings.prior_mean, name: coefficient}
        joint = replace(joint, settings=replace(joint.settings, prior_mean=means))
    k = len(flights)
    hidden = concealed(joint, [k])
    along = nuisance(hidden)
    before, after = fit_both(hidden, [bleed], along)
    assert before.converged and after.converged
    state = inferred(joint, k, after, along, bleed)
    on = np.zeros(len(unseen.columns["time_s"]))
    on[state.number] = state.on
    told = replace(joint, flights=(*flights, _with(unseen, column, on > 0.5)))
    plain, zeroed, shift = [], [], np.zeros(3)
    for trial in (before, after):
        p = predicted(told, [k], trial, along)
        e, y, rows = p.fit.equations.residual, p.problem.measured, on[p.number] > 0.5
        plain.append({s: errors(e[r], y[r]) for s, r in (("on", rows), ("off", ~rows)) if r.any()})
        scaled = e / np.where(np.arange(3) == 2, y, 1.0)
        shift = np.nanmean(scaled[~rows], axis=0)
        zeroed.append(errors((scaled[rows] - shift) * np.where(np.arange(3) == 2, y[rows], 1.0), y[rows]))
    off = (float(shift[0]) / N2_POINT_RPM, float(shift[1]), 100.0 * float(shift[2]))
    return Judged(np.asarray(unseen.columns["time_s"]), on > 0.5, plain[0], plain[1], zeroed[0], zeroed[1], off)


def _with(f: Flight, column: str, values: np.ndarray) -> Flight:
    return replace(f, columns={**f.columns, column: np.asarray(values, float)})


def cut(flight: Flight, at_s: float) -> tuple[Flight, Flight]:
    """A flight before and after a time."""
    early = np.asarray(flight.columns["time_s"]) < at_s
    one, other = ({c: v[rows] for c, v in flight.columns.items()} for rows in (early, ~early))
    return (
        replace(flight, label=f"{flight.label} first part", columns=one),
        replace(flight, label=f"{flight.label} second part", columns=other),
    )


# the story


def told(title: str, e: Errors) -> str:
    return f"{title}: N2 {e[0]:.2f} points, ITT {e[1]:.1f} K, fuel flow {e[2]:.2f} %"


def main(flights: Path, say: Says = print) -> None:
    with tempfile.TemporaryDirectory() as folder:
        story(flights, Path(folder), say)


def story(flights: Path, folder: Path, say: Says) -> None:
    found, trials = {}, {}
    for side in SIDES:
        f = search(load(flights, (REF, B22), side, nominal(folder, flights, side)), side)
        found[side], trials[side] = f, refitted(f)
        say(
            f"{side} engine: chi2 {Projection(f.base).objective:.0f} of {Projection(f.base).dof} readings without it; "
            f"ln likelihood ratio of a hidden amplitude (gate {f.first.threshold:.0f}):"
        )
        say("  " + ", ".join(f"{h.location.name} {h.lr:.0f}" for h in f.findings[:8]))
        say(
            f"  {f.first.location.name}: ln evidence of two states {f.first.switch_lr:.0f}, of a continuous amplitude "
            f"{f.first.continuous_lr:.0f}; on in flight_ref: {int(f.states[f.of(REF)].sum())} of {f.of(REF).sum()}"
        )
        for label, t in trials[side].items():
            values = ", ".join(f"{n.split('|')[0]} {v:.4g} ± {s:.2g}" for n, (v, s) in t.coefficients.items())
            say(
                f"  chi2 {t.objective:6.0f}  {label}: {values}"
                + ("  AT ITS BOUND" if t.at_bound else "")
                + ("" if t.converged else "  did not converge")
            )
        bleed = trials[side]["@".join(BLEED)]
        for name, t in (("without", None), ("with", bleed)):
            for state, e in two_state_rms(t, f).items():
                say("  " + told(f"b22 {state}, {name} the bleed", e))
    left, right = (
        dict(zip(stack_column(f.evidence, "time_s")[f.of(B22)], f.states[f.of(B22)], strict=True))
        for f in found.values()
    )
    both = [t for t in left if t in right]
    say(f"left and right state agree in {sum(left[t] == right[t] for t in both)} of {len(both)} common records")
    for side in SIDES:
        for c in changes(found[side], trials[side]["@".join(BLEED)], flights):
            say(
                f"  {side}: {'on ' if c.on else 'off'} at {c.time_s:.0f} s (T {c.statistic:.0f}), "
                f"N1 {100 * c.N1:.0f} %, moving by {100 * c.N1_range:.1f} %"
            )
    for side, other in (SIDES, SIDES[::-1]):
        coefficient = trials[side]["@".join(BLEED)].coefficients[".".join((*BLEED, "fraction"))][0]
        known = load(flights, (REF,), other, nominal(folder, flights, other))
        f = found[other]
        j = judged(known, np.zeros(int(f.of(REF).sum())), f.evidence.flights[1], coefficient)
        say(f"{other} engine in b22, unseen: identified on flight_ref, bleed as found on the {side} engine")
        _judged(say, j)
    for side in SIDES:
        f = found[side]
        first, second = cut(f.evidence.flights[1], RAW_STEPS_S[2][0])
        train = search(replace(f.evidence, flights=(f.evidence.flights[0], first)), side)
        j = judged(train.evidence, train.states, second)
        say(f"{side} engine, second part of b22 unseen: bleed and states found on flight_ref and the first part")
        _judged(say, j)


def _judged(say: Says, j: Judged) -> None:
    at = np.flatnonzero(np.diff(j.on.astype(int)) != 0)
    say(
        "  inferred: "
        + ("on" if j.on[0] else "off")
        + "".join(
            f", {'on' if j.on[k + 1] else 'off'} between {j.time_s[k]:.0f} and {j.time_s[k + 1]:.0f} s" for k in at
        )
    )
    for state in j.before:
        say("  " + told(f"{state}, without", j.before[state]) + "; " + told("with", j.after[state]))
    say("  " + told("instruments off by, mean of the off state", j.off_error))
    say("  " + told("on, that taken off, without", j.zeroed_before) + "; " + told("with", j.zeroed_after))


if __name__ == "__main__":
    main(public_data("c550_jt15d"))
    sys.exit(0)
