"""Laws that an engine file states by a formula: data, where `physics/terms/` are code."""
