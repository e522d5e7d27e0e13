"""The keys of an engine file. Component keys are declared beside the components themselves.

The `physics:` block of an engine file: the effects that its model carries.

The blocks of an engine file that later stages read: `identification:` and `mismatch:`.

The `identification:` block of an engine file: what is estimated, how loosely, and with which noise.

The `mismatch:` block of an engine file: what `locate`, `explain` and `refine` reckon with.
"""

from __future__ import annotations

from enginediag_cli.config.fields import Either, Field, Section, Variants
from enginediag_cli.engine.components import COMPONENTS
from enginediag_cli.engine.control_section import CONTROL
from enginediag_cli.engine.network import DEMAND

LOSSES = ("soft_l1", "huber", "none")
"""Robust losses of a normalised residual; `identification.loss` has their formulas."""
NOISE_CHOICES = ("estimate", "specified")
MONITORING_CHOICES = ("fit", "cross_validation")

IDENTIFICATION = Section(
    "identification",
    "What `identify` estimates from healthy recordings, and how far from nominal it may plausibly lie.",
    (
        Field(
            "parameters",
            "texts",
            "names or patterns (`hpc.*`) of what is estimated; all when empty",
            default=(),
        ),
        Field("fixed", "texts", "names or patterns that keep their nominal value", default=()),
        Field(
            "prior_mean",
            "number_map",
            "parameter: where its prior is centred, if not at nominal",
            default={},
            unit="the parameter's",
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior",
            default={},
            unit="the parameter's",
        ),
        Field("sensors", "texts", "columns that are fitted; every recorded sensor when empty", default=()),
        Field(
            "noise_sigma",
            "number_map",
            "column: standard deviation of one reading, if not the sensor's own",
            default={},
            unit="the column's",
        ),
        Field(
            "noise",
            "choice",
            "`estimate`: noise is what the fit leaves; `specified`: as the sensors state",
            default="estimate",
            choices=NOISE_CHOICES,
        ),
        Field(
            "monitoring_noise",
            "choice",
            "noise that later stages reckon with: `fit`: that of the fit; `cross_validation`: what the model "
            "leaves on records that the fit has not seen, its own error included",
            default="fit",
            choices=MONITORING_CHOICES,
        ),
        Field(
            "recording_bias_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its offset from one recording to the next "
            "(nuisance)",
            default={},
            unit="the column's",
        ),
        Field(
            "recording_scale_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its scale error from one recording to the next "
            "(nuisance)",
            default={},
            unit="fraction",
        ),
        Field("loss", "choice", "robust loss of a normalised residual", default="soft_l1", choices=LOSSES),
        Field(
            "loss_scale",
            "number",
            "residual, in standard deviations, beyond which a reading counts less",
            default=2.5,
            minimum=0.5,
            maximum=100.0,
        ),
        Field(
            "cross_validation_block",
            "integer",
            "records in one contiguous left-out block; 0 for an eighth of all",
            default=0,
            minimum=0,
            unit="records",
        ),
        Field(
            "max_iterations",
            "integer",
            "Gauss–Newton steps of all passes and attempts before giving up; flights of real engines take about 20",
            default=75,
            minimum=1,
        ),
    ),
)


SEARCH_NOISE_CHOICES = ("specified", "estimate")

MISMATCH = Section(
    "mismatch",
    "how `locate`, `explain` and `refine` reckon with this engine",
    (
        Field(
            "nuisance",
            "texts",
            "names or patterns of what is identified along with an effect; default: what "
            "`identification:` estimates, else the monitored parameters and the sensors' scale errors; "
            "besides, the scale of each sensor of which no error is identified and no offsets of recordings are stated",
            (),
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior, if not its own",
            {},
            unit="the parameter's",
        ),
        Field(
            "limits",
            "number_map",
            "coefficient of an effect: largest value that the installation can have, where "
            "that is less than the effect's own bound",
            {},
            unit="the coefficient's",
        ),
        Field(
            "map_accuracy",
            "number",
            "relative accuracy of the component maps: the model-error floor",
            0.003,
            minimum=0.0,
            maximum=0.1,
        ),
        Field("input_noise", "number_map", "input column: standard deviation of one reading", {}, unit="the column's"),
        Field(
            "input_noise_share", "number_map", "input column: standard deviation of one reading, as a share of it", {}
        ),
        Field(
            "noise",
            "choice",
            "specified: noise as the sensors, `identification:` or a nominal file state it; "
            "estimate: what nothing that is looked for explains",
            "specified",
            choices=SEARCH_NOISE_CHOICES,
        ),
    ),
)


