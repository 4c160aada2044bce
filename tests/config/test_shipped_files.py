"""Claims about the files in config/ and launch/."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import yaml

import diffphys_ros
from diffphys_ros import config

ROOT = Path(diffphys_ros.__file__).resolve().parent.parent
LAUNCH = sorted((ROOT / "launch").glob("*.launch.py"))


def test_defaults_yaml_holds_every_default():
    text = (ROOT / "config" / "defaults.yaml").read_text()
    assert config.flatten(yaml.safe_load(text), "defaults.yaml") == {name: leaf.default for name, leaf in config.leaves().items()}, "make tables"
    assert config.layered([ROOT / "config" / "defaults.yaml"]) == config.build({})


def test_defaults_yaml_says_what_every_setting_means():
    lines = (ROOT / "config" / "defaults.yaml").read_text().splitlines()
    docs = {m[1]: m[2] for m in (re.match(r"  (\w+): .*?  # (.*)", line) for line in lines) if m}
    for name, leaf in config.leaves().items():
        said = docs[name.split(".")[1]] if sum(n.endswith("." + name.split(".")[1]) for n in config.leaves()) == 1 else "\n".join(lines)
        assert leaf.doc in said, name
        assert not leaf.unit or f"[{leaf.unit}]" in said, name
        assert leaf.range_text in said, name


def test_the_fast_dds_profile_enlarges_shared_memory_and_udp_buffers():
    tree = ElementTree.parse(ROOT / "nodes" / "fastdds.xml").getroot()
    space = {"d": "http://www.eprosima.com"}
    found = {t.findtext("d:transport_id", namespaces=space): t for t in tree.iterfind(".//d:transport_descriptor", space)}
    used = {t.text for t in tree.iterfind(".//d:userTransports/d:transport_id", space)}
    assert set(found) == used
    assert int(found["large_shm"].findtext("d:segment_size", namespaces=space)) >= 32 * 2**20
    assert int(found["large_udp"].findtext("d:receiveBufferSize", namespaces=space)) >= 4 * 2**20
    assert tree.findtext(".//d:useBuiltinTransports", namespaces=space) == "false"


def test_package_xml_and_package_have_one_version():
    assert ElementTree.parse(ROOT / "package.xml").getroot().findtext("version") == diffphys_ros.__version__
