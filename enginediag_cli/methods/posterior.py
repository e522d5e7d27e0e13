"""The set of changes with the largest posterior probability: the tool's own isolation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.methods.answers import LINEARISE_FIELD, Answers, by_score
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.score import Score

_DEFAULT = SetPrior()

SECTION = Section(
    "posterior",
    "posterior probability of every set of changes",
    (
        LINEARISE_FIELD,
        Field(
            "inclusion",
            "number",
            "prior probability that a parameter changed",
            _DEFAULT.inclusion,
            minimum=1e-6,
            maximum=0.999,
        ),
        Field(
            "worn",
            "number",
            "prior probability of an engine on which any number of changes is equally probable",
            _DEFAULT.worn,
            minimum=0.0,
            maximum=1.0,
        ),
        Field(
            "sensor",
            "number",
            "prior probability that a sensor is wrong, where sensors are monitored",
            _DEFAULT.sensor,
            minimum=1e-6,
            maximum=0.999,
        ),
        Field(
            "slabs",
            "numbers",
            "sizes of a change, each as probable, in prior standard deviations of the parameter",
            _DEFAULT.slabs,
            minimum=1e-6,
        ),
        Field("largest", "integer", "largest number of changes considered", None, minimum=1),
    ),
)


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    prior = SetPrior(options["inclusion"], options["worn"], tuple(options["slabs"]), options["sensor"])

    def isolate(window: int, score: Score) -> tuple[tuple[str, ...], float]:
        found = set_posterior(score, prior, largest=options["largest"])
        return found.names(0), float(found.probabilities[0])

    return by_score(evidence, options["linearise"], isolate)
