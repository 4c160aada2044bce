"""Everything that reaches rerun: the one file that imports it. A Stream is one recording, in a file or a viewer."""

from __future__ import annotations

import os
import shutil
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from ..colours import COMPONENTS, stiffness_colours
from ..errors import InputError
from ..types import Camera, Clip, Recovery, Scale, Splats

APPLICATION = "diffphys_ros"
TIME = "time"  # the timeline
ARROWS = 300  # most force arrows in one frame
ARROW_SHARE = 0.35  # length of the longest arrow, as a share of the object's extent
_JPEG_QUALITY = 90
_WEB_MEMORY = "512MiB"  # of data that is kept for browsers that come later


class Stream:
    """One rerun recording. World frame, SI units; times are ROS stamps [ns].

    Open it with `file` (an .rrd) or `viewer` (a grpc URL, or "spawn" for a new viewer); close it to flush.
    """

    def __init__(self, *, file: str | Path | None = None, viewer: str | None = None, recording_id: str | None = None) -> None:
        if (file is None) == (viewer is None):
            raise ValueError("give a file or a viewer")
        self._rec, arranged = _recording(recording_id), blueprint()
        if file is not None:
            self._rec.save(str(file), default_blueprint=arranged)
        elif viewer == "spawn":
            self._rec.spawn(default_blueprint=arranged)
        else:
            self._rec.connect_grpc(viewer, default_blueprint=arranged)
        arranged.let_go()
        self.name_net_force("net force", "N")
        self._losses: list[float] = []
        self._shown = 0  # of the losses

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Write what is buffered and let go of the sink."""
        self._show_losses()
        self._rec.flush()
        self._rec.disconnect()

    def at(self, stamp_ns: int) -> None:
        """What is logged next happened at this stamp [ns]."""
        self._rec.set_time(TIME, timestamp=np.datetime64(int(stamp_ns), "ns"))

    def log_camera(self, camera: Camera, *, plane_m: float = 0.1) -> None:
        """The pinhole camera and its pose; its image is drawn `plane_m` in front of it [m]."""
        pose = rr.Transform3D(translation=camera.position, mat3x3=camera.world_from_camera[:3, :3])
        self._rec.log("world/camera", pose, static=True)
        pinhole = rr.Pinhole(
            image_from_camera=camera.pixel_from_camera,
            width=camera.width,
            height=camera.height,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=plane_m,
        )
        self._rec.log("world/camera/image", pinhole, static=True)

    def log_image(self, rgb: np.ndarray, *, entity: str = "world/camera/image/input") -> None:
        """A colour image, uint8 (H, W, 3)."""
        self._rec.log(entity, rr.Image(np.ascontiguousarray(rgb)).compress(jpeg_quality=_JPEG_QUALITY))

    def log_rendered(self, rgb: np.ndarray) -> None:
        """A rendered image, uint8 (H, W, 3)."""
        self.log_image(rgb, entity="rendered")

    def log_labels(self, labels: np.ndarray) -> None:
        """A label image, uint8 (H, W): 0 background, 1..n parts, 255 ignore."""
        self._rec.log("labels", rr.SegmentationImage(labels))

    def log_splats(self, splats: Splats) -> None:
        """The Gaussians of frame 0."""
        rgba = np.concatenate([splats.color, splats.opacity[:, None]], 1)
        colours = np.rint(255 * rgba.clip(0, 1)).astype(np.uint8)
        xyzw = np.roll(splats.rotation, -1, 1)
        self._rec.log("world/splats", rr.GaussianSplats3D(splats.mean, scales=splats.scale, quaternions=xyzw, colors=colours))

    def log_cloud(self, points: np.ndarray, colours: np.ndarray, *, radius_m: float) -> None:
        """Points (N, 3) [m] with colours, uint8 (N, 3)."""
        self._rec.log("world/object", rr.Points3D(points, colors=colours, radii=radius_m))

    def log_arrows(self, points: np.ndarray, vectors: np.ndarray) -> None:
        """Arrows (N, 3), already scaled to metres, from points (N, 3) [m]."""
        self._rec.log("world/force", rr.Arrows3D(origins=points, vectors=vectors, colors=(235, 110, 40)))

    def name_net_force(self, name: str, unit: str) -> None:
        """What the three time series of the net force are called, and their unit; empty for a ratio."""
        for axis, colour in zip("xyz", COMPONENTS, strict=True):
            self._rec.log(f"net_force/{axis}", rr.SeriesLines(colors=_rgb(colour), names=f"{name} {axis}" + (f" [{unit}]" if unit else ""), widths=2), static=True)

    def log_net_force(self, force: np.ndarray) -> None:
        """Net force (3,), in the unit that it was named with, as three time series."""
        for name, value in zip("xyz", force, strict=True):
            self._rec.log(f"net_force/{name}", rr.Scalars(float(value)))

    def log_loss(self, loss: float) -> None:
        """The loss of one more iteration; a bar each, because iterations are no time of the clip's clock.

        All bars are written again when there are an eighth more, and at the end: so a recording grows with the iterations, not with their square.
        """
        self._losses.append(loss)
        if len(self._losses) > self._shown * 9 // 8:
            self._show_losses()

    def _show_losses(self) -> None:
        if len(self._losses) > self._shown:
            self._rec.log("loss", rr.BarChart(np.array(self._losses)), static=True)
            self._shown = len(self._losses)

    def log_force_so_far(self, size: np.ndarray) -> None:
        """Size of the net force by frame (T,) while a fit runs, in the place of the one before."""
        self._rec.log("force_so_far", rr.BarChart(size), static=True)

    def log_text(self, text: str) -> None:
        """One line of news."""
        self._rec.log("log", rr.TextLog(text))

    def log_document(self, markdown: str) -> None:
        """The summary shown beside the views."""
        self._rec.log("summary", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


class Web:
    """A viewer for web browsers at `url`, and the server of data that it shows, on the next port: streams go to the viewer `uri`. Raises
    InputError where either port is taken."""

    def __init__(self, port: int) -> None:
        for each in (port, port + 1):
            _check_free(each)
        self._rec, arranged = _recording(None), blueprint()
        self.uri = self._rec.serve_grpc(grpc_port=port + 1, default_blueprint=arranged, server_memory_limit=_WEB_MEMORY)
        arranged.let_go()
        rr.serve_web_viewer(web_port=port, open_browser=False, connect_to=self.uri)
        self.url = f"http://127.0.0.1:{port}?url={quote(self.uri, safe='')}"

    def close(self) -> None:
        """Stop to serve data."""
        self._rec.disconnect()


def _check_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("0.0.0.0", port))
        except OSError as error:
            raise InputError(f"web_port: port {port} cannot be opened ({error.strerror}); choose a web_port that is free, with the one after it") from error


def _recording(recording_id: str | None) -> rr.RecordingStream:
    """A recording, begun in a thread of its own: one that a signal broke off half-way could not be thrown away without a traceback."""
    _forget_closed()
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(rr.RecordingStream, APPLICATION, recording_id=recording_id).result()


def _forget_closed() -> None:
    """Let recordings that nobody holds any more go, with their threads: rerun keeps each until it is told to look."""
    chosen = rr.get_global_data_recording()  # somebody else's, which that look would unset
    flush_and_cleanup_orphaned_recordings()
    if chosen is not None:
        rr.set_global_data_recording(chosen)


class Arrangement(rrb.Blueprint):
    """A blueprint of which no copy stays: rerun logs it to a recording in memory, which holds itself, and two threads, until it is disconnected."""

    def __init__(self, *contents: Any, **options: Any) -> None:
        super().__init__(*contents, **options)
        self._copies: list[rr.RecordingStream] = []

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._copies.append(stream)
        super()._log_to_stream(stream)

    def let_go(self) -> None:
        """It was handed over."""
        while self._copies:
            self._copies.pop().disconnect()


def blueprint() -> Arrangement:
    """The default arrangement: images, world, force and loss over time."""
    images = rrb.Vertical(
        rrb.Spatial2DView(origin="world/camera/image", name="input"), rrb.Spatial2DView(origin="rendered", name="rendered")
    )
    curves = rrb.Vertical(
        rrb.TimeSeriesView(origin="net_force", name="net force"),
        rrb.Tabs(
            rrb.TextDocumentView(origin="summary", name="summary"),
            rrb.BarChartView(origin="loss", name="loss by iteration"),
            rrb.BarChartView(origin="force_so_far", name="net force by frame, while fitting"),
            rrb.TextLogView(origin="log", name="log"),
        ),
    )
    world = rrb.Spatial3DView(origin="world", name="object: stiffness and force")
    layout = rrb.Horizontal(images, world, curves, column_shares=[2, 3, 2])
    return Arrangement(layout, rrb.TimePanel(timeline=TIME, state="collapsed"), collapse_panels=True)


def write_rrd(path: str | Path, recovery: Recovery, clip: Clip, splats: Splats | None = None, scale: Scale | None = None) -> Path:
    """Write a whole recovery as an .rrd file: input, render, particles coloured by stiffness, force, loss. Raises OSError.

    The file is made in memory, where it is smaller than the clip's frames: rerun waits for ever on a disc that is full.
    """
    with open(os.memfd_create("rrd"), "r+b") as memory, Path(path).open("wb") as file:
        with Stream(file=f"/proc/self/fd/{memory.fileno()}", recording_id=f"{clip.start_ns}") as stream:
            log_recovery(stream, recovery, clip, splats=splats, scale=scale)
        shutil.copyfileobj(memory, file)
    return Path(path)


def log_recovery(stream: Stream, recovery: Recovery, clip: Clip, *, splats: Splats | None = None, scale: Scale | None = None) -> None:
    """Log a recovery and the clip it came from, every frame at its stamp; in the recovery's own scale where no other is given."""
    scale = scale or recovery.scale
    stream.at(clip.start_ns)
    stream.log_camera(clip.camera, plane_m=float(np.linalg.norm(recovery.points.mean(0) - clip.camera.position)) * 1.6)
    stream.log_document(_document(recovery, scale))
    if splats is not None:
        stream.log_splats(splats)
    losses = recovery.metrics.get("loss_history")
    for loss in losses if isinstance(losses, (list, tuple)) else ():
        stream.log_loss(float(loss))
    colours, radius = stiffness_colours(recovery.young), point_radius(recovery.volume)
    arrows, (net, name, unit) = force_arrows(recovery.points, recovery.force, recovery.clamped), recovery.net_quantity(scale)
    stream.name_net_force(name, unit)
    for frame, seconds in enumerate(clip.times):
        stream.at(clip.start_ns + round(seconds * 1e9))
        stream.log_image(clip.frames[frame])
        if recovery.frames is not None:
            stream.log_rendered(recovery.frames[frame])
        stream.log_cloud(recovery.trajectory[frame], colours, radius_m=radius)
        index, vectors = arrows
        stream.log_arrows(recovery.trajectory[frame][index], vectors[frame])
        stream.log_net_force(net[frame])


