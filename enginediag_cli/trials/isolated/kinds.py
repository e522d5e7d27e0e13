"""What a trial of isolation may be about, and how often."""

from __future__ import annotations

from collections.abc import Mapping

NULL, COMPONENT, OUTPUT_SENSOR = "null", "component", "output_sensor"
INPUT_CHANNEL, SEVERAL, PHYSICS = "input_channel", "several", "physics"

WEIGHTS: Mapping[str, int] = {NULL: 20, COMPONENT: 30, OUTPUT_SENSOR: 14, INPUT_CHANNEL: 10, SEVERAL: 16, PHYSICS: 10}
"""Shares of kinds of trials when nobody chooses: mostly what engines have, and enough nulls to count false names."""
KINDS = tuple(WEIGHTS)

SAME_MODEL, REALISTIC = "same_model", "realistic"
TRUTHS = (SAME_MODEL, REALISTIC)
