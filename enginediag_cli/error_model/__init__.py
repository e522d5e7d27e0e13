"""One error model: how wrong the engine's maps may be, what that does to every answer, and how large it is."""
