"""Claims about ROS parameters: the same tree, checked in the same way."""

from __future__ import annotations

import pytest
import yaml
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.nodes.parameters import Own, existing
from diffphys_ros.nodes.segment_node import SegmentNode


def test_every_setting_is_a_parameter_with_doc_unit_and_range(make_node):
    node = make_node(SegmentNode)
    for name, leaf in config.leaves().items():
        descriptor = node.describe_parameter(name)
        assert leaf.doc in descriptor.description
        assert leaf.unit in descriptor.description
        assert descriptor.additional_constraints == leaf.range_text
    assert node.parameters.settings() == config.build({})


def test_values_are_taken_as_on_the_command_line(make_node):
    node = make_node(SegmentNode, scene__mass_kg=1, scene__gravity_m_s2="[0.0, 0.0, -9.81]", fit__schedule="joint", scene__at_rest="true")
    assert node.parameters.settings() == config.build(
        {"scene.mass_kg": 1.0, "scene.gravity_m_s2": [0, 0, -9.81], "fit.schedule": "joint", "scene.at_rest": True}
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
        make_node(SegmentNode, **{name: value})


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
    for name, text in (("a", "fit: {iterations: 3, seed: 5}\nscene: {mass_kg: 1, first_mask: m.png}"), ("b", "fit: {iterations: 4}")):
        (tmp_path / f"{name}.yaml").write_text(text)
    node = make_node(SegmentNode, config=f"[{tmp_path}/a.yaml, {tmp_path}/b.yaml]", scene__mass_kg=2.0)
    settings = node.parameters.settings()
    assert (settings.fit.iterations, settings.fit.seed, settings.scene.mass_kg) == (4, 5, 2.0)
    assert settings.scene.first_mask == str(tmp_path / "m.png")


def test_a_change_out_of_range_is_refused_and_nothing_changes(make_node):
    node = make_node(SegmentNode)
    wrong = [Parameter("fit.seed", value=7), Parameter("fit.iterations", value=-1)]
    result = node.set_parameters_atomically(wrong)
    assert not result.successful
    assert "fit.iterations" in result.reason
    assert node.parameters.settings() == config.build({})
    assert node.set_parameters_atomically([Parameter("fit.seed", value=7)]).successful
    assert node.parameters.settings().fit.seed == 7


def test_what_cannot_change_while_running_is_read_only(make_node):
    node = make_node(SegmentNode)
    assert not node.set_parameters([Parameter("config", value="x.yaml")])[0].successful
