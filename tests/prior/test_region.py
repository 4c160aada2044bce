"""From records to pixels, and from pixels to points."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.prior import find
from diffphys_ros.prior.records import of_material
from diffphys_ros.prior.region import spread

WOOD, RUBBER, FOAM = (of_material(find(name, "test")) for name in ("wood", "rubber", "foam"))


def on(record, **region):
    return dataclasses.replace(record, **region)


def test_parts_beat_boxes_and_small_boxes_beat_large_ones_in_any_order(labels) -> None:
    records = [on(FOAM, box=(0.4, 0.2, 0.6, 0.4)), on(RUBBER, part=1), on(WOOD, box=(0.0, 0.0, 1.0, 1.0))]
    for order in ([0, 1, 2], [2, 1, 0], [1, 0, 2]):
        prior = spread([records[k] for k in order], labels, source="test")
        names = np.array(prior.name)[prior.index]
        assert (names[labels == 1] == "rubber").all()
        assert names[20, 40] == "polyurethane foam"
        assert names[8, 22] == "wood"


def test_pixels_that_no_box_covers_take_the_nearest_material_on_the_object(labels) -> None:
    prior = spread([on(WOOD, box=(0.4, 0.8, 0.6, 1.0)), on(RUBBER, box=(0.2, 0.1, 0.8, 0.2))], labels, source="test")
    wood = prior.index == 0
    assert wood[40, 40]
    assert not wood[20, 40]
    assert wood[59, 0]
    assert not wood[0, 79]


def test_a_box_reaches_pixels_whose_centres_it_holds_and_no_pixel_off_the_object(labels) -> None:
    prior = spread([on(WOOD, box=(0.0, 0.0, 0.5, 1.0)), on(RUBBER, box=(0.5, 0.0, 1.0, 1.0))], labels, source="test")
    assert (prior.index[10, 20:40] == 0).all()
    assert (prior.index[10, 40:60] == 1).all()


def test_records_beside_the_object_are_refused(labels) -> None:
    with pytest.raises(InputError, match="no box or part touches the object"):
        spread([on(WOOD, box=(0.9, 0.9, 1.0, 1.0))], labels, source="a file")


def test_points_find_the_material_that_they_are_seen_on(clip, labels) -> None:
    prior = spread([on(WOOD, part=1), on(RUBBER, part=2)], labels, source="test")
    pixels = np.array([[40.0, 50.0], [40.0, 10.0], [-30.0, 10.0]])
    points = clip.camera.backproject(pixels, np.full(3, 0.7))
    np.testing.assert_array_equal(prior.at(clip.camera, points), [0, 1, 1])
    assert prior.at(clip.camera, points[None]).shape == (1, 3)
