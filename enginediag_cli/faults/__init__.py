"""The catalogue of faults: named directions in parameter space, errors of instruments, and their laws in time."""
