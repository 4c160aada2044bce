"""From a simulator's call to kernels on a device: shapes in memory, launches, tape, replay backwards."""