SWITCH = Field(
    "switch",
    "text",
    "column of the recordings that is 1 where the effect is on and 0 where it is off or "
    "not recorded; without it the effect is always on",
    "",
)
TERM = Section(
    "term",
    "a physical effect of the library; `enginediag physics` lists them",
    (
        Field("term", "text", "name of the effect"),
        Field("at", "text", "where it acts: a component, a shaft or a sensor"),
        Field(
            "coefficients", "number_map", "its coefficients; those left out are absent", {}, unit="the coefficient's"
        ),
        Field(
            "standard_errors", "number_map", "of the coefficients, when they were fitted", {}, unit="the coefficient's"
        ),
        SWITCH,
        Field("source", "text", "where the coefficients come from: data and command", ""),
    ),
)
COEFFICIENT = Section(
    "coefficient",
    "a number of a law",
    (
        Field("value", "number", "its value", unit="`unit`"),
        Field("unit", "text", "its unit, 1 for a number", "1"),
        Field("lower", "number", "least that physics allows; default none", None, unit="`unit`"),
        Field("upper", "number", "most that physics allows; default none", None, unit="`unit`"),
        Field(
            "absent",
            "number",
            "value at which the law is not there; at least one coefficient has one",
            None,
            unit="`unit`",
        ),
        Field(
            "prior_sigma",
            "number",
            "how far it plausibly lies from that, or from its value; default: it is not sought",
            None,
            unit="`unit`",
            minimum=0.0,
        ),
        Field("standard_error", "number", "when it was fitted", None, unit="`unit`", minimum=0.0),
        Field("description", "text", "what it is", ""),
    ),
)
LAW = Section(
    "law",
    "an effect outside the library, as a formula of the variables that `enginediag physics --variables` lists",
    (
        Field("law", "text", "a name of your own"),
        Field("at", "text", "where it acts: a parameter of the engine (hpc.efficiency) or a recorded reading (T45_K)"),
        Field(
            "expression",
            "text",
            "f: of a factor (nominal 1) the share that is added, else what is added in the parameter's or reading's "
            "unit; 0 at the design point; numbers, variables, coefficients, + - * / **, exp, ln, sqrt, tanh, min, max",
        ),
        Field("coefficients", "section_map", "its coefficients by name", section=COEFFICIENT),
        Field("statement", "text", "what it says in plain words", ""),
        SWITCH,
        Field("source", "text", "where it comes from: data and command", ""),
    ),
)
EFFECT = Either("effect", "a physical effect that the model carries: a `term` or a `law`", {"term": TERM, "law": LAW})


