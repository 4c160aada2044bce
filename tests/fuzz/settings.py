"""Settings: YAML files, flags and the tree itself."""

from __future__ import annotations

import string
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from diffphys_ros import config
from diffphys_ros.__main__ import _parse
from diffphys_ros.errors import InputError
from tests.fuzz._spoil import checked_sentence, spoiled_bytes, words_of

COUNT = 15_000

NUMBERS = ("0", "1", "-1", "2.5", "1e-3", "1e-06", "2e6", "1e+07", "1e308", "1e309", "-1e309", "5e-324", ".inf", "-.INF", ".nan", "nan", "inf", "1:30", "010", "0x1F", "0o7", "0b1", "1_000", "1,5", "+3", "5.", ".5", "1" * 30, "1" * 400, "9" * 5000, "-0", "0.49", "0.3", "1000", "3", "12", "100")  # fmt: skip
WORDS = ("", "~", "null", "yes", "no", "true", "false", "on", "2020-01-02", "2020-13-45", "auto", "motion", "joint", "none", "cpu", "cuda:0", "cuda:99", "gpu", "rubber", "mask.png", "~/m.png", "~nobody/x", "../../m", "/dev/zero", "a\0b", "a\nb", "\ud800", "é" * 9, "\u202e", "\x1b[31m", "<<", "*a", "&a 1", "!!int foo", "!!timestamp x", "!!python/object/apply:os.system [ls]", "!x y", "%YAML", "- 1", "? x", "[", "]", "{", "}", "'", '"', '"\\ud800"', '"\\U00ffffff"', "#", "|", ">", "@", "`", "x" * 600, "x" * 5000, "[" * 2000, "{a: " * 500, "- " * 500)  # fmt: skip


@lru_cache(1)
def names() -> tuple[str, ...]:
    return tuple(config.leaves())


@lru_cache(1)
def shipped() -> bytes:
    """Every default, as the package ships it."""
    return (Path(__file__).resolve().parents[2] / "config" / "defaults.yaml").read_bytes()


def case(seed: int, folder: Path) -> str:
    rng = np.random.default_rng(seed)
    try:
        settings = (by_file, by_file, by_words, by_flags, by_command, by_values)[rng.integers(6)](rng, folder)
    except InputError as error:
        return checked_sentence(error)
    check(settings)
    return "taken"


def check(settings: config.Settings) -> None:
    """What was taken is inside its bounds and stays itself when it goes round."""
    values = config.flat(settings)
    assert config.build(values) == settings
    for name, leaf in config.leaves().items():
        items = values[name] if leaf.is_list else [values[name]]
        assert items is None or leaf.length is None or len(items) == leaf.length
        for item in items or ():
            assert (item is None and leaf.optional) or isinstance(item, leaf.kind), name
            if leaf.kind in (int, float) and item is not None:
                assert abs(item) < 1e309, name
                assert leaf.low is None or item >= leaf.low, name
                assert leaf.high is None or item <= leaf.high, name
            assert not isinstance(item, str) or not set(item) & {"\0", "\n", "\ud800"}, name


def by_file(rng: np.random.Generator, folder: Path) -> config.Settings:
    """A spoiled copy of the shipped file, or a made-up one, or several."""
    paths = [folder / f"{k}.yaml" for k in range(rng.integers(1, 3))]
    for path in paths:
        path.write_bytes(spoiled_bytes(rng, shipped() if rng.random() < 0.3 else made_up(rng).encode("utf-8", "surrogatepass")))
    for path in paths:
        config.read_yaml(path)
    return config.layered(paths)


def made_up(rng: np.random.Generator) -> str:
    """Groups of settings with values of any kind; some stand twice, some are nested, anchored or merged."""
    lines = ["<<: *a"] if rng.random() < 0.02 else []
    for name in rng.choice(names(), rng.integers(1, 6)):
        group, key = name.split(".")
        key = key if rng.random() < 0.95 else text(rng)
        value = value_text(rng, name)
        form = rng.integers(6)
        lines.append((f"{group}: {{{key}: {value}}}", f"{group}:\n  {key}: {value}", f"{name}: {value}", f'"{group}": {{"{key}": {value}}}', f"{group}: {value}", f"{group}:\n- {key}: {value}")[form if rng.random() < 0.3 else form % 3])
    return "\n".join(lines) + "\n"


def value_text(rng: np.random.Generator, name: str) -> str:
    """A value that may fit, and often does not."""
    leaf = config.leaves()[name]
    if rng.random() < 0.6:
        return fitting(rng, leaf)
    one = rng.choice(NUMBERS) if rng.random() < 0.6 else text(rng)
    return one if rng.random() < 0.7 else f"[{', '.join([str(one)] * rng.integers(0, 8))}]"


def fitting(rng: np.random.Generator, leaf: config.Leaf) -> str:
    """What the setting takes."""
    if leaf.choices:
        return str(rng.choice(leaf.choices))
    if leaf.kind is bool:
        return str(rng.choice(["true", "false"]))
    if leaf.kind is str:
        return "auto" if leaf.pattern else "rubber"
    low, high = (-10.0 if leaf.low is None else leaf.low), (10.0 if leaf.high is None else leaf.high)
    one = f"{low + (high - low) * rng.random():.6g}" if leaf.kind is float else str(int(rng.integers(int(low), int(high), endpoint=True)))
    return f"[{', '.join([one] * (leaf.length or 1))}]" if leaf.is_list else one


def text(rng: np.random.Generator) -> str:
    return str(rng.choice(WORDS)) if rng.random() < 0.8 else "".join(rng.choice(list(string.printable), rng.integers(1, 30)))


def by_words(rng: np.random.Generator, folder: Path) -> config.Settings:
    """One word of a command line for one setting."""
    leaf = config.leaves()[rng.choice(names())]
    return config.build({leaf.name: config.parse_text(leaf, value_text(rng, leaf.name))}, "command line")


def flags(rng: np.random.Generator) -> list[str]:
    found = []
    for name in rng.choice(names(), rng.integers(1, 5)):
        given = name if rng.random() < 0.95 else name[: rng.integers(len(name))] + text(rng)
        value = value_text(rng, name).strip("[]")
        found += [f"--{given}={value}"] if rng.random() < 0.5 else [f"--{given}", value] if rng.random() < 0.95 else [f"--{given}"]
    return found if rng.random() < 0.95 else [*found, text(rng)]


def by_flags(rng: np.random.Generator, folder: Path) -> config.Settings:
    return config.layered(flags=config.flags_of(flags(rng)))


def by_command(rng: np.random.Generator, folder: Path) -> config.Settings:
    """A whole command line of `recover`, its own words in any place; words that argparse refuses by its usage are left out."""
    words = [["clip.mcap"], ["--out", "there"], *([flag] for flag in flags(rng) if flag.startswith("--") and "=" in flag)]
    words += [[["--resume"], ["--out", "elsewhere"], ["--conf", "x"], ["--config", str(folder / "no.yaml")]][rng.integers(4)]] if rng.random() < 0.3 else []
    options = _parse(["recover", *(word for k in rng.permutation(len(words)) for word in words[k])])
    return config.layered(options.config, options.flags)


def by_values(rng: np.random.Generator, folder: Path) -> config.Settings:
    """Python values, as parameters of a node and stored settings are."""
    values: dict[str, Any] = {}
    for name in rng.choice(names(), rng.integers(1, 4)):
        values[name if rng.random() < 0.95 else text(rng)] = words_of(rng) if rng.random() < 0.7 else config.parse_text(config.leaves()[name], fitting(rng, config.leaves()[name]))
    return config.build(values, "parameters")
