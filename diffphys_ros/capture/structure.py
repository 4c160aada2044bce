"""Structure from motion through pycolmap (COLMAP, Schoenberger and Frahm 2016): the one door to it.

Everything runs on the CPU, picture by picture in a fixed order and from fixed seeds, so that equal pictures give equal answers.
COLMAP's pixel centres lie at half integers, those of `types.Camera` at integers.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Camera

SEED = 0
MOST_FEATURES = 4096  # a picture; matching takes time with their square
LEAST_FEATURES = 60  # with fewer on most pictures there is no texture to match
EXHAUSTIVE_UP_TO = 60  # pictures, all pairs of which are matched where capture.matching is auto
SEQUENTIAL_OVERLAP = 12  # neighbours in time that a picture is matched with otherwise
FOCAL_OVER_WIDTH = 1.2  # first guess of a focal length that is not known
LEAST_SHARE = 0.5  # of the pictures that must find their place
MODELS = {"opencv": "OPENCV", "pinhole": "PINHOLE"}  # capture.lens -> COLMAP's camera model
LONE_MODEL = "SIMPLE_RADIAL"  # of a camera that took one picture only


@dataclass(frozen=True)
class PictureCamera:
    """A camera that took some of the pictures."""

    names: tuple[str, ...]  # files in the folder of pictures
    width: int  # px
    height: int  # px
    model: str  # COLMAP's name
    pixel_from_camera: np.ndarray | None = None  # known and held, px, shape (3, 3); None: estimated, with distortion as the model has it


@dataclass(frozen=True)
class Placed:
    """One picture that found its place, in the frame and the unit of the reconstruction."""

    name: str
    camera: Camera
    distortion: np.ndarray  # k1 k2 p1 p2 as OpenCV has them, shape (4,)
    seen: np.ndarray  # sparse points that it shows, indices, shape (K,)
    pixels: np.ndarray  # where they were found [px], as taken (not undistorted), shape (K, 2)


@dataclass(frozen=True)
class Structure:
    """A sparse reconstruction, in a frame and a unit of its own."""

    placed: tuple[Placed, ...]  # in the order of names
    points: np.ndarray  # shape (N, 3)
    colors: np.ndarray  # RGB, uint8, shape (N, 3)
    errors: np.ndarray  # mean reprojection error [px], shape (N,)
    error_px: float  # of the reconstruction
    lost: tuple[str, ...]  # pictures without a place

    def named(self, name: str) -> Placed | None:
        """The picture of that name, None where it has no place."""
        return next((p for p in self.placed if p.name == name), None)


def colmap() -> ModuleType:
    """pycolmap, silent. Raises InputError where it is not installed."""
    try:
        import pycolmap
    except ModuleNotFoundError as error:
        raise InputError("capture: needs the package pycolmap; install diffphys_ros with the extra [capture]") from error
    pycolmap.logging.minloglevel = 3
    return pycolmap


def find_features(database: Path, folder: Path, lenses: Sequence[PictureCamera]) -> Iterator[str]:
    """Writes the SIFT features of every lens's pictures into a database that is made; yields each name when it is done."""
    pycolmap = colmap()
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads, extraction.sift.max_num_features = 1, MOST_FEATURES
    for lens in lenses:
        reader = pycolmap.ImageReaderOptions()
        with pycolmap.Database.open(database) as file:
            reader.existing_camera_id = file.write_camera(_camera_of(pycolmap, lens))
        for name in lens.names:
            pycolmap.set_random_seed(SEED)
            pycolmap.extract_features(
                database, folder, [name], reader_options=reader, extraction_options=extraction, device=pycolmap.Device.cpu
            )
            yield name


def match(database: Path, *, exhaustive: bool) -> None:
    """Matches the features of all pairs of pictures, or of those that follow each other, and keeps what one geometry explains.

    Raises InputError where hardly a picture has features.
    """
    pycolmap = colmap()
    with pycolmap.Database.open(database) as file:
        counts = [file.num_keypoints_for_image(image.image_id) for image in file.read_all_images()]
    if np.median(counts) < LEAST_FEATURES:
        raise InputError(
            f"capture: a picture holds {int(np.median(counts))} SIFT features at the median, needs at least {LEAST_FEATURES}; "
            "put the object on or before something with texture (printed cloth, newspaper) and focus"
        )
    matching, verification = pycolmap.FeatureMatchingOptions(), pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    pycolmap.set_random_seed(SEED)
    if exhaustive:
        pycolmap.match_exhaustive(database, matching, verification_options=verification, device=pycolmap.Device.cpu)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = SEQUENTIAL_OVERLAP
    pycolmap.match_sequential(database, matching, pairing, verification, device=pycolmap.Device.cpu)