SHAFT = Section(
    "shaft",
    "what turns together",
    (
        Field("name", "text", "name of the shaft"),
        Field("speed_label", "text", "N1, N2, …: its speed is the column <label>_rpm"),
        Field("design_speed_rpm", "number", "at the design point", unit="rpm", minimum=1.0),
        Field(
            "speed",
            "choice",
            "balance: follows from the power balance; constant: the design speed (synchronous "
            "generator); input: a recorded column",
            "balance",
            choices=("balance", "constant", "input"),
        ),
        Field(
            "mechanical_efficiency",
            "number",
            "share of turbine power that reaches the shaft",
            1.0,
            minimum=0.8,
            maximum=1.0,
        ),
        Field("power_offtake_W", "number", "power taken from the shaft", 0.0, unit="W"),
        Field(
            "inertia_kg_m2",
            "number",
            "polar moment of inertia of all that turns with the shaft; 0: its speed follows at once",
            0.0,
            unit="kg m2",
            minimum=0.0,
        ),
    ),
)
SENSOR = Section(
    "sensor",
    "one measured output; the key of the entry is its column",
    (
        Field(
            "reads",
            "any_map",
            "columns of the model and their weights, {T45_K: 0.6, T5_K: 0.4}; default the column itself",
            None,
        ),
        Field("over", "text", "model column by which the reading is divided (a ratio such as EPR)", None),
        Field("noise_sigma", "number", "standard deviation of one reading, in the column's unit", minimum=0.0),
        Field("maximum", "number", "largest reading, in the column's unit; scales uniform noise", None),
        Field("bias_sigma", "number", "plausible bias, in the column's unit; default 3 noise_sigma", None, minimum=0.0),
        Field("scale_sigma", "number", "plausible scale error", 0.01, minimum=0.0),
        Field("soak", "text", "input column with the heat-soak driver; adds parameter sensor.<quantity>.soak", None),
        Field("soak_sigma", "number", "plausible soak coefficient, reading unit per driver unit", 0.01, minimum=0.0),
    ),
)
DESIGN = Section(
    "design",
    "the design point, at which components are sized",
    (
        Field("altitude_m", "number", "geopotential altitude", 0.0, unit="m"),
        Field("mach", "number", "flight Mach number", 0.0, minimum=0.0, maximum=1.0),
        Field("dT_isa_K", "number", "deviation from the standard atmosphere", 0.0, unit="K"),
        Field("ambient_pressure_Pa", "number", "for ground conditions", 101325.0, unit="Pa"),
        Field("ambient_temperature_K", "number", "for ground conditions", 288.15, unit="K"),
        Field("humidity_kg_kg", "number", "water vapour per dry air", 0.0, unit="kg/kg", minimum=0.0),
        Field("dP_inlet_Pa", "number", "measured inlet loss", 0.0, unit="Pa"),
    ),
)
RANGE = Section(
    "range",
    "lowest and highest value, in the column's unit",
    (Field("low", "number", "lowest value"), Field("high", "number", "highest value")),
)
COMPONENT = Variants("component", "a component of the gas path", {t: c.SECTION for t, c in COMPONENTS.items()})

ENGINE_FILE = Section(
    "engine",
    "an engine as a network of components",
    (
        Field("kind", "choice", "what this file is", "engine", choices=("engine",)),
        Field("description", "text", "which engine it is"),
        Field("sources", "texts", "where its numbers come from", ()),
        Field("name", "text", "short name"),
        Field(
            "fuel_hydrogen_carbon_ratio",
            "number",
            "atoms of hydrogen per atom of carbon",
            1.9185,
            minimum=0.5,
            maximum=4.0,
        ),
        Field("design", "section", "design point", {}, section=DESIGN),
        Field(
            "power_setting",
            "text",
            "column that sets the power: Wf_kg_s, a shaft speed such as N1_rpm, the temperature of a station behind "
            "the burner such as T4_K or T5_K, EPR, Fn_N, power_W (of all loads together), or one machine's "
            "<name>_power_W or <name>_torque_N_m; given as input, the rest are outputs",
        ),
        Field("power_demand", "section", "a recorded set point that the power setting follows", None, section=DEMAND),
        Field("components", "named_sections", "in the order of the gas path", section=COMPONENT),
        Field("shafts", "named_sections", "the shafts", section=SHAFT),
        Field("controls", "named_sections", "what moves the engine's actuators", (), section=CONTROL),
        Field("sensors", "section_map", "measured outputs by column", section=SENSOR),
        Field(
            "monitored",
            "texts",
            "health parameters that are watched; default: all but those of the burner",
            (),
        ),
        Field("envelope", "section_map", "largest range of every input column, {low, high}", section=RANGE),
        Field(
            "power_range",
            "range",
            "corrected power setting from idle to rating (W_f/(δ√θ), N/√θ, T/θ, EPR, F/δ, P/(δ√θ), torque/δ)",
        ),
        Field("start", "number_map", "starting values of unknowns, relative to design", {}),
        Field("physics", "sections", "effects that the model carries beyond its components", (), section=EFFECT),
        Field("identification", "section", "what `identify` estimates", None, section=IDENTIFICATION),
        Field("mismatch", "section", "what `locate`, `explain` and `refine` reckon with", None, section=MISMATCH),
    ),
)
