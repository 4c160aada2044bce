"""First answers on coarser elements than a user's, in half the time."""

from tests.coarse import coarse

__all__ = ["coarse"]
