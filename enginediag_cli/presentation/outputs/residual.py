"""Rows of `residual`: local statistics of windows, or residuals of records."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column
from enginediag_cli.presentation.outputs.windows import WINDOW

_MADE = {
    "nominal": "fingerprint of the nominal state and its engine",
    "window": "length of the windows; empty for whole flights",
    "step": "from one window to the next",
    "linearise": "where the model was linearised",
    "monitor": "parameters monitored, as they were asked for",
    "reference": "records that the window was compared with, 0 for nominal",
    "last": "records at the end of each flight that alone were judged, 0 for all",
    "model_error": "accuracy of the maps, where it was set by hand",
    "recorder": "fingerprint of the recorder file",
    "engine_instance": "the engine that was chosen of several",
}
_SQUARED = "per product of two parameters"

RESIDUAL = Table(
    "residual",
    1,
    "one row per window: local statistics s, F, V, which add; all that detect, isolate and trend need",
    (
        *WINDOW,
        column("silent", "texts", "monitored errors of sensors that gave no reading", empty=True),
        column("n", "integer", "records that the statistics rest on", empty=True),
        column("chi2", "number", "χ² of the residuals", empty=True),
        column("dof", "number", "its degrees of freedom", empty=True),
        column("noise_A1", "number", "how uncertain the noise makes the metric: first moment", empty=True),
        column("noise_A2", "number", "how uncertain the noise makes the metric: second moment", empty=True),
        column("noise_Q", "number", "how far the noise is from Gaussian", empty=True),
        column("parameters", "text", "what each parameter is, as a JSON list", empty=True),
        column("conditions", "text", "mean of each input over the records judged, as a JSON object", empty=True),
        column(
            "nuisance",
            "text",
            "JSON object: how many unit normals all windows share (common), and the standard deviations of what each "
            "recording has anew (own); empty: counted in s, F and V already (--reference)",
            empty=True,
        ),
        *(column(f"made:{name}", "text", help) for name, help in _MADE.items()),
        column("checksum", "text", "checksum of the other cells of the row"),
    ),
    families=(
        column("theta0:<parameter>", "number", "nominal value", "of the parameter", empty=True),
        column("prior_sigma:<parameter>", "number", "prior size of a change", "of the parameter", empty=True),
        column(
            "nuisance:<number>",
            "text",
            "s, F and V of what nuisance lists, and F and V between it and the parameters: f8: and base 64 of float64",
            empty=True,
        ),
        column("s:<parameter>", "number", "score Σ JᵀR⁻¹e", "per parameter", empty=True),
        column("F:<parameter>|<parameter>", "number", "information Σ JᵀR⁻¹J, upper triangle", _SQUARED, empty=True),
        column("V:<parameter>|<parameter>", "number", "covariance of s, upper triangle", _SQUARED, empty=True),
        column(
            "slopes:<parameter>|<parameter>",
            "number",
            "covariance that wrong slopes of the maps add to a change",
            "product of two parameters",
            empty=True,
        ),
    ),
)

RECORDS = Table(
    "residual/records",
    1,
    "residual --what records: one row per record, measured minus predicted",
    (
        column("source", "text", "file of the record"),
        column("line", "integer", "its line there, from 1"),
        column("flight", "text", "flight, as the recording calls it"),
        column("engine", "text", "engine, as the recording calls it"),
        column("time_s", "number", "time of the record", "s", empty=True),
        column("state", "text", "ok, or why there is no residual or what is doubtful about it"),
    ),
    families=(
        column("<sensor>:residual", "number", "measured minus predicted", "of the sensor's column", empty=True),
        column("<sensor>:sigmas", "number", "the residual in standard deviations of the noise", empty=True),
    ),
    asked=dict.fromkeys(("flight", "engine", "time_s"), "a recording that has the column"),
)
