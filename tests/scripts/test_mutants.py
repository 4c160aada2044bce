"""Claims about the runner of the mutants, on a toy repository, and about the patches that this one holds."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOY = {
    "diffphys_ros/__init__.py": "def double(x):\n    return 2 * x\n\n\ndef half(x):\n    return x / 2\n",
    "tests/test_double.py": "import diffphys_ros\n\n\ndef test_twice_three_is_six():\n    assert diffphys_ros.double(3) == 6\n",
}
NOTICED, SURVIVES, CRASHES = ("return 2 * x", "return 3 * x"), ("return x / 2", "return x / 3"), ("return 2 * x", "return 2 * y")


@pytest.fixture(scope="module")
def runner() -> ModuleType:
    sys.path.insert(0, str(ROOT / "scripts"))
    import mutants

    yield mutants
    sys.path.remove(str(ROOT / "scripts"))


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A repository of one module and one test."""
    for name, text in TOY.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    (tmp_path / "tests" / "mutants").mkdir()
    return tmp_path


def put(toy: Path, name: str, edit: tuple[str, str]) -> None:
    """A fault of the toy's module."""
    module = "diffphys_ros/__init__.py"
    lines, new = TOY[module].splitlines(), TOY[module].replace(*edit).splitlines()
    at = next(i for i in range(len(lines)) if lines[i] != new[i])
    body = [f" {line}" for line in lines[:at]] + [f"-{lines[at]}", f"+{new[at]}"] + [f" {line}" for line in lines[at + 1 :]]
    count = len(lines)
    head = "# what: a wrong factor\n# noticed by: the product\n# test: tests/test_double.py::test_twice_three_is_six\n"
    diff = [f"--- a/{module}", f"+++ b/{module}", f"@@ -1,{count} +1,{count} @@", *body]
    (toy / "tests" / "mutants" / f"{name}.patch").write_text(head + "\n".join(diff) + "\n")


@pytest.mark.slow
def test_a_fault_that_an_assertion_notices_is_told_with_it_and_the_status_is_0(runner, toy, capsys):
    put(toy, "tripled", NOTICED)
    assert runner.main(["--table", str(toy / "table.md")], toy) == 0
    said = capsys.readouterr().out
    assert "noticed   tripled" in said
    assert "tests/test_double.py::test_twice_three_is_six: assert 9 == 6" in said
    assert "| tripled | a wrong factor | noticed | the product |" in (toy / "table.md").read_text()


@pytest.mark.slow
def test_a_fault_that_no_test_notices_survives_and_the_status_is_1(runner, toy, capsys):
    put(toy, "thirds", SURVIVES)
    assert runner.main([], toy) == 1
    assert "SURVIVED  thirds" in capsys.readouterr().out


@pytest.mark.slow
def test_a_fault_that_stops_the_program_is_not_noticed_but_crashed(runner, toy, capsys):
    put(toy, "unknown_name", CRASHES)
    assert runner.main(["unknown_name"], toy) == 1
    assert "crashed   unknown_name" in capsys.readouterr().out


@pytest.mark.slow
def test_a_patch_that_no_longer_applies_is_an_error_of_status_2_before_any_test(runner, toy, capsys):
    put(toy, "tripled", NOTICED)
    (toy / "diffphys_ros" / "__init__.py").write_text("def double(x):\n    return x + x\n")
    assert runner.main([], toy) == 2
    assert "tripled.patch no longer applies" in capsys.readouterr().err


@pytest.mark.slow
def test_tests_that_fail_without_any_fault_are_an_error_of_status_2(runner, toy, capsys):
    put(toy, "tripled", NOTICED)
    (toy / "tests" / "test_double.py").write_text(TOY["tests/test_double.py"].replace("== 6", "== 7"))
    assert runner.main([], toy) == 2
    assert "without any fault the tests do not pass" in capsys.readouterr().err


@pytest.fixture(scope="module")
def patches(runner):
    if subprocess.run(["git", "-C", ROOT, "ls-files", "--error-unmatch", "setup.py"], capture_output=True).returncode:
        pytest.skip("not a git checkout")
    return runner.mutants(ROOT)


def test_every_patch_applies_to_the_tree(runner, patches, tmp_path):
    folder = runner.copy_tree(ROOT, tmp_path / "tree")
    for mutant in patches:
        runner.apply(mutant, folder)
        subprocess.run(["git", "apply", "--reverse", str(mutant.path)], cwd=folder, check=True, capture_output=True)


def test_every_test_that_a_patch_names_is_there(patches):
    for mutant in patches:
        for test in mutant.tests:
            file, _, name = test.partition("::")
            functions = {node.name for node in ast.walk(ast.parse((ROOT / file).read_text())) if isinstance(node, ast.FunctionDef)}
            assert not name or name.partition("[")[0] in functions, f"{mutant.path.name} names {test}"
