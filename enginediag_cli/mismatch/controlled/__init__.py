"""Controls that a model lacks: readings that stand still, what holds them, and whether that predicts the others."""
