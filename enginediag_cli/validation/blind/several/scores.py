"""Lines of the score sheet of several causes, with their targets."""

from __future__ import annotations

from collections.abc import Mapping

from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.line import Score

_TWO, _THREE, _FOUR = ((k,) for k in kinds.SEVERAL_KINDS)

SEVERAL_SCORES: Mapping[str, Score] = {
    "several_all_of_two": Score("several_all", _TWO, ">= 0.85", ">= 0.85"),
    "several_all_of_three": Score("several_all", _THREE, ">= 0.70", ">= 0.70"),
    "several_all_of_four": Score("several_all", _FOUR),
    "several_share": Score("several_share", kinds.SEVERAL_KINDS, size=True),
    "several_none_false": Score("several_none_false", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_none_told_false": Score("several_none_told_false", kinds.SEVERAL_KINDS),
    "several_unexplained": Score("several_unexplained", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_no_verdict": Score("no_verdict", kinds.SEVERAL_KINDS),
}
"""What each of them counts is in `opened`."""
