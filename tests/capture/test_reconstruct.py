"""Claims about captures of a room whose geometry is known."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.capture import load, reconstruct
from diffphys_ros.capture.pictures import CLIP_NAME
from diffphys_ros.depth.capture import read_clip_view
from diffphys_ros.depth.scale import _extent_at_unit_depth
from diffphys_ros.errors import InputError
from diffphys_ros.splats import ply
from diffphys_ros.types import Camera

from . import room
from .conftest import Made, run, settings_of

NEAR = "123567"  # pictures that suffice for the clip to find its place among them


def turn_deg(a: Camera, b: Camera) -> float:
    """Angle between two cameras."""
    cosine = (np.trace(a.world_from_camera[:3, :3].T @ b.world_from_camera[:3, :3]) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def of_pictures(made: Made) -> list[tuple[Camera, Camera]]:
    """Cameras as found and as they were."""
    found = dict(zip(made.capture.names, made.capture.cameras, strict=True))
    return [(found[f"view_{k:02d}.png"], camera) for k, camera in enumerate(made.cameras)]


def some_of(made: Made, folder: Path, numbers: str) -> Path:
    """The pictures of these numbers alone: the fewer, the sooner their features are found and matched; six are the least."""
    folder.mkdir()
    for k in numbers:
        shutil.copy(made.images / f"view_{int(k):02d}.png", folder)
    return folder


def test_every_picture_finds_its_place_in_the_clips_world_in_metres(made: Made) -> None:
    assert made.capture.lost == ()
    assert made.capture.error_px < 0.5
    pairs = of_pictures(made)
    assert np.median([turn_deg(a, b) for a, b in pairs]) < 0.2
    assert np.median([np.linalg.norm(a.position - b.position) for a, b in pairs]) < 0.005  # 1 % of the distance
    assert made.capture.scale.startswith("depth topic")


def test_an_unknown_focal_length_is_found(made: Made) -> None:
    assert made.capture.cameras[-1].focal_px == pytest.approx(room.FOCAL, rel=0.01)


def test_sparse_points_lie_on_the_surfaces(made: Made) -> None:
    pixels, depth = made.clip_camera.project(made.capture.points)
    inside = ((pixels > 0) & (pixels < np.array(room.SIZE) - 1)).all(1)
    on = trace_depth(made.clip_camera, pixels[inside])
    hidden = depth[inside] > 1.02 * on  # seen by other pictures alone
    error = np.abs(depth[inside] - on)[~hidden]
    assert (~hidden).sum() > 150
    assert np.median(error) < 0.003


def trace_depth(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    return room.trace(camera, pixels, texture=False)[1]


def test_frame_0_gets_the_depth_of_the_object_to_millimetres(made: Made) -> None:
    view = read_clip_view(made.out)
    _, true, mask = room.picture(made.clip_camera)
    known = mask & (view.depth > 0)
    error = np.abs(view.depth - true)[known]
    assert known.sum() > 0.8 * mask.sum()
    assert (view.depth[~mask] == 0).all()
    assert np.median(error) < 0.002
    assert np.quantile(error, 0.95) < 0.012


def test_the_clips_camera_stays_as_its_recording_has_it(made: Made) -> None:
    camera = read_clip_view(made.out).camera
    assert np.allclose(camera.world_from_camera, made.clip_camera.world_from_camera, atol=1e-6)
    assert np.allclose(camera.pixel_from_camera, made.clip_camera.pixel_from_camera)
    assert camera.world_frame_id == "world"


def test_no_thickness_is_claimed_where_no_picture_shows_the_back(made: Made) -> None:
    assert np.isnan(read_clip_view(made.out).thickness_m)
    assert any("not measured" in note for note in made.capture.notes)


def test_the_object_is_what_hangs_together_with_what_frame_0_shows_of_it(made: Made) -> None:
    scene, body = (ply.read(made.out / name) for name in ("scene.ply", "object.ply"))
    assert len(scene.mean) == made.capture.gaussians
    assert len(body.mean) == made.capture.object_gaussians
    middle = np.abs(body.mean - (room.LOW + room.HIGH) / 2) - (room.HIGH - room.LOW) / 2
    assert np.quantile(middle.max(1), 0.95) < 0.02  # beside the box by no more, the wall is 0.4 m behind
    assert 0.02 < len(body.mean) / len(scene.mean) < 0.8


def test_an_interrupted_run_goes_on_after_the_reconstruction(made: Made, tmp_path: Path) -> None:
    settings = settings_of()
    shutil.copytree(made.out / "sfm", tmp_path / "out.part" / "sfm")  # what a run leaves that was stopped after it
    steps = reconstruct(made.images, tmp_path / "out", settings, made.clip)
    capture, news = run(steps)
    assert "taken over from an earlier run" in [n.text for n in news]
    assert not any(n.stage == "features" for n in news)
    assert not (tmp_path / "out.part").exists()
    assert np.array_equal(capture.points, made.capture.points)


def test_a_run_that_is_stopped_leaves_no_capture_and_other_pictures_are_not_taken_for_the_same(made: Made, tmp_path: Path) -> None:
    shutil.copytree(made.out / "sfm", tmp_path / "out.part" / "sfm")
    images = shutil.copytree(made.images, tmp_path / "images")
    (images / "view_08.png").unlink()
    steps = reconstruct(images, tmp_path / "out", settings_of(), made.clip)
    assert next(n for n in steps if n.stage == "features").iterations == 9
    steps.close()
    assert not (tmp_path / "out").exists()


def test_a_finished_capture_is_kept_until_the_next_is_whole(made: Made, tmp_path: Path) -> None:
    out = shutil.copytree(made.out, tmp_path / "out")
    steps = reconstruct(made.images, out, settings_of(), made.clip)
    while next(steps).stage != "scale":
        assert load(out).gaussians == made.capture.gaussians
    run(steps)
    assert load(out).gaussians == 0


def test_other_tools_read_pictures_and_model_in_colmaps_layout(made: Made) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(made.out / "sparse" / "0")
    assert model.num_reg_images() == len(made.capture.names)
    assert {camera.model.name for camera in model.cameras.values()} == {"PINHOLE"}
    found = sorted(tuple(p.xyz) for p in model.points3D.values())
    assert np.allclose(found, sorted(map(tuple, made.capture.points)), atol=1e-6)
    image = next(i for i in model.images.values() if i.name == CLIP_NAME)
    assert np.allclose(image.projection_center(), made.clip_camera.position, atol=1e-4)
    assert (made.out / "images" / image.name).exists()


def test_without_a_clip_the_scale_is_stated_as_unknown_and_a_second_run_gives_equal_bytes(made: Made, tmp_path: Path) -> None:
    images = some_of(made, tmp_path / "images", "123456")
    capture, _ = run(reconstruct(images, tmp_path / "one", settings_of()))
    run(reconstruct(images, tmp_path / "two", settings_of()))
    assert capture.scale.startswith("unknown")
    assert not (tmp_path / "one" / "clip_view.npz").exists()
    one, two = (tmp_path / name / "capture.npz" for name in ("one", "two"))
    with np.load(one) as first, np.load(two) as second:  # says what differs
        assert str(first["outline"]) == str(second["outline"])
        assert [name for name in first.files if not np.array_equal(first[name], second[name])] == []
    assert one.read_bytes() == two.read_bytes()


def test_known_positions_give_scale_and_world(made: Made, tmp_path: Path) -> None:
    """Here of a world that is turned and moved against the clip's."""
    shutil.copytree(made.out / "sfm", tmp_path / "out.part" / "sfm")
    at = {f"view_{k:02d}": [3.0, 0, 0] + c.position[[1, 2, 0]] for k, c in enumerate(made.cameras)}
    lines = [f"{name}.png {x} {y} {z}" for name, (x, y, z) in list(at.items())[::2]]
    (tmp_path / "at.txt").write_text("\n".join(lines))
    capture, _ = run(reconstruct(made.images, tmp_path / "out", settings_of(capture__positions=str(tmp_path / "at.txt")), made.clip))
    assert capture.scale.startswith("positions of 5 cameras")
    found = dict(zip(capture.names, capture.cameras, strict=True))
    assert max(np.linalg.norm(found[f"{name}.png"].position - position) for name, position in at.items()) < 0.01
    assert read_clip_view(tmp_path / "out").camera.world_frame_id == "capture"


