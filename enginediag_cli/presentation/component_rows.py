"""The answer of `isolate --by component`: one row per window, and the same in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from enginediag_cli.presentation.outputs.isolate import COMPONENTS

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.isolation.components import ComponentIsolation
    from enginediag_cli.parameters import Parameter


def component_row(verdict: Verdict, found: ComponentIsolation | None, known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Row of one window; `inclusion` lists the components likeliest first, down to one in a hundred."""
    from enginediag_cli.presentation.isolation_rows import class_cells, fit_cells, reservation, told_verdict
    from enginediag_cli.presentation.sentences import instrument_fault
    from enginediag_cli.residuals.flat import window_row

    adequacy = found.adequacy if found else None
    row = window_row(verdict.window)
    row.update(
        verdict=told_verdict(verdict, adequacy),
        p_value=verdict.test.p_value if verdict.test else None,
        **fit_cells(adequacy),
        note=verdict.reason,
        instruments=[instrument_fault(fault) for fault in verdict.window.instruments],
    )
    if found is not None:
        shown = sorted(found.inclusion.items(), key=lambda item: -item[1])
        row.update(
            components=list(found.components),
            probability=found.probability,
            **class_cells(found.one_of),
            inclusion=[f"{name} ({chance:.2g})" for name, chance in shown if chance >= 0.01],
            rivals=[f"{' & '.join(r.parameters) or 'nothing'} ({r.probability:.2g})" for r in found.rivals],
            note="; ".join(
                filter(
                    None,
                    [
                        reservation(found.adequacy, known),
                        "" if found.complete else "larger sets of parameters were not considered",
                    ],
                )
            ),
        )
    return COMPONENTS.row(row)


def component_sentence(found: ComponentIsolation, known: Mapping[str, Parameter]) -> str:
    """The answer for one window in words."""
    from enginediag_cli.presentation.isolation_rows import reservation
    from enginediag_cli.presentation.names import listed, spelled
    from enginediag_cli.presentation.numbers import probability
    from enginediag_cli.presentation.sentences import one_of, unexplained

    def words(components: tuple[str, ...]) -> str:
        return listed([spelled(c) for c in components]) or "no component"

    told = f"{words(found.components)} changed (probability {probability(found.probability)})"
    if found.perhaps:
        besides = [f"{spelled(c)} ({probability(found.inclusion[c])})" for c in found.perhaps]
        told = f"{words(found.components)} changed (probability {probability(found.all_of_them)})"
        told += f", perhaps {listed(besides)} as well; exactly this: probability {probability(found.probability)}"
    if found.rivals:
        told += f"; next: {words(found.rivals[0].parameters)} ({probability(found.rivals[0].probability)})"
    if found.one_of is not None:
        told += f"; {one_of(found.one_of, lambda names: [spelled(c) for c in names])}"
    left = unexplained(found.adequacy.before, found.adequacy.fit, found.adequacy.explained)
    told += left and f"; {left}"
    caution = reservation(found.adequacy, known)
    leading = "" if found.adequacy.stands else "leading, but not to be relied on: "
    return f"{caution}; {leading}{told}" if caution else told
