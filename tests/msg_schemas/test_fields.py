"""Claims about what is published of a recovery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros import config, msg_schemas
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import clouds, fields, messages
from diffphys_ros.msg_schemas.thinning import thin
from diffphys_ros.types import Recovery

BOX = [-0.005, -0.02, -0.02, 0.005, 0.03, 0.04]


def answer(recovery, clip, **settings):
    values = {name.replace("__", "."): value for name, value in settings.items()}
    return fields.answer(recovery, clip, config.build(values))


def varied(recovery: Recovery) -> Recovery:
    """The same recovery with a force and volumes that differ from particle to particle."""
    rng = np.random.default_rng(0)
    return replace(
        recovery,
        force=(recovery.force + rng.normal(0, 100, recovery.force.shape)).astype(np.float32),
        volume=recovery.volume * rng.uniform(0.5, 1.5, len(recovery.volume)),
    )


@pytest.mark.parametrize("most", [1, 2, 7, 39])
def test_thinning_keeps_the_net_force_and_the_volume(made_recovery, most):
    recovery = varied(made_recovery)
    thinned = thin(recovery, most)
    assert len(thinned.ids) <= max(most, 2)  # one per part at least
    assert thinned.volume.sum() == pytest.approx(recovery.volume.sum(), rel=1e-12)
    np.testing.assert_allclose(np.einsum("tnc,n->tc", thinned.force, thinned.volume), recovery.net_force(), rtol=1e-9, atol=1e-12)


def test_a_cluster_stays_within_a_part_and_ids_ascend(made_recovery):
    thinned = thin(made_recovery, 9)
    assert set(made_recovery.part[thinned.ids]) == {1, 2}
    assert (np.diff(thinned.ids) > 0).all()
    for part in (1, 2):
        own = made_recovery.part[thinned.ids] == part
        assert thinned.volume[own].sum() == pytest.approx(made_recovery.volume[made_recovery.part == part].sum())


@pytest.mark.parametrize("most", [12, 1000])
def test_the_sum_over_the_published_force_field_is_the_net_force(made_recovery, made_clip, most):
    recovery = varied(made_recovery)
    cloud = clouds.unpack(answer(recovery, made_clip, publish__max_points=most).force_field())
    net = np.stack([(cloud[f].astype(float) * cloud["volume"]).sum(1) for f in ("fx", "fy", "fz")], -1)
    np.testing.assert_allclose(net, recovery.net_force(), rtol=1e-5, atol=1e-6 * np.abs(recovery.net_force()).max())


def test_material_and_force_field_share_order_and_ids(made_recovery, made_clip):
    found = answer(made_recovery, made_clip, publish__max_points=20)
    material, force = clouds.unpack(found.material_field()), clouds.unpack(found.force_field())
    assert force.shape == (len(made_recovery.force), material.shape[1])
    assert (force["id"] == material["id"]).all()
    assert (force["volume"] == material["volume"]).all()


def test_material_field_has_the_documented_bytes(made_recovery, made_clip):
    message = answer(made_recovery, made_clip).material_field()
    names = ["x", "y", "z", "young_modulus", "poisson_ratio", "density", "volume", "log10_young_sd", "intensity", "id", "part"]
    assert [f["name"] for f in message["fields"]] == names
    assert [f["datatype"] for f in message["fields"]] == [7] * 9 + [6] * 2
    assert len(message["data"]) == message["row_step"] * message["height"] == 44 * 40
    cloud = clouds.unpack(message)[0]
    np.testing.assert_allclose(cloud["intensity"], np.log10(made_recovery.young), rtol=1e-6)
    assert (cloud["part"] == made_recovery.part).all()
    assert message["is_dense"]


def test_the_modulus_of_an_unidentified_part_is_nan_and_the_cloud_says_so(made_recovery, made_clip):
    message = answer(replace(made_recovery, identified=np.array([True, False])), made_clip).material_field()
    cloud = clouds.unpack(message)[0]
    assert (np.isnan(cloud["young_modulus"]) == (cloud["part"] == 2)).all()
    assert not message["is_dense"]


def test_times_of_the_force_field_count_from_the_header_stamp(made_recovery, made_clip):
    found = answer(made_recovery, made_clip)
    message = found.force_field()
    stamp = message["header"]["stamp"]
    assert stamp["sec"] * 10**9 + stamp["nanosec"] == made_clip.start_ns == found.stamp_ns(0)
    np.testing.assert_allclose(clouds.unpack(message)["t"][:, 0], made_clip.times, rtol=1e-6)


def test_state_is_one_row_of_the_force_field(made_recovery, made_clip):
    found = answer(made_recovery, made_clip)
    state, rows = clouds.unpack(found.state(4))[0], clouds.unpack(found.force_field())
    for name in ("x", "y", "z", "fx", "fy", "fz", "id"):
        assert (state[name] == rows[name][4]).all()


def test_torque_is_taken_about_the_centre_of_the_clamp_plane(made_recovery, made_clip):
    one = np.zeros_like(made_recovery.force)
    one[0, -1] = [0, 0, 5e6]  # 5 N on the last particle
    found = answer(replace(made_recovery, force=one), made_clip, scene__clamp_box_m=BOX)
    assert found.reference == pytest.approx([0.0, 0.005, 0.01])  # 5 mm inside the face x = 5 mm
    force, torque = found.wrench(0)
    assert force == pytest.approx([0, 0, 5.0])
    arm = made_recovery.trajectory[0, -1] - found.reference
    assert torque == pytest.approx([arm[1] * 5, -arm[0] * 5, 0], rel=1e-5)
    assert found.net_force(0)["header"]["frame_id"] == "world"


def test_without_a_clamp_box_the_reference_is_the_origin(made_recovery, made_clip):
    assert (answer(made_recovery, made_clip).reference == 0).all()


def test_the_reference_lies_on_the_side_where_the_body_leaves_a_thick_box():
    points = np.array([[-0.5, 0, 0], [-0.1, 0, 0], [-0.02, 0, 0]])
    reference, _ = fields.moment_reference(points, [-0.02, -0.1, -0.1, 0.08, 0.1, 0.1])
    assert reference == pytest.approx([-0.015, 0, 0])


def test_markers_are_capped_cleared_first_and_have_unit_quaternions(made_recovery, made_clip):
    markers = answer(made_recovery, made_clip, publish__max_markers=5).force_markers(3)["markers"]
    assert markers[0]["action"] == fields.DELETE_ALL
    assert len(markers[1]["points"]) == 10
    assert all(m["pose"]["orientation"]["w"] == 1 for m in markers)
    length = np.diff([[p[a] for a in "xyz"] for p in markers[1]["points"]], axis=0)[::2]
    assert np.abs(length).max() <= fields.ARROW_LENGTH * 0.1


def test_no_markers_means_only_the_deletion(made_recovery, made_clip):
    assert len(answer(made_recovery, made_clip, publish__max_markers=0).force_markers(0)["markers"]) == 1


def test_quality_has_one_status_per_part_with_the_documented_keys(made_recovery, made_clip):
    statuses = answer(replace(made_recovery, identified=np.array([True, False])), made_clip).quality()["status"]
    *statuses, force = statuses
    assert len(statuses) == 2
    assert list(messages.values_of(force)) == ["identified", "reason", "peak_net_force", "density_source"]
    keys = ["identified", "reason", "young_modulus", "log10_young_sd", "density_source", "metric_scale_source"]
    assert [list(messages.values_of(s)) for s in statuses] == [keys, keys]
    assert [s["level"] for s in statuses] == [messages.OK, messages.WARN]
    assert messages.values_of(statuses[1])["young_modulus"] == "nan"
    assert "density assumed" in statuses[0]["message"]


@pytest.mark.parametrize(("known", "level"), [(True, messages.OK), (False, messages.WARN)])
def test_quality_says_whether_the_force_is_known_and_why(made_recovery, made_clip, known, level):
    force = answer(replace(made_recovery, force_identified=known, force_reason="the camera moves."), made_clip).quality()["status"][-1]
    assert (force["name"], force["level"]) == ("fit_node: force", level)
    values = messages.values_of(force)
    assert (values["identified"], values["reason"]) == (str(known).lower(), "the camera moves.")
    assert float(values["peak_net_force"]) == pytest.approx(np.linalg.norm(made_recovery.net_force(), axis=1).max(), rel=1e-5)


def test_progress_has_the_documented_keys():
    status = fields.progress(0, stage="fit", iteration=3, iterations=10, loss=0.5, run="3f9a2c1e")["status"][0]
    assert messages.values_of(status) == {"run": "3f9a2c1e", "stage": "fit", "iteration": "3", "iterations": "10", "loss": "0.5", "seconds_left": ""}


def test_a_recording_begins_with_the_latched_results_and_goes_on_in_time(made_recovery, made_clip):
    recorded = list(msg_schemas.recording(made_recovery, made_clip, config.build({})))
    assert [m.topic for m in recorded[:3]] == ["/fit_node/material_field", "/fit_node/force_field", "/fit_node/quality"]
    assert (np.diff([m.stamp_ns for m in recorded]) >= 0).all()
    assert sum(m.topic == "/fit_node/rendered" for m in recorded) == len(made_recovery.force)


def test_a_quaternion_gives_its_rotation_back():
    rng = np.random.default_rng(1)
    for _ in range(20):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.linalg.det(rotation)
        w, x, y, z = messages.quaternion(rotation)
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        np.testing.assert_allclose(np.eye(3) + 2 * w * skew + 2 * skew @ skew, rotation, atol=1e-12)


def test_a_cloud_with_padding_and_big_endian_bytes_is_read():
    record = np.dtype({"names": ["x", "id"], "formats": [">f4", ">u4"], "offsets": [4, 8], "itemsize": 16})
    points = np.zeros(3, record)
    points["x"], points["id"] = [1, 2, 3], [7, 8, 9]
    layout = [{"name": "x", "offset": 4, "datatype": 7}, {"name": "id", "offset": 8, "datatype": 6}]
    cloud = {
        "fields": layout, "height": 1, "width": 3, "point_step": 16, "row_step": 48, "is_bigendian": True, "data": points.tobytes(),
    }  # fmt: skip
    assert clouds.unpack(cloud)["x"][0].tolist() == [1, 2, 3]
    assert clouds.unpack(cloud)["id"][0].tolist() == [7, 8, 9]
    with pytest.raises(InputError, match="do not hold"):
        clouds.unpack(cloud | {"width": 4})
