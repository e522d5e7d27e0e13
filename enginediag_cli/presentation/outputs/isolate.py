"""Rows of `isolate`: one per window and isolated parameter, or one per window with its components."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.beside import ASKED_FLIPS, ASKED_SCOPE, FLIPS, SCOPE
from enginediag_cli.presentation.outputs.declared import Table, column
from enginediag_cli.presentation.outputs.windows import INSTRUMENTS, WINDOW

_TESTED = (
    column("verdict", "text", "healthy, fault, no verdict, or cannot tell where the leading answer does not stand"),
    column("p_value", "number", "probability of such a statistic where nothing changed", empty=True),
    column("fit_before", "number", "χ² per degree of freedom without any answer", empty=True),
    column("fit", "number", "χ² per degree of freedom that the answer leaves", empty=True),
    column("explained", "number", "share of the excess χ² that the answer takes away", empty=True),
    column("unlisted", "number", "probability that it is something that is not among the suspects", empty=True),
)
_CLASS = (
    column("class", "number", "probability that one of `members` is it", empty=True),
    column("members", "texts", "answers that the data cannot tell apart", empty=True),
    column("would_tell", "texts", "sensors that would tell the members apart", empty=True),
)

ISOLATE = Table(
    "isolate",
    1,
    "one row per window and isolated parameter, a single one where none is isolated",
    (
        *WINDOW,
        *_TESTED,
        INSTRUMENTS,
        column(
            "isolated", "texts", "the set of parameters that changed, with the instruments that are wrong", empty=True
        ),
        column(
            "probability",
            "number",
            "probability that these changed and nothing else that matters; with those of all others and `unlisted`, 1",
            empty=True,
        ),
        *_CLASS,
        column("parameter", "text", "the parameter that this row is about", empty=True),
        column("inclusion", "number", "probability that this parameter changed, in any set", empty=True),
        column("change", "number", "its change from nominal", "of the parameter", empty=True),
        column("lower", "number", "lower end of the change's interval (--confidence)", "of the parameter", empty=True),
        column("upper", "number", "upper end of the change's interval (--confidence)", "of the parameter", empty=True),
        column("unit", "text", "unit of the change; 1 is a share of nominal", empty=True),
        column("percent", "number", "the change in per cent of nominal", "%", empty=True),
        column("rivals", "texts", "other sets that cannot be excluded, with their probabilities", empty=True),
        column("rivals_left_out", "integer", "rivals that are not listed", empty=True),
        column("note", "text", "why there is no verdict, or what a bad fit did to the answer"),
        column("named", "texts", "faults of the catalogue that it is", empty=True),
        column("named_probability", "number", "probability of exactly these faults", empty=True),
        column(
            "severity", "texts", "size of each named fault with its interval, 1 as the catalogue has it", empty=True
        ),
        column("named_rivals", "texts", "other faults that cannot be excluded", empty=True),
        column("advice", "texts", "what to record next, in sentences"),
        *FLIPS,
        *SCOPE,
    ),
    asked={
        **ASKED_FLIPS,
        **ASKED_SCOPE,
        **dict.fromkeys(("named", "named_probability", "severity", "named_rivals"), "--catalogue"),
        "advice": "--advise",
    },
)

COMPONENTS = Table(
    "isolate/components",
    1,
    "isolate --by component: one row per window",
    (
        *WINDOW,
        *_TESTED,
        INSTRUMENTS,
        column("components", "texts", "the components that changed", empty=True),
        column("probability", "number", "probability of exactly these", empty=True),
        *_CLASS,
        column(
            "inclusion", "texts", "each component with the probability that it changed, likeliest first", empty=True
        ),
        column("rivals", "texts", "other sets of components, with their probabilities", empty=True),
        column("note", "text", "why there is no verdict, or what a bad fit did to the answer"),
        *FLIPS,
        *SCOPE,
    ),
    asked={**ASKED_FLIPS, **ASKED_SCOPE},
)
