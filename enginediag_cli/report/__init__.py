"""Report: everything that is shown: result tables, messages, pictures, and the HTML report.

It reads results of the library and gives rows (CSV, JSON, tables for a terminal), sentences on stderr, SVG pictures and
pages. Nothing is computed here that is not in a result.

Open first: `tables` (the columns of each command, declared once), `output` (formats and files), `messages` (notes,
warnings, progress, log), `plotting` (charts as data; `svg` and `interactive` draw them). The HTML report: `evidence`
(results sorted by engine), `page` and `engine_page` (its sections), `html` (how they are written). `reference` makes
the pages of the command reference.
"""
