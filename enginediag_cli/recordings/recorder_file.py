"""The recorder YAML: what its keys are, one declaration for validation, help and schema."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.recordings.derived import RULES
from enginediag_cli.recordings.source import DELIMITERS, LAYOUTS, THOUSANDS
from enginediag_cli.recordings.stamps import NUMBERS

_COLUMN = Section(
    "column",
    "where a column comes from and how it is converted",
    (
        Field("from", "text", "source column; {prefix} stands for the engine's prefix"),
        Field("unit", "text", "unit of the source; default: the suffix of its name", None),
        Field("full_scale", "number", "value of the target at 100 %, for sources in pct", None),
        Field("scale", "number", "factor on the source's reading, in its own unit", 1.0),
        Field("offset", "number", "added to the source's reading after the scale, in its own unit", 0.0),
        Field("limits", "range", "what the sensor can truthfully read, in the target's unit", None),
        Field("density_kg_m3", "number", "of the fuel, for a volume flow that becomes a mass flow", None, minimum=1.0),
        Field("fill", "choice", "cells left empty between readings", "none", choices=("none", "hold", "interpolate")),
        Field("fill_records", "integer", "most records that a reading is held, or two lie apart", 0, minimum=0),
    ),
)

_ENGINE = Section(
    "engine",
    "one engine of the file",
    (
        Field("prefix", "text", "text that stands for {prefix}", ""),
        Field("constants", "number_map", "columns with one value, for this engine", {}),
        Field("full_scale", "number_map", "target column to its value at 100 %, for this engine", {}),
    ),
)

_CHECK = Section(
    "check",
    "a ratio of two columns that shows that the file is what it is taken for",
    (
        Field("of", "text", "column above"),
        Field("over", "text", "column below"),
        Field("between", "range", "where the median of the ratio must lie"),
        Field("otherwise", "text", "what to tell the user if it does not"),
    ),
)

_MASKS = Section(
    "masks",
    "how much it takes to mask a value; 0 turns a search off",
    (
        Field("dropped_records", "integer", "missing values in a row: the sensor is dropped", 10, minimum=1),
        Field("stuck_records", "integer", "identical readings in a row", 20, minimum=0),
        Field("outlier_sigma", "number", "robust standard deviations of a gross outlier", 8.0, minimum=0.0),
        Field("frozen_records", "integer", "records in a row in which every column repeats", 20, minimum=0),
    ),
)

_STEADY = Section(
    "steady",
    "conditions for a record to be steady, in the units of the target columns",
    (
        Field("window_s", "number", "time over which spread and slope are taken", 10.0, unit="s", minimum=0.0),
        Field("gap_s", "number", "a longer step of time begins a new stretch", None, unit="s", minimum=0.0),
        Field("spread", "number_map", "largest maximum minus minimum in the window", {}),
        Field("slope", "number_map", "largest trend in the window, per second", {}),
        Field("dwell_s", "number", "time since the last change (heat soak)", 0.0, unit="s", minimum=0.0),
        Field("dwell", "number_map", "spread within dwell_s that counts as a change", {}),
        Field("minimum", "number_map", "smallest value", {}),
        Field("maximum", "number_map", "largest value", {}),
        Field("neighbours", "number_map", "largest difference from the records before and after", {}),
    ),
)

_LONG = Section(
    "long",
    "an export of one reading a line: time, tag, value; each tag becomes a column of this name",
    (
        Field("tag", "text", "column of the tags' names"),
        Field("value", "text", "column of the values"),
        Field("quality", "text", "column of the quality of a value; none if empty", ""),
        Field("good", "texts", "words of the quality of a value that is used, in any case", ()),
        Field("clock", "text", "tag at whose times there is a record; none: whenever a used tag has a value", ""),
        Field("max_age_s", "number", "how long a tag's last value is held; 0: its own time", 0.0, "s", minimum=0.0),
    ),
)

_FILE = Section(
    "file",
    "how the file is written",
    (
        Field("delimiter", "choice", "between cells", "auto", choices=("auto", *DELIMITERS, *LAYOUTS)),
        Field("widths", "numbers", "characters of each column, of delimiter: fixed", ()),
        Field("decimal", "choice", "decimal mark", "point", choices=("point", "comma")),
        Field("thousands", "choice", "mark between groups of three digits", "none", choices=("none", *THOUSANDS)),
        Field("encoding", "text", "of the text, as Python names it: utf-8, latin-1, cp1252", "utf-8"),
        Field("header", "choice", "whether a line names the columns", "line", choices=("line", "none")),
        Field("header_line", "integer", "line of the header; 0: the first that is not blank or #", 0, minimum=0),
        Field("names", "texts", "names of the columns, of header: none; an empty one is not read", ()),
        Field("unit_row", "boolean", "whether a row of units follows the header", False),
        Field("missing", "texts", "further words for a missing value, in any case; a number by its value", ()),
        Field("sheet", "text", "sheet of an Excel workbook; the first if empty", ""),
        Field("long", "section", "an export of one reading a line", None, section=_LONG),
    ),
)

_TIME = Section(
    "time",
    "time stamps that become time_s, in seconds",
    (
        Field("from", "texts", "column of the stamp, or of date and of time"),
        Field(
            "format",
            "text",
            "iso (ISO 8601; a time of day alone may pass midnight), as in strptime ('%d.%m.%Y %H:%M:%S'), or a number: "
            + ", ".join(NUMBERS),
            "iso",
        ),
        Field("zone", "text", "time zone of stamps that do not say: +02:00 or Europe/Berlin; UTC if not given", ""),
        Field(
            "since",
            "choice",
            "where time_s is 0: the first record of the file, or 1970-01-01 UTC",
            "first_record",
            choices=("first_record", "epoch"),
        ),
    ),
)

_JOIN = Section(
    "join",
    "a further file, at another rate; its column c is called NAME.c, with the name of the join",
    (
        Field("recording", "text", "its name, beside the recording: {name} is that of the recording without ending"),
        Field("cut", "text", "end of the recording's name that {name} is without, such as _fast", ""),
        Field("file", "section", "how it is written; none: as the recording", None, section=_FILE),
        Field("time", "section", "its time stamps; none: as the recording's", None, section=_TIME),
        Field(
            "how", "choice", "last value held, or each to one record, the nearest", "hold", choices=("hold", "nearest")
        ),
        Field("max_age_s", "number", "how far a value may be from a record that takes it", unit="s", minimum=0.0),
    ),
)

RECORDER_FILE = Section(
    "recorder",
    "how the columns of a foreign recording become those of the program",
    (
        Field("kind", "choice", "recorder", choices=("recorder",)),
        Field("description", "text", "what recorder and which files"),
        Field("sources", "texts", "where the facts come from", ()),
        Field("decide", "texts", "decisions that a draft leaves open, repeated by every command until removed", ()),
        Field("file", "section", "how the file is written", {}, section=_FILE),
        Field("time", "section", "time stamps; none: time is a number, or not recorded", None, section=_TIME),
        Field("joins", "named_sections", "further files, beside the recording, joined on time", (), section=_JOIN),
        Field("columns", "section_map", "target column (with its SI unit) to its source", section=_COLUMN),
        Field("engines", "section_map", "engines of the file by name; none: one engine", {}, section=_ENGINE),
        Field("constants", "number_map", "columns with one value", {}),
        Field("text", "text_map", "target text column to its source, untouched", {}),
        Field("keep", "texts", "source columns to pass through untouched", ()),
        Field(
            "derived",
            "named_sections",
            "computed columns, in this order",
            (),
            section=Variants(
                "rule",
                "how the column is computed",
                {name: rule.section for name, rule in RULES.items()},
                "rule",
            ),
        ),
        Field("checks", "named_sections", "proofs that the file is what it is taken for", (), section=_CHECK),
        Field("masks", "section", "search for bad values", {}, section=_MASKS),
        Field("steady", "section", "the stability gate; none: every record is kept", None, section=_STEADY),
        Field("average_s", "number", "windows to average over; 0: none", 0.0, unit="s", minimum=0.0),
    ),
)
