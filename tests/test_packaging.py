"""Claims about what an installation holds, in every way of installing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

import diffphys_ros

ROOT = Path(diffphys_ros.__file__).resolve().parent.parent
NODES = {"ingest_node", "segment_node", "splat_node", "fit_node", "inspect_node", "graph"}
LINKED = ("nodes", "bags", "msg_schemas")

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not (ROOT / "setup.py").exists(), reason="not a checkout")]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """A copy of what git tracks, links kept."""
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    folder = tmp_path_factory.mktemp("workspace") / "src" / "diffphys_ros"
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    return folder


@pytest.fixture(scope="module")
def wheel(checkout, tmp_path_factory) -> Path:
    return built(checkout, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def sdist(checkout, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("sdist")
    run(sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", out, cwd=checkout)
    return next(out.glob("*.tar.gz"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """An environment of its own with the wheel in it and, behind it, the third parties of this one: no checkout is in reach."""
    root = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", root)
    run(sys.executable, "-m", "pip", "--python", root / "bin" / "python", "install", "--quiet", "--no-index", "--no-deps", wheel)
    (packages,) = root.glob("lib/python3*/site-packages")
    (packages / "third_parties.pth").write_text("\n".join(sorted({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})) + "\n")
    return root


def built(source: Path, out: Path) -> Path:
    """The wheel of a source tree."""
    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", out, source)
    return next(out.glob("*.whl"))


def run(*command: object, cwd: Path | None = None, **environment: str) -> str:
    """Output of a command; fails with it where the command does."""
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=os.environ | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_wheel_holds_one_top_level_package_and_the_sample(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    assert {t for t in top if "." not in t} == {"diffphys_ros"}
    for room in LINKED:
        assert f"diffphys_ros/{room}/__init__.py" in names
    assert "diffphys_ros/bags/sample/clip.mcap" in names
    assert "diffphys_ros/prior/materials.yaml" in names
    assert "diffphys_ros/nodes/fastdds.xml" in names


def test_a_wheel_puts_executables_where_ros2_run_looks(wheel):
    archive = zipfile.ZipFile(wheel)
    prefix = next(n for n in archive.namelist() if n.endswith("data/lib/diffphys_ros/fit_node")).removesuffix("fit_node")
    for node in NODES:
        assert archive.getinfo(prefix + node).external_attr >> 16 & 0o111  # executable
    data = prefix.removesuffix("lib/diffphys_ros/")
    for file in (
        "share/ament_index/resource_index/packages/diffphys_ros",
        "share/diffphys_ros/package.xml",
        "share/diffphys_ros/launch/fit.launch.py",
        "share/diffphys_ros/config/fastdds.xml",
    ):
        assert data + file in archive.namelist()


def test_ros_is_an_extra_and_never_required(wheel):
    archive = zipfile.ZipFile(wheel)
    metadata = archive.read(next(n for n in archive.namelist() if n.endswith("METADATA"))).decode()
    required = [line for line in metadata.splitlines() if line.startswith("Requires-Dist: ros-")]
    assert required
    assert all('extra == "ros"' in line for line in required)


def test_a_source_archive_builds_the_same_wheel(sdist, tmp_path, wheel):
    shutil.unpack_archive(sdist, tmp_path)
    (source,) = tmp_path.iterdir()
    again = zipfile.ZipFile(built(source, tmp_path / "wheel"))
    package = [name for name in again.namelist() if name.startswith("diffphys_ros/")]
    assert sorted(again.namelist()) == sorted(zipfile.ZipFile(wheel).namelist())
    assert [name for name in package if again.read(name) != zipfile.ZipFile(wheel).read(name)] == []


def test_what_developers_alone_need_is_in_neither_archive(sdist, wheel):
    with tarfile.open(sdist) as files:
        names = {*zipfile.ZipFile(wheel).namelist(), *("/".join(name.split("/")[1:]) for name in files.getnames())}
    of_developers = {"tools", "tests", "benchmarks", "scripts", "sample_maker", "make_sample.py", "maker"}
    assert sorted(name for name in names if of_developers & set(name.split("/"))) == []


def test_an_installed_wheel_says_what_it_can_do(installed):
    assert "recover" in run(installed / "bin" / "diffphys", "--help", cwd=installed, PYTHONPATH="")
    settings = run(installed / "bin" / "diffphys", "settings", cwd=installed, PYTHONPATH="")
    assert "scene.mass_kg" in settings
    for node in NODES:
        assert os.access(installed / "bin" / node, os.X_OK)
        assert os.access(installed / "lib" / "diffphys_ros" / node, os.X_OK)


def test_an_installed_wheel_reads_the_samples_that_it_brings(installed):
    code = (
        "from diffphys_ros import config; from diffphys_ros.bags.read import read_clip; from diffphys_ros.bags.sample import SAMPLES, sample_folder\n"
        "for kind in SAMPLES:\n"
        "    folder = sample_folder(kind); settings = config.layered([folder / 'given.yaml'])\n"
        "    print(folder, read_clip(folder / 'clip.mcap', settings).frames.shape, settings.scene.mass_kg)"
    )
    bar, strip = run(installed / "bin" / "python", "-c", code, cwd=installed, PYTHONPATH="").splitlines()
    assert all(line.startswith(str(installed)) for line in (bar, strip))
    assert bar.endswith("(36, 240, 320, 3) 2.5875")
    assert strip.endswith("(39, 240, 320, 3) 0.6075")


def test_every_requirement_has_a_pin(wheel):
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    archive = zipfile.ZipFile(wheel)
    metadata = archive.read(next(n for n in archive.namelist() if n.endswith("METADATA"))).decode()
    required = [Requirement(line.partition(": ")[2]) for line in metadata.splitlines() if line.startswith("Requires-Dist: ")]
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and not line.startswith("#")]
    pins = {canonicalize_name(line.partition("==")[0]): line.partition("==")[2] for line in lines}
    for requirement in required:
        assert pins[canonicalize_name(requirement.name)] in requirement.specifier, requirement


@pytest.mark.skipif(shutil.which("colcon", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}") is None, reason="no colcon")
class TestColcon:
    PATH = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"

    def test_sees_an_ament_python_package(self, checkout):
        assert "(ros.ament_python)" in run("colcon", "list", cwd=checkout.parent.parent, PATH=self.PATH)

    @pytest.mark.parametrize("mode", [[], ["--symlink-install"]])
    def test_installs_all_executables_and_an_importable_package(self, checkout, tmp_path, mode):
        run("colcon", "build", *mode, "--base-paths", checkout, cwd=tmp_path, PATH=self.PATH)
        prefix = tmp_path / "install" / "diffphys_ros"
        assert {p.name for p in (prefix / "lib" / "diffphys_ros").iterdir() if os.access(p, os.X_OK)} >= NODES
        assert (prefix / "share" / "diffphys_ros" / "launch" / "graph.launch.py").exists()
        assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "diffphys_ros").exists()
        code = (
            "import importlib.util as u, diffphys_ros.nodes.executables as e, diffphys_ros.bags.sample as s;"
            f"print(e.__file__, e.middleware.PROFILE.exists(), (s.sample_folder() / 'clip.mcap').exists(), [u.find_spec(n) for n in {LINKED}])"
        )
        said = run("bash", "-c", f'. install/local_setup.bash; "{sys.executable}" -P -c "{code}"', cwd=tmp_path, PYTHONPATH="", PATH=self.PATH)
        assert said.startswith(str(tmp_path))
        assert said.endswith("True True [None, None, None]\n")
