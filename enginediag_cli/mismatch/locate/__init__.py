"""Where model and recordings differ: location and driver."""
