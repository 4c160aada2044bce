"""Layouts of everything that is published: clouds, frames, QoS, units. No ROS import; nodes, bags and tests share it."""

from .recording import recording
from .topics import TOPICS, Topic

__all__ = ["TOPICS", "Topic", "recording"]
