"""The other end of a correspondent: a process that answers questions, one JSON object a line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

from enginediag_cli.errors import EngineDiagError
from enginediag_cli.parent_process import end_with_parent


def answer_questions(answer: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
    """Answer until standard input ends, and end at once with the process whose number is the first argument, if one is
    given. What fails is answered by `error` and why."""
    if len(sys.argv) > 1:
        end_with_parent(int(sys.argv[1]))
    for line in sys.stdin:
        try:
            told = answer(json.loads(line))
        except EngineDiagError as error:
            told = {"error": str(error)}
        except Exception as error:  # the prover counts it, and goes on
            told = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()
