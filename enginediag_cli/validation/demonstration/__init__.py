"""The demonstration: what is put into simulated flights, what the commands find, and how the two compare."""
