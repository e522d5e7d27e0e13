"""A fleet as a whole: which engines stand out, and what all of them have in common.

The judgement of a fleet: which engines stand out, in which order, how long they last, and what is common to all.

What engines of a fleet have in common: a random-effects mean of each parameter's change.

Engine e reads off by r_e (m,) after its baseline, with scatter S_e and mean r̄ over the fleet, of covariance

    R = cov(r_e)/n + diag (h r̄)²

the second part what wrong slopes of the maps make of it in all engines alike, which no number of them averages out. One
component, or instrument, with effects J (m, k) of one prior standard deviation, or nothing, is what all have in common:

    C = (Jᵀ R⁻¹ J + 1)⁻¹,   μ = C Jᵀ R⁻¹ r̄,   ln P(r̄ | component)/P(r̄ | nothing) = ½ μᵀ C⁻¹ μ + ½ ln |C|

Its changes in each engine, by the same map with S_e in the place of R, have a spread τ, by moments (R. DerSimonian, N.
Laird, Controlled Clin. Trials 7 (1986) 177–188); the error of their mean is that of its weighted scatter (J. Hartung,
G. Knapp, Stat. Med. 20 (2001) 3875–3889) and C. What most engines have alike is no fault of one: physics that the model
lacks, an error of the recorder or of a kind of instrument, or wear that all share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.detection.e_values import listed
from enginediag_cli.fleets.finding import (
    CHANGED,
    NO_VERDICT,
    CommonChange,
    Discoveries,
    EngineFinding,
    Estimate,
    FleetFinding,
    FleetSettings,
    State,
)
from enginediag_cli.fleets.margin import with_forecasts
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.isolation.over_time import GENERIC
from enginediag_cli.parameters import Parameter, meanings

FEWEST_ENGINES = 5
"""Engines of which it is said what they have in common, at least."""
MOST = 0.9
"""Share of the engines that have a change the same way, where it is called alike."""
NOTHING = 0.5
"""Probability beforehand that engines have nothing in common."""
CLASS = 0.95
"""Probability that those which are told to be common hold together."""


def random_effects(x: np.ndarray, v: np.ndarray) -> tuple[float, float, float]:
    """Mean, its standard error, and standard deviation τ between engines, of changes x (n,) with variances v (n,)."""
    w = 1 / v
    fixed = float(w @ x / w.sum())
    Q = float(w @ (x - fixed) ** 2)
    scale = float(w.sum() - (w**2).sum() / w.sum())
    between = max((Q - (len(x) - 1)) / scale, 0.0) if scale > 0 else 0.0
    w = 1 / (v + between)
    mean = float(w @ x / w.sum())
    q = float(w @ (x - mean) ** 2) / (len(x) - 1)
    return mean, float(np.sqrt(max(q, 1.0) / w.sum())), float(np.sqrt(between))


def common_changes(
    findings: Sequence[EngineFinding], known: Mapping[str, Parameter] | None = None
) -> tuple[CommonChange, ...]:
    """What engines have in common, of each parameter, those that are alike first, surest first; known: what the
    parameters are."""
    by_kind: dict[tuple[tuple[str, ...], int], list[State]] = {}
    for finding in findings:
        if finding.state is not None:
            state = finding.state
            by_kind.setdefault((state.parameters, len(state.off)), []).append(state)
    told: list[tuple[float, CommonChange]] = []
    for (names, _), states in by_kind.items():
        if len(states) >= FEWEST_ENGINES:
            told += _of_a_kind(states, tuple(meanings(known or {}, names).values()))
    return tuple(change for _, change in sorted(told, key=lambda pair: (not pair[1].common, pair[0])))


def _of_a_kind(states: Sequence[State], described: Sequence[Parameter]) -> list[tuple[float, CommonChange]]:
    from scipy.special import ndtr

    off, S = np.stack([s.off for s in states]), np.stack([s.covariance for s in states])
    effect, unit, n = np.mean([s.effect for s in states], axis=0), states[0].unit, len(states)
    mean = off.mean(axis=0)
    wrong = np.diag((GENERIC * mean) ** 2)
    # fewer engines than readings do not tell how these go together: what flights scatter by is the least
    between = np.cov(off.T) * (n - 1) / (n + len(mean)) + S.mean(axis=0)
    W, W1 = np.linalg.inv(between / n + wrong), np.linalg.inv(S.mean(axis=0) + wrong)
    groups: dict[str, list[int]] = {}
    for k, p in enumerate(described):
        if np.abs(effect[:, k]).max() > 0:
            groups.setdefault(p.component, []).append(k)
    log = {"": np.log(NOTHING)}
    told = {}
    for component, at in groups.items():
        J = effect[:, at]
        C = np.linalg.inv(J.T @ W @ J + np.eye(len(at)))
        middle = C @ (J.T @ W @ mean)
        odds = 0.5 * middle @ np.linalg.solve(C, middle) + 0.5 * np.linalg.slogdet(C)[1]
        log[component] = float(odds + np.log((1 - NOTHING) / len(groups)))
        G = np.linalg.solve(J.T @ W1 @ J + np.eye(len(at)), J.T @ W1)
        told[component] = off @ G.T, np.einsum("pm,nmk,pk->np", G, S, G), np.diag(C)
    total = np.logaddexp.reduce(list(log.values()))
    chance = {c: float(np.exp(x - total)) for c, x in log.items()}
    named = _class(chance)
    found = []
    for component, at in groups.items():
        x, v, left = told[component]
        for k, i in enumerate(at):
            p = described[i]
            average, error, spread = random_effects(x[:, k], v[:, k])
            half = float(NORMAL_95 * unit[i] * np.hypot(error, np.sqrt(left[k])))
            alike = float(ndtr(abs(average) / spread)) if spread > 0 else 1.0
            common = component in named and alike >= MOST
            value = float(unit[i] * average)
            found.append(
                (
                    -chance[component],
                    CommonChange(
                        p.name,
                        component,
                        p.words or p.name,
                        p.shown_unit,
                        Estimate(value, value - half, value + half),
                        float(unit[i] * spread),
                        n,
                        alike,
                        chance[component],
                        common,
                        _reading(average, p, len(named)) if common else "",
                    ),
                )
            )
    return found


def _class(chance: Mapping[str, float]) -> tuple[str, ...]:
    """Components, likeliest first, that hold CLASS of the probability; none where nothing in common is among them."""
    told: list[str] = []
    for component in sorted(chance, key=lambda c: -chance[c]):
        told.append(component)
        if sum(chance[c] for c in told) >= CLASS:
            break
    return () if "" in told else tuple(told)


def _reading(mean: float, parameter: Parameter, among: int) -> str:
    """What a common change may be."""
    if parameter.of_instrument:
        what = "an error of the recorder or of this kind of instrument, or physics that the model lacks"
    elif parameter.wear and np.sign(mean) == parameter.wear:
        what = "wear that all engines share, or physics that the model lacks"
    else:
        what = "physics that the model lacks, or an error of the recorder; no wear of single engines"
    return f"{what}{'; it, or another of those told beside it' if among > 1 else ''}: see locate and explain"


def judged_fleet(
    findings: Sequence[EngineFinding], settings: FleetSettings, known: Mapping[str, Parameter] | None = None
) -> FleetFinding:
    """The fleet of these engines. known: what the parameters are, as a series knows them."""
    judged = [f for f in findings if f.verdict != NO_VERDICT or np.isfinite(f.log10_e)]
    chosen = listed(np.array([f.log10_e for f in judged]) * np.log(10), settings.false_discovery)
    found = {f.serial for f, of_them in zip(judged, chosen.tolist(), strict=True) if of_them}
    told = with_forecasts([_listed(f) if f.serial in found else f for f in findings], settings)
    ranked = sorted(told, key=lambda f: -np.nan_to_num(f.severity.value, nan=-np.inf))
    names = [f.serial for f in sorted(judged, key=lambda f: -f.log10_e) if f.serial in found]
    return FleetFinding(
        tuple(ranked),
        Discoveries(tuple(names), settings.false_discovery, bound_in_words(len(names), settings.false_discovery)),
        common_changes(findings, known),
        tuple((f.serial, f.reason) for f in findings if f.verdict == NO_VERDICT),
    )


def _listed(finding: EngineFinding) -> EngineFinding:
    """A finding on the list, which is a change whatever its own false-alarm probability says."""
    if finding.verdict == CHANGED:
        return replace(finding, discovery=True)
    reason = "its evidence is enough for the fleet's list, and not for an alarm of its own"
    return replace(finding, discovery=True, verdict=CHANGED, reason=reason)


def bound_in_words(count: int, level: float) -> str:
    """What a list of so many engines promises."""
    share = f"{100 * level:g} %"
    if not count:
        return f"no engine is listed; of lists made so, at most {share} of the engines on them are healthy on average"
    return (
        f"of the engines listed ({count}) at most {share} are healthy, on average over such lists, whenever one looks "
        "and however the engines depend on each other"
    )
