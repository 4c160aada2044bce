"""Learned perceptual distance of two images (LPIPS 0.1; Zhang et al. 2018, "The unreasonable effectiveness of deep features as a perceptual metric").

The weights are the published ones, from local files: torchvision's AlexNet or VGG-16, and the linear heads of the lpips package. No code of either runs.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from ..errors import InputError
from ..npz import in_words

SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)  # of the published metric, for values -1..1
MARGIN_PX = 16  # around the object that is compared
WEIGHTS = "experiment.lpips_weights"
BACKBONE, HEADS = "backbone", "heads"  # files of that folder
SUFFIXES = (".pth", ".safetensors")


@dataclass(frozen=True)
class Layer:
    """One convolution of a torchvision network, with what follows it."""

    index: int  # in torchvision's `features`
    channels: int  # that come out
    kernel: int
    stride: int = 1
    padding: int = 1
    pool: int = 0  # side of the max-pooling before it; 0: none
    tapped: bool = True  # whether its rectified output is compared


ALEX = (Layer(0, 64, 11, 4, 2), Layer(3, 192, 5, 1, 2, pool=3), Layer(6, 384, 3, pool=3), Layer(8, 256, 3), Layer(10, 256, 3))
_VGG = {0: 64, 2: 64, 5: 128, 7: 128, 10: 256, 12: 256, 14: 256, 17: 512, 19: 512, 21: 512, 24: 512, 26: 512, 28: 512}  # channels by index
VGG = tuple(Layer(index, channels, 3, pool=2 if index in (5, 10, 17, 24) else 0, tapped=index in (2, 7, 14, 21, 28)) for index, channels in _VGG.items())


class Lpips:
    """The distance, ready to be called. Raises InputError for files that do not hold the weights."""

    def __init__(self, backbone: str | Path, heads: str | Path, *, device: str = "cpu"):
        weights, linear = _state(backbone), _state(heads)
        first = weights.get("features.0.weight")
        self.layers = VGG if isinstance(first, torch.Tensor) and first.shape[-1:] == (3,) else ALEX
        before = (3, *(layer.channels for layer in self.layers))
        self.convolutions = [_convolution(weights, layer, count, backbone, device) for layer, count in zip(self.layers, before, strict=False)]
        tapped = [layer.channels for layer in self.layers if layer.tapped]
        self.heads = [_head(linear, k, count, heads, device) for k, count in enumerate(tapped)]
        self.device = device

    @classmethod
    def of(cls, folder: str | Path, *, device: str = "cpu") -> Lpips:
        """The distance with the weights in a folder: files BACKBONE and HEADS. Raises InputError where one is absent."""
        return cls(_file(folder, BACKBONE), _file(folder, HEADS), device=device)

    @torch.no_grad()
    def masked(self, rendered: np.ndarray, observed: np.ndarray, mask: np.ndarray) -> float:
        """Distance over the object's pixels, 0 for equal images: uint8 RGB (H, W, 3), mask bool (H, W).

        Both images are black off the mask; every layer is averaged over the object's share of its cells, so that a mask of the whole
        image gives the published distance. Raises InputError for an empty mask.
        """
        if not mask.any():
            raise InputError("mask: has no pixel to compare; give a mask that covers the object")
        window = _window(mask)
        share = torch.as_tensor(mask[window], dtype=torch.float32, device=self.device)[None, None]
        images = torch.stack([torch.as_tensor(np.where(mask[..., None], image, 0)[window], device=self.device) for image in (rendered, observed)])
        features = self._features(images.permute(0, 3, 1, 2).float() / 127.5 - 1)
        total = 0.0
        for feature, head in zip(features, self.heads, strict=True):
            difference = (feature[0] - feature[1]).square()
            weight = functional.interpolate(share, size=difference.shape[-2:], mode="area")[0, 0]
            total += float(((head[:, None, None] * difference).sum(0) * weight).sum() / weight.sum())
        return total

    def _features(self, images: torch.Tensor) -> list[torch.Tensor]:
        """Unit vectors (2, C, h, w) of every tapped layer."""
        shift, scale = (torch.tensor(v, device=self.device)[:, None, None] for v in (SHIFT, SCALE))
        x, found = (images - shift) / scale, []
        for layer, (weight, bias) in zip(self.layers, self.convolutions, strict=True):
            if layer.pool:
                x = functional.max_pool2d(x, layer.pool, 2)
            x = functional.relu(functional.conv2d(x, weight, bias, layer.stride, layer.padding))
            if layer.tapped:
                found.append(x / (x.square().sum(1, keepdim=True).sqrt() + 1e-10))
        return found


def _window(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns around the object, wide enough for every layer."""
    sides = []
    for axis, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        there = np.flatnonzero(mask.any(axis))
        low, high = int(there[0]) - MARGIN_PX, int(there[-1]) + 1 + MARGIN_PX
        missing = max(0, 64 - (high - low))
        sides.append(slice(max(0, low - missing), min(size, high + missing)))
    return sides[0], sides[1]


