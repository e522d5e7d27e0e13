"""A sensor and a component as rivals: is the instrument wrong, or the engine?"""

from __future__ import annotations

from dataclasses import dataclass

from enginediag_cli.isolation.result import Explanation, IsolationResult
from enginediag_cli.residuals.score import Score

LEAST = 0.05
"""A rival this much less probable than the other, or less, is no rival."""


@dataclass(frozen=True)
class SensorRivalry:
    """Two explanations that differ by a sensor's error in one and a component's change in the other.

    `sensors` and `components`: what is only in the one, and only in the other; `shared`: what is in both.
    """

    sensors: tuple[str, ...]
    components: tuple[str, ...]
    shared: tuple[str, ...]
    of_sensors: float
    of_components: float


def sensor_rivalry(result: IsolationResult, score: Score) -> SensorRivalry | None:
    """The most probable pair of explanations, one of them the answer, in which a sensor stands against a
    component; None when there is no such pair or one of the two is improbable. `score`: of which the result was made,
    which knows what is a sensor's error."""
    answer, sensors = set(result.isolated), {p.name for p in score.described if p.of_instrument}
    for rival in result.rivals:
        if rival.probability < LEAST * result.probability:
            continue
        only_answer, only_rival = answer - set(rival.parameters), set(rival.parameters) - answer
        if not only_answer or not only_rival:
            continue
        if only_answer <= sensors and not only_rival & sensors:
            return _rivalry(only_answer, only_rival, answer, result.probability, rival)
        if only_rival <= sensors and not only_answer & sensors:
            return _rivalry(only_rival, only_answer, answer, rival.probability, rival, result.probability)
    return None


def _rivalry(
    sensors: set[str],
    components: set[str],
    answer: set[str],
    of_sensors: float,
    rival: Explanation,
    of_components: float | None = None,
) -> SensorRivalry:
    return SensorRivalry(
        tuple(sorted(sensors)),
        tuple(sorted(components)),
        tuple(sorted(answer & set(rival.parameters))),
        of_sensors,
        rival.probability if of_components is None else of_components,
    )
