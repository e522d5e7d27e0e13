"""Pictures as SVG files, written without a plotting library: the same numbers give the same bytes."""
