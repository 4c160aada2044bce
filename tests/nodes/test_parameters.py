"""Claims about ROS parameters: the same tree, checked in the same way."""

from __future__ import annotations

import pytest
import rclpy
import yaml
from rclpy.parameter import Parameter

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode

NODES = {cls.__name__: cls for cls in (IngestNode, SegmentNode, SplatNode, FitNode)}


@pytest.mark.parametrize(("cls", "count"), [("IngestNode", 14), ("SegmentNode", 29), ("SplatNode", 22), ("FitNode", 53)])
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
        ("config", "3", "config is 3, must be a path or a list of paths"),
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
        ("max_frames", ".nan", r"max_frames is nan, must be a number in 2 \.\. 10000"),
        ("max_frames", "-1", r"must be in 2 \.\. 10000"),
        ("max_frames", "2.5", "must be a whole number"),
        ("silence_s", "soon", r"must be a number in 0 \.\. 3600"),
        ("silence_s", "-3.0", r"must be in 0 \.\. 3600"),
        ("max_mib", "0", "must be in 1"),
        ("bag", "3", "bag is 3, must be text"),
        ("bag", "x" * 5000, "there is no such file or folder"),
        ("reliability", "perfect", "must be one of"),
        ("autostart", "3", "must be true or false"),
    ],
)
def test_a_nodes_own_parameters_are_checked_too(make_node, name, value, words):
    with pytest.raises(InputError, match=words) as caught:
        make_node(IngestNode, **{name: value})
    assert len(str(caught.value)) < 400


def test_a_nodes_own_numbers_have_ranges(make_node):
    described = make_node(IngestNode).describe_parameters(["silence_s", "max_frames", "max_mib"])
    assert [d.additional_constraints for d in described] == ["0 .. 3600", "2 .. 10000", "1 .. 1.04858e+06"]
    assert (described[0].floating_point_range[0].to_value, described[1].integer_range[0].from_value) == (3600.0, 2)


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
    for name, value in (("max_mib", 3), ("autostart", False), ("wait_for", "click")):
        assert not node.set_parameters([Parameter(name, value=value)])[0].successful


def dumped(node) -> str:
    """What `ros2 param dump` writes: groups by the dots, a value that is not set as null."""
    tree: dict = {}
    for name in node.list_parameters([], 0).names:
        value, here = node.get_parameter(name).value, tree
        *groups, last = name.split(".")
        for group in groups:
            here = here.setdefault(group, {})
        here[last] = list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value
    return yaml.dump({"/fit_node": {"ros__parameters": tree}})


def test_a_dump_of_the_parameters_can_be_given_back(make_node, domain, tmp_path):
    node = make_node(FitNode, scene__mass_kg=0.8, scene__gravity_m_s2="[0.0, 0.0, -9.81]")
    wanted = node.parameters.settings()
    (tmp_path / "dump.yaml").write_text(dumped(node).replace("bag: ''", "bag: null"))
    assert "floor_z_m: null" in dumped(node)
    rclpy.try_shutdown()
    rclpy.init(args=["--ros-args", "--params-file", str(tmp_path / "dump.yaml")], domain_id=domain)
    again = FitNode()
    try:
        assert again.parameters.settings() == wanted
        assert again.get_parameter("scene.floor_z_m").value is None
        assert dumped(again) == dumped(node)
    finally:
        again.close()
        again.destroy_node()


@pytest.mark.parametrize("unset", [Parameter("scene.mass_kg", value="null"), Parameter("scene.mass_kg", value="None"), Parameter("scene.mass_kg")])
def test_an_optional_value_can_be_unset_and_set_again(make_node, unset):
    node = make_node(FitNode, scene__mass_kg=0.8)
    for _ in range(2):
        assert node.set_parameters_atomically([unset]).successful
        assert node.parameters.settings().scene.mass_kg is None
        assert node.get_parameter("scene.mass_kg").value is None
        assert "mass of the object" in node.describe_parameter("scene.mass_kg").description
        assert not node.set_parameters_atomically([Parameter("scene.mass_kg", value=-1.0)]).successful
        assert node.set_parameters_atomically([Parameter("scene.mass_kg", value=2.0)]).successful
        assert node.parameters.settings().scene.mass_kg == 2.0


