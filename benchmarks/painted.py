"""Clips of a plain object: a bundled sample with parts of one colour each, drawn over its room where its truth has them.

    python benchmarks/painted.py OUT [--sample bags/sample] [--depth]

OUT gets clip.mcap, given.yaml and mask0.png; depth is told where --depth is given.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from diffphys_ros import config  # noqa: E402
from diffphys_ros.bags.read import read_clip  # noqa: E402
from diffphys_ros.bags.write import write_recording  # noqa: E402
from tests.gates.clips import painted  # noqa: E402
from tools.sample_maker.messages import clip_messages  # noqa: E402


def main() -> int:
    """Writes the folder; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sample", type=Path, default=ROOT / "bags" / "sample", help="folder with clip.mcap, given.yaml, mask0.png and truth.npz")
    parser.add_argument("--depth", action="store_true", help="tell the depth images")
    options = parser.parse_args()
    given = options.sample / "given.yaml"
    clip = read_clip(options.sample / "clip.mcap", config.layered([given]))
    options.out.mkdir(parents=True, exist_ok=True)
    write_recording(options.out / "clip.mcap", clip_messages(clip.camera, painted(clip, options.sample / "truth.npz"), clip.depth))
    shutil.copy(options.sample / "mask0.png", options.out)
    (options.out / "given.yaml").write_text(given.read_text().rstrip() + ("\n" if options.depth else "\ntopics:\n  depth: none\n"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
