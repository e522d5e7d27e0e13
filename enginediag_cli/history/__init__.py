"""What changed in an engine over its flights: one model, and one result that everything else reads.

It reads the windows of recordings and gives an `EngineTrend` for each engine: whether anything changed, what, since
when, how, and how much now. `trend`, `fleet`, `detect --follow`, margins and the report read it.

Begin with `posterior` (`judge_history`, the whole chain, and its result), then `hypotheses` (what may have changed,
and how), `background` (what is uncertain beside that) and `search` (several changes at once). `engines` makes
histories from windows; `follow` watches one flight while it is recorded; `deltas` has the raw deltas of engine
monitoring.
"""
