"""What should be known of a nominal state before recordings are held against it, as warnings."""

from __future__ import annotations

from enginediag_cli.intake.baseline import Baseline
from enginediag_cli.presentation.messages import Messages


def tell_baseline(messages: Messages, baseline: Baseline, engine_instance: str = "") -> None:
    """A changed engine file, a nominal file without its checksum, and recordings of another engine."""
    if baseline.changed_engine:
        messages.warning(
            f"{baseline.engine.path} has changed since its nominal state was identified; what follows is judged with "
            "the engine as it is now"
        )
    if baseline.left_aside:
        messages.warning(
            f"{baseline.left_aside} has changed since its nominal state was identified; the engine that was "
            f"identified, which travels in {baseline.path}, is used (--accept-changed-engine: the file as it is now)"
        )
    if not baseline.nominal.sealed:
        messages.warning(f"{baseline.path} has no checksum: nothing shows that it is as identify wrote it")
    other = baseline.other_instance(engine_instance)
    if other is not None:
        messages.warning(
            f"{baseline.path} was identified on engine {other[0]!r}, and these are recordings of {other[1]!r}: what is "
            "found may be the difference between the two"
        )
