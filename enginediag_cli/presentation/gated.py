"""What was not looked for because a recorder left out the records that would show it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from enginediag_cli.presentation.sentences import count

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.gated import Gated


def gated_sentences(g: Gated | None) -> Iterator[str]:
    """None where nothing was left out."""
    if g is not None:
        yield (
            f"Not looked for: {count(len(g.effects), 'effect')} with memory ({', '.join(g.effects)}), which would show "
            f"in the {g.records:,} of {g.of:,} {g.unit} that the recorder left out as not steady. A recorder file "
            "without `steady:` and `average_s:` lets them be looked for."
        )
