# mypy: disable-error-code="operator,valid-type"

"""CUDA kernels: which Gaussians touch which tile of which frame, nearest first, without asking the device how many they are.

Each tile's list has its place by a scan over the tiles' counts, is filled in any order and then sorted on its own, by
depth and, for equal depths, by index: the result is the same in every run. A list that fits is sorted in shared memory.
Where the lists outgrow the room given, they are cut, and the last cursor says how much room they need.
"""

import warp as wp

from .step import BLOCK

wp.set_module_options({"enable_backward": False})

TILE_PX = 16
SCAN_BLOCK = 1024


# One block: its 32 warps each add up a stretch of tiles, then run over it again from where the stretches before it end.
SCAN = """
    __shared__ int sums[32];
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int stretch = (tiles + 1023) / 1024 * 32;
    const int first = min(warp * stretch, tiles), end = min(first + stretch, tiles);
    int sum = 0;
    for (int t = first + lane; t < end; t += 32)
        sum += pairs.data[t];
    for (int step = 16; step > 0; step /= 2)
        sum += __shfl_xor_sync(all, sum, step);
    if (lane == 0)
        sums[warp] = sum;
    __syncthreads();
    int before = lane < warp ? sums[lane] : 0;
    for (int step = 16; step > 0; step /= 2)
        before += __shfl_xor_sync(all, before, step);
    for (int base = first; base < end; base += 32) {
        const int t = base + lane;
        const int own = t < end ? pairs.data[t] : 0;
        int upto = own;
        for (int step = 1; step < 32; step *= 2) {
            const int left = __shfl_up_sync(all, upto, step);
            upto += lane >= step ? left : 0;
        }
        if (t < end) {
            cursor.data[t] = before + upto - own;
            start.data[t] = min(before + upto - own, room);
        }
        before += __shfl_sync(all, upto, 31);
    }
    if (threadIdx.x == 1023) {
        cursor.data[tiles] = before;
        start.data[tiles] = min(before, room);
    }
"""


@wp.func_native(SCAN)
def scan(tiles: int, room: int, pairs: wp.array(dtype=int), start: wp.array(dtype=int), cursor: wp.array(dtype=int)): ...


@wp.kernel(module="unique", enable_backward=False)
def place_lists(
    # in:
    tiles: int,
    key: wp.array(dtype=wp.int64),  # for the room that it has
    pairs: wp.array(dtype=int),
    # out:
    start: wp.array(dtype=int),  # first pair of every tile, and the end, no further than the room reaches
    cursor: wp.array(dtype=int),  # the same, however far
):
    wp.tid()
    scan(tiles, key.shape[0], pairs, start, cursor)


@wp.kernel
def list_pairs(
    # in:
    gaussians: int,
    columns: int,
    rows: int,
    box: wp.array(dtype=wp.vec4i),
    count: wp.array(dtype=int),
    depth: wp.array(dtype=float),
    # out:
    cursor: wp.array(dtype=int),  # moves on to the end of its list
    key: wp.array(dtype=wp.int64),  # bits of depth, index over (frame, Gaussian)
):
    i = wp.tid()
    if count[i] == 0:
        return
    # the bits of positive floats sort as the floats do
    entry = (wp.int64(wp.cast(depth[i], int)) << wp.int64(32)) | wp.int64(i)  # type: ignore[arg-type]
    first = (i / gaussians) * rows * columns
    for y in range(box[i][1], box[i][3]):
        for x in range(box[i][0], box[i][2]):
            k = wp.atomic_add(cursor, first + y * columns + x, 1)  # type: ignore[call-overload]
            if k < key.shape[0]:
                key[k] = entry


# A bitonic network whose comparisons all put the smaller key first, so that a list of any length needs no padding.
SORT = """
    __shared__ long long fast[4096];
    const int begin = start.data[tile], count = start.data[tile + 1] - begin, own = threadIdx.x;
    if (count < 2)
        return;
    long long* list = count <= 4096 ? fast : (long long*)key.data + begin;
    if (count <= 4096)
        for (int k = own; k < count; k += 256)
            fast[k] = key.data[begin + k];
    __syncthreads();
    for (int half = 1; half < count; half *= 2) {
        for (int step = half; step > 0; step /= 2) {
            const bool flip = step == half;
            for (int t = own; ; t += 256) {
                const int i = (t & ~(step - 1)) * 2 + (t & (step - 1));
                if (i >= count)
                    break;
                const int j = flip ? (i | (2 * step - 1)) - (i & (step - 1)) : i + step;
                if (j < count) {
                    const long long a = list[i], b = list[j];
                    if (a > b) {
                        list[i] = b;
                        list[j] = a;
                    }
                }
            }
            __syncthreads();
        }
    }
    if (count <= 4096)
        for (int k = own; k < count; k += 256)
            key.data[begin + k] = fast[k];
"""


@wp.func_native(SORT)
def sort_list(tile: int, start: wp.array(dtype=int), key: wp.array(dtype=wp.int64)): ...


@wp.kernel
def sort_lists(
    # in:
    start: wp.array(dtype=int),
    # in and out:
    key: wp.array(dtype=wp.int64),
):
    sort_list(wp.tid() / BLOCK, start, key)
