# mypy: disable-error-code="operator,valid-type"
# ruff: noqa: UP018 (Warp needs the call to tell a variable from a constant)

"""Kernels: 3D Gaussians to 2D Gaussians in the image (EWA splatting) and the way back.

Zwicker et al. 2001, "EWA volume splatting"; Kerbl et al. 2023, "3D Gaussian splatting", section 4. One thread is one
Gaussian of one frame; arrays over (frame, Gaussian) are flat with index frame * gaussians + gaussian.
"""

import warp as wp

from .view import View

wp.set_module_options({"enable_backward": False})

DILATION_PX2 = wp.constant(0.3)  # added to the image covariance so that no Gaussian slips between pixel centres
NEAR_M = wp.constant(0.01)  # nearer Gaussians are left out
ALPHA_MIN = wp.constant(1.0 / 255.0)  # smaller contributions are left out; this bounds a Gaussian's reach


@wp.func
def unit_rotation(q: wp.vec4):
    """Rotation matrix of a unit quaternion wxyz."""
    return wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))


@wp.func
def clamp2(value: wp.vec2, low: wp.vec2, high: wp.vec2):
    return wp.vec2(wp.clamp(value[0], low[0], high[0]), wp.clamp(value[1], low[1], high[1]))


@wp.func
def slope_x(focal: wp.vec3, at: wp.vec2, depth: float):
    """Gradient of the pixel column with respect to camera coordinates, at direction x/z, y/z [px/m]."""
    return wp.vec3(focal[0], focal[2], -(focal[0] * at[0] + focal[2] * at[1])) / depth


@wp.func
def slope_y(focal: wp.vec3, at: wp.vec2, depth: float):
    """Gradient of the pixel row with respect to camera coordinates [px/m]."""
    return wp.vec3(0.0, focal[1], -focal[1] * at[1]) / depth


@wp.kernel
def project(
    # in:
    view: View,
    tile: int,
    gaussians: int,
    colors: int,
    mean: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec4),
    scale: wp.array(dtype=wp.vec3),
    opacity: wp.array(dtype=float),
    color: wp.array(dtype=wp.vec3),  # of every Gaussian, or of every Gaussian of every frame
    # out:
    centre: wp.array(dtype=wp.vec2),  # [px]
    conic: wp.array(dtype=wp.vec3),  # xx, xy, yy of the inverse covariance [1/px^2]
    depth: wp.array(dtype=float),  # [m]
    reach: wp.array(dtype=float),  # largest squared Mahalanobis distance at which alpha >= ALPHA_MIN; -1: left out
    peak: wp.array(dtype=float),  # the opacity
    paint: wp.array(dtype=wp.vec3),  # the colour
    box: wp.array(dtype=wp.vec4i),  # tiles touched: first column, first row, end column, end row
    count: wp.array(dtype=int),  # of those tiles
    pairs: wp.array(dtype=int),  # Gaussians of every tile of every frame, added to what is there; may be missing
):
    i = wp.tid()
    g = i % gaussians
    count[i] = 0
    reach[i] = -1.0
    p = view.camera_from_world * mean[i] + view.offset
    depth[i] = p[2]
    if not (p[2] > NEAR_M and opacity[g] >= ALPHA_MIN):  # holds for what is not a number, too
        return
    direction = wp.vec2(p[0], p[1]) / p[2]
    at = clamp2(direction, view.low, view.high)
    axes = wp.transpose(view.camera_from_world * unit_rotation(wp.normalize(rotation[i])))
    ax = wp.cw_mul(axes * slope_x(view.focal, at, p[2]), scale[g])
    ay = wp.cw_mul(axes * slope_y(view.focal, at, p[2]), scale[g])
    xx, xy, yy = wp.dot(ax, ax) + DILATION_PX2, wp.dot(ax, ay), wp.dot(ay, ay) + DILATION_PX2
    x = view.focal[0] * direction[0] + view.focal[2] * direction[1] + view.centre[0]
    y = view.focal[1] * direction[1] + view.centre[1]
    centre[i] = wp.vec2(x, y)
    conic[i] = wp.vec3(yy, -xy, xx) / (xx * yy - xy * xy)
    r = 2.0 * wp.log(opacity[g] / ALPHA_MIN)
    rx, ry = wp.sqrt(r * xx), wp.sqrt(r * yy)
    if not wp.isfinite(rx + ry + conic[i][0] + conic[i][1] + conic[i][2] + wp.length_sq(rotation[i])):
        return
    if not (x + rx >= 0.0 and y + ry >= 0.0 and x - rx <= float(view.width - 1) and y - ry <= float(view.height - 1)):
        return
    first_x = int(wp.max(wp.ceil(x - rx), 0.0)) / tile
    first_y = int(wp.max(wp.ceil(y - ry), 0.0)) / tile
    end_x = int(wp.min(wp.floor(x + rx), float(view.width - 1))) / tile + 1
    end_y = int(wp.min(wp.floor(y + ry), float(view.height - 1))) / tile + 1
    reach[i] = r
    peak[i] = opacity[g]
    paint[i] = color[i % colors]
    box[i] = wp.vec4i(first_x, first_y, end_x, end_y)  # type: ignore[call-overload]
    count[i] = wp.max(end_x - first_x, 0) * wp.max(end_y - first_y, 0)
    if pairs.shape[0] > 0:
        columns, rows = (view.width - 1) / tile + 1, (view.height - 1) / tile + 1
        for row in range(first_y, end_y):  # type: ignore[call-overload]
            for column in range(first_x, end_x):  # type: ignore[call-overload]
                wp.atomic_add(pairs, ((i / gaussians) * rows + row) * columns + column, 1)


