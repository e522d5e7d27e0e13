"""Planning: which flight to record next, so that alternative hypotheses separate soonest.

It reads the envelope of an engine and the predictions of the hypotheses, and gives `Suggestion` objects: a flight, a
switched effect or a further sensor, each with the probability of identifying the right hypothesis by it.
`flights` holds all of it.
"""
