"""Declaration of the YAML file that describes a fleet."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

LINEARISE = ("estimate", "nominal")

_OF_A_BUILD = (
    Field("engine", "text", "engine file, relative to this file; or one that comes with the program", None),
    Field(
        "nominal",
        "text",
        "nominal file of identify, relative to this file; where absent one is identified from the baseline",
        None,
    ),
    Field(
        "recordings",
        "texts",
        "patterns of the recordings, relative to this file, such as 'flights/*.csv' or '**/*.parquet'",
        (),
    ),
    Field("recorder", "text", "recorder of foreign recordings, relative to this file; or a shipped one", None),
)

BUILD = Section("build", "engines of one build: what they are, and which recordings are theirs", _OF_A_BUILD)

ENGINES = Section(
    "engines",
    "how engines are told apart",
    (
        Field(
            "serial_from",
            "choice",
            "where the serial number of an engine stands: in the column `engine` of a recording (a recorder may map "
            "another one to it), or in the name of its file",
            "column",
            choices=("column", "file"),
        ),
        Field(
            "pattern",
            "text",
            "with serial_from: file, a regular expression of the file's path with one group, the serial number, such "
            "as 'engine_(\\d+)'",
            "",
        ),
    ),
)

BASELINE = Section(
    "baseline",
    "the early life of each engine, believed healthy: it is judged against that, and the common model is identified "
    "from it",
    (
        Field("flights", "integer", "first flights of each engine", None, minimum=1),
        Field("records", "integer", "flights within the first so many records of each engine", None, minimum=1),
    ),
)

IDENTIFY = Section(
    "identify",
    "the common model, for builds without a nominal file",
    (
        Field("engines", "integer", "from the baseline of at most so many engines", 20, minimum=1),
        Field("records", "integer", "and of at most so many records", 6000, minimum=20),
        Field(
            "model_error", "number", "relative accuracy of the component maps, by hand", None, minimum=0, maximum=0.1
        ),
    ),
)

JUDGE = Section(
    "judge",
    "what is judged, and how strictly",
    (
        Field(
            "false_alarm",
            "number",
            "probability that a healthy engine is ever called changed",
            0.01,
            minimum=1e-9,
            maximum=0.5,
        ),
        Field(
            "fdr",
            "number",
            "false discovery rate: share of healthy engines among those listed",
            0.05,
            minimum=1e-9,
            maximum=0.5,
        ),
        Field(
            "window",
            "text",
            "cut flights into windows: records (60) or time (300s, 10min, 1h); where absent a flight is one window, "
            "and a recording without flights one window a record",
            None,
        ),
        Field("linearise", "choice", "where the model is linearised", "estimate", choices=LINEARISE),
        Field("sensors", "boolean", "instruments are suspects, too", True),
        Field(
            "limits_K",
            "number_map",
            "highest permitted exhaust temperature by column, at the reference condition, for its margin",
            {},
            unit="K",
        ),
        Field(
            "consumed_limit_K",
            "numbers",
            "margin that engines have lost when they are taken off, and its standard deviation, where no temperature "
            "limit is known: [25, 3]",
            None,
            unit="K",
        ),
        Field(
            "taken_off",
            "texts",
            "serial numbers of engines whose recordings end where they were taken off because they were worn, three at "
            "least: what they had lost by then is the limit of all others, in place of consumed_limit_K",
            (),
        ),
        Field("thorough", "boolean", "engines that stand out are judged as `trend` does, at a second each", True),
    ),
)

FLEET_FILE = Section(
    "fleet",
    "a fleet: engines by serial number, their recordings, maintenance, and what to judge",
    (
        Field("kind", "choice", "kind of file", "fleet", choices=("fleet",)),
        Field("description", "text", "what the fleet is", ""),
        Field("sources", "texts", "where its recordings come from", ()),
        *_OF_A_BUILD,
        Field("builds", "section_map", "several builds by name, in place of the four keys above", {}, section=BUILD),
        Field("engines", "section", "how engines are told apart", {}, section=ENGINES),
        Field("baseline", "section", "early life, believed healthy", section=BASELINE),
        Field("identify", "section", "the common model", {}, section=IDENTIFY),
        Field(
            "events",
            "text",
            "CSV of maintenance, relative to this file: columns engine, kind (wash, overhaul, exchange), flight or "
            "time_s, component",
            None,
        ),
        Field("judge", "section", "what is judged", {}, section=JUDGE),
    ),
)
