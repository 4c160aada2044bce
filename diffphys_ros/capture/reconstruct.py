"""Pictures of a still object in, cameras, sparse points and Gaussians out (paper section 4.1: COLMAP, then static Gaussians)."""

from __future__ import annotations

import shutil
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import store
from ..bags.read import is_bag, read_clip
from ..config import Settings
from ..depth.capture import FILE, ClipView
from ..devices import usable
from ..errors import InputError
from ..progress import Progress, told
from ..splats import ply
from ..types import Camera, Clip, Splats, object_mask
from . import folder as places
from .align import read_positions
from .clip_view import SURFACE, World, in_world, object_depth, place_clip, unknown_world, world_of, world_of_positions
from .folder import Capture
from .gaussians import THROUGH, part_of_object, pick, scene_gaussians
from .pictures import CLIP_NAME, Picture, pictures_of
from .structure import (
    EXHAUSTIVE_UP_TO,
    LONE_MODEL,
    MODELS,
    PictureCamera,
    Structure,
    find_features,
    match,
    read_structure,
    reconstruct_sparse,
    write_dataset,
    write_image,
)
from .thickness import thickness_along
from .views import Shot, moved, shot


@dataclass(frozen=True)
class _Seen:
    """The clip's frame 0 among the pictures."""

    clip: Clip  # with labels, the intrinsics found, frame 0 undistorted
    taken: np.ndarray  # frame 0 as the clip has it, uint8 (H, W, 3)
    distortion: np.ndarray  # shape (4,)
    shot: Shot
    depth: np.ndarray  # of the object, in the unit of the reconstruction, 0 where unknown, (H, W)

    @property
    def mask(self) -> np.ndarray:
        """The object, bool (H, W)."""
        assert self.clip.labels is not None
        return object_mask(self.clip.labels[0])


def reconstruct(images: str | Path, out: str | Path, settings: Settings, clip: str | Path | None = None) -> Generator[Progress, None, Capture]:
    """Structure from motion, metric scale and Gaussians of a still scene, written to the folder `out` whole or not at all.

    Args:
        images: folder of images, video, or recording of the still object from all around.
        out: folder to write. An interrupted or earlier run's structure from motion is used again where it was made of the same.
        settings: `capture.*`; `scene.*`, `segment.*` and `topics.*` for the clip; `experiment.view_iterations`, `fit.device`.
        clip: the clip whose object this is; its frame 0 joins the pictures and gives the world frame and the metric scale.

    Raises InputError for pictures from which nothing can be built, a clip whose frame 0 finds no place among them, and places that
    cannot be written.
    """
    usable(settings.fit.device)  # one that is not there is known before an hour's work
    out, source = Path(out), Path(clip) if clip is not None else None
    film = None if source is None else read_clip(source, settings)
    work = places.begin(out)
    sparse = work / places.SPARSE
    yield Progress("pictures", text=f"reading {images}")
    lenses = _write_pictures(Path(images), sparse, settings, film, known=source is not None and (is_bag(source) or settings.camera.fov_deg is not None))
    structure = yield from _structure(sparse, lenses, settings, None if film is None else CLIP_NAME)
    yield Progress("structure", text=describe(structure))
    seen = None if film is None else (yield from _find_clip(film, structure, sparse / places.PICTURES, settings))
    world = _world(structure, seen, settings)
    yield Progress("scale", text=f"metric scale: {world.scale}")
    capture = yield from _write(work, structure, seen, world, settings)
    places.finish(work, out)
    return capture


def describe(structure: Structure) -> str:
    """A reconstruction in a line for people."""
    lost = f"; without a place: {', '.join(structure.lost)}" if structure.lost else ""
    return f"{len(structure.placed)} pictures placed, {len(structure.points)} points, reprojection error {structure.error_px:.2f} px{lost}"


def _write_pictures(images: Path, sparse: Path, settings: Settings, film: Clip | None, *, known: bool) -> list[PictureCamera]:
    """Every picture as a file; the cameras that took them. `known`: the clip's intrinsics are not assumed."""
    target = sparse / places.PICTURES
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    pictures, matrix = pictures_of(images, settings)
    names, height, width = [], 0, 0
    for picture in pictures:
        _write_picture(target, picture)
        names.append(picture.name)
        height, width = picture.image.shape[:2]
    model = MODELS[settings.capture.lens]
    if film is None:
        return [PictureCamera(tuple(names), width, height, model, matrix)]
    _write_picture(target, Picture(CLIP_NAME, film.frames[0]))
    own = film.camera.pixel_from_camera if known else None
    if settings.capture.same_camera:
        if (width, height) != (film.camera.width, film.camera.height):
            raise InputError(
                f"capture.same_camera: the pictures have {width}x{height} px, the clip {film.camera.width}x{film.camera.height} px, must be equal; "
                "leave it out, or take the pictures with the clip's camera and size"
            )
        return [PictureCamera((*names, CLIP_NAME), width, height, model, matrix if own is None else own)]
    return [PictureCamera(tuple(names), width, height, model, matrix), PictureCamera((CLIP_NAME,), film.camera.width, film.camera.height, LONE_MODEL, own)]


def _write_picture(target: Path, picture: Picture) -> None:
    write_image(target / picture.name, picture.image)


