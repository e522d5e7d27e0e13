"""Charts: one model of a chart, and what draws it as SVG, as a plot that moves, or as PNG."""
