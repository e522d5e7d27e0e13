"""enginediag: diagnosis of gas turbines from recorded flights with a nonlinear physical model."""

__version__ = "0.4.0"
