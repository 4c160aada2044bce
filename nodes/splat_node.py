"""splat_node: first image, mask and depth in, static 3D Gaussians out."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from diffphys_ros.msg_schemas import messages
from diffphys_ros.msg_schemas.messages import world_frame

from .child import steps
from .clip_checks import in_world
from .clip_stage import ClipStage, assembled
from .splat_job import fit
from .splat_topic import splat_cloud
from .worker import Job

SPLATS = "splats"


class SplatNode(ClipStage):
    """Fits Gaussians to frame 0 when clip and masks are complete, again when the masks change, and latches them on `splats`."""

    def __init__(self) -> None:
        self.loss: float | None = None
        super().__init__("splat_node", publishes=[SPLATS], masks=True, first_alone=True)

    def health(self) -> dict[str, Any]:
        return super().health() | {"loss": self.loss}

    def job(self) -> Job:
        buffer, settings, drawn = self.buffer.copy(), self.parameters.settings(), self.drawing()

        def fitted() -> Generator[Any, None, dict[str, Any]]:
            clip = in_world((yield from assembled(buffer, frames=1)), settings)
            splats, camera = yield from steps(fit, clip, drawn(settings, clip.camera))
            return splat_cloud(splats, messages.header(clip.start_ns, world_frame(camera)), buffer.first_labels_crc())

        return fitted

    def on_news(self, news: Any) -> None:
        self.loss = news.loss if news.loss is not None else self.loss

    def on_done(self, cloud: dict[str, Any]) -> None:
        self.send(SPLATS, cloud)
        self.get_logger().info(f"published {cloud['width']} Gaussians, loss {self.loss}")
