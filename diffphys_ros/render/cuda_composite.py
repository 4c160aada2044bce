# mypy: ignore-errors

"""CUDA kernels: compositing as in composite.py, by warps of 32 threads that each paint a part of 8 x 4 pixels of a tile.

A warp takes 32 Gaussians of its tile's list at a time, one per lane, keeps those that reach its pixels, and then runs over
these alone. No warp waits for another. On the way back a Gaussian's derivatives are added up over the warp's pixels
first; the warps' sums are added either at once, in whatever order they come, or pair by pair of Gaussian and tile, one
warp after another, and then over a Gaussian's pairs in order: the same in every run.
"""

import warp as wp

from .composite import ALPHA_MAX, STOP, TINY

wp.set_module_options({"enable_backward": False})

PARTS = wp.constant(8)  # of a tile
SPLAT = 12  # floats of a projected Gaussian: centre 2, conic 3, reach, depth, opacity, color 3, unused
GRADIENT = 10  # floats: centre 2, conic 3, depth, opacity, color 3
vec10 = wp.types.vector(GRADIENT, float)

PIXEL = """
    __shared__ float4 staged[8][32][3];
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const float left = tile % columns * 16 + part % 2 * 8, top = tile / columns % rows * 16 + part / 2 * 4;
    const float x = left + lane % 8, y = top + lane / 8;
    const bool inside = x < width && y < height;
    const size_t pixel = inside ? ((size_t)(tile / (columns * rows)) * height + (int)y) * width + (int)x : 0;
    const float* behind = background.data + 3 * (pixel % background.shape[0]);
    const int end = start.data[tile + 1];
"""

# The smallest distance to a rectangle is 0 or lies on one of the two sides that face the centre. A little is allowed for
# rounding: each pixel is asked again.
STAGE = """
        bool reaches = false;
        float4 p, q, c;
        if (first + lane < end) {
            const int i = (int)(key.data[first + lane] & 0xffffffff);
            const float4* splat = (const float4*)splats.data + 3 * (size_t)i;
            p = splat[0], q = splat[1], c = splat[2];
            const float x0 = left - p.x, x1 = left + 7.0f - p.x, y0 = top - p.y, y1 = top + 3.0f - p.y;
            const float near_x = fminf(fmaxf(0.0f, x0), x1), near_y = fminf(fmaxf(0.0f, y0), y1);
            const float along_y = fminf(fmaxf(-p.w * near_x / q.x, y0), y1), along_x = fminf(fmaxf(-p.w * near_y / p.z, x0), x1);
            const float on_x = p.z * near_x * near_x + 2.0f * p.w * near_x * along_y + q.x * along_y * along_y;
            const float on_y = p.z * along_x * along_x + 2.0f * p.w * along_x * near_y + q.x * near_y * near_y;
            reaches = fminf(on_x, on_y) <= 1.001f * q.y + 0.01f;
            c.w = __int_as_float(NAME);
        }
        const unsigned those = __ballot_sync(all, reaches);
        __syncwarp(all);
        if (reaches) {
            const int slot = __popc(those & ((1u << lane) - 1u));
            staged[warp][slot][0] = p;
            staged[warp][slot][1] = q;
            staged[warp][slot][2] = c;
        }
        __syncwarp(all);
        const int count = __popc(those);
"""

COMPOSITE = (
    PIXEL
    + """
    float passed = 1.0f, red = 0.0f, green = 0.0f, blue = 0.0f, z = 0.0f;
    bool done = !inside;
    for (int first = start.data[tile]; first < end; first += 32) {
        if (__all_sync(all, done))
            break;
"""
    + STAGE.replace("NAME", "i")
    + """
        for (int k = 0; k < count; ++k) {
            const float4 p = staged[warp][k][0], q = staged[warp][k][1], c = staged[warp][k][2];
            const float dx = x - p.x, dy = y - p.y;
            const float d2 = p.z * dx * dx + 2.0f * p.w * dx * dy + q.x * dy * dy;
            if (!done && d2 <= q.y) {
                const float a = fminf(q.w * __expf(-0.5f * d2), ALPHA_MAX);
                const float next = passed * (1.0f - a), weight = passed * a;
                done = next <= STOP;
                if (!done) {
                    red += weight * c.x;
                    green += weight * c.y;
                    blue += weight * c.z;
                    z += weight * q.z;
                    passed = next;
                }
            }
        }
    }
    if (inside) {
        image.data[3 * pixel] = red + passed * behind[0];
        image.data[3 * pixel + 1] = green + passed * behind[1];
        image.data[3 * pixel + 2] = blue + passed * behind[2];
        alpha.data[pixel] = 1.0f - passed;
        depth.data[pixel] = z / fmaxf(1.0f - passed, TINY);
    }
"""
)

