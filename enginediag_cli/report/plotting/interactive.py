"""A chart as a plot that moves: zoom, hover with the row of origin, series on and off by their legend.

By bokeh (extra `enginediag[report]`), whose script comes in its package. What a page needs of it is plain JSON and that
script, once; nothing is fetched from any network, and ids are counted anew in every plot, so that the same chart gives
the same bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from enginediag_cli.report.plotting import (
    FAINT,
    INK,
    QUIET,
    Axis,
    Band,
    Bars,
    Chart,
    HeatCells,
    Intervals,
    Layer,
    Line,
    Points,
    RowOrigin,
    colour,
    format_value,
    shade,
    shade_scale,
    x_range,
    y_range,
)

HEIGHT, ROW, CELL, BESIDE, BAR = 300, 24, 21, 66, 62
"""Pixels of a plot, of a row of a lying one, of a row of a heat map, of what stands above and below rows, and of a
colour bar."""
DIGITS = 6
"""Significant digits of a coordinate: a screen has four, and zooming in gives two more."""
WITHOUT = "without the extra enginediag[report] pictures do not move: pip install 'enginediag[report]'"


def available() -> bool:
    """Whether the library is installed."""
    from importlib.util import find_spec

    return find_spec("bokeh") is not None


def version() -> str:
    """Of the library, on which the bytes of a page depend."""
    from importlib.metadata import version as of

    return f"bokeh {of('bokeh')}"


def _library(part: str) -> Any:
    """A module of the library, which takes a second to import: only where a plot is made."""
    from importlib import import_module

    return import_module(f"bokeh.{part}")


def script() -> str:
    """The library's script, without the addresses in it: a text that names a host is never fetched then."""
    from importlib.resources import files

    text = (files("bokeh") / "server" / "static" / "js" / "bokeh.min.js").read_text(encoding="utf-8")
    return re.sub(r"""(["'`])(?:https?|wss?)://(?!www\.w3\.org/)""", r"\1blocked:", text)


def plot(chart: Chart) -> dict[str, Any]:
    """Plain JSON: `item`, which `Bokeh.embed.embed_item` draws, and `legend`, pairs of a series and its colour."""
    legend = {
        layer.name: colour(getattr(layer, "colour", 0))
        for layer in chart.layers
        if layer.name and not isinstance(layer, HeatCells)
    }
    return {"item": _renumber(dict(_library("embed").json_item(_figure(chart)))), "legend": list(legend.items())}


def _figure(chart: Chart) -> Any:
    figure, models = _library("plotting").figure, _library("models")

    low, high = x_range(chart)
    bottom, top = y_range(chart)
    heat = any(isinstance(layer, HeatCells) for layer in chart.layers)
    rows = len(chart.y.categories)
    on = figure(
        x_axis_type="datetime" if chart.x.dates else "auto",
        height=(max(rows, 2) * (CELL if heat else ROW) + BESIDE + (60 + BAR if heat else 0)) if rows else HEIGHT,
        sizing_mode="stretch_width",
        tools="pan,box_zoom,reset,save",
        toolbar_location="right",
        x_range=models.FactorRange(factors=_names(chart.x))
        if chart.x.categories
        else models.Range1d(start=_place(chart.x, low), end=_place(chart.x, high)),
        y_range=models.FactorRange(factors=_names(chart.y)[::-1]) if rows else models.Range1d(start=bottom, end=top),
        output_backend="canvas",
    )
    on.toolbar.logo = None
    _dress(on, chart)
    for layer in chart.layers:
        _draw(on, chart, layer)
    _marks(on, chart)
    return on


def _dress(on: Any, chart: Chart) -> None:
    """Colours that the page replaces in the dark, and names of axes."""
    on.background_fill_alpha = on.border_fill_alpha = 0
    on.outline_line_color = INK
    for axis, grid, said in ((on.xaxis[0], on.xgrid[0], chart.x), (on.yaxis[0], on.ygrid[0], chart.y)):
        axis.axis_label = said.words
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size, axis.major_label_text_font_size = "13px", "12px"
        axis.axis_label_text_color = axis.major_label_text_color = INK
        axis.axis_line_color = axis.major_tick_line_color = INK
        axis.minor_tick_line_color = None
        grid.grid_line_color = None if said.categories else FAINT
    if chart.x.categories:
        on.xaxis[0].major_label_orientation = 0.8


