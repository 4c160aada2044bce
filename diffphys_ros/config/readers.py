"""Who reads which settings: a flag or a parameter that would change nothing is refused; a file of settings serves them all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from ..errors import InputError
from .leaf import leaves

_FIT = ("scene", "camera", "topics", "sync", "segment", "depth", "tracks", "prior", "fit", "publish")
_OF_WORLD = ("scene.gravity_m_s2", "scene.thickness_axis", "scene.clamp_box_m", "scene.floor_z_m")  # who reads them waits for a world
_RECOVER = (*_FIT, "frames", "experiment")
READERS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {  # groups, and single settings of others
        "diffphys recover": _RECOVER,
        "diffphys ingest": _RECOVER,
        "diffphys batch": _RECOVER,
        "diffphys capture": ("scene", "camera", "topics", "sync", "segment", "depth", "fit", "capture", "experiment"),
        "ingest_node": ("topics", "sync", "camera", "scene.target_frame", *_OF_WORLD, "frames.every"),
        "segment_node": ("scene", "segment", "depth", "tracks.evidence", "prior.materials", "fit.device"),
        "splat_node": ("scene", "depth", "fit.device"),
        "fit_node": (*_FIT, "playback", "frames.every"),
        "inspect_node": (),
    }
)


def read_by(reader: str) -> list[str]:
    """Dotted names of the settings that one of READERS may be given, in the order of the tree."""
    return [name for name in leaves() if _reads(reader, name)]


def require_read(names: Iterable[str], reader: str, origin: str) -> None:
    """Raises InputError for the first setting of `names` that `reader` does not read; what is no setting is `build`'s to refuse."""
    for name in names:
        if name in leaves() and not _reads(reader, name):
            others = ", ".join(other for other in READERS if _reads(other, name))
            raise InputError(f"{origin}: {name} is not read here but by {others}; give it there, or in a YAML file of settings")


def _reads(reader: str, name: str) -> bool:
    return bool({name, name.partition(".")[0]} & set(READERS.get(reader, ())))
