"""When simulation and recordings differ: where, which physics was left out, the refined model, and the proof."""
