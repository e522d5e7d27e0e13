"""One physical effect per module; the module is named as its term. `enginediag_cli.physics.registry` finds them."""
