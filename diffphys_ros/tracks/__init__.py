"""Surface points followed through the clip and lifted to 3-D; and whether the camera stood still."""

from .background import CameraMotion, camera_motion
from .carried import carried
from .follow import LostError, follow, follow_on
from .tripod import OnTripod, laid_over_first, on_tripod

__all__ = ["CameraMotion", "LostError", "OnTripod", "camera_motion", "carried", "follow", "follow_on", "laid_over_first", "on_tripod"]
