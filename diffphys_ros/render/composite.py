# mypy: disable-error-code="valid-type"
# ruff: noqa: UP018 (Warp needs the call to tell a variable from a constant)

"""Kernels: front-to-back alpha compositing of the Gaussians of each tile, and its derivative.

A pixel's colour is sum_i T_i alpha_i c_i with T_i = prod_{j<i} (1 - alpha_j) (Kerbl et al. 2023, equation 3). One thread
is one pixel of one frame. The backward pass walks front to back again: with phi_i the cotangent of what Gaussian i
adds per unit weight, d/d alpha_i = T_i phi_i - (sum of later terms) / (1 - alpha_i), and the later terms are the
total less what was passed. What is left of the light after the last Gaussian shows the background.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

ALPHA_MAX = wp.constant(0.999)  # keeps 1 - alpha away from 0
TINY = wp.constant(1.0e-12)  # keeps empty pixels from dividing by 0
STOP = wp.constant(1.0e-4)  # compositing ends before the transmittance falls to this


@wp.struct
class Layout:
    """How threads map to pixels: tile after tile, so that neighbours share their list of Gaussians."""

    width: int  # of the window [px]
    height: int
    side: int  # of a tile [px]
    columns: int  # tiles across
    rows: int


@wp.func
def tile_of(layout: Layout, thread: int):
    return thread / (layout.side * layout.side)


@wp.func
def pixel_of(layout: Layout, thread: int):
    """Column, row and flat index over (frame, row, column) of a thread's pixel; index -1 outside the window."""
    tile = tile_of(layout, thread)
    inner = thread % (layout.side * layout.side)
    x = (tile % layout.columns) * layout.side + inner % layout.side
    y = (tile / layout.columns % layout.rows) * layout.side + inner / layout.side
    frame = tile / (layout.columns * layout.rows)
    if x >= layout.width or y >= layout.height:
        return wp.vec3i(x, y, -1)
    return wp.vec3i(x, y, (frame * layout.height + y) * layout.width + x)


@wp.func
def distance2(conic: wp.vec3, d: wp.vec2):
    """Squared Mahalanobis distance."""
    return conic[0] * d[0] * d[0] + 2.0 * conic[1] * d[0] * d[1] + conic[2] * d[1] * d[1]


@wp.kernel
def composite(
    # in:
    layout: Layout,
    start: wp.array(dtype=int),
    owner: wp.array(dtype=int),
    centre: wp.array(dtype=wp.vec2),
    conic: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=float),
    depth: wp.array(dtype=float),
    opacity: wp.array(dtype=float),
    color: wp.array(dtype=wp.vec3),
    background: wp.array(dtype=wp.vec3),  # repeats after its last pixel
    # out:
    image: wp.array(dtype=wp.vec3),
    alpha: wp.array(dtype=float),
    mean_depth: wp.array(dtype=float),  # weighted by what each Gaussian adds [m]; 0 where nothing is
):
    thread = wp.tid()
    pixel = pixel_of(layout, thread)  # type: ignore[arg-type]
    if pixel[2] < 0:
        return
    tile = tile_of(layout, thread)  # type: ignore[arg-type]
    at = wp.vec2(float(pixel[0]), float(pixel[1]))
    passed = float(1.0)
    rgb = wp.vec3()
    z = float(0.0)
    for k in range(start[tile], start[tile + 1]):
        i = owner[k]
        d2 = distance2(conic[i], at - centre[i])
        if d2 <= reach[i]:
            a = wp.min(opacity[i] * wp.exp(-0.5 * d2), ALPHA_MAX)
            if passed * (1.0 - a) <= STOP:
                break
            rgb += passed * a * color[i]
            z += passed * a * depth[i]
            passed *= 1.0 - a
    image[pixel[2]] = rgb + passed * background[pixel[2] % background.shape[0]]
    alpha[pixel[2]] = 1.0 - passed
    mean_depth[pixel[2]] = z / wp.max(1.0 - passed, TINY)


@wp.kernel
def composite_backward(
    # in:
    layout: Layout,
    start: wp.array(dtype=int),
    owner: wp.array(dtype=int),
    centre: wp.array(dtype=wp.vec2),
    conic: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=float),
    depth: wp.array(dtype=float),
    opacity: wp.array(dtype=float),
    color: wp.array(dtype=wp.vec3),
    background: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    alpha: wp.array(dtype=float),
    mean_depth: wp.array(dtype=float),
    d_image: wp.array(dtype=wp.vec3),
    d_alpha: wp.array(dtype=float),
    d_mean_depth: wp.array(dtype=float),
    # out: added to, over (frame, Gaussian)
    d_centre: wp.array(dtype=wp.vec2),
    d_conic: wp.array(dtype=wp.vec3),
    d_depth: wp.array(dtype=float),
    d_opacity: wp.array(dtype=float),
    d_color: wp.array(dtype=wp.vec3),
):
    thread = wp.tid()
    pixel = pixel_of(layout, thread)  # type: ignore[arg-type]
    if pixel[2] < 0:
        return
    if alpha[pixel[2]] == 0.0:
        return
    c_rgb, c_alpha, c_z = d_image[pixel[2]], d_alpha[pixel[2]], d_mean_depth[pixel[2]] / alpha[pixel[2]]
    if wp.length_sq(c_rgb) == 0.0 and c_alpha == 0.0 and c_z == 0.0:
        return
    tile = tile_of(layout, thread)  # type: ignore[arg-type]
    at = wp.vec2(float(pixel[0]), float(pixel[1]))
    passed = float(1.0)
    behind = background[pixel[2] % background.shape[0]]
    later = wp.dot(c_rgb, image[pixel[2]] - behind) + c_alpha * alpha[pixel[2]]  # the terms of depth add up to 0
    c_clear = c_alpha - wp.dot(c_rgb, behind) - c_z * mean_depth[pixel[2]]
    for k in range(start[tile], start[tile + 1]):
        i = owner[k]
        d = at - centre[i]
        d2 = distance2(conic[i], d)
        if d2 <= reach[i]:
            falloff = wp.exp(-0.5 * d2)
            free = opacity[i] * falloff
            a = wp.min(free, ALPHA_MAX)
            if passed * (1.0 - a) <= STOP:
                break
            phi = wp.dot(c_rgb, color[i]) + c_clear + c_z * depth[i]
            later -= passed * a * phi
            wp.atomic_add(d_color, i, passed * a * c_rgb)
            wp.atomic_add(d_depth, i, passed * a * c_z)
            if free < ALPHA_MAX:
                d_a = passed * phi - later / (1.0 - a)
                wp.atomic_add(d_opacity, i, d_a * falloff)
                d_d2 = -0.5 * d_a * a
                wp.atomic_add(d_conic, i, d_d2 * wp.vec3(d[0] * d[0], 2.0 * d[0] * d[1], d[1] * d[1]))
                pull = wp.vec2(conic[i][0] * d[0] + conic[i][1] * d[1], conic[i][1] * d[0] + conic[i][2] * d[1])
                wp.atomic_add(d_centre, i, -2.0 * d_d2 * pull)
            passed *= 1.0 - a