def point_radius(volume: np.ndarray) -> float:
    """Radius [m] at which points of these volumes [m^3] look like a solid."""
    return 0.45 * float(np.cbrt(np.median(volume)))


def force_arrows(points: np.ndarray, force: np.ndarray, clamped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (M,) of at most ARROWS free points spread over the object and their arrows (T, M, 3) [m].

    points (N, 3) [m], force (T, N, 3) [N/m^3]; the longest arrow spans ARROW_SHARE of the object.
    """
    free = np.flatnonzero(~clamped)
    index = free[np.linspace(0, len(free) - 1, min(ARROWS, len(free))).astype(int)]
    some = force[:, index].astype(float)
    peak = np.linalg.norm(some, axis=2).max(initial=0.0)
    scale = ARROW_SHARE * np.ptp(points, axis=0).max() / peak if peak > 0 else 0.0
    return index, some * scale


def _document(recovery: Recovery, scale: Scale) -> str:
    values, name, unit = recovery.stiffness(scale)
    all_sd = recovery.log10_young_sd if scale.absolute else recovery.log10_specific_sd
    rows = [f"| part | {name}{f' [{unit}]' if unit else ''} | sd of log10 | identified |", "|---|---|---|---|"]
    for number, (known, reason) in enumerate(zip(recovery.identified, recovery.reasons, strict=True), 1):
        here = recovery.part == number
        young, sd = (float(np.median(of[here])) if here.any() else float("nan") for of in (values, all_sd))
        rows.append(f"| {number} | {young:.4g} | {sd:.3f} | {'yes' if known else 'no'}: {reason} |")
    return "\n".join([*rows, "", *(f"- {note}" for note in recovery.notes)])


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour[1:]))
