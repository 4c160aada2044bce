"""Hostile input for every door, by seeds. One module a door, each with

    COUNT = 20_000                              # cases of a full run
    def case(seed: int, folder: Path) -> str    # one case from its seed alone: "taken" or "refused"; what it raises is a fault

`folder` is empty and the only place where a case may make files. Run by scripts/fuzz.py, a slice of it by test_slice.py. Seeds that
ever failed stand in kept/<door>.txt, one a line with a comment, and run first.
"""