def _file(folder: str | Path, name: str) -> Path:
    found = [path for suffix in SUFFIXES if (path := Path(folder) / f"{name}{suffix}").is_file()]
    if not found:
        raise InputError(f"{WEIGHTS} {folder}: has no {' or '.join(name + suffix for suffix in SUFFIXES)}; put {BACKBONE} and {HEADS} of one network there")
    return found[0]


def _state(path: str | Path) -> Mapping[str, Any]:
    """What a .safetensors or .pth file holds by name; of the latter plain tensors alone are read, no code."""
    cure = "give the published state dict"
    if not Path(path).is_file():
        raise InputError(f"{WEIGHTS} {path}: there is no such file; {cure}")
    try:
        found = _read(Path(path))
    except ModuleNotFoundError as error:
        raise InputError(f"{WEIGHTS} {path}: needs the package safetensors; install diffphys_ros with the extra [models], or give the .pth file") from error
    except Exception as error:  # whatever a broken file makes the readers raise
        raise InputError(f"{WEIGHTS} {path}: not a file of tensors ({in_words(error)}); {cure}") from error
    if not isinstance(found, Mapping):
        raise InputError(f"{WEIGHTS} {path}: holds a {type(found).__name__}, must be a dict of tensors by name; {cure}")
    return found


def _read(path: Path) -> Any:
    if path.suffix == ".safetensors":
        from safetensors.torch import load_file

        return load_file(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch, about how the file was written
        return torch.load(path, map_location="cpu", weights_only=True)


def _convolution(
    weights: Mapping[str, Any], layer: Layer, before: int, path: str | Path, device: str
) -> tuple[torch.Tensor, torch.Tensor]:
    name, bias = f"features.{layer.index}.weight", f"features.{layer.index}.bias"
    shape = (layer.channels, before, layer.kernel, layer.kernel)
    if not _is(weights.get(name), shape) or not _is(weights.get(bias), (layer.channels,)):
        wanted = " x ".join(map(str, shape))
        raise InputError(f"{WEIGHTS} {path}: holds no finite {name} of {wanted} numbers with its bias; give torchvision's state dict of AlexNet or VGG-16")
    return weights[name].float().to(device), weights[bias].float().to(device)


def _head(heads: Mapping[str, Any], k: int, channels: int, path: str | Path, device: str) -> torch.Tensor:
    weight: Any = heads.get(f"lin{k}.model.1.weight")
    if not _is(weight, (1, channels, 1, 1)):
        raise InputError(f"{WEIGHTS} {path}: holds no finite lin{k}.model.1.weight of {channels} numbers; give the heads of LPIPS 0.1 for the network of {BACKBONE}")
    return weight.float().reshape(-1).to(device)


def _is(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether this is a plain tensor of finite numbers of a shape."""
    plain = isinstance(value, torch.Tensor) and value.layout == torch.strided and value.is_floating_point() and value.device.type == "cpu"
    return plain and tuple(value.shape) == shape and bool(value.isfinite().all())
