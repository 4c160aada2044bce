"""Gaussians fitted to many pictures: a still scene from all around (paper section 4.1), or the frames of a clip whose motion is known."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..config import Settings
from ..render import Rasterizer, Window, window_around
from ..types import Camera, Splats
from .ellipsoids import Ellipsoids, ellipsoids_of, product, rotated, to_splats
from .growth import prune_and_grow
from .ply import canonical
from .primitives import ShrinkingAdam
from .seed import BLOCKS_DB, MOST, count_blocks
from .view import View, check_views, picture_loss

MARGIN_PX = 8  # of the rendered window around the object
GROW_AT = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # shares of the iterations after which Gaussians are pruned and grow in number
ASKED = 16  # most views that say where the pictures are wrong
RATES = {"offset": 0.2, "log_scale": 0.06, "rotation": 0.06, "logit": 0.15, "color": 0.03}  # Adam steps [size, -, -, -, -]
NEAR_RATE = 0.2  # of the steps where the start is near
LAST_RATE = 0.05  # of the steps at the end over those at the start
SIDES = 2  # of an object, of which one view sees one
TOGETHER = {"cpu": 1, "cuda": 4}  # most views in one step, where they share a camera

Tensors = tuple[torch.Tensor, ...]


@dataclass(frozen=True)
class _Group:
    """Views through one camera, cropped to the window that holds the object in all of them."""

    rasterizer: Rasterizer
    window: Window
    image: torch.Tensor  # uint8, (V, h, w, 3)
    mask: torch.Tensor  # bool, (V, h, w)
    counted: torch.Tensor  # not ignored, bool, (V, h, w)
    behind: torch.Tensor  # uint8, full pictures, (V, H, W, 3), or (H, W, 3) where all are alike
    views: Sequence[View]

    def behind_of(self, index: list[int]) -> torch.Tensor:
        """0..1."""
        return (self.behind if self.behind.ndim == 3 else self.behind[index]).float() / 255

    def render(self, gaussians: Tensors, index: list[int]) -> Tensors:
        """Image (B, h, w, 3) and alpha (B, h, w)."""
        mean, rotation, scale, opacity, color = gaussians
        return self.rasterizer.render_frames(mean, rotation, scale, opacity, color, self.behind_of(index), window=self.window)[:2]

    def observed(self, index: list[int]) -> torch.Tensor:
        """0..1."""
        return self.image[index].float() / 255


@dataclass(frozen=True)
class _Carried:
    """Where the anchors of Gaussians are in the views of a group."""

    position: torch.Tensor  # [m], (V, G, 3)
    turn: torch.Tensor | None  # wxyz, (V, G, 4); None: no view moves

    @classmethod
    def of(cls, group: _Group, anchor: torch.Tensor) -> _Carried:
        moves = [view.motion for view in group.views]
        if all(move is None for move in moves):
            return cls(anchor.expand(len(moves), *anchor.shape), None)
        still = torch.zeros_like(anchor), anchor.new_tensor([1.0, 0, 0, 0]).expand(len(anchor), 4)
        with torch.no_grad():
            shift, turn = zip(*(still if move is None else move(anchor) for move in moves), strict=True)
        return cls(anchor + torch.stack(shift), torch.stack(turn))

    def gaussians(self, e: Ellipsoids, index: list[int]) -> Tensors:
        """Mean (B, G, 3), rotation (B, G, 4), scale, opacity and colour as the renderer takes them; differentiable."""
        mean, rotation = self.position[index], e.rotation.expand(len(index), *e.rotation.shape)
        if self.turn is None:
            mean = mean + e.shift
        else:
            turn = self.turn[index]
            mean, rotation = mean + rotated(turn, e.shift.expand(mean.shape)), product(turn, rotation)
        return mean, rotation, e.log_scale.exp(), e.logit.sigmoid(), e.color


def fit_views(
    views: Sequence[View],
    start: Splats,
    settings: Settings,
    device: str = "cpu",
    *,
    iterations: int | None = None,
    count: int | None = None,
    near: bool = False,
) -> Generator[tuple[int, int, float], None, Splats]:
    """Gaussians of all views; yields (iteration, iterations, loss) and returns canonical Splats, frame 0 where views move.

    start: Gaussians of frame 0, or from_points(points, colors) of a sparse cloud. iterations: steps, each of one view (of up to four
    that share a camera on CUDA); None: splats.view_iterations. count: most Gaussians; None: splats.max_count, where that is 0 what
    BLOCKS_DB asks for in the view with most detail, from both sides; no less than start has. near: start is near to the pictures:
    steps are smaller and the Gaussians stay who they are. A view's motion is asked again whenever their number changes; between, each
    moves with its anchor.
    Raises InputError where no view shows the object or a picture has another size than its camera.
    """
    views = check_views(views)
    iterations = settings.splats.view_iterations if iterations is None else iterations
    if count is None:
        count = max(settings.splats.max_count or _chosen(views), len(start.mean))
    e, groups, rounds = ellipsoids_of(start, device), _groups(views, device), [] if near else [round(share * iterations) for share in GROW_AT]
    fitted = yield from _optimise(e, groups, settings, iterations, rounds, count, NEAR_RATE if near else 1.0)
    return canonical(to_splats(fitted))


def _chosen(views: Sequence[View]) -> int:
    few = views[:: -(-len(views) // ASKED)]
    blocks = max(count_blocks(v.image.astype(np.float32) / 255, v.mask, BLOCKS_DB, MOST) for v in few)
    return min(SIDES * blocks, MOST)


def _groups(views: Sequence[View], device: str) -> list[_Group]:
    """Views by camera, in the order of their first view."""
    found: list[list[View]] = []
    for view in views:
        same = next((g for g in found if _same(g[0].camera, view.camera)), None)
        if same is None:
            found.append([view])
        else:
            same.append(view)
    return [_group(members, device) for members in found]


def _same(a: Camera, b: Camera) -> bool:
    arrays = ((a.pixel_from_camera, b.pixel_from_camera), (a.world_from_camera, b.world_from_camera))
    return (a.width, a.height) == (b.width, b.height) and all(np.array_equal(x, y) for x, y in arrays)


def _group(views: Sequence[View], device: str) -> _Group:
    mask = np.stack([view.mask for view in views])
    window = left, top, right, bottom = window_around(mask, MARGIN_PX)
    crop = (slice(top, bottom), slice(left, right))

    def stacked(arrays: Sequence[np.ndarray]) -> torch.Tensor:
        return torch.as_tensor(np.stack(arrays), device=device)

    counted = [np.ones(mask.shape[1:], bool) if v.labels is None else v.mask | (v.labels == 0) for v in views]
    shared = all(v.background is views[0].background for v in views) and views[0].background is not None
    behind = torch.as_tensor(views[0].behind, device=device) if shared else stacked([v.behind for v in views])
    image, seen, valid = (stacked([a[crop] for a in arrays]) for arrays in ([v.image for v in views], mask, counted))
    return _Group(Rasterizer(views[0].camera, device), window, image, seen, valid, behind, views)


def _optimise(
    e: Ellipsoids, groups: list[_Group], settings: Settings, iterations: int, rounds: list[int], count: int, rate: float
) -> Generator[tuple[int, int, float], None, Ellipsoids]:
    """Adam with steps that shrink to LAST_RATE; Gaussians are pruned and grow towards count in rounds, after so many iterations."""
    first, steps, descent = len(e), _order(groups, settings.fit.seed), ShrinkingAdam(RATES, last=LAST_RATE, iterations=iterations, share=rate)
    descent.begin(e)
    carried = [_Carried.of(group, e.anchor) for group in groups]
    for iteration in range(iterations):
        if iteration and iteration in rounds:
            share = (rounds.index(iteration) + 1) / len(rounds)
            error, cover, spread = _judged(e, groups, carried)
            e = prune_and_grow(e, error, cover, spread, count=round(first + share * (count - first))).leaves()
            descent.begin(e, iteration)
            carried = [_Carried.of(group, e.anchor) for group in groups]
        number, index = next(steps)
        loss = _loss(e, groups[number], carried[number], index, settings.fit.ssim_weight)
        descent.step(loss)
        yield iteration + 1, iterations, float(loss.detach())
    return e


def _order(groups: list[_Group], seed: int) -> Iterator[tuple[int, list[int]]]:
    """Group and views of every step, without end: all views once in random order, then again in another."""
    generator = torch.Generator().manual_seed(seed)
    while True:
        steps: list[tuple[int, list[int]]] = []
        for number, group in enumerate(groups):
            order = torch.randperm(len(group.views), generator=generator).tolist()
            size = TOGETHER[group.rasterizer.device.type]
            steps += [(number, order[k : k + size]) for k in range(0, len(order), size)]
        yield from (steps[k] for k in torch.randperm(len(steps), generator=generator).tolist())


def _loss(e: Ellipsoids, group: _Group, carried: _Carried, index: list[int], ssim_weight: float) -> torch.Tensor:
    image, alpha = group.render(carried.gaussians(e, index), index)
    return picture_loss(image, alpha, group.observed(index), group.mask[index], group.counted[index], ssim_weight=ssim_weight)


def _judged(e: Ellipsoids, groups: list[_Group], carried: list[_Carried]) -> Tensors:
    """Squared residual under each Gaussian, summed over views; pixels that it fills, and its size over the picture's width, where
    these are largest (G,)."""
    every = [(number, k) for number, group in enumerate(groups) for k in range(len(group.views))]
    chosen = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, ASKED).round().astype(int))]
    error, cover, spread = (torch.zeros(len(e), device=e.anchor.device) for _ in range(3))
    for number, k in chosen:
        group = groups[number]
        wrong, filled = _under(e, group, carried[number], k)
        error, cover = error + wrong, torch.maximum(cover, filled)
        spread = torch.maximum(spread, torch.where(filled > 0, _spread(e, carried[number], group.rasterizer.camera, k), 0.0))
    return error, cover, spread


def _under(e: Ellipsoids, group: _Group, carried: _Carried, k: int) -> Tensors:
    """Squared residual under each Gaussian and pixels that it fills in one view (G,): the gradient of the image with respect to a
    colour is how much of each pixel the Gaussian fills."""
    *shape, color = (t.detach() for t in carried.gaussians(e, [k]))
    color.requires_grad_()
    image, _ = group.render((*shape, color), [k])
    residual = (group.observed([k]) - image.detach()).square().sum(-1) * group.mask[[k]]
    asked = (image[..., 0] * residual).sum() + (image[..., 1] * group.mask[[k]]).sum()
    wrong, filled, _ = torch.autograd.grad(asked, color)[0].unbind(1)
    return wrong, filled


def _spread(e: Ellipsoids, carried: _Carried, camera: Camera, k: int) -> torch.Tensor:
    """Largest standard deviation over the width of the picture (G,)."""
    line = torch.as_tensor(camera.world_from_camera[:3, 2], dtype=torch.float32, device=e.anchor.device)
    eye = line.new_tensor(camera.position)
    depth = ((carried.position[k] - eye) @ line).clamp_min(1e-6)
    return e.log_scale.detach().amax(1).exp() * camera.focal_px / depth / camera.width
