"""What local statistics are about: the parameters, the point where the model is linear, how far each may go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class Frame:
    """`names` of p parameters; theta0 (p,): the point of linearisation, in their units; prior_sigma (p,): how large a
    change of each is plausible; meaning: what they are, by name, where it is known."""

    names: Sequence[str]
    theta0: np.ndarray
    prior_sigma: np.ndarray
    meaning: Mapping[str, Parameter] = field(default_factory=dict)
