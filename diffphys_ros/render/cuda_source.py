"""CUDA C++ of the compositing: what one warp of 32 threads does with its part of a tile, forward and backward.

The kernels around it are in cuda_composite.py.
"""

from .composite import ALPHA_MAX, STOP, TINY

DEEP = 2  # pixels of a thread, 4 rows apart

PIXELS = """
    __shared__ float4 staged[8][32][3];
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const float left = tile % columns * 16 + part % 2 * 8, top = tile / columns % rows * 16 + part / 2 * 4 * DEEP;
    const float x = left + lane % 8, y = top + lane / 8;
    const int end = start.data[tile + 1];
    bool inside[DEEP];
    size_t pixel[DEEP];
    #pragma unroll
    for (int s = 0; s < DEEP; ++s) {
        inside[s] = x < width && y + 4 * s < height;
        pixel[s] = inside[s] ? ((size_t)(tile / (columns * rows)) * height + (int)y + 4 * s) * width + (int)x : 0;
    }
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
            const float x0 = left - p.x, x1 = left + 7.0f - p.x, y0 = top - p.y, y1 = top + 4.0f * DEEP - 1.0f - p.y;
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
    PIXELS
    + """
    float passed[DEEP], red[DEEP], green[DEEP], blue[DEEP], z[DEEP];
    bool done[DEEP];
    #pragma unroll
    for (int s = 0; s < DEEP; ++s) {
        passed[s] = 1.0f;
        red[s] = green[s] = blue[s] = z[s] = 0.0f;
        done[s] = !inside[s];
    }
    for (int first = start.data[tile]; first < end; first += 32) {
        bool ended = true;
        for (int s = 0; s < DEEP; ++s)
            ended = ended && done[s];
        if (__all_sync(all, ended))
            break;
"""
    + STAGE.replace("NAME", "i")
    + """
        for (int k = 0; k < count; ++k) {
            const float4 p = staged[warp][k][0], q = staged[warp][k][1], c = staged[warp][k][2];
            const float dx = x - p.x;
            #pragma unroll
            for (int s = 0; s < DEEP; ++s) {
                const float dy = y + 4 * s - p.y, d2 = p.z * dx * dx + 2.0f * p.w * dx * dy + q.x * dy * dy;
                if (!done[s] && d2 <= q.y) {
                    const float a = fminf(q.w * __expf(-0.5f * d2), ALPHA_MAX);
                    const float next = passed[s] * (1.0f - a), weight = passed[s] * a;
                    done[s] = next <= STOP;
                    if (!done[s]) {
                        red[s] += weight * c.x;
                        green[s] += weight * c.y;
                        blue[s] += weight * c.z;
                        z[s] += weight * q.z;
                        passed[s] = next;
                    }
                }
            }
        }
    }
    #pragma unroll
    for (int s = 0; s < DEEP; ++s) {
        if (inside[s]) {
            const float* behind = background.data + 3 * (pixel[s] % background.shape[0]);
            image.data[3 * pixel[s]] = red[s] + passed[s] * behind[0];
            image.data[3 * pixel[s] + 1] = green[s] + passed[s] * behind[1];
            image.data[3 * pixel[s] + 2] = blue[s] + passed[s] * behind[2];
            alpha.data[pixel[s]] = 1.0f - passed[s];
            depth.data[pixel[s]] = z[s] / fmaxf(1.0f - passed[s], TINY);
        }
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
    PIXELS
    + """
    // which of the ten sums this lane ends up with
    const int of_five = (lane & 8 ? 3 : 0) + (lane & 4 ? 2 : 0) + (lane & 2 ? 1 : 0);
    const bool has_sum = !(lane & 1) && (lane & 8 ? !(lane & 4) : (lane & 6) != 6);
    const int which = (lane & 16 ? 5 : 0) + of_five;
    float cr[DEEP], cg[DEEP], cb[DEEP], ca[DEEP], cz[DEEP], passed[DEEP], later[DEEP];
    bool done[DEEP];
    #pragma unroll
    for (int s = 0; s < DEEP; ++s) {
        const size_t at = pixel[s];
        const float* behind = background.data + 3 * (at % background.shape[0]);
        const float covered = inside[s] ? alpha.data[at] : 0.0f;
        const bool colored = covered > 0.0f && d_image.data;
        cr[s] = colored ? d_image.data[3 * at] : 0.0f;
        cg[s] = colored ? d_image.data[3 * at + 1] : 0.0f;
        cb[s] = colored ? d_image.data[3 * at + 2] : 0.0f;
        ca[s] = covered > 0.0f && d_alpha.data ? d_alpha.data[at] : 0.0f;
        cz[s] = covered > 0.0f && d_depth.data ? d_depth.data[at] / covered : 0.0f;
        done[s] = cr[s] == 0.0f && cg[s] == 0.0f && cb[s] == 0.0f && ca[s] == 0.0f && cz[s] == 0.0f;
        passed[s] = 1.0f;
        later[s] = 0.0f;
        if (!done[s]) {
            later[s] = cr[s] * (image.data[3 * at] - behind[0]) + cg[s] * (image.data[3 * at + 1] - behind[1])
                + cb[s] * (image.data[3 * at + 2] - behind[2]) + ca[s] * covered;
            ca[s] -= cr[s] * behind[0] + cg[s] * behind[1] + cb[s] * behind[2] + cz[s] * depth.data[at];
        }
    }
    for (int first = start.data[tile]; first < end; first += 32) {
        bool ended = true;
        for (int s = 0; s < DEEP; ++s)
            ended = ended && done[s];
        if (__all_sync(all, ended))
            break;
"""
    + STAGE.replace("NAME", "by_pair ? first + lane : i")
    + """
        for (int k = 0; k < count; ++k) {
            const float4 p = staged[warp][k][0], q = staged[warp][k][1], c = staged[warp][k][2];
            const float dx = x - p.x;
            float v[10] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
            bool any = false;
            #pragma unroll
            for (int s = 0; s < DEEP; ++s) {
                const float dy = y + 4 * s - p.y, d2 = p.z * dx * dx + 2.0f * p.w * dx * dy + q.x * dy * dy;
                if (done[s] || d2 > q.y)
                    continue;
                const float falloff = __expf(-0.5f * d2), free = q.w * falloff, a = fminf(free, ALPHA_MAX);
                if (passed[s] * (1.0f - a) <= STOP) {
                    done[s] = true;
                    continue;
                }
                any = true;
                const float phi = cr[s] * c.x + cg[s] * c.y + cb[s] * c.z + ca[s] + cz[s] * q.z, weight = passed[s] * a;
                later[s] -= weight * phi;
                v[5] += weight * cz[s];
                v[7] += weight * cr[s];
                v[8] += weight * cg[s];
                v[9] += weight * cb[s];
                if (free < ALPHA_MAX) {
                    const float d_a = passed[s] * phi - later[s] / (1.0f - a), d_d2 = -0.5f * d_a * a;
                    v[0] -= 2.0f * d_d2 * (p.z * dx + p.w * dy);
                    v[1] -= 2.0f * d_d2 * (p.w * dx + q.x * dy);
                    v[2] += d_d2 * dx * dx;
                    v[3] += 2.0f * d_d2 * dx * dy;
                    v[4] += d_d2 * dy * dy;
                    v[6] += d_a * falloff;
                }
                passed[s] *= 1.0f - a;
            }
            if (!__any_sync(all, any))
                continue;
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


def _in_numbers(source: str) -> str:
    for name, value in {"ALPHA_MAX": ALPHA_MAX, "STOP": STOP, "TINY": TINY}.items():
        source = source.replace(name, f"{value!r}f")
    return source.replace("DEEP", str(DEEP))


COMPOSITE, BACKWARD = _in_numbers(COMPOSITE), _in_numbers(BACKWARD)
