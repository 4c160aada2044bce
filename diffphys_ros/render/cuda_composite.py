# mypy: disable-error-code="operator,valid-type"

"""CUDA kernels: compositing as in composite.py, by warps of 32 threads that each paint a part of a tile, some pixels a thread.

A warp takes 32 Gaussians of its tile's list at a time, one per lane, keeps those that reach its pixels, and then runs over
these alone. No warp waits for another. On the way back a Gaussian's derivatives are added up over the warp's pixels
first; the warps' sums are added either at once, in whatever order they come, or pair by pair of Gaussian and tile, one
warp after another, and then over a Gaussian's pairs in order: the same in every run.
"""

import warp as wp

from .cuda_source import BACKWARD, COMPOSITE, DEEP

wp.set_module_options({"enable_backward": False})

WARP = wp.constant(32)
PARTS = wp.constant(8 // DEEP)  # of a tile: 8 pixels wide, 4 DEEP high
SPLAT = 12  # floats of a projected Gaussian: centre 2, conic 3, reach, depth, opacity, color 3, unused
GRADIENT = 10  # floats: centre 2, conic 3, depth, opacity, color 3
vec10 = wp.types.vector(GRADIENT, float)


@wp.func_native(COMPOSITE)
def composite_part(
    tile: int,
    part: int,
    width: int,
    height: int,
    columns: int,
    rows: int,
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    splats: wp.array(dtype=float),
    background: wp.array(dtype=float),
    image: wp.array(dtype=float),
    alpha: wp.array(dtype=float),
    depth: wp.array(dtype=float),
): ...


@wp.func_native(BACKWARD)
def composite_part_backward(
    tile: int,
    part: int,
    by_pair: int,
    width: int,
    height: int,
    columns: int,
    rows: int,
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    splats: wp.array(dtype=float),
    background: wp.array(dtype=float),
    image: wp.array(dtype=float),
    alpha: wp.array(dtype=float),
    depth: wp.array(dtype=float),
    d_image: wp.array(dtype=float),
    d_alpha: wp.array(dtype=float),
    d_depth: wp.array(dtype=float),
    gradient: wp.array(dtype=float),
): ...


@wp.kernel
def composite_tiles(
    # in:
    tiles: int,
    width: int,
    height: int,
    columns: int,
    rows: int,
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    splats: wp.array(dtype=float),
    background: wp.array(dtype=float),  # shape [0] counts pixels
    # out:
    image: wp.array(dtype=float),
    alpha: wp.array(dtype=float),
    depth: wp.array(dtype=float),
):
    """A warp for every part of every tile."""
    part = wp.tid() / WARP
    if part >= tiles * PARTS:
        return
    composite_part(part / PARTS, part % PARTS, width, height, columns, rows, start, key, splats, background, image, alpha, depth)


@wp.kernel
def composite_tiles_backward(
    # in:
    tiles: int,
    width: int,
    height: int,
    columns: int,
    rows: int,
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    splats: wp.array(dtype=float),
    background: wp.array(dtype=float),
    image: wp.array(dtype=float),
    alpha: wp.array(dtype=float),
    depth: wp.array(dtype=float),
    d_image: wp.array(dtype=float),  # these three may be missing
    d_alpha: wp.array(dtype=float),
    d_depth: wp.array(dtype=float),
    # out: added to
    gradient: wp.array(dtype=float),  # of every projected Gaussian
):
    """A warp for every part of every tile; sums in the order in which warps end."""
    part = wp.tid() / WARP
    if part >= tiles * PARTS:
        return
    composite_part_backward(
        part / PARTS,
        part % PARTS,
        0,
        width,
        height,
        columns,
        rows,
        start,
        key,
        splats,
        background,
        image,
        alpha,
        depth,
        d_image,
        d_alpha,
        d_depth,
        gradient,
    )


@wp.kernel
def composite_pairs_backward(
    # in:
    tiles: int,
    width: int,
    height: int,
    columns: int,
    rows: int,
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    splats: wp.array(dtype=float),
    background: wp.array(dtype=float),
    image: wp.array(dtype=float),
    alpha: wp.array(dtype=float),
    depth: wp.array(dtype=float),
    d_image: wp.array(dtype=float),
    d_alpha: wp.array(dtype=float),
    d_depth: wp.array(dtype=float),
    # out: added to
    gradient: wp.array(dtype=float),  # of every pair of tile and Gaussian
):
    """A warp for every tile, which goes through its parts in order."""
    tile = wp.tid() / WARP
    if tile >= tiles:
        return
    for part in range(PARTS):
        composite_part_backward(
            tile,
            part,
            1,
            width,
            height,
            columns,
            rows,
            start,
            key,
            splats,
            background,
            image,
            alpha,
            depth,
            d_image,
            d_alpha,
            d_depth,
            gradient,
        )


@wp.kernel
def sum_pairs(
    # in:
    gaussians: int,
    columns: int,
    rows: int,
    box: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=int),
    depth: wp.array(dtype=float),
    start: wp.array(dtype=int),
    key: wp.array(dtype=wp.int64),
    pair: wp.array(dtype=vec10),
    # out:
    gradient: wp.array(dtype=vec10),
):
    """Each projected Gaussian looks itself up in the lists of its tiles, row by row."""
    i = wp.tid()
    total = vec10()
    if count[i] > 0:
        entry = (wp.int64(wp.cast(depth[i], int)) << wp.int64(32)) | wp.int64(i)  # type: ignore[arg-type]
        first = (i / gaussians) * rows * columns
        for y in range(box[i][1], box[i][3]):
            for x in range(box[i][0], box[i][2]):
                low = start[first + y * columns + x]
                high = start[first + y * columns + x + 1]
                while high - low > 1:
                    middle = (low + high) / 2
                    if key[middle] <= entry:
                        low = middle
                    else:
                        high = middle
                total += pair[low]
    gradient[i] = total
