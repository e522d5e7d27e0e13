"""Marks of what was said of a concealed law.

With t the truth, of place p, variables V and curve f over the records of the recordings, and the first of what was
said, of place p̂, groups of variables Ĝ and curve f̂; visible: λ ≥ 60 and λ_sep ≥ 25 from all that the library has:

    law_judged   visible
    law_given    a law was said                                             visible
    law_place    p̂ = p, λ_sep(p̂) < 11, or D < 11                            visible, a law was said
    law_driver   as many groups as variables, each v ∈ V correlated with
                 one of its own by more than 0.95 in these recordings       visible, a law was said
    law_driver_told  law_driver of one of those that are said to hold the
                 truth together, of which there are law_drivers_told        visible, a law was said
    law_driver_or_alike  law_driver, or D < 11                              visible, a law was said
    law_curve    D < 11                                                     visible, a law was said
    law_form     D < 11 with the law's coefficients fitted anew, too        visible, a law was said
    law_error    rms(f̂ − f − mean(f̂ − f))/(max f − min f)                    visible, p̂ = p
    law_alone    what was said acts at one place                            visible, a law was said
    stated       probability that was said of p̂ and of the places said to
                 be alike, together, beside whether law_place               visible, a law was said
    stated_driver  probability that was said of the first groups, beside
                 whether law_driver                                         visible, a law was said
    law_gain_…   see `ahead`; law_worse: whether it is worse than none      visible, a law was said
    law_false    a law was said                                             nothing concealed
    higher_at_ceiling  share of the records four kilometres higher that the
                 envelope keeps lower than that

    D = χ² of the recordings without noise with the law as it was said in place of the true one, all that is
        identified fitted anew: the non-centrality at which a test could tell the two apart

`…_of_all`: the same of all visible trials, wrong where no law was said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.drivers import SAME
from enginediag_cli.mismatch.explain.answer import FAILED, HIDDEN, LAW, NAMED, NOTHING
from enginediag_cli.validation.blind.laws.ahead import FOUND, SPLINE, gain, worse
from enginediag_cli.validation.blind.score import Marks, Said
from enginediag_cli.validation.blind.separability import Separability
from enginediag_cli.validation.blind.visible import VISIBLE

JUDGED = 60.0
"""λ from which a law is asked for."""


def null_marks(said: Said) -> Marks:
    """Where nothing is concealed."""
    if said.status == FAILED:
        return {"no_verdict": True}
    return {
        "no_verdict": False,
        "law_false": said.status == LAW,
        "law_false_name": said.status in (NAMED, HIDDEN),
        "law_false_finding": said.status != NOTHING,
    }


def judged(far: Separability) -> bool:
    """Whether the readings show the law, and that the library has nothing that says it."""
    return far.ok and far.total >= JUDGED and far.nearest >= VISIBLE


def given_marks(far: Separability, said: Said) -> Marks:
    """Whether a law was said at all, or what else."""
    if said.status == FAILED:
        return {"no_verdict": True}
    found: Marks = {"no_verdict": False, "law_judged": judged(far)}
    if not judged(far):
        return found
    found |= {"law_given": said.status == LAW, "law_found": said.status != NOTHING}
    found["law_wrong_name"] = said.status == NAMED and not any(a in far.aliases for a in said.aliases)
    return found


def same_driver(true: Sequence[str], named: Sequence[Sequence[str]], values: Mapping[str, np.ndarray]) -> bool:
    """Whether each true variable is told by a group of its own. `values`: of all variables over the records (N,)."""
    if len(true) != len(named):
        return False
    return any(
        all(any(_alike(values, v, n) for n in group) for v, group in zip(true, order, strict=True))
        for order in permutations(named)
    )


def _alike(values: Mapping[str, np.ndarray], a: str, b: str) -> bool:
    if a == b:
        return True
    if a not in values or b not in values:
        return False
    x, y = values[a], values[b]
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 2 or not np.std(x[good]) or not np.std(y[good]):
        return False
    return abs(float(np.corrcoef(x[good], y[good])[0, 1])) > SAME


def curve_error(found: np.ndarray, true: np.ndarray) -> float:
    """Of a law's curve over the records, a constant taken away, over the true one's range."""
    off = found - true
    good = np.isfinite(off)
    return float(np.std(off[good]) / max(float(np.ptp(true[good])), 1e-300)) if good.any() else float("nan")


def ahead_marks(excess: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Gains of the law and of the spline on each kind of unseen flights, and whether they are worse than no law."""
    marks: dict[str, Any] = {}
    for model, words in ((FOUND, "law"), (SPLINE, "spline")):
        own = {name: e for name, e in excess.items() if model in e}
        for name, e in own.items():
            g = gain(e, model)
            if g is not None:
                marks[f"{words}_gain_{name}"] = [g]
        if own:
            marks[f"{words}_worse"] = [float(worse(e, model)) for e in own.values()]
    return marks
