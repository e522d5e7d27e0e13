"""What a rule for a derived column consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Section

Columns = Mapping[str, np.ndarray]
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class Rule:
    """section: the YAML keys; needs: the columns that these settings ask for; compute: the column (N,); one_unit: these
    columns and that one must be in the same unit.

    Missing values (NaN) in give missing values out.
    """

    section: Section
    needs: Callable[[Settings], list[str]]
    compute: Callable[[Columns, Settings], np.ndarray]
    one_unit: bool = False
