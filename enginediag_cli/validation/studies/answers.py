"""What a study counts of a method's verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.methods.base import PARAMETERS, Verdicts


@dataclass(frozen=True)
class Answers:
    """On W windows: judged (W,): there is a verdict; detected (W,); isolated (W, p) bool, None for a method that
    names no parameters; probability (W,) that the answer is right, NaN for a method that states none."""

    judged: np.ndarray
    detected: np.ndarray
    isolated: np.ndarray | None
    probability: np.ndarray


def answers_of(verdicts: Verdicts, parameters: Sequence[str]) -> Answers:
    """Methods that name sensors, not parameters, or nothing, are judged on detection only.

    A method that can say what is likeliest without an alarm is asked for that on every window.
    """
    named = verdicts.isolated if verdicts.likeliest is None else verdicts.likeliest
    W = len(verdicts.converged)
    isolated = None
    if named is not None and verdicts.kind == PARAMETERS:
        isolated = np.zeros((W, len(parameters)), bool)
        isolated[:, [list(parameters).index(name) for name in verdicts.names]] = named
    probability = np.full(W, np.nan) if verdicts.probability is None else verdicts.probability
    return Answers(verdicts.judged, verdicts.alarm, isolated, probability)