def test_a_bare_video_gets_its_focal_length_from_the_pictures_and_its_scale_from_a_known_size(made: Made, tmp_path: Path) -> None:
    image, true, mask = room.picture(made.clip_camera)
    for name in ("0.png", "1.png"):
        write_png(tmp_path / "clip" / name, image)
    write_png(tmp_path / "mask.png", np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, -1))
    distance = float(np.median(true[mask]))
    known = {"camera.fps": 30.0, "scene.first_mask": str(tmp_path / "mask.png"), "scene.size_m": _extent_at_unit_depth(made.clip_camera, mask) * distance}
    settings = settings_of(topics__mask=None, scene__thickness_axis=None, **{name.replace(".", "__"): value for name, value in known.items()})
    capture, _ = run(reconstruct(some_of(made, tmp_path / "images", NEAR), tmp_path / "out", settings, tmp_path / "clip"))
    view, found = read_clip_view(tmp_path / "out"), dict(zip(capture.names, capture.cameras, strict=True))
    assert capture.scale.startswith("size_m")
    assert view.camera.focal_px == pytest.approx(room.FOCAL, rel=0.03)  # a guess of 50 degrees would be 343 px
    assert not view.camera.pose_known
    span = np.linalg.norm(found["view_01.png"].position - found["view_07.png"].position)
    assert span == pytest.approx(np.linalg.norm(made.cameras[1].position - made.cameras[7].position), rel=0.05)


