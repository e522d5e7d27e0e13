"""How often what fails, before the data: the one place of prior chances, each that of one recording that is judged.

Components wear, and an engine that is judged is seldom new. Valves that bleed a compressor, to keep it from surging or
for the aircraft, leak and stick as often as a module is at fault: a public benchmark of gas-path diagnostics draws its
faults of the variable bleed valve and of the variable vanes as often as those of each module (Simon, D. L. (2010)
Propulsion Diagnostic Method Evaluation Strategy (ProDiMES) User's Guide, NASA/TM-2010-215840), and leaks of bleeds are
among the faults that every programme of single faults holds (Volponi, A. J., DePold, H., Ganguli, R. and Daguang, C.
(2003) Journal of Engineering for Gas Turbines and Power 125, 917–924). Instruments are checked and replaced.
"""

from __future__ import annotations

PARAMETER = 0.1
"""That a parameter of a component has changed, or that a bleed valve stands off where it should: of five components
with two parameters each, one on the average. Judgement, to which `SetPrior.spread` adds a factor of two either way."""
INSTRUMENT = 0.005
"""That an instrument is wrong: of sixteen one is then wrong in one window of thirteen. The chance is taken from every
answer that records cannot defend against a wrong instrument beside it, as single records cannot. Judgement."""
MOST_AT_ONCE = 2
"""Instruments and valves that are wrong at once at most: each fails by itself, and three hardly ever do."""
FORMS = 5
"""Bias, scale, drift, stuck, noise: forms of one fault of an instrument, each as probable as the others."""
UNLISTED = 0.02
"""That what happened is none of what is listed: once in fifty windows. Judgement."""
