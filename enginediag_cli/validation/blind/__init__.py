"""Blind trials: something is drawn and concealed, an explainer in another process judges, a scorer opens the answer."""