def _structure(sparse: Path, lenses: list[PictureCamera], settings: Settings, needed: str | None) -> Generator[Progress, None, Structure]:
    """The sparse reconstruction, that of an earlier run where it was made of the same."""
    pictures, database, model = (sparse / name for name in (places.PICTURES, places.DATABASE, places.MODEL))
    names = [name for lens in lenses for name in lens.names]
    stamp = places.stamp_of(pictures, lenses, {"matching": settings.capture.matching})
    if places.is_made_of(sparse, stamp):
        yield Progress("structure", text="taken over from an earlier run")
        return read_structure(model, names)
    (sparse / places.STAMP).unlink(missing_ok=True)
    database.unlink(missing_ok=True)
    shutil.rmtree(model, ignore_errors=True)
    for k, _ in enumerate(find_features(database, pictures, lenses)):
        yield Progress("features", iteration=k + 1, iterations=len(names))
    exhaustive = settings.capture.matching == "exhaustive" or (settings.capture.matching == "auto" and len(names) <= EXHAUSTIVE_UP_TO)
    yield Progress("matching", text=f"{len(names)} pictures, {'all pairs' if exhaustive else 'neighbours in time'}")
    match(database, exhaustive=exhaustive)
    yield Progress("structure", text="placing pictures")
    reconstruct_sparse(database, pictures, model, needed=needed)
    structure = read_structure(model, names)
    database.unlink()
    (sparse / places.STAMP).write_text(stamp, encoding="utf-8")
    return structure


def _find_clip(film: Clip, structure: Structure, pictures: Path, settings: Settings) -> Generator[Progress, None, _Seen]:
    from ..segment import label_clip

    placed = structure.named(CLIP_NAME)
    assert placed is not None  # reconstruct_sparse refuses otherwise
    first, clip = place_clip(placed, film)
    yield Progress("segment", text="the object in frame 0 of the clip")
    clip = clip.with_labels(label_clip(clip, settings))
    yield Progress("depth", text="depth of frame 0 from its neighbours")
    others = [shot(p, pictures) for p in structure.placed if p.name != CLIP_NAME]
    assert clip.labels is not None
    return _Seen(clip, film.frames[0], placed.distortion, first, object_depth(first, others, structure, clip.labels[0]))


def _world(structure: Structure, seen: _Seen | None, settings: Settings) -> World:
    if settings.capture.positions is not None:
        return world_of_positions(structure, read_positions(Path(settings.capture.positions)), settings.capture.positions)
    return unknown_world(structure) if seen is None else world_of(structure, seen.shot, seen.depth, seen.clip, settings)


def _write(work: Path, structure: Structure, seen: _Seen | None, world: World, settings: Settings) -> Generator[Progress, None, Capture]:
    """Everything that a finished capture holds; returns its description."""
    pictures = work / places.SPARSE / places.PICTURES
    for name in ("images", "sparse"):
        shutil.rmtree(work / name, ignore_errors=True)
    write_dataset(work / places.SPARSE / places.MODEL, pictures, work, world.similarity)
    scale = float(np.cbrt(np.linalg.det(world.similarity[:3, :3])))
    points = structure.points @ world.similarity[:3, :3].T + world.similarity[:3, 3]
    cameras = tuple(moved(p.camera, world.similarity, world.frame_id) for p in structure.placed)
    splats = None
    if settings.capture.max_gaussians:
        shots = [shot(p, pictures) for p in structure.placed]
        splats = yield from _gaussians(shots, cameras, points, structure.colors, settings)
        ply.write(work / places.SCENE, splats)
    names = tuple(p.name for p in structure.placed)
    capture = Capture(
        names, cameras, points, structure.colors, structure.errors, structure.error_px, world.scale, structure.lost, 0 if splats is None else len(splats.mean)
    )
    if seen is not None:
        camera, depth = in_world(seen.shot, seen.clip, world), (scale * seen.depth).astype(np.float32)
        capture = _with_object(work, capture, seen, camera, depth, splats)
        axis = np.array(settings.scene.thickness_unit or camera.world_from_camera[:3, 2], float)
        thickness, note = _thickness(structure, capture, camera, seen.mask, depth, axis)
        capture = replace(capture, notes=(*capture.notes, note))
        view = ClipView(seen.taken, camera, seen.distortion, depth, SURFACE, world.scale, thickness, axis)
        store.write_arrays(work / FILE, view.arrays())
    for note in capture.notes:
        yield Progress("object", text=note)
    store.save(work / places.CAPTURE, capture)
    return capture


def _gaussians(
    shots: list[Shot], cameras: tuple[Camera, ...], points: np.ndarray, colors: np.ndarray, settings: Settings
) -> Generator[Progress, None, Splats]:
    return (yield from told("gaussians", scene_gaussians(shots, cameras, points, colors, settings, usable(settings.fit.device))))


def _with_object(work: Path, capture: Capture, seen: _Seen, camera: Camera, depth: np.ndarray, splats: Splats | None) -> Capture:
    """Writes object.ply; the capture with what is known of the object."""
    share = float((depth[seen.mask] > 0).mean())
    note = f"{share:.0%} of the object's pixels have a depth from other pictures, the rest is filled from around"
    if splats is None:
        return replace(capture, notes=(note,))
    chosen = part_of_object(splats.mean.astype(float), camera, seen.mask, depth)
    if chosen.any():
        ply.write(work / places.OBJECT, pick(splats, chosen))
    return replace(capture, notes=(note,), object_gaussians=int(chosen.sum()))


def _thickness(
    structure: Structure, capture: Capture, camera: Camera, mask: np.ndarray, depth: np.ndarray, axis: np.ndarray
) -> tuple[float, str]:
    """Extent [m] of the object's sparse points along a world axis, and how it is known; NaN where it is not."""
    around = np.flatnonzero(part_of_object(capture.points, camera, mask, depth, link=THROUGH))
    surface = part_of_object(capture.points, camera, mask, depth)[around]
    shown = [np.isin(around, placed.seen) for placed in structure.placed]
    return thickness_along(axis, capture.points[around], surface, shown, capture.cameras, camera)