def _draw(on: Any, chart: Chart, layer: Layer) -> None:
    ink = colour(getattr(layer, "colour", 0))
    said = {"name": layer.name}  # by which the page's legend finds it
    if isinstance(layer, Band):
        kept = [k for k, (a, b) in enumerate(zip(layer.low, layer.high, strict=True)) if _are_finite(a, b)]
        on.varea(
            _places(chart.x, layer.x, kept),
            _round_values(layer.low, kept),
            _round_values(layer.high, kept),
            color=ink,
            alpha=0.2,
            **said,
        )
    elif isinstance(layer, Line):
        dash = "dashed" if layer.dashed else "solid"
        x = _places(chart.x, layer.x, range(len(layer.x)))
        look = {"color": QUIET, "line_width": 1} if layer.quiet else {"color": ink, "line_width": 2}
        on.line(x, _round_values(layer.y), line_dash=dash, **look, **said)
    elif isinstance(layer, Bars):
        _bars(on, chart, layer, ink, said)
    elif isinstance(layer, HeatCells):
        _cells(on, chart, layer)
    else:
        _dots(on, chart, layer, ink, said)


def _dots(on: Any, chart: Chart, layer: Points | Intervals, ink: str, said: dict[str, str]) -> None:
    kept = [k for k, (x, y) in enumerate(zip(layer.x, layer.y, strict=True)) if _are_finite(x, y)]
    source = _source(chart, layer, kept)
    if isinstance(layer, Intervals):
        source.data["low"], source.data["high"] = _round_values(layer.low, kept), _round_values(layer.high, kept)
        ends = ("low", "y", "high", "y") if layer.lying else ("x", "low", "x", "high")
        on.segment(*ends, source=source, color=ink, line_width=1.6, **said)
    small = isinstance(layer, Points) and layer.small
    dots = on.scatter("x", "y", source=source, color=ink, size=3 if small else 7, alpha=0.55 if small else 1.0, **said)
    _hover(on, chart, dots, source, interval=isinstance(layer, Intervals))


def _bars(on: Any, chart: Chart, layer: Bars, ink: str, said: dict[str, str]) -> None:
    kept = [k for k, x in enumerate(layer.x) if math.isfinite(x)]
    source = _source(chart, layer, kept)
    place = _library("transform").dodge("y", -layer.shift, range=on.y_range) if layer.shift else "y"
    bars = on.hbar(y=place, left=0, right="x", height=layer.thick, source=source, color=ink, line_color=None, **said)
    _hover(on, chart, bars, source)


def _cells(on: Any, chart: Chart, layer: HeatCells) -> None:
    kept = [k for k, value in enumerate(layer.value) if math.isfinite(value)]
    source = _source(chart, layer, kept)
    shades = [shade(layer.value[k], layer.largest, layer.rooted) for k in kept]
    source.data["fill"], source.data["ink"] = [s[0] for s in shades], [s[1] for s in shades]
    source.data["value"] = _round_values(layer.value, kept)
    source.data["words"] = [layer.words[k] if layer.words else "" for k in kept]
    cells = on.rect("x", "y", 0.97, 0.92, source=source, fill_color="fill", line_color=None)
    _colour_bar(on, layer)
    if len(chart.x.categories) <= MOST_WORDS:
        on.text("x", "y", "words", source=source, text_align="center", text_baseline="middle", **TEXT)
    _hover(on, chart, cells, source, value=layer.name)


def _colour_bar(on: Any, layer: HeatCells) -> None:
    """Steps of equal width, with the values at their ends."""
    models, scale = _library("models"), shade_scale(layer)
    numbers = {k: format_value(low, 2) for k, (low, _, _) in enumerate(scale)}
    numbers[len(scale)] = format_value(scale[-1][1], 2)
    bar = models.ColorBar(
        color_mapper=models.LinearColorMapper(palette=[fill for _, _, fill in scale], low=0, high=len(scale)),
        ticker=models.FixedTicker(ticks=list(numbers)),
        major_label_overrides=numbers,
        title=layer.name,
        height=10,
        background_fill_alpha=0.0,
        major_tick_line_color=None,
        title_text_color=INK,
        major_label_text_color=INK,
        title_text_font_style="normal",
    )
    on.add_layout(bar, "below")


