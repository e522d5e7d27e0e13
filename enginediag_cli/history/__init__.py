"""What changed in an engine over its flights: one model, and one result that everything else reads."""
