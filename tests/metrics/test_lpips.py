"""LPIPS in the files of torchvision and the lpips package, with random weights."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from diffphys_ros.errors import InputError
from diffphys_ros.metrics.lpips import Lpips

VGG_CHANNELS = (64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0)
TAPS = {"alex": (1, 4, 7, 9, 11), "vgg": (3, 8, 15, 22, 29)}


def alexnet() -> nn.Sequential:
    """The `features` of torchvision's AlexNet, as its paper lists them."""
    return nn.Sequential(
        nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2), nn.Conv2d(64, 192, 5, 1, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, 1, 1), nn.ReLU(), nn.Conv2d(384, 256, 3, 1, 1), nn.ReLU(), nn.Conv2d(256, 256, 3, 1, 1), nn.ReLU(),
    )  # fmt: skip


def vgg16() -> nn.Sequential:
    layers, before = [], 3
    for channels in VGG_CHANNELS:
        if channels:
            layers += [nn.Conv2d(before, channels, 3, 1, 1), nn.ReLU()]
            before = channels
        else:
            layers.append(nn.MaxPool2d(2, 2))
    return nn.Sequential(*layers)


@pytest.fixture(scope="module", params=["alex", "vgg"])
def files(request, tmp_path_factory) -> tuple[str, nn.Sequential, list[torch.Tensor], Path, Path]:
    """Kind, network, heads and the two files."""
    torch.manual_seed(0)
    network = {"alex": alexnet, "vgg": vgg16}[request.param]()
    channels = [network[tap - 1].out_channels for tap in TAPS[request.param]]
    heads = [torch.rand(1, c, 1, 1) for c in channels]
    folder = tmp_path_factory.mktemp(request.param)
    torch.save({f"features.{k}": v for k, v in network.state_dict().items()} | {"classifier.1.bias": torch.zeros(3)}, folder / "net.pth")
    torch.save({f"lin{k}.model.1.weight": head for k, head in enumerate(heads)}, folder / "heads.pth")
    return request.param, network, heads, folder / "net.pth", folder / "heads.pth"


def images() -> tuple[np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed).integers(0, 256, (72, 96, 3), dtype=np.uint8) for seed in (0, 1))


def published(kind: str, network: nn.Sequential, heads: list[torch.Tensor], a: np.ndarray, b: np.ndarray) -> float:
    """The distance as section 3 and the code of the paper define it, on whole images."""
    shift, scale = torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1), torch.tensor([0.458, 0.448, 0.450]).view(1, 3, 1, 1)
    x, y = ((torch.tensor(i).permute(2, 0, 1)[None].float() / 255 * 2 - 1 - shift) / scale for i in (a, b))
    total = 0.0
    with torch.no_grad():
        for k, layer in enumerate(network):
            x, y = layer(x), layer(y)
            if k in TAPS[kind]:
                one, other = (z / z.norm(dim=1, keepdim=True) for z in (x, y))
                total += float(((one - other) ** 2 * heads[TAPS[kind].index(k)]).sum(1).mean())
    return total


def test_over_a_whole_image_it_is_the_published_distance(files) -> None:
    kind, network, heads, backbone, linear = files
    a, b = images()
    assert Lpips(backbone, linear).masked(a, b, np.ones((72, 96), bool)) == pytest.approx(published(kind, network, heads, a, b), rel=1e-4)


def test_equal_images_have_no_distance_and_changes_off_the_object_do_not_count(files) -> None:
    lpips = Lpips(*files[3:])
    a, b = images()
    mask = np.zeros((72, 96), bool)
    mask[20:50, 30:70] = True
    assert lpips.masked(a, a, mask) == 0
    assert lpips.masked(a, np.where(mask[..., None], a, b), mask) == 0
    assert lpips.masked(a, b, mask) > 0.01


def test_a_stronger_change_is_farther(files) -> None:
    lpips = Lpips(*files[3:])
    a, b = images()
    mask = np.ones((72, 96), bool)
    near, far = (lpips.masked(a, (a * (1 - share) + b * share).astype(np.uint8), mask) for share in (0.1, 0.6))
    assert 0 < near < far


def test_safetensors_hold_the_same(files, tmp_path: Path) -> None:
    safetensors = pytest.importorskip("safetensors.torch", reason="safetensors is not installed; pip install '.[models]'")
    for name, path in (("net", files[3]), ("heads", files[4])):
        safetensors.save_file(torch.load(path, weights_only=True), tmp_path / f"{name}.safetensors")
    a, b = images()
    mask = np.ones((72, 96), bool)
    assert Lpips(tmp_path / "net.safetensors", tmp_path / "heads.safetensors").masked(a, b, mask) == Lpips(*files[3:]).masked(a, b, mask)


class Harmful:
    def __reduce__(self):
        return (Path.touch, (Path("harm"),))


def test_a_pickle_that_would_run_code_is_refused(files, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.pth").write_bytes(pickle.dumps({"features.0.weight": Harmful()}))
    torch.save({"features.0.weight": Harmful()}, tmp_path / "zip.pth")
    for name in ("net.pth", "zip.pth"):
        with pytest.raises(InputError, match="not a file of tensors"):
            Lpips(tmp_path / name, files[4])
    assert not (tmp_path / "harm").exists()


def test_files_of_another_network_are_refused(files, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"experiment\.lpips_weights.*give torchvision's state dict"):
        Lpips(files[4], files[4])
    with pytest.raises(InputError, match=r"experiment\.lpips_weights.*the network of backbone"):
        Lpips(files[3], files[3])
    with pytest.raises(InputError, match="there is no such file"):
        Lpips(tmp_path / "missing.pth", files[4])


def test_a_folder_holds_both_files_by_their_names(files, tmp_path: Path) -> None:
    shutil.copy(files[3], tmp_path / "backbone.pth")
    with pytest.raises(InputError, match=r"experiment\.lpips_weights .* has no heads\.pth or heads\.safetensors; put backbone and heads of one network there"):
        Lpips.of(tmp_path)
    shutil.copy(files[4], tmp_path / "heads.pth")
    a, b = images()
    mask = np.ones((72, 96), bool)
    assert Lpips.of(tmp_path).masked(a, b, mask) == Lpips(*files[3:]).masked(a, b, mask)


def test_an_empty_mask_is_refused(files) -> None:
    with pytest.raises(InputError, match="no pixel to compare"):
        Lpips(*files[3:]).masked(*images(), np.zeros((72, 96), bool))


@pytest.mark.parametrize(
    "change",
    [
        lambda net: list(net.values()),
        lambda net: net["features.0.bias"],
        lambda net: net | {"features.0.weight": torch.zeros(())},
        lambda net: net | {"features.0.weight": net["features.0.weight"][:, :1]},
        lambda net: net | {"features.0.bias": net["features.0.bias"][:3]},
        lambda net: net | {"features.0.weight": net["features.0.weight"].int()},
        lambda net: net | {"features.0.weight": torch.zeros(1).expand(10**6, 10**6, 11, 11)},
        lambda net: net | {"features.0.weight": net["features.0.weight"] / 0},
        lambda net: net | {"features.0.weight": [1.0]},
    ],
)
def test_weights_of_another_shape_are_refused(files, tmp_path: Path, change) -> None:
    torch.save(change(torch.load(files[3], weights_only=True)), tmp_path / "net.pth")
    with pytest.raises(InputError, match=r"experiment\.lpips_weights .*; give (torchvision's|the published) state dict"):
        Lpips(tmp_path / "net.pth", files[4])