def reconstruct_sparse(database: Path, folder: Path, out: Path, *, needed: str | None) -> None:
    """Incremental mapping; writes the largest model (that with the picture `needed`, where one is named) in COLMAP's binary format.

    Raises InputError where no model holds half of the pictures, or none the needed one.
    """
    pycolmap = colmap()
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.structure_less_registration_fallback = 1, False
    for part in (options, options.mapper, options.triangulation):
        part.random_seed = SEED
    with pycolmap.Database.open(database) as file:
        count = file.num_images()
        options.constant_cameras = {c.camera_id for c in file.read_all_cameras() if c.has_prior_focal_length}  # calibrated
    options.min_model_size = 3
    pycolmap.set_random_seed(SEED)
    scratch = out.with_name(out.name + ".models")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    models = pycolmap.incremental_mapping(database, folder, scratch, options).values()
    shutil.rmtree(scratch)
    best = _largest(models, needed, count)
    out.mkdir(parents=True, exist_ok=True)
    best.write(out)


def read_structure(folder: Path, names: Sequence[str]) -> Structure:
    """The model in a folder of COLMAP's binary format; `names` are all pictures that were given."""
    model = colmap().Reconstruction(folder)
    ids = sorted(model.point3D_ids())
    row = {identifier: k for k, identifier in enumerate(ids)}
    points = [model.point3D(identifier) for identifier in ids]
    placed = sorted((_placed(image, row) for image in model.images.values() if image.has_pose), key=lambda p: p.name)
    found = {p.name for p in placed}
    return Structure(
        placed=tuple(placed),
        points=np.array([p.xyz for p in points]).reshape(-1, 3),
        colors=np.array([p.color for p in points], np.uint8).reshape(-1, 3),
        errors=np.array([p.error for p in points]),
        error_px=float(model.compute_mean_reprojection_error()),
        lost=tuple(sorted(set(names) - found)),
    )


def write_dataset(model: Path, folder: Path, out: Path, similarity: np.ndarray) -> None:
    """Undistorted pictures (out/images) and the model moved by a similarity (4, 4) (out/sparse/0) in COLMAP's binary format, as
    trainers of Gaussians and radiance fields read it."""
    pycolmap = colmap()
    pycolmap.undistort_images(out, model, folder, num_threads=1)
    moved = pycolmap.Reconstruction(out / "sparse")
    moved.transform(pycolmap.Sim3d(similarity[:3]))
    for file in (out / "sparse").iterdir():
        file.unlink()
    (out / "sparse" / "0").mkdir()
    moved.write(out / "sparse" / "0")
    for name in ("stereo", "run-colmap-geometric.sh", "run-colmap-photometric.sh"):  # for dense stereo, which nothing here runs
        path = out / name
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def read_image(path: Path) -> np.ndarray:
    """RGB uint8 (H, W, 3) of an image file that this room wrote."""
    return np.ascontiguousarray(colmap().Bitmap.read(path, as_rgb=True).to_array())


def write_image(path: Path, image: np.ndarray) -> None:
    """A .png of an RGB uint8 image (H, W, 3)."""
    if not colmap().Bitmap.from_array(np.ascontiguousarray(image)).write(path):
        raise InputError(f"capture {path}: the picture cannot be written; free space or choose another folder")


def _camera_of(pycolmap: ModuleType, lens: PictureCamera) -> Any:
    if lens.pixel_from_camera is None:
        return pycolmap.Camera.create_from_model_name(0, lens.model, FOCAL_OVER_WIDTH * max(lens.width, lens.height), lens.width, lens.height)
    k = lens.pixel_from_camera
    camera = pycolmap.Camera.create_from_model_name(0, "PINHOLE", k[0, 0], lens.width, lens.height)
    camera.params = [k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5]
    camera.has_prior_focal_length = True
    return camera


def _largest(models: Any, needed: str | None, count: int) -> Any:
    ranked = sorted(models, key=lambda m: (m.num_reg_images(), m.num_points3D()), reverse=True)
    if not ranked:
        raise InputError(
            "capture: no two pictures could be placed against each other; take more with small steps around the object, in focus and with texture in view"
        )
    best = ranked[0]
    if needed is not None:
        best = next((m for m in ranked if _has(m, needed)), None)
    if best is None:
        raise InputError(
            "capture: frame 0 of the clip found no place among the pictures; take some from near the clip's camera, with the scene as it is in the clip"
        )
    if best.num_reg_images() < LEAST_SHARE * count:
        raise InputError(
            f"capture: {best.num_reg_images()} of {count} pictures found their place, needs at least {LEAST_SHARE:.0%}; "
            "take them in smaller steps, in focus, with texture in view"
        )
    return best


def _has(model: Any, name: str) -> bool:
    image = model.find_image_with_name(name)
    return image is not None and image.has_pose


def _placed(image: Any, row: dict[int, int]) -> Placed:
    matched = list(image.get_observation_points2D())
    matrix, distortion = _intrinsics(image.camera)
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().inverse().matrix()
    return Placed(
        name=image.name,
        camera=Camera(matrix, pose, image.camera.width, image.camera.height),
        distortion=distortion,
        seen=np.array([row[p.point3D_id] for p in matched], int),
        pixels=np.array([p.xy for p in matched]).reshape(-1, 2) - 0.5,
    )


def _intrinsics(camera: Any) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsic matrix (3, 3) [px], pixel centres at integers, and OpenCV's k1 k2 p1 p2."""
    matrix = np.array(camera.calibration_matrix())
    matrix[:2, 2] -= 0.5
    extra = np.array(camera.params)[list(camera.extra_params_idxs())]
    return matrix, np.concatenate([extra, np.zeros(4 - len(extra))])
