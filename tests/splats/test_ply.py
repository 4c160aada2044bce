"""The 3DGS parameterisation and its .ply files."""

import os

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.splats import ply
from diffphys_ros.types import Splats


def random_splats(count=500, seed=0):
    """Extremes included: opacities of 0 and 1, scales over nine decades, pure colours."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    opacity, color = rng.random(count), rng.random((count, 3))
    opacity[:4], color[:4] = (0, 1, 1e-12, 1 - 1e-7), [[0, 0, 0], [1, 1, 1], [0, 1, 0], [1, 0, 1]]
    fields = (rng.normal(size=(count, 3)) * 10, rotation, 10 ** rng.uniform(-6, 3, (count, 3)), opacity, color)
    return Splats(*(f.astype(np.float32) for f in fields))


def equal(a, b):
    return all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in zip(vars(a).values(), vars(b).values(), strict=True))


def test_raw_rows_hold_log_scale_logit_and_harmonics():
    splats = Splats(*(np.array([v], np.float32) for v in ([1, 2, 3], [1, 0, 0, 0], [1, np.e, 0.5], 0.5, [0.5, 1, 0])))
    row = dict(zip(ply.FIELDS, ply.to_raw(splats)[0], strict=True))
    assert [row["x"], row["y"], row["z"], row["rot_0"]] == [1, 2, 3, 1]
    assert [row["scale_0"], row["scale_1"], row["scale_2"]] == pytest.approx([0, 1, np.log(0.5)])
    assert [row["opacity"], row["f_dc_0"]] == [0, 0]
    assert [row["f_dc_1"], row["f_dc_2"]] == pytest.approx([0.5 / 0.28209479, -0.5 / 0.28209479])


@pytest.mark.parametrize("seed", range(5))
def test_canonical_splats_survive_raw_form_to_the_bit(seed):
    splats = ply.canonical(random_splats(seed=seed))
    assert equal(ply.from_raw(ply.to_raw(splats)), splats)
    assert equal(ply.canonical(splats), splats)


def test_canonical_changes_no_value_noticeably():
    splats = random_splats()
    same = ply.canonical(splats)
    np.testing.assert_array_equal(same.mean, splats.mean)
    np.testing.assert_allclose(same.scale, splats.scale, rtol=1e-5)
    np.testing.assert_allclose(same.opacity, splats.opacity, atol=1e-6)
    np.testing.assert_allclose(same.color, splats.color, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(same.rotation, axis=1), 1, atol=1e-6)


def test_a_file_gives_back_canonical_splats_to_the_bit(tmp_path):
    splats = ply.canonical(random_splats())
    ply.write(tmp_path / "a.ply", splats)
    assert equal(ply.read(tmp_path / "a.ply"), splats)
    assert os.listdir(tmp_path) == ["a.ply"]


def test_the_header_is_the_one_viewers_expect(tmp_path):
    ply.write(tmp_path / "a.ply", random_splats(7))
    lines = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")[0].decode().splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 7"]
    names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
    assert lines[3:] == [f"property float {name}" for name in names.split()]
    assert (tmp_path / "a.ply").stat().st_size == len("\n".join(lines)) + 1 + len("end_header\n") + 7 * 17 * 4


def test_a_foreign_file_with_other_order_and_more_properties_is_read(tmp_path):
    splats = ply.canonical(random_splats(20))
    raw = ply.to_raw(splats)
    names = [*reversed([n for n in ply.FIELDS if n not in ("nx", "ny", "nz")]), "f_rest_0"]
    rows = np.zeros(20, [(n, "<f8" if n == "x" else "<f4") for n in names])
    for n in names[:-1]:
        rows[n] = raw[:, ply.FIELDS.index(n)]
    types = [f"property {'double' if n == 'x' else 'float'} {n}" for n in names]
    header = ["ply", "format binary_little_endian 1.0", "comment another program", "element vertex 20", *types, "end_header", ""]
    (tmp_path / "b.ply").write_bytes("\n".join(header).encode() + rows.tobytes())
    assert equal(ply.read(tmp_path / "b.ply"), splats)


def broken(data):
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 5\n"
    return {
        "ends after": data[:-10],
        "no binary little-endian": data.replace(b"binary_little_endian", b"ascii"),
        "has no opacity": data.replace(b"property float opacity", b"property float capacity"),
        "plain scalar": data.replace(b"property float nx", b"property list uchar int nx"),
        "one element": data.replace(b"element vertex", b"element face"),
        "must be \\(G, 17\\)": data.replace(b"vertex 5", b"vertex 0"),
        "no .*end|no binary": head,
        "and their number": data.replace(b"element vertex 5", b"element vertex"),
        "their number; export": data.replace(b"element vertex 5", b"element"),
        "one element, the vertices, and": data.replace(b"vertex 5", b"vertex " + b"9" * 5000),
        "ends after 5 of 9999999999": data.replace(b"vertex 5", b"vertex 9999999999"),
        "a property twice": data.replace(b"property float nx", b"property float x"),
        "more than 256": data.replace(b"end_header", b"".join(b"property float f_%d\n" % k for k in range(300)) + b"end_header"),
    }


@pytest.mark.parametrize("message", broken(b""))
def test_a_broken_file_is_named_with_its_fault(tmp_path, message):
    path = tmp_path / "c.ply"
    ply.write(path, random_splats(5))
    path.write_bytes(broken(path.read_bytes())[message])
    with pytest.raises(InputError, match=message):
        ply.read(path)


def test_numbers_that_are_not_finite_are_refused():
    raw = ply.to_raw(random_splats(5))
    raw[3, 1] = np.nan
    with pytest.raises(InputError, match="row 3"):
        ply.from_raw(raw)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.ply: No such file"):
        ply.read(tmp_path / "none.ply")


def test_an_unwritable_place_leaves_nothing_behind(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        ply.write(tmp_path / "folder" / "a.ply", random_splats(5))
    (tmp_path / "is_a_folder.ply").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        ply.write(tmp_path / "is_a_folder.ply", random_splats(5))
    assert os.listdir(tmp_path) == ["is_a_folder.ply"]


@pytest.mark.parametrize(("field", "value"), [("scale_1", 200.0), ("scale_0", -80.0), ("x", 2e6), ("z", -1e30)])
def test_a_place_or_a_scale_out_of_bounds_is_refused(field, value):
    raw = ply.to_raw(random_splats(5))
    raw[2, ply.FIELDS.index(field)] = value
    with pytest.raises(InputError, match=r"row 2 lies beyond 1e\+06 m or has a scale outside 1e-18 .. 1e\+06 m"):
        ply.from_raw(raw)


@pytest.mark.parametrize("logit", [-1e38, -800.0, 800.0, 1e38])
@pytest.mark.filterwarnings("error")
def test_extreme_opacities_are_0_or_1(logit):
    raw = ply.to_raw(random_splats(5))
    raw[4, ply.FIELDS.index("opacity")] = logit
    assert ply.from_raw(raw).opacity[4] == (logit > 0)


@pytest.mark.filterwarnings("error")
def test_doubles_that_no_float_holds_are_refused(tmp_path):
    rows = np.zeros(1, [(n, "<f8") for n in ply.FIELDS])
    rows["rot_0"], rows["x"] = 1, 1e300
    header = ["ply", "format binary_little_endian 1.0", "element vertex 1", *(f"property double {n}" for n in ply.FIELDS), "end_header", ""]
    (tmp_path / "d.ply").write_bytes("\n".join(header).encode() + rows.tobytes())
    with pytest.raises(InputError, match="row 0 holds a number that is not finite"):
        ply.read(tmp_path / "d.ply")


@pytest.mark.timeout(20)
def test_what_is_no_file_is_named(tmp_path):
    os.mkfifo(tmp_path / "pipe.ply")
    for path in (tmp_path / "pipe.ply", tmp_path, tmp_path / "a\0b.ply"):
        with pytest.raises(InputError, match=r"no regular file|null byte"):
            ply.read(path)
