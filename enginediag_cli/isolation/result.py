"""What isolation hands over: the set, how sure, its rivals, the sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from enginediag_cli.isolation.classes import Class
from enginediag_cli.isolation.sizes import ParameterChange


@dataclass(frozen=True)
class Explanation:
    """A set of changed parameters with its probability (posterior) or p value (tests)."""

    parameters: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class IsolationResult:
    """Outcome of one isolation method.

    isolated: changed parameters, empty when none; probability that these changed and nothing else that matters
    (`averaging.least_that_matters`; NaN for methods without one); rivals: other sets that the data cannot exclude,
    likeliest first, which together with the answer hold `coverage`; rivals_left_out: how many more were not listed;
    inclusion: probability per parameter that it changed (empty for methods without one); sizes of the isolated
    parameters; complete: False when the method stopped at a limit before it was satisfied; note says why in plain
    words. one_of: the class of which the answer is the likeliest member, where these data cannot tell its members
    apart, or None. Sets that differ by the form of an instrument's error (bias, scale, drift) are one, named by the
    likeliest form; forms: of an isolated instrument the chance of each form, given that it is wrong.
    """

    method: str
    isolated: tuple[str, ...]
    probability: float
    rivals: tuple[Explanation, ...]
    rivals_left_out: int
    coverage: float
    inclusion: dict[str, float]
    sizes: tuple[ParameterChange, ...]
    complete: bool = True
    note: str = ""
    one_of: Class | None = None
    forms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
