"""Why something that was fitted is no explanation, in words."""

from __future__ import annotations

from enginediag_cli.mismatch.explain.rejected import Reason, Rejected


def why_rejected(r: Rejected) -> str:
    """Why something that was fitted is no explanation."""
    return {
        Reason.NOT_CONVERGED: lambda: f"did not converge: {r.what}",
        Reason.WORSE: lambda: f"χ² is {r.figure:.1f} worse{f' {r.what}' if r.what else ''}",
        Reason.AT_BOUND: lambda: f"needs {r.what} beyond its physical bound",
        Reason.LEAVES_MISFIT: lambda: f"leaves a misfit behind (−ln p = {r.figure:.1f})",
        Reason.FEW_FLIGHTS: lambda: (
            f"predicts only {100 * r.figure:.0f} % of the flights better: not separable from map error"
        ),
        Reason.NOT_NEEDED: lambda: f"does not need {r.what}",
        Reason.ONE_UNLISTED: lambda: "one unlisted effect explains as much",
    }[r.reason]()
