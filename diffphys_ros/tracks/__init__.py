"""Surface points followed through the clip and lifted to 3-D."""

from .follow import follow

__all__ = ["follow"]
