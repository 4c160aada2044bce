"""Claims about what is published of a recovery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros import config, msg_schemas
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import clouds, fields, messages
from diffphys_ros.msg_schemas.markers import DELETE_ALL
from diffphys_ros.msg_schemas.recording import played
from diffphys_ros.msg_schemas.thinning import thin
from diffphys_ros.progress import ForceSoFar
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


# name, sensor_msgs/PointField datatype (6 uint32, 7 float32), offset: what subscribers may rely on. Later versions add fields at the end.
PINNED = {
    "material_field": [
        ("x", 7, 0), ("y", 7, 4), ("z", 7, 8), ("young_modulus", 7, 12), ("log10_young_sd", 7, 16), ("young_lower", 7, 20), ("poisson_ratio", 7, 24),
        ("density", 7, 28), ("volume", 7, 32), ("part", 6, 36), ("identified", 6, 40), ("absolute", 6, 44), ("intensity", 7, 48), ("id", 6, 52),
    ],
    "force_field": [
        ("x", 7, 0), ("y", 7, 4), ("z", 7, 8), ("t", 7, 12), ("fx", 7, 16), ("fy", 7, 20), ("fz", 7, 24), ("volume", 7, 28), ("intensity", 7, 32),
        ("id", 6, 36),
    ],
    "state": [("x", 7, 0), ("y", 7, 4), ("z", 7, 8), ("fx", 7, 12), ("fy", 7, 16), ("fz", 7, 20), ("intensity", 7, 24), ("id", 6, 28)],
}  # fmt: skip


@pytest.mark.parametrize("name", PINNED)
def test_names_types_and_places_of_the_fields_are_those_that_subscribers_rely_on(made_recovery, made_clip, name):
    found = answer(made_recovery, made_clip)
    message = found.state(3) if name == "state" else getattr(found, name)()
    fields_of = [(f["name"], f["datatype"], f["offset"]) for f in message["fields"]]
    assert fields_of[: len(PINNED[name])] == PINNED[name]
    assert len(message["data"]) == message["row_step"] * message["height"] == message["point_step"] * message["width"] * message["height"]
    assert f"~/{name}" in clouds.LAYOUTS


def test_the_material_field_says_what_is_known_of_every_particle(made_recovery, made_clip):
    cloud = clouds.unpack(answer(replace(made_recovery, identified=np.array([True, False])), made_clip).material_field())[0]
    np.testing.assert_allclose(cloud["intensity"], np.log10(made_recovery.young), rtol=1e-6)
    assert (cloud["part"] == made_recovery.part).all()
    assert (cloud["identified"] == (made_recovery.part == 1)).all()
    assert np.isnan(cloud["young_lower"][made_recovery.part == 1]).all()
    assert (cloud["young_lower"][made_recovery.part == 2] == 1e4).all()


@pytest.mark.parametrize(
    ("density", "scale", "absolute"),
    [
        ("mass_kg over the filled volume", "depth topic", 1),
        ("assumed: 1000 kg/m^3", "depth topic", 0),
        ("density_kg_m3", "unknown: the object is assumed 1 m away", 0),
        (None, None, 0),
    ],
)
def test_the_scale_is_absolute_where_neither_density_nor_size_is_assumed(made_recovery, made_clip, density, scale, absolute):
    told = {name: value for name, value in (("density_source", density), ("metric_scale_source", scale)) if value}
    cloud = clouds.unpack(answer(replace(made_recovery, metrics=told), made_clip).material_field())
    assert (cloud["absolute"] == absolute).all()


NO_MASS = {"density_source": "assumed: 1000 kg/m^3", "metric_scale_source": "depth topic"}
NO_LENGTH = {"density_source": "mass_kg over the filled volume", "metric_scale_source": "unknown: the object is assumed 1 m away"}


@pytest.mark.parametrize(("sources", "over_mass"), [(NO_MASS, True), (NO_LENGTH, False)])
def test_no_pascals_and_no_newtons_are_published_from_an_assumed_density_or_size(made_recovery, made_clip, sources, over_mass):
    found = answer(replace(made_recovery, metrics=sources), made_clip)
    material, force, state = clouds.unpack(found.material_field()), clouds.unpack(found.force_field()), clouds.unpack(found.state(3))
    assert np.isnan([material["young_modulus"], material["young_lower"]]).all()
    assert np.isnan([rows[name].max() for rows in (force, state) for name in ("fx", "fy", "fz")]).all()
    assert found.net_force(3) is None
    assert "~/net_force" not in {m.topic for m in played(found, 3)}
    said = [messages.values_of(s) for s in found.quality()["status"]]
    assert all("nan" in (values.get("young_modulus"), values.get("peak_net_force")) and values["scale"].startswith("relative") for values in said)
    assert np.isfinite(material["young_over_density"]).all() == np.isfinite(force["ax"]).all() == over_mass


@pytest.mark.parametrize("sources", [NO_MASS, NO_LENGTH])
def test_what_is_known_without_mass_and_size_is_published(made_recovery, made_clip, sources):
    found = answer(replace(made_recovery, metrics=sources), made_clip)
    material, force = clouds.unpack(found.material_field())[0], clouds.unpack(found.force_field())
    np.testing.assert_allclose(material["young_relative"], np.where(made_recovery.part == 1, 1.0, 0.25), rtol=1e-6)
    np.testing.assert_allclose(clouds.xyz(force, "r"), made_recovery.force * ~made_recovery.clamped[:, None] / np.abs(made_recovery.force).max(), atol=1e-6)
    np.testing.assert_allclose(force["intensity"], np.linalg.norm(clouds.xyz(force, "r"), axis=-1), rtol=1e-5)
    clouds.particles(found.force_field(), clouds.FIELD)  # a listener takes it
    part, *_, net = (messages.values_of(s) for s in found.quality()["status"])
    specific, acceleration = float(part["young_over_density"]), float(net["peak_net_force_over_mass"])
    if sources is NO_MASS:
        assert specific == pytest.approx(8e4 / 500)
        assert acceleration == pytest.approx(np.linalg.norm(made_recovery.net_force(), axis=1).max() / made_recovery.mass_kg, rel=1e-5)
    else:
        assert np.isnan([specific, acceleration]).all()


def test_an_assumed_scale_passes_for_a_known_one_where_that_is_allowed(made_recovery, made_clip):
    assumed = replace(made_recovery, metrics=NO_MASS)
    told, allowed = answer(made_recovery, made_clip), answer(assumed, made_clip, publish__allow_assumed_scale=True)
    assert allowed.material_field() == told.material_field()
    assert allowed.force_field() == told.force_field()
    assert allowed.net_force(3) == told.net_force(3)
    assert fields.limited(allowed, config.build({})).net_force(3) is None


@pytest.mark.parametrize("name", ["force_field", "state"])
def test_the_intensity_of_a_force_is_its_size(made_recovery, made_clip, name):
    found = answer(varied(made_recovery), made_clip)
    cloud = clouds.unpack(found.force_field() if name == "force_field" else found.state(3))
    np.testing.assert_allclose(cloud["intensity"], np.linalg.norm(clouds.xyz(cloud, "f"), axis=-1), rtol=1e-5)


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


def test_markers_are_capped_cleared_first_and_have_unit_quaternions(made_recovery, made_clip, monkeypatch):
    monkeypatch.setattr(fields, "MOST_MARKERS", 5)
    markers = answer(made_recovery, made_clip).force_markers(3)["markers"]
    assert markers[0]["action"] == DELETE_ALL
    assert len(markers[1]["points"]) == 10
    assert all(m["pose"]["orientation"]["w"] == 1 for m in markers)
    length = np.diff([[p[a] for a in "xyz"] for p in markers[1]["points"]], axis=0)[::2]
    assert np.abs(length).max() <= fields.ARROW_LENGTH * 0.1


def test_stiffness_markers_have_one_colour_a_stiffness_and_grey_where_it_is_not_identified(made_recovery, made_clip, monkeypatch):
    monkeypatch.setattr(fields, "MOST_MARKERS", 30)
    partly = replace(made_recovery, identified=np.array([True, False]))
    deletion, cubes = answer(partly, made_clip).stiffness_markers()["markers"]
    assert deletion["action"] == DELETE_ALL
    assert len(cubes["points"]) == len(cubes["colors"]) <= 30
    soft = np.array([point["x"] > 0.05 for point in cubes["points"]])
    colours = np.array([[colour[c] for c in "rgba"] for colour in cubes["colors"]])
    assert soft.any()
    assert not soft.all()
    assert (np.ptp(colours[soft, :3], axis=1) == 0).all()
    assert (np.ptp(colours[~soft, :3], axis=1) > 0.1).all()
    assert (colours[:, 3] == 1).all()
    whole = answer(made_recovery, made_clip).stiffness_markers()["markers"][1]
    assert len({tuple(colour.values()) for colour in whole["colors"]}) == 2


def test_the_camera_of_a_rendered_image_has_its_stamp_and_stands_in_the_tree(made_recovery, made_clip):
    found = answer(made_recovery, made_clip)
    info, picture = found.camera_info(4), found.rendered(4)
    assert info["header"] == picture["header"]
    assert (info["height"], info["width"]) == (picture["height"], picture["width"])
    (link,) = found.tree()["transforms"]
    assert (link["header"]["frame_id"], link["child_frame_id"]) == (found.world, info["header"]["frame_id"])
    assert answer(replace(made_recovery, frames=None), made_clip).camera_info(4) is None


def test_a_camera_without_a_pose_looks_along_x_of_a_world_of_its_own(made_recovery, made_clip):
    alone = replace(made_clip, camera=replace(made_clip.camera, world_from_camera=np.eye(4), world_frame_id=""))
    (link,) = answer(made_recovery, alone).tree()["transforms"]
    assert (link["header"]["frame_id"], link["child_frame_id"]) == ("world", "camera_optical")
    q = link["transform"]["rotation"]
    assert [q[c] for c in "xyzw"] == pytest.approx([-0.5, 0.5, -0.5, 0.5])  # REP-103: optical z forward is x, optical y down is -z


def test_quality_has_one_status_per_part_with_the_documented_keys(made_recovery, made_clip):
    told = replace(made_recovery, identified=np.array([True, False]), notes=("density assumed", "depth: of the bag."))
    statuses = answer(told, made_clip).quality()["status"]
    *statuses, force = statuses
    assert len(statuses) == 2
    assert list(messages.values_of(force)) == ["identified", "reason", "peak_net_force", "density_source", "peak_net_force_over_mass", "scale", "peak_net_force_sd"]
    keys = ["identified", "reason", "young_modulus", "log10_young_sd", "density_source", "metric_scale_source", "young_over_density", "young_relative", "scale"]
    assert [list(messages.values_of(s)) for s in statuses] == [keys, keys]
    assert [s["level"] for s in statuses] == [messages.OK, messages.WARN]
    assert messages.values_of(statuses[1])["young_modulus"] == "nan"
    assert statuses[0]["message"] == "density assumed; depth: of the bag"


@pytest.mark.parametrize(("known", "level"), [(True, messages.OK), (False, messages.WARN)])
def test_quality_says_whether_the_force_is_known_and_why(made_recovery, made_clip, known, level):
    force = answer(replace(made_recovery, force_identified=known, force_reason="the camera moves."), made_clip).quality()["status"][-1]
    assert (force["name"], force["level"]) == ("fit_node: force", level)
    values = messages.values_of(force)
    assert (values["identified"], values["reason"]) == (str(known).lower(), "the camera moves.")
    assert float(values["peak_net_force"]) == pytest.approx(made_recovery.net_force_peak, rel=1e-5)
    assert float(values["peak_net_force_sd"]) == pytest.approx(made_recovery.net_force_peak_sd, rel=1e-5)


def test_the_deviation_of_the_net_force_has_the_wrench_s_stamp_and_frame(made_recovery, made_clip):
    found = answer(made_recovery, made_clip)
    told = [found.net_force_sd(k) for k in range(len(found))]
    np.testing.assert_array_equal([[m["vector"][c] for c in "xyz"] for m in told], made_recovery.net_force_sd)
    assert [m["header"] for m in told] == [found.net_force(k)["header"] for k in range(len(found))]


def test_the_force_so_far_times_its_volume_is_the_net_force():
    net = np.random.default_rng(0).normal(size=(5, 3))
    so_far = ForceSoFar(10**9, 0.1, "world", (1.0, 2.0, 3.0), 4e-4, tuple(map(tuple, net.tolist())), 0.2, density_told=True, length_told=True)
    rows = clouds.particles(fields.force_so_far(so_far), clouds.FIELD)
    assert rows.shape == (5, 1)
    np.testing.assert_allclose((clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1), net, rtol=1e-6)
    np.testing.assert_allclose(rows["t"][:, 0], np.arange(5) * 0.1, rtol=1e-6)
    assert [rows[axis][0, 0] for axis in "xyz"] == [1, 2, 3]
    untold = clouds.particles(fields.force_so_far(replace(so_far, density_told=False)), clouds.FIELD)
    assert np.isnan(untold["fx"]).all()
    np.testing.assert_allclose(clouds.xyz(untold, "a")[:, 0], net / 0.2, rtol=1e-6)


def test_progress_has_the_documented_keys():
    status = fields.progress(0, stage="fit", iteration=3, iterations=10, loss=0.5, run="3f9a2c1e")["status"][0]
    assert messages.values_of(status) == {"run": "3f9a2c1e", "stage": "fit", "iteration": "3", "iterations": "10", "loss": "0.5", "seconds_left": ""}


@pytest.mark.parametrize("node", ["fit_node", "/robot1/finder"])
def test_a_recording_begins_with_what_is_latched_and_goes_on_in_time_under_the_name_of_its_node(made_recovery, made_clip, node):
    recorded = list(msg_schemas.recording(made_recovery, made_clip, config.build({}), node=node))
    name = node.lstrip("/")
    latched = [f"/{name}/{topic}" for topic in ("material_field", "force_field", "stiffness_markers", "quality")]
    assert [m.topic for m in recorded[:5]] == ["/tf_static", *latched]
    assert (np.diff([m.stamp_ns for m in recorded]) >= 0).all()
    for each in ("rendered", "camera_info"):
        assert sum(m.topic == f"/{name}/{each}" for m in recorded) == len(made_recovery.force)
    assert recorded[4].fields["status"][0]["name"] == f"{name.split('/')[-1]}: part 1"


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
