"""How recordings become statistics, and the key under which those are kept: recording, nominal and settings."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from enginediag_cli import __version__
from enginediag_cli.fleets.condensed_file import FORMAT
from enginediag_cli.residuals.windows import WindowPlan


@dataclass(frozen=True)
class Making:
    """nominal: path of its file, and `fingerprint` of what is in it; recorder: path of its file, "" for none, and the
    SHA-256 of that; plan and linearise: as of `residuals.files.Judging`; accept_mismatch: as of `Source`."""

    nominal: str
    fingerprint: str
    recorder: str
    recorder_sha256: str
    plan: WindowPlan
    linearise: str
    accept_mismatch: bool = False

    def key(self, sha256: str) -> str:
        """Of a recording whose bytes have this SHA-256: what is condensed alike has the same, whatever files are
        called."""
        settings = (self.plan.length, self.plan.step, self.plan.in_time, self.plan.whole_flights, self.linearise)
        accepted = ("mismatch accepted",) if self.accept_mismatch else ()
        parts = (__version__, FORMAT, sha256, self.fingerprint, self.recorder_sha256, *settings, *accepted)
        return hashlib.sha256("\n".join(map(str, parts)).encode()).hexdigest()
