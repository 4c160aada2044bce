"""Surface points followed through the clip and lifted to 3-D; and whether the camera stood still."""

from .background import CameraMotion, camera_motion
from .follow import follow, follow_on
from .tripod import OnTripod, on_tripod

__all__ = ["CameraMotion", "OnTripod", "camera_motion", "follow", "follow_on", "on_tripod"]
