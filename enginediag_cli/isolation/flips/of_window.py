"""What would flip the answer for one window."""

from __future__ import annotations

from enginediag_cli.isolation.adequacy import tempered
from enginediag_cli.isolation.components import ComponentIsolation
from enginediag_cli.isolation.diagnosis import Diagnosis
from enginediag_cli.isolation.flips.errors import SingleError, columns_of_instruments, single_errors, stated_errors
from enginediag_cli.isolation.flips.flips import Flips, flips_of_components, flips_of_parameters
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.window import WindowStatistics


def flips_of_diagnosis(diagnosis: Diagnosis, window: WindowStatistics, monitor: Monitor | None) -> Flips | None:
    """Of the first set of parameters; None of a method without a posterior. monitor: None where it is not at hand, and
    errors are measured by what is plausible."""
    belief = diagnosis.belief
    if belief is None:
        return None
    return flips_of_parameters(belief, _errors(belief.score, window, monitor))


def flips_of_isolated_components(
    found: ComponentIsolation,
    score: Score,
    prior: SetPrior,
    window: WindowStatistics,
    monitor: Monitor | None,
    largest: int | None = None,
) -> Flips:
    """Of the components that are named; score: of which they were isolated."""
    score = tempered(score, found.adequacy.noise)
    return flips_of_components(score, prior, _errors(score, window, monitor), largest)


def _errors(score: Score, window: WindowStatistics, monitor: Monitor | None) -> tuple[SingleError, ...]:
    """Errors of what gave a reading."""
    if monitor is None:
        errors = single_errors(score, {}, {}, {})
    else:
        readings = {**window.conditions, **window.readings}
        stated = stated_errors(monitor, readings, window.flown)
        errors = single_errors(score, stated, columns_of_instruments(monitor), readings)
    return tuple(error for error in errors if error.what not in window.silent)
