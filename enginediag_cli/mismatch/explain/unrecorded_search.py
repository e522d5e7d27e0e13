"""What the search of drivers that no column shows is given: noise that holds nothing that switches, and its gate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from enginediag_cli.mismatch.explain.explain import UNRECORDED
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.hidden import Scan
from enginediag_cli.mismatch.unrecorded.own_noise import freed_of_switches
from enginediag_cli.progress import stage


def refit_noise_without_switches(evidence: Dataset) -> Dataset:
    """The evidence with noise that holds nothing that switches (`freed_of_switches`)."""
    rng = np.random.default_rng((evidence.settings.seed, 2))
    return freed_of_switches(evidence, level=UNRECORDED * evidence.settings.false_alarm, rng=rng)


def hidden_search(evidence: Dataset) -> Callable[[HypothesisFit], Scan]:
    """The search for effects whose driver no column shows, at a trial."""
    rng = np.random.default_rng((evidence.settings.seed, 1))
    level = UNRECORDED * evidence.settings.false_alarm

    @stage("looking for a driver that is not recorded")
    def search(trial: HypothesisFit) -> Scan:
        return Scan(trial.found, trial.projection, level, rng)

    return search
