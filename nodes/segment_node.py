"""segment_node: clip in, part labels out."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from .clip_stage import MASK, ClipStage
from .clip_topics import mask_messages, slot_stamps
from .worker import Job


class SegmentNode(ClipStage):
    """Publishes clip/mask, one mono8 label image per frame, when the clip is complete."""

    def __init__(self) -> None:
        super().__init__("segment_node", publishes=[MASK], masks=False)

    def job(self) -> Job:
        buffer, settings = self.buffer, self.parameters.settings()

        def label() -> Generator[str, None, list[Any]]:
            from diffphys_ros.segment import label_clip

            clip = buffer.clip()
            yield f"labelling {len(clip)} frames"
            return list(mask_messages(clip.with_labels(label_clip(clip, settings)), slot_stamps(clip, buffer.stamps())))

        return label

    def on_news(self, news: str) -> None:
        self.get_logger().info(news)

    def on_done(self, masks: list[Any]) -> None:
        self.advertise(MASK)
        for name, fields in masks:
            self.send(name, fields)
        self.get_logger().info(f"published {len(masks)} label images")
