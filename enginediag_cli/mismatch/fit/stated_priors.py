"""What an engine is expected to be, where its identification has seen the very recordings that are searched.

An identification that lacks some physics is bent by it. Priors about what it found would hold what is looked for: the
true law would pay for every parameter that it sets right. So they stay where the engine file has them, and are wide
enough for both,

    θ ~ N(m, max(σ, |θ̂ − m|)²)

with m and σ as stated and θ̂ as identified: an engine that is not what its file expects is no finding either. Of
amounts of map error nothing is known beforehand but their size.
"""

from __future__ import annotations

from dataclasses import replace

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.problem import settings_from_mapping
from enginediag_cli.mismatch.fit.evidence import Settings


def with_stated_priors(settings: Settings, engine: Engine) -> Settings:
    """The settings, whose prior means are as identified, with those that the engine file states; a parameter of which
    it says nothing is at nominal."""
    stated = settings_from_mapping(engine.declared.get("identification")).prior_mean
    found = {n: v for n, v in settings.prior_mean.items() if n in engine.parameters}
    mean = {n: stated.get(n, engine.parameters[n].nominal) for n in settings.nuisance if n in engine.parameters}
    sigma = {n: max(s, abs(found.get(n, mean[n]) - mean[n])) if n in mean else s for n, s in settings.nuisance.items()}
    return replace(settings, nuisance=sigma, prior_mean={n: v for n, v in mean.items() if n in stated})