# Ten sums over 32 lanes in twelve exchanges: at each of the first four, a lane keeps half of its sums and gives the rest away.
REDUCE = """
            #pragma unroll
            for (int s = 0; s < 5; ++s)
                v[s] = (lane & 16 ? v[s + 5] : v[s]) + __shfl_xor_sync(all, lane & 16 ? v[s] : v[s + 5], 16);
            v[5] = 0.0f;
            #pragma unroll
            for (int s = 0; s < 3; ++s)
                v[s] = (lane & 8 ? v[s + 3] : v[s]) + __shfl_xor_sync(all, lane & 8 ? v[s] : v[s + 3], 8);
            v[3] = 0.0f;
            #pragma unroll
            for (int s = 0; s < 2; ++s)
                v[s] = (lane & 4 ? v[s + 2] : v[s]) + __shfl_xor_sync(all, lane & 4 ? v[s] : v[s + 2], 4);
            float sum = (lane & 2 ? v[1] : v[0]) + __shfl_xor_sync(all, lane & 2 ? v[0] : v[1], 2);
            sum += __shfl_xor_sync(all, sum, 1);
"""

BACKWARD = (
    PIXEL
    + """
    // which of the ten sums this lane ends up with
    const int of_five = (lane & 8 ? 3 : 0) + (lane & 4 ? 2 : 0) + (lane & 2 ? 1 : 0);
    const bool has_sum = !(lane & 1) && (lane & 8 ? !(lane & 4) : (lane & 6) != 6);
    const int which = (lane & 16 ? 5 : 0) + of_five;
    float cr = 0.0f, cg = 0.0f, cb = 0.0f, ca = 0.0f, cz = 0.0f, passed = 1.0f, later = 0.0f;
    const float covered = inside ? alpha.data[pixel] : 0.0f;
    if (covered > 0.0f) {
        if (d_image.data) {
            cr = d_image.data[3 * pixel];
            cg = d_image.data[3 * pixel + 1];
            cb = d_image.data[3 * pixel + 2];
        }
        ca = d_alpha.data ? d_alpha.data[pixel] : 0.0f;
        cz = d_depth.data ? d_depth.data[pixel] / covered : 0.0f;
    }
    bool done = cr == 0.0f && cg == 0.0f && cb == 0.0f && ca == 0.0f && cz == 0.0f;
    if (!done) {
        later = cr * (image.data[3 * pixel] - behind[0]) + cg * (image.data[3 * pixel + 1] - behind[1])
            + cb * (image.data[3 * pixel + 2] - behind[2]) + ca * covered;
        ca -= cr * behind[0] + cg * behind[1] + cb * behind[2] + cz * depth.data[pixel];
    }
    for (int first = start.data[tile]; first < end; first += 32) {
        if (__all_sync(all, done))
            break;
"""
    + STAGE.replace("NAME", "by_pair ? first + lane : i")
    + """
        for (int k = 0; k < count; ++k) {
            const float4 p = staged[warp][k][0], q = staged[warp][k][1], c = staged[warp][k][2];
            const float dx = x - p.x, dy = y - p.y;
            const float d2 = p.z * dx * dx + 2.0f * p.w * dx * dy + q.x * dy * dy;
            const float falloff = __expf(-0.5f * d2), free = q.w * falloff, a = fminf(free, ALPHA_MAX);
            bool counts = !done && d2 <= q.y;
            if (counts && passed * (1.0f - a) <= STOP) {
                done = true;
                counts = false;
            }
            if (!__any_sync(all, counts))
                continue;
            float v[10] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
            if (counts) {
                const float phi = cr * c.x + cg * c.y + cb * c.z + ca + cz * q.z, weight = passed * a;
                later -= weight * phi;
                v[5] = weight * cz;
                v[7] = weight * cr;
                v[8] = weight * cg;
                v[9] = weight * cb;
                if (free < ALPHA_MAX) {
                    const float d_a = passed * phi - later / (1.0f - a), d_d2 = -0.5f * d_a * a;
                    v[0] = -2.0f * d_d2 * (p.z * dx + p.w * dy);
                    v[1] = -2.0f * d_d2 * (p.w * dx + q.x * dy);
                    v[2] = d_d2 * dx * dx;
                    v[3] = 2.0f * d_d2 * dx * dy;
                    v[4] = d_d2 * dy * dy;
                    v[6] = d_a * falloff;
                }
                passed *= 1.0f - a;
            }
"""
    + REDUCE
    + """
            if (has_sum) {
                float* to = gradient.data + 10 * (size_t)__float_as_int(c.w) + which;
                if (by_pair)
                    *to += sum;
                else
                    atomicAdd(to, sum);
            }
        }
    }
"""
)


def _limited(snippet: str) -> str:
    for name, value in {"ALPHA_MAX": ALPHA_MAX, "STOP": STOP, "TINY": TINY}.items():
        snippet = snippet.replace(name, f"{value!r}f")
    return snippet


@wp.func_native(_limited(COMPOSITE))
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


@wp.func_native(_limited(BACKWARD))
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
    part = wp.tid() / 32
    composite_part(
        part / PARTS, part % PARTS, width, height, columns, rows, start, key, splats, background, image, alpha, depth
    )


@wp.kernel
def composite_tiles_backward(
    # in:
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
    part = wp.tid() / 32
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
    tile = wp.tid() / 32
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
        entry = (wp.int64(wp.cast(depth[i], int)) << wp.int64(32)) | wp.int64(i)
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
