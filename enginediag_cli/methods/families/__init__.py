"""Five families of residuals behind one interface, to be compared on the same windows."""