MOST_WORDS = 24
"""Columns of a heat map between which numbers still have room."""
TEXT = {"text_color": {"field": "ink"}, "text_font_size": "11px"}


def _source(chart: Chart, layer: Points | Intervals | Bars | HeatCells, kept: Sequence[int]) -> Any:
    data = {"x": _places(chart.x, layer.x, kept), "y": _places(chart.y, layer.y, kept)}
    origins: Sequence[RowOrigin] = layer.origins
    if origins:
        files = {origins[k].file for k in kept}
        data["row"] = [origins[k].row for k in kept]
        if len(files) > 1:
            data["file"] = [origins[k].file for k in kept]
    return _library("models").ColumnDataSource(data)


def _hover(on: Any, chart: Chart, glyph: Any, source: Any, *, interval: bool = False, value: str = "") -> None:
    """Text at the pointer: the place, the number, and where both come from."""
    tips = [(chart.x.label or "at", "@x{%F}" if chart.x.dates else "@x"), (chart.y.label or "of", "@y")]
    if interval:
        tips.append(("95 %", "@low to @high"))
    if value:
        tips.append((value, "@value"))
    if "row" in source.data:
        tips.append(("line", "@file @row" if "file" in source.data else "@row"))
    safe = [(re.sub(r"[@$%{}]", "", name)[:60], text) for name, text in tips]
    hover = _library("models").HoverTool
    form = {"@x": "datetime"} if chart.x.dates else {}
    on.add_tools(hover(renderers=[glyph], tooltips=safe, formatters=form, attachment="vertical", visible=False))


def _marks(on: Any, chart: Chart) -> None:
    models = _library("models")

    for level in chart.levels:
        on.add_layout(models.Span(location=level.y, dimension="width", line_color=QUIET, line_dash="dashed"))
        on.add_layout(models.Label(x=6, x_units="screen", y=level.y, text=level.words, **LABEL))
    for mark in chart.marks:
        if mark.end is not None and mark.end > mark.x:
            ends = {"left": _place(chart.x, mark.x), "right": _place(chart.x, mark.end)}
            on.add_layout(models.BoxAnnotation(**ends, fill_color=QUIET, fill_alpha=0.12))
        x = _place(chart.x, mark.x)
        on.add_layout(models.Span(location=x, dimension="height", line_color=QUIET, line_dash="dashed"))
        on.add_layout(models.Label(x=x, y=4, y_units="screen", x_offset=4, text=mark.words, **LABEL))


LABEL = {"text_color": QUIET, "text_font_size": "11px"}


def _places(axis: Axis, values: Sequence[float], kept: Sequence[int]) -> list[Any]:
    if axis.dates:
        return [round(_place(axis, values[k])) for k in kept]
    if not axis.categories:
        return _round_values(values, kept)
    names = _names(axis)
    return [names[round(values[k])] for k in kept]


def _place(axis: Axis, value: float) -> float:
    """A number of an axis as the library has it: dates in milliseconds."""
    return 1000.0 * value if axis.dates else value


def _names(axis: Axis) -> list[str]:
    """Categories, made distinct where two have the same name."""
    met: dict[str, int] = {}
    names = []
    for name in axis.categories:
        met[name] = met.get(name, 0) + 1
        names.append(name if met[name] == 1 else f"{name} ({met[name]})")
    return names


def _round_values(values: Sequence[float], kept: Sequence[int] | None = None) -> list[float]:
    chosen = values if kept is None else [values[k] for k in kept]
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else math.nan for v in chosen]


def _are_finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


def _renumber(item: dict[str, Any]) -> dict[str, Any]:
    """The item with its ids counted from 1 in the order in which they are met, wherever they stand."""
    numbers: dict[str, str] = {}

    def number(name: str) -> str:
        return numbers.setdefault(name, f"p{len(numbers) + 1}")

    def walked(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: number(v) if k in IDS and isinstance(v, str) else walked(v) for k, v in value.items()}
        if isinstance(value, list):
            return [walked(v) for v in value]
        return {"type": "number", "value": "nan"} if isinstance(value, float) and math.isnan(value) else value

    return dict(walked(item))


IDS = frozenset({"id", "root_id"})
"""Keys under which a model's number stands."""
