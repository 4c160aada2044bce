"""Errors that a user can act on."""


class InputError(ValueError):
    """Bad input. The message is one sentence that names the input, the bound it misses and the cure.

    The command line prints it and exits with status 2; a node logs it and publishes it in ~/quality.
    """


class SimulationError(RuntimeError):
    """The simulation left its bounds. The message names frame, substep and particle, and what to lower."""