@wp.func
def quaternion_gradient(q: wp.vec4, d: wp.mat33):
    """Gradient with respect to a unit quaternion wxyz from that with respect to its rotation matrix."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return 2.0 * wp.vec4(
        x * (d[2, 1] - d[1, 2]) + y * (d[0, 2] - d[2, 0]) + z * (d[1, 0] - d[0, 1]),
        y * (d[0, 1] + d[1, 0]) + z * (d[0, 2] + d[2, 0]) + w * (d[2, 1] - d[1, 2]) - 2.0 * x * (d[1, 1] + d[2, 2]),
        x * (d[0, 1] + d[1, 0]) + z * (d[1, 2] + d[2, 1]) + w * (d[0, 2] - d[2, 0]) - 2.0 * y * (d[0, 0] + d[2, 2]),
        x * (d[0, 2] + d[2, 0]) + y * (d[1, 2] + d[2, 1]) + w * (d[1, 0] - d[0, 1]) - 2.0 * z * (d[0, 0] + d[1, 1]),
    )


@wp.kernel
def project_backward(
    # in:
    view: View,
    gaussians: int,
    mean: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec4),
    scale: wp.array(dtype=wp.vec3),
    conic: wp.array(dtype=wp.vec3),
    count: wp.array(dtype=int),
    d_centre: wp.array(dtype=wp.vec2),
    d_conic: wp.array(dtype=wp.vec3),  # of xx, xy, yy where xy stands for both off-diagonal entries
    d_depth: wp.array(dtype=float),
    # out: zero where the Gaussian was left out; d_scale of each frame
    d_mean: wp.array(dtype=wp.vec3),
    d_rotation: wp.array(dtype=wp.vec4),
    d_scale: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    g = i % gaussians
    if count[i] == 0:
        d_mean[i] = wp.vec3()
        d_rotation[i] = wp.vec4()
        d_scale[i] = wp.vec3()
        return
    p = view.camera_from_world * mean[i] + view.offset
    direction = wp.vec2(p[0], p[1]) / p[2]
    at = clamp2(direction, view.low, view.high)
    q = wp.normalize(rotation[i])
    turn = view.camera_from_world * unit_rotation(q)
    jx, jy = slope_x(view.focal, at, p[2]), slope_y(view.focal, at, p[2])
    ex, ey = wp.transpose(turn) * jx, wp.transpose(turn) * jy
    ax, ay = wp.cw_mul(ex, scale[g]), wp.cw_mul(ey, scale[g])

    # inverse: d(covariance) = -conic d(conic) conic
    k, d = conic[i], d_conic[i]
    inverse = wp.mat22(k[0], k[1], k[1], k[2])
    h = -(inverse * wp.mat22(d[0], 0.5 * d[1], 0.5 * d[1], d[2]) * inverse)
    d_ax = 2.0 * (h[0, 0] * ax + h[0, 1] * ay)
    d_ay = 2.0 * (h[0, 1] * ax + h[1, 1] * ay)
    d_ex, d_ey = wp.cw_mul(d_ax, scale[g]), wp.cw_mul(d_ay, scale[g])
    d_scale[i] = wp.cw_mul(d_ax, ex) + wp.cw_mul(d_ay, ey)
    d_turn = wp.outer(jx, d_ex) + wp.outer(jy, d_ey)
    d_q = quaternion_gradient(q, wp.transpose(view.camera_from_world) * d_turn)
    d_rotation[i] = (d_q - q * wp.dot(q, d_q)) / wp.max(wp.length(rotation[i]), 1.0e-12)

    d_jx, d_jy = turn * d_ex, turn * d_ey
    d_x = view.focal[0] * d_centre[i][0]
    d_y = view.focal[2] * d_centre[i][0] + view.focal[1] * d_centre[i][1]
    if at[0] == direction[0]:
        d_x -= view.focal[0] * d_jx[2] / p[2]
    if at[1] == direction[1]:
        d_y -= (view.focal[2] * d_jx[2] + view.focal[1] * d_jy[2]) / p[2]
    d_z = d_depth[i] - (wp.dot(d_jx, jx) + wp.dot(d_jy, jy) + d_x * direction[0] + d_y * direction[1]) / p[2]
    d_mean[i] = wp.transpose(view.camera_from_world) * wp.vec3(d_x / p[2], d_y / p[2], d_z)


@wp.kernel
def sum_frames(
    # in:
    frames: int,
    gaussians: int,
    colors: int,
    scale: wp.array(dtype=wp.vec3),  # gradients over (frame, Gaussian)
    peak: wp.array(dtype=float),
    paint: wp.array(dtype=wp.vec3),
    # out: gradients of what the frames share, added up in their order
    d_scale: wp.array(dtype=wp.vec3),
    d_opacity: wp.array(dtype=float),
    d_color: wp.array(dtype=wp.vec3),
):
    g = wp.tid()
    s, o, c = wp.vec3(), float(0.0), wp.vec3()
    for frame in range(frames):
        i = frame * gaussians + g
        s += scale[i]
        o += peak[i]
        if colors == gaussians:
            c += paint[i]
        else:
            d_color[i] = paint[i]
    d_scale[g] = s
    d_opacity[g] = o
    if colors == gaussians:
        d_color[g] = c
