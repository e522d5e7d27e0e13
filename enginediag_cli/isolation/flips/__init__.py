"""What would flip an answer: the smallest single error of a map, an instrument or the prior that changes its name."""
