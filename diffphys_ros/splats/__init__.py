"""3D Gaussians: of frame 0, back-projected from depth and fitted; of many views; .ply in and out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import ply

if TYPE_CHECKING:
    from .ellipsoids import from_points
    from .fit import fit_splats
    from .multi_view import fit_views
    from .view import Motion, View

__all__ = ["Motion", "View", "fit_splats", "fit_views", "from_points", "ply"]

_FILES = {"Motion": "view", "View": "view", "fit_splats": "fit", "fit_views": "multi_view", "from_points": "ellipsoids"}


def __getattr__(name: str) -> Any:
    """Torch and Warp take seconds to import: who only moves Gaussians between .ply and topics does not wait for them."""
    if name not in _FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_FILES[name]}", __name__), name)
