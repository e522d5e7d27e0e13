"""The key of a journal of trials of isolation; the journal itself is that of every blind trial."""

from __future__ import annotations

import hashlib
from pathlib import Path

from enginediag_cli import __version__
from enginediag_cli.validation.isolated.trial import Plan


def plan_key(plan: Plan) -> str:
    """Hash of all that a trial depends on but its number."""
    digest = hashlib.sha256(f"isolate {__version__} {plan.seed} {plan.truths} {plan.kinds}".encode())
    for engine in plan.engines:
        digest.update(b"\0" + Path(engine).read_bytes())
    return digest.hexdigest()
