"""Which pixels are the object, and which part of it: label images for every frame."""

from .label import described, label_clip
from .plain import plain_labels
from .prompt import Mark

__all__ = ["Mark", "described", "label_clip", "plain_labels"]