def write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(path), image[..., ::-1])


def test_a_clip_of_something_else_is_refused(made: Made, tmp_path: Path) -> None:
    clip = room.write_clip(tmp_path / "clip.mcap", made.clip_camera, mirrored=True)
    with pytest.raises(InputError, match="frame 0 of the clip found no place"):
        run(reconstruct(some_of(made, tmp_path / "images", NEAR), tmp_path / "out", settings_of(), clip))
    assert not (tmp_path / "out").exists()


def test_pictures_without_texture_are_refused(tmp_path: Path) -> None:
    images = room.write_pictures(tmp_path / "images", room.around(6, 60.0), texture=False)
    with pytest.raises(InputError, match=r"SIFT features at the median.*texture"):
        run(reconstruct(images, tmp_path / "out", settings_of()))


def test_pictures_that_do_not_overlap_are_refused(tmp_path: Path) -> None:
    images = room.write_pictures(tmp_path / "images", [room.camera_from(a, 20.0) for a in (-170, -110, -50, 10, 70, 130)])
    with pytest.raises(InputError, match=r"placed against each other|found their place"):
        run(reconstruct(images, tmp_path / "out", settings_of()))


@pytest.mark.parametrize(("count", "sentence"), [(3, "holds 3 pictures, needs at least 6"), (0, "holds 0 pictures")])
def test_too_few_pictures_are_refused(count: int, sentence: str, made: Made, tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for k in range(count):
        shutil.copy(made.images / f"view_{k:02d}.png", tmp_path / "images")
    with pytest.raises(InputError, match=sentence):
        run(reconstruct(tmp_path / "images", tmp_path / "out", settings_of()))


def test_a_folder_that_holds_something_else_is_not_overwritten(made: Made, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="is no capture"):
        run(reconstruct(made.images, tmp_path / "out", settings_of()))
    assert (tmp_path / "out" / "letter.txt").exists()