def test_a_dump_that_is_loaded_into_the_running_node_sets_no_text_where_nothing_was_set(make_node):
    node = make_node(FitNode)
    before = node.parameters.settings()
    unset = [name for name in config.read_by("fit_node") if node.get_parameter_or(name).value is None]
    assert "scene.target_frame" in unset  # any text would do
    assert node.set_parameters_atomically([Parameter(name, value="None") for name in unset]).successful  # as `ros2 param load` says null
    assert node.parameters.settings() == before


@pytest.mark.parametrize("name", ["fit.iterations", "bag", "use_sim_time"])
def test_a_value_that_is_needed_cannot_be_unset(make_node, name):
    node = make_node(FitNode)
    before = node.get_parameter(name).value
    result = node.set_parameters_atomically([Parameter(name)])
    assert not result.successful
    assert node.get_parameter(name).value == before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fit__law": "bogus"}, "fit.law: 'bogus' is unknown; choose one of neo_hookean"),
        ({"fit__device": "cuda:99"}, "fit.device is 'cuda:99', but"),
        ({"scene__mass_kg": 1.0, "scene__density_kg_m3": "[1000.0]"}, "scene.mass_kg and scene.density_kg_m3 are both given"),
    ],
)
def test_what_cannot_be_fitted_is_refused_at_the_start_and_when_it_is_set(make_node, given, words):
    node = make_node(FitNode)
    changes = [Parameter(name.replace("__", "."), value=yaml.safe_load(value) if isinstance(value, str) else value) for name, value in given.items()]
    result = node.set_parameters_atomically(changes)
    assert not result.successful
    assert words in result.reason
    rclpy.try_shutdown()
    with pytest.raises(InputError) as caught:
        make_node(FitNode, **given)
    assert words in str(caught.value)


def test_a_mass_beside_densities_of_several_parts_is_taken(make_node):
    """Their ratio is what they tell."""
    settings = make_node(FitNode, scene__mass_kg=1.0, scene__density_kg_m3="[1000.0, 2000.0]").parameters.settings()
    assert settings.scene.density_kg_m3 == [1000.0, 2000.0]


def test_a_file_of_settings_given_to_a_running_node_sets_what_it_names(make_node, tmp_path):
    (tmp_path / "given.yaml").write_text("scene: {mass_kg: 2}\nexperiment: {seed: 3}\n")
    (tmp_path / "bad.yaml").write_text("scene: {mass_kg: -2}\n")
    node = make_node(FitNode, scene__thickness_m=0.1)
    assert node.set_parameters_atomically([Parameter("config", value=str(tmp_path / "given.yaml"))]).successful
    settings = node.parameters.settings()
    assert (settings.scene.mass_kg, settings.experiment.seed, settings.scene.thickness_m) == (2.0, 3, 0.1)
    assert node.get_parameter("scene.mass_kg").value == 2
    for wrong, words in (("bad.yaml", "scene.mass_kg is -2"), ("none.yaml", "none.yaml")):
        result = node.set_parameters_atomically([Parameter("config", value=str(tmp_path / wrong))])
        assert not result.successful
        assert words in result.reason
    assert node.parameters.settings() == settings
    assert node.parameters.paths("config") == [str(tmp_path / "given.yaml")]


def test_the_answer_to_a_change_says_from_when_on_it_holds(make_node):
    node = make_node(FitNode)
    assert node.set_parameters_atomically([Parameter("scene.mass_kg", value=2.0)]).reason == "scene.mass_kg: holds for the next job"
    assert node.set_parameters_atomically([Parameter("scene.mass_kg", value=2.0)]).reason == ""  # it was that before
    assert node.set_parameters_atomically([Parameter("playback.rate", value=2.0)]).reason == ""  # at once
