"""Charts as data: what is drawn, in which units, and the rows it came from; one file per kind, two renderers."""
