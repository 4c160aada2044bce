"""The rendered half of the paper's equation 3: Gaussians that ride on particles (paper A.11), as a camera sees them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from ..particles import Binding, bind, deform_splats
from ..render import Rasterizer, Window
from ..splats import Motion
from ..types import Camera, Splats

AT_ONCE = {"cpu": 30_000, "cuda": 1_000_000}  # Gaussians of all frames that are rendered together, at some 3 kB each with gradient, half of that without;
# more frames are rendered again on the way back, for 3 % more time on a CPU; a GPU wants many at a time


@dataclass(frozen=True)
class CarriedGaussians:
    """G Gaussians bound to P particles, which have a frame of their own."""

    rasterizer: Rasterizer
    binding: Binding
    mean: torch.Tensor  # frame 0 [m], world, (G, 3)
    rotation: torch.Tensor  # wxyz, (G, 4)
    scale: torch.Tensor  # [m], (G, 3)
    opacity: torch.Tensor  # (G,)
    color: torch.Tensor  # (G, 3)
    world_from_particles: torch.Tensor  # rotation and translation, (3, 4)
    background: torch.Tensor  # 0..1, (H, W, 3)

    @classmethod
    def of(
        cls,
        splats: Splats,
        particles: np.ndarray,
        camera: Camera,
        background: np.ndarray,
        *,
        world_from_particles: np.ndarray | None = None,
        places: np.ndarray | None = None,
        device: str,
    ) -> CarriedGaussians:
        """Bind Gaussians of frame 0 to the particles (P, 3) [m] nearest to them there. background uint8 (H, W, 3); world_from_particles
        (4, 4), None: the particles are given in the world frame. places (G, 3) [m], world: where the Gaussians are in the particles' pose, None: where
        they are in frame 0."""
        pose = np.eye(4) if world_from_particles is None else world_from_particles
        mean, rotation, scale, opacity, color, placed = (torch.as_tensor(a, dtype=torch.float32, device=device) for a in (*vars(splats).values(), pose[:3]))
        behind = torch.as_tensor(background, device=device).float() / 255
        binding = bind(((splats.mean.astype(float) if places is None else places) - pose[:3, 3]) @ pose[:3, :3], particles)
        return cls(Rasterizer(camera, device), binding, mean, rotation, scale, opacity, color, placed, behind)

    def over(self, background: np.ndarray) -> CarriedGaussians:
        """The same before another scene, uint8 (H, W, 3)."""
        return replace(self, background=torch.as_tensor(background, device=self.mean.device).float() / 255)

    def moved(self, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (S, G, 3) [m] and rotation (S, G, 4), world, where particles that were at x0 (P, 3) [m] are at x (S, P, 3); deformation
        gradients F (S, P, 3, 3), None: from the positions. Differentiable."""
        turn, shift = self.world_from_particles[:, :3], self.world_from_particles[:, 3]
        x, x0, F = x.float() @ turn.T + shift, x0.float() @ turn.T + shift, None if F is None else turn @ F.float() @ turn.T
        return deform_splats(self.binding, self.mean, self.rotation, x, x0, F)

    def render(self, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor | None, window: Window | None) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Image (S, h, w, 3), alpha and depth (S, h, w) of particles as in `moved`."""
        mean, rotation = self.moved(x, x0, F)
        return self.rasterizer.render_frames(mean, rotation, self.scale, self.opacity, self.color, self.background, window=window)

    def clip(self, x: np.ndarray, F: np.ndarray | None = None) -> np.ndarray:
        """Full frames, uint8 (T, H, W, 3), of particles x (T, P, 3) that were at x[0]; F (T, P, 3, 3) as in `moved`."""
        place, gradient = self._own(x), None if F is None else self._own(F)
        frames = np.empty((len(x), *self.background.shape), np.uint8)
        with torch.no_grad():
            for chunk in self.spans(len(x)):
                image = self.render(place[chunk], place[0], None if gradient is None else gradient[chunk], None)[0]
                frames[chunk] = (image.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
        return frames

    def spans(self, frames: int) -> list[slice]:
        """So many frames, as many of them at a time as memory is meant for."""
        size = max(1, AT_ONCE[self.mean.device.type] // len(self.mean))
        return [slice(first, first + size) for first in range(0, frames, size)]

    def motion(self, x: np.ndarray, x0: np.ndarray) -> Motion:
        """How these very Gaussians, which a fit that is `near` keeps, move with particles from x0 (P, 3) to x (P, 3) [m]."""

        def move(mean: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            assert torch.equal(mean, self.mean), "other Gaussians than those that were bound"
            still = replace(self, rotation=mean.new_tensor([1.0, 0, 0, 0]).expand(len(mean), 4))
            there, turn = still.moved(self._own(x)[None], self._own(x0), None)
            return there[0] - mean, turn[0]

        return move

    def _own(self, values: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.mean.device)
