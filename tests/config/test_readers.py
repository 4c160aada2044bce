"""Claims about who reads which settings."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from diffphys_ros import config
from diffphys_ros.errors import InputError

OWN = ("dataclasses", "diffphys_ros.config")  # who looks at every setting, whatever for


def test_a_person_chooses_from_fewer_than_sixty_settings() -> None:
    for_captures = config.leaves()["capture.lens"].heading
    counts = {heading: sum(leaf.heading == heading for leaf in config.leaves().values()) for heading in config.HEADINGS}
    assert all(counts.values())
    assert sum(counts.values()) - counts[config.EXPERIMENT] - counts[for_captures] <= 55


def test_every_setting_is_read_by_someone_and_no_experiment_is_a_parameter() -> None:
    assert {name for reader in config.READERS for name in config.read_by(reader)} == set(config.leaves())
    nodes = {name for reader in config.READERS if reader.endswith("_node") for name in config.read_by(reader)}
    assert not [name for name in nodes if config.leaves()[name].heading == config.EXPERIMENT]


def test_a_setting_that_another_reads_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"^here: playback.rate is not read here but by fit_node; give it there, or in a YAML file of settings$"):
        config.require_read(["scene.mass_kg", "playback.rate"], "diffphys recover", "here")
    config.require_read(["scene.mass_kg", "fit.device"], "segment_node", "here")


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[set[str]]:
    """Dotted names of the settings that are looked at meanwhile."""
    seen: set[str] = set()
    for group in dataclasses.fields(config.Settings):
        keys = {f.name for f in dataclasses.fields(group.default_factory)}

        def look(self: object, key: str, group: str = group.name, keys: set[str] = keys) -> object:  # bound now, not when it is called
            if key in keys and not sys._getframe(1).f_globals["__name__"].startswith(OWN):
                seen.add(f"{group}.{key}")
            return object.__getattribute__(self, key)

        monkeypatch.setattr(group.default_factory, "__getattribute__", look, raising=False)
    yield seen
    monkeypatch.undo()


def ingested(folder: Path, settings: config.Settings) -> None:
    from diffphys_ros.bags.read import read_clip

    read_clip(folder / "clip.mcap", settings)


def segmented(folder: Path, settings: config.Settings) -> None:
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.depth import placed
    from diffphys_ros.segment import label_clip

    label_clip(placed(read_clip(folder / "clip.mcap", settings), settings), settings)


def splatted(folder: Path, settings: config.Settings) -> None:
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.depth import placed, surface_depth
    from diffphys_ros.inverse import fit_gaussians, label

    clip = placed(read_clip(folder / "clip.mcap", settings), settings)
    clip = label(clip, settings)
    list(fit_gaussians(clip, surface_depth(clip, settings)[0], settings))


@pytest.mark.parametrize(
    ("readers", "stage"),
    [(["ingest_node"], ingested), (["ingest_node", "segment_node"], segmented), (["ingest_node", "segment_node", "splat_node"], splatted)],
    ids=["ingest", "segment", "splat"],
)
def test_a_node_may_be_given_what_its_stage_looks_at(readers: list[str], stage: Callable, half_sample: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = config.layered([half_sample / "given.yaml"], {"experiment.splat_iterations": 2, "experiment.max_splats": 200})
    with watched(monkeypatch) as seen:
        stage(half_sample, settings)
    assert seen
    given = {name for reader in readers for name in config.read_by(reader)}
    assert [name for name in sorted(seen - given) if not name.startswith("experiment.")] == []
