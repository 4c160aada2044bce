# mypy: disable-error-code="operator,valid-type"
# ruff: noqa: UP018, RUF046 (Warp needs the call to tell a variable from a constant)

"""Which Gaussians touch which tile of which frame, nearest first."""

from dataclasses import dataclass

import warp as wp

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class Tiles:
    """Pairs of tile and Gaussian, sorted by tile and then by depth."""

    start: wp.array  # first pair of every tile of every frame, and the end, int, shape (frames * rows * columns + 1,)
    owner: wp.array  # index (frame * gaussians + gaussian) of every pair, int


@wp.kernel
def list_pairs(
    # in:
    gaussians: int,
    columns: int,
    rows: int,
    box: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=int),
    end: wp.array(dtype=int),  # inclusive sum of count
    depth: wp.array(dtype=float),
    # out:
    key: wp.array(dtype=wp.int64),
    owner: wp.array(dtype=int),
):
    i = wp.tid()
    if count[i] == 0:
        return
    # the bits of positive floats sort as the floats do
    low = wp.int64(wp.cast(depth[i], int))
    first = (i / gaussians) * rows * columns
    k = end[i] - count[i]
    for y in range(box[i][1], box[i][3]):
        for x in range(box[i][0], box[i][2]):
            key[k] = (wp.int64(first + y * columns + x) << wp.int64(32)) | low
            owner[k] = i
            k += 1


@wp.kernel
def find_starts(
    # in:
    key: wp.array(dtype=wp.int64),
    pairs: int,
    tiles: int,
    # out:
    start: wp.array(dtype=int),
):
    k = wp.tid()
    before, here = int(-1), tiles
    if k > 0:
        before = int(key[k - 1] >> wp.int64(32))
    if k < pairs:
        here = int(key[k] >> wp.int64(32))
    for t in range(before + 1, here + 1):
        start[t] = k


def sort_into_tiles(box: wp.array, count: wp.array, depth: wp.array, *, gaussians: int, columns: int, rows: int) -> Tiles:
    """Tiles of the projected Gaussians (frames * gaussians,). Ties in depth keep the order of the Gaussians."""
    device, tiles = count.device, count.shape[0] // gaussians * rows * columns
    end = wp.empty_like(count)
    wp.utils.array_scan(count, end, inclusive=True)
    pairs = int(end[-1:].numpy()[0])
    key = wp.empty(max(2 * pairs, 1), dtype=wp.int64, device=device)  # the sort needs the second half
    owner = wp.empty(max(2 * pairs, 1), dtype=int, device=device)
    start = wp.empty(tiles + 1, dtype=int, device=device)
    wp.launch(list_pairs, count.shape[0], [gaussians, columns, rows, box, count, end, depth], [key, owner], device=device)
    if pairs:
        wp.utils.radix_sort_pairs(key, owner, pairs)
    wp.launch(find_starts, pairs + 1, [key, pairs, tiles], [start], device=device)
    return Tiles(start, owner)
