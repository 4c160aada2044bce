"""Which pixels are the object, and which part of it: label images for every frame."""

from .label import label_clip

__all__ = ["label_clip"]
