"""Claims about ROS parameters: the same tree, checked in the same way."""

from __future__ import annotations

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.parameters import Own, existing
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode

NODES = {cls.__name__: cls for cls in (IngestNode, SegmentNode, SplatNode, FitNode)}


@pytest.mark.parametrize(("cls", "count"), [("IngestNode", 13), ("SegmentNode", 22), ("SplatNode", 19), ("FitNode", 51)])
def test_a_node_has_the_settings_that_it_reads_as_parameters_with_doc_unit_and_range(make_node, cls, count):
    node = make_node(NODES[cls])
    declared = [name for name in config.leaves() if node.has_parameter(name)]
    assert declared == config.read_by(node.get_name())
    assert len(declared) == count
    for name in declared:
        leaf, descriptor = config.leaves()[name], node.describe_parameter(name)
        assert leaf.doc in descriptor.description
        assert leaf.unit in descriptor.description
        assert descriptor.additional_constraints == leaf.range_text
    assert node.parameters.settings() == config.build({})


@pytest.mark.parametrize(
    ("cls", "name", "words"),
    [
        ("SegmentNode", "fit__law", r"fit\.law is not read here but by .*fit_node; give it there, or in a YAML file"),
        ("IngestNode", "scene__mass_kg", r"scene\.mass_kg is not read here but by .*segment_node"),
        ("FitNode", "capture__every", r"capture\.every is not read here but by diffphys capture;"),
        ("FitNode", "experiment__seed", r"experiment\.seed is not read here but by .* or in a YAML file"),
        ("FitNode", "fit__seed", r"fit\.seed is called experiment\.seed since version 0\.2; rename it"),
        ("SegmentNode", "prior__source", r"prior\.source is gone since version 0\.2; the source follows"),
    ],
)
def test_a_parameter_that_is_none_of_the_nodes_is_refused_by_name(make_node, cls, name, words):
    with pytest.raises(InputError, match=words):
        make_node(NODES[cls], **{name: 1})


def test_a_file_of_settings_serves_every_node(make_node, tmp_path):
    path = tmp_path / "all.yaml"
    path.write_text("scene: {mass_kg: 2}\nexperiment: {seed: 3}\nplayback: {rate: 0.5}\ncapture: {every: 2}\nfit: {law: fixed_corotated}\n")
    wanted = config.layered([path])
    for cls in NODES.values():
        node = make_node(cls, config=path)
        assert node.parameters.settings() == wanted
        rclpy.try_shutdown()
    path.write_text("fit: {iterations: -1}")
    with pytest.raises(InputError, match=r"fit\.iterations is -1"):
        make_node(SegmentNode, config=path)


def test_values_are_taken_as_on_the_command_line(make_node):
    node = make_node(FitNode, scene__mass_kg=1, scene__gravity_m_s2="[0.0, 0.0, -9.81]", fit__force_field="modes", scene__at_rest="true")
    assert node.parameters.settings() == config.build(
        {"scene.mass_kg": 1.0, "scene.gravity_m_s2": [0, 0, -9.81], "fit.force_field": "modes", "scene.at_rest": True}
    )


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("fit__iteratoins", 3, "did you mean 'fit.iterations'"),
        ("fit__iterations", -3, "must be in 0"),
        ("scene__mass_kg", "heavy", "must be a number in kg"),
        ("scene__gravity_m_s2", "[0.0, 1.0]", "needs 3"),
        ("config", "/nowhere.yaml", "/nowhere.yaml"),
        ("config", "3", "config holds 3, must be a path or a list of paths"),
        ("fit__device", "gpu", "must be auto, cpu or cuda:0"),
        ("topics__image", '"a' + "x" * 5000 + '"', "must be text of at most 512 characters"),
        ("scene__mass_kg", "1e-3x", "must be a number in kg, written like"),
    ],
)
def test_bad_parameters_end_the_node_with_a_sentence(make_node, name, value, words):
    with pytest.raises(InputError, match=words):
        make_node(FitNode, **{name: value})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("max_frames", ".nan", "must be a number"),
        ("silence_s", "soon", "must be a number"),
        ("bag", "3", "bag is 3, must be text"),
        ("bag", "x" * 5000, "there is no such file or folder"),
        ("reliability", "perfect", "must be one of"),
    ],
)
def test_a_nodes_own_parameters_are_checked_too(make_node, name, value, words):
    node = make_node(SegmentNode)
    default = {"max_frames": 1200, "silence_s": 2.0, "bag": "", "reliability": "best_effort"}[name]
    own = Own(name, default, "as of ingest_node", ("best_effort", "reliable") if name == "reliability" else ())
    node.parameters._own[name] = own
    node.declare_parameter(name, yaml.safe_load(str(value)), ParameterDescriptor(dynamic_typing=True))
    with pytest.raises(InputError, match=words) as caught:
        existing(node.parameters[name])
    assert len(str(caught.value)) < 400


def test_parameters_win_over_files_and_later_files_over_earlier(make_node, tmp_path):
    for name, text in (("a", "fit: {iterations: 3}\nexperiment: {seed: 5}\nscene: {mass_kg: 1, first_mask: m.png}"), ("b", "fit: {iterations: 4}")):
        (tmp_path / f"{name}.yaml").write_text(text)
    node = make_node(SegmentNode, config=f"[{tmp_path}/a.yaml, {tmp_path}/b.yaml]", scene__mass_kg=2.0)
    settings = node.parameters.settings()
    assert (settings.fit.iterations, settings.experiment.seed, settings.scene.mass_kg) == (4, 5, 2.0)
    assert settings.scene.first_mask == str(tmp_path / "m.png")


def test_a_change_out_of_range_is_refused_and_nothing_changes(make_node):
    node = make_node(FitNode)
    wrong = [Parameter("playback.rate", value=7.0), Parameter("fit.iterations", value=-1)]
    result = node.set_parameters_atomically(wrong)
    assert not result.successful
    assert "fit.iterations" in result.reason
    assert node.parameters.settings() == config.build({})
    assert node.set_parameters_atomically([Parameter("playback.rate", value=7.0)]).successful
    assert node.parameters.settings().playback.rate == 7


def test_what_cannot_change_while_running_is_read_only(make_node):
    node = make_node(SegmentNode)
    assert not node.set_parameters([Parameter("config", value="x.yaml")])[0].successful
