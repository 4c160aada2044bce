"""Surface points followed through the clip and lifted to 3-D; and whether the camera stood still."""

from .background import CameraMotion, camera_motion
from .follow import follow, follow_on

__all__ = ["CameraMotion", "camera_motion", "follow", "follow_on"]
