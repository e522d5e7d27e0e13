"""Monte-Carlo studies: how often diagnosis is right, on data of the full engine model with known faults."""
