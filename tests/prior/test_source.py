"""The words of prior.source."""

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.prior import SOURCES, material_prior


def test_without_a_source_there_is_no_prior(clip) -> None:
    assert material_prior(clip, build({})) is None


def test_every_source_but_none_is_a_choice_of_the_setting() -> None:
    from diffphys_ros.config import leaves

    assert leaves()["prior.source"].choices == ("none", *SOURCES)


def test_a_name_per_part_lands_on_its_part(clip, labels) -> None:
    prior = material_prior(clip, build({"prior.source": "database", "prior.materials": ["stem", "petal"]}))
    assert prior is not None
    assert prior.name == ("green stem", "petal")
    np.testing.assert_array_equal(prior.index[labels == 1], 0)
    np.testing.assert_array_equal(prior.index[labels == 2], 1)


def test_one_name_covers_the_whole_object(clip) -> None:
    prior = material_prior(clip, build({"prior.source": "database", "prior.materials": ["foam"]}))
    assert prior is not None
    assert not prior.index.any()
    assert prior.density[0] == 40.0


def test_a_file_is_read_relative_to_nothing_but_its_own_path(clip, tmp_path) -> None:
    path = tmp_path / "materials.yaml"
    path.write_text("parts: [{material: silicone}]")
    prior = material_prior(clip, build({"prior.source": "file", "prior.file": str(path)}))
    assert prior is not None
    assert prior.name == ("silicone",)
    assert prior.source == "a person's file of materials"


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"prior.source": "file"}, "prior.file is not set"),
        ({"prior.source": "database"}, "prior.materials is not set"),
        ({"prior.source": "database", "prior.materials": ["wood"] * 3}, "prior.materials has 3 names, must be 1 or 2"),
        ({"prior.source": "database", "prior.materials": ["unobtainium"]}, "'unobtainium' is not in the database"),
    ],
)
def test_sources_without_what_they_need_are_refused(clip, values: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        material_prior(clip, build(values))
