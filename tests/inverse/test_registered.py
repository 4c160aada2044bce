"""A law and a schedule are an entry of a dict: settings, tables and refusals ask the dict."""

import pytest

from diffphys_ros import __main__ as command
from diffphys_ros.config import build, leaves
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.prepare import prepare
from diffphys_ros.inverse.registered import REGISTERED, registered
from diffphys_ros.inverse.stages import SCHEDULES
from diffphys_ros.simulate.laws import LAWS
from diffphys_ros.simulate.laws.neo_hookean import LAW


@pytest.mark.parametrize("name", REGISTERED)
def test_a_setting_that_asks_a_dict_is_one_and_its_default_is_an_entry(name):
    assert leaves()[name].default in registered(name).split(", ")
    assert not leaves()[name].choices


def test_a_new_law_and_a_new_schedule_are_known_by_one_line_each(monkeypatch, capsys, made_clip):
    monkeypatch.setitem(LAWS, "made_up", LAW)
    monkeypatch.setitem(SCHEDULES, "at_once", SCHEDULES["linear"])
    assert command.main(["settings"]) == 0
    listed = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line and line[0] != "#"}
    assert "made_up" in listed["fit.law"]
    assert "at_once" in listed["experiment.schedule"]
    next(prepare(made_clip, build({"fit.law": "made_up", "experiment.schedule": "at_once"})))


def test_a_misspelt_schedule_is_answered_with_the_known_ones_before_the_work_begins(made_clip):
    with pytest.raises(InputError, match=r"experiment.schedule: 'liner' is unknown; choose one of auto, modes, joint, linear, paper"):
        next(prepare(made_clip, build({"experiment.schedule": "liner"})))
