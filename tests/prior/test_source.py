"""Where the prior comes from follows from what is given."""

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.prior import SOURCES, material_prior


def test_without_a_source_there_is_no_prior(clip) -> None:
    assert material_prior(clip, build({})) is None


@pytest.mark.parametrize(
    ("given", "source"),
    [
        ({}, "none"),
        ({"api_key_env": "MY_KEY"}, "none"),
        ({"file": "m.yaml"}, "file"),
        ({"materials": ["wood"]}, "database"),
        ({"base_url": "https://x/v1", "model": "seer-1"}, "model"),
        ({"model": "seer-1", "materials": ["wood"]}, "model"),
    ],
)
def test_the_source_follows_from_what_is_given(given: dict, source: str) -> None:
    assert build({f"prior.{key}": value for key, value in given.items()}).prior.source == source
    assert source in {"none", *SOURCES}


@pytest.mark.parametrize("other", [{"prior.materials": ["wood"]}, {"prior.model": "seer-1"}, {"prior.base_url": "https://x/v1"}])
def test_a_file_beside_another_prior_is_refused(other: dict) -> None:
    with pytest.raises(InputError, match=rf"prior\.file and {next(iter(other))} are both given, must be one prior; leave one out"):
        build({"prior.file": "m.yaml", **other})
    assert build({"prior.file": None, **other})


def test_a_name_per_part_lands_on_its_part(clip, labels) -> None:
    prior = material_prior(clip, build({"prior.materials": ["stem", "petal"]}))
    assert prior is not None
    assert prior.name == ("green stem", "petal")
    np.testing.assert_array_equal(prior.index[labels == 1], 0)
    np.testing.assert_array_equal(prior.index[labels == 2], 1)


def test_one_name_covers_the_whole_object(clip) -> None:
    prior = material_prior(clip, build({"prior.materials": ["foam"]}))
    assert prior is not None
    assert not prior.index.any()
    assert prior.density[0] == 40.0


def test_a_file_is_read_relative_to_nothing_but_its_own_path(clip, tmp_path) -> None:
    path = tmp_path / "materials.yaml"
    path.write_text("parts: [{material: silicone}]")
    prior = material_prior(clip, build({"prior.file": str(path)}))
    assert prior is not None
    assert prior.name == ("silicone",)
    assert prior.source == "a person's file of materials"


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"prior.materials": ["wood"] * 3}, "prior.materials has 3 names, must be 1 or 2"),
        ({"prior.materials": ["unobtainium"]}, "'unobtainium' is not in the database"),
    ],
)
def test_names_that_do_not_fit_are_refused(clip, values: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        material_prior(clip, build(values))
