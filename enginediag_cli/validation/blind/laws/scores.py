"""Lines of the score sheet of laws, with their targets."""

from __future__ import annotations

from collections.abc import Mapping

from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.line import MEDIAN, RIGHT_LESS_STATED, Score

_LAW, _NULL = (f"{kinds.SINGLE}_{kinds.LAW}",), (f"{kinds.NULL}_{kinds.LAW}",)
PLACE, DRIVER, CURVE = (">= 0.97", ">= 0.90"), (">= 0.93", ">= 0.93"), (">= 0.85", ">= 0.85")
"""Targets of truths from the same model and of truths with other maps, where a name is asked for often enough."""
WORSE, ERROR = ("<= 0.03", "<= 0.03"), ("<= 0.05", "<= 0.05")
GAIN, GAIN_HIGHER = (">= 0.95", ">= 0.95"), (">= 0.90", ">= 0.90")
STATED = ("within 0.05", "within 0.05")

LAW_SCORES: Mapping[str, Score] = {
    "law_judged": Score("law_judged", _LAW),
    "law_given": Score("law_given", _LAW),
    "law_found": Score("law_found", _LAW),
    "law_wrong_name": Score("law_wrong_name", _LAW),
    "law_place": Score("law_place", _LAW, *PLACE),
    "law_place_of_all": Score("law_place_of_all", _LAW, *PLACE),
    "law_place_exact": Score("law_place_exact", _LAW),
    "law_component": Score("law_component", _LAW),
    "law_driver": Score("law_driver", _LAW, *DRIVER),
    "law_driver_of_all": Score("law_driver_of_all", _LAW, *DRIVER),
    "law_driver_told": Score("law_driver_told", _LAW),
    "law_drivers_told": Score("law_drivers_told", _LAW, size=True),
    "law_driver_or_alike": Score("law_driver_or_alike", _LAW),
    "law_curve": Score("law_curve", _LAW, *CURVE),
    "law_curve_of_all": Score("law_curve_of_all", _LAW, *CURVE),
    "law_form": Score("law_form", _LAW),
    "law_alone": Score("law_alone", _LAW),
    "law_error": Score("law_error", _LAW, *ERROR, how=MEDIAN),
    "law_gain_unseen": Score("law_gain_unseen", _LAW, *GAIN, how=MEDIAN),
    "law_gain_higher": Score("law_gain_higher", _LAW, *GAIN_HIGHER, how=MEDIAN),
    "law_worse": Score("law_worse", _LAW, *WORSE),
    "spline_gain_unseen": Score("spline_gain_unseen", _LAW, how=MEDIAN),
    "spline_gain_higher": Score("spline_gain_higher", _LAW, how=MEDIAN),
    "spline_worse": Score("spline_worse", _LAW),
    "higher_at_ceiling": Score("higher_at_ceiling", _LAW, size=True),
    "law_place_right_less_stated": Score("stated", _LAW, *STATED, how=RIGHT_LESS_STATED),
    "law_driver_right_less_stated": Score("stated_driver", _LAW, how=RIGHT_LESS_STATED),
    "law_false": Score("law_false", _NULL, "<= 0.02", "<= 0.05"),
    "law_false_name": Score("law_false_name", _NULL),
    "law_false_finding": Score("law_false_finding", _NULL),
    "law_no_verdict": Score("no_verdict", kinds.LAW_KINDS),
}
"""What each of them counts is in `marks`."""
