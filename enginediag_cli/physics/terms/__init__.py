"""The library of effects, in families; a new effect is one class in its family."""
