"""Scenes, looked up: compiled, since a tick asks for up to 21 places among hundreds of objects.

An object is a row of numbers, those of `scene.ObjectRow`. A texture that objects are made of is a
row too, with its tables in one pool of numbers. `scene.py` makes the rows.
"""

from __future__ import annotations

import numpy as np

from haptic_driver.render.compiled import kernel
from haptic_driver.render.lookup import picture_at, places_ahead, profile_at, waves_at
from haptic_driver.render.texture import FARTHEST_M
from haptic_driver.signals import Array, BoolArray

__all__ = ["places_ahead", "scene_at", "scene_at_points"]

# Columns of an object and of a material, and their kinds: numbers are constants in a kernel.
_OUTLINE, _X, _Y, _COS, _SIN, _HALF_X, _HALF_Y, _RADIUS, _FIRST, _COUNT = range(10)
_REACH, _EDGE, _MATERIAL, _COF = range(10, 14)
_KIND, _START, _SIZE_1, _SIZE_2, _SIZE_3, _N_1, _N_2, _N_3, _N_4, _N_5 = (0, *range(5, 14))
_EVERYWHERE, _RECTANGLE, _ELLIPSE, _POLYGON = 0, 1, 2, 3
_EVEN, _GRATING, _PROFILE, _WAVES = 0, 1, 2, 3

_WAY = 64  # places at most that lie close together
_OPAQUE = 1e-9  # what is left to see through an object's middle, at most
_HALF = 0.5  # an edge towards nothing is where half of the object is there


@kernel
def scene_at_points(
    objects: Array,
    points: Array,
    materials: Array,
    pool: Array,
    met: tuple[float, float],
    x_m: Array,
    y_m: Array,
) -> Array:
    cof = np.empty(x_m.size)
    near = objects
    if 0 < x_m.size <= _WAY:
        near = objects[reached(objects, x_m, y_m)]
    for m in range(x_m.size):
        cof[m] = scene_at(near, points, materials, pool, met, x_m[m], y_m[m])
    return cof


@kernel
def reached(objects: Array, x_m: Array, y_m: Array) -> BoolArray:
    """Which objects may be met on a short way: those that reach a circle around all its places."""
    middle_x_m, middle_y_m = 0.5 * (x_m.min() + x_m.max()), 0.5 * (y_m.min() + y_m.max())
    farthest_m = np.hypot(x_m.max() - middle_x_m, y_m.max() - middle_y_m)
    near = np.empty(objects.shape[0], np.bool_)
    for k in range(objects.shape[0]):
        off_m = np.hypot(middle_x_m - objects[k, _X], middle_y_m - objects[k, _Y])
        near[k] = not off_m > objects[k, _REACH] + farthest_m
    return near


@kernel
def scene_at(
    objects: Array,
    points: Array,
    materials: Array,
    pool: Array,
    met: tuple[float, float],
    x_m: float,
    y_m: float,
) -> float:
    """Friction where objects lie on one another, the last row on top.

    An edge of some width shows more and more of what is below it. Where an object asks for nothing
    it is not there; where nothing does, the answer is NaN. `met`: speed and load of the finger.
    """
    left, cof = 1.0, 0.0
    if not (abs(x_m) < FARTHEST_M and abs(y_m) < FARTHEST_M):  # not for NaN
        return np.nan
    for k in range(objects.shape[0] - 1, -1, -1):
        row = objects[k]
        dx, dy = x_m - row[_X], y_m - row[_Y]
        if dx * dx + dy * dy > row[_REACH] * row[_REACH]:
            continue
        u = row[_COS] * dx + row[_SIN] * dy
        v = row[_COS] * dy - row[_SIN] * dx
        there = covered(distance_to(row, points, materials, pool, u, v), row[_EDGE])
        if there <= 0.0:
            continue
        own = row[_COF]
        if row[_MATERIAL] >= 0.0:
            own = material_at(materials[int(row[_MATERIAL])], pool, met, u, v)
        if np.isnan(own):
            continue
        cof += left * there * own
        left *= 1.0 - there
        if left < _OPAQUE:
            return float(cof / (1.0 - left))
    return float(cof / (1.0 - left)) if left <= _HALF else np.nan


@kernel
def covered(distance_m: float, edge_m: float) -> float:
    """How much of an object is there at a distance outside its outline: straight over an edge."""
    if edge_m <= 0.0:
        return 1.0 if distance_m <= 0.0 else 0.0
    return min(max(0.5 - distance_m / edge_m, 0.0), 1.0)


@kernel
def distance_to(
    row: Array, points: Array, materials: Array, pool: Array, u_m: float, v_m: float
) -> float:
    """How far outside an object's outline a place of its own coordinates is; inside it is
    negative.
    """
    outline = int(row[_OUTLINE])
    if outline == _EVERYWHERE:
        return -np.inf
    if outline == _RECTANGLE:
        return outside_rectangle(u_m, v_m, row[_HALF_X], row[_HALF_Y], row[_RADIUS])
    if outline == _ELLIPSE:
        return outside_ellipse(u_m, v_m, row[_HALF_X], row[_HALF_Y])
    if outline == _POLYGON:
        return outside_polygon(points, int(row[_FIRST]), int(row[_COUNT]), u_m, v_m)
    mask = materials[int(row[_FIRST])]
    frame_m = outside_rectangle(u_m, v_m, row[_HALF_X], row[_HALF_Y], 0.0)
    inside_m = material_at(mask, pool, (0.0, 0.0), u_m + row[_HALF_X], v_m + row[_HALF_Y])
    return max(frame_m, inside_m)


@kernel
def outside_rectangle(
    u_m: float, v_m: float, half_x_m: float, half_y_m: float, radius_m: float
) -> float:
    """Of one around 0, 0 whose corners are as round."""
    beyond_x = abs(u_m) - half_x_m + radius_m
    beyond_y = abs(v_m) - half_y_m + radius_m
    corner_m = np.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0))
    return float(corner_m + min(max(beyond_x, beyond_y), 0.0) - radius_m)


@kernel
def outside_ellipse(u_m: float, v_m: float, half_x_m: float, half_y_m: float) -> float:
    """Exact for a circle and on the outline; near it to first order."""
    place = np.hypot(u_m / half_x_m, v_m / half_y_m)
    slope = np.hypot(u_m / (half_x_m * half_x_m), v_m / (half_y_m * half_y_m))
    if slope == 0.0:
        return -min(half_x_m, half_y_m)
    return float(place * (place - 1.0) / slope)


@kernel
def outside_polygon(points: Array, first: int, count: int, u_m: float, v_m: float) -> float:
    """The distance to the nearest side; inside where a ray crosses an odd number of sides."""
    nearest_m2, inside = np.inf, False
    for k in range(count):
        ax, ay = points[first + k, 0], points[first + k, 1]
        following = first + (k + 1) % count
        bx, by = points[following, 0], points[following, 1]
        along_x, along_y, from_x, from_y = bx - ax, by - ay, u_m - ax, v_m - ay
        length_m2 = along_x * along_x + along_y * along_y
        share = 0.0
        if length_m2 > 0.0:
            share = min(max((from_x * along_x + from_y * along_y) / length_m2, 0.0), 1.0)
        off_x, off_y = from_x - share * along_x, from_y - share * along_y
        nearest_m2 = min(nearest_m2, off_x * off_x + off_y * off_y)
        if (ay > v_m) != (by > v_m) and u_m < ax + (v_m - ay) * along_x / along_y:
            inside = not inside
    distance_m = float(np.sqrt(nearest_m2))
    return -distance_m if inside else distance_m


@kernel
def material_at(row: Array, pool: Array, met: tuple[float, float], x_m: float, y_m: float) -> float:
    """Friction of a texture at a place of its object's coordinates."""
    dx, dy = x_m - row[_X], y_m - row[_Y]
    u = row[_COS] * dx + row[_SIN] * dy
    v = row[_COS] * dy - row[_SIN] * dx
    kind, start = int(row[_KIND]), int(row[_START])
    size_1, size_2, size_3 = int(row[_SIZE_1]), int(row[_SIZE_2]), int(row[_SIZE_3])
    if kind == _EVEN:
        return float(row[_N_1])
    if kind == _GRATING:
        return float(row[_N_1] + row[_N_2] * np.sin(row[_N_3] * u + row[_N_4] * v + row[_N_5]))
    if kind == _PROFILE:
        places_m = pool[start : start + size_1]
        cof = pool[start + size_1 : start + 2 * size_1]
        return profile_at(places_m, cof, u, row[_N_1] != 0.0, row[_N_2] != 0.0)
    if kind == _WAVES:
        along = (u * row[_N_2] + v * row[_N_3]) / row[_N_1]
        loads, waves = start + size_1, start + size_1 + size_2
        speed_m_s, load_n = met
        if not speed_m_s >= 0.0:
            speed_m_s, load_n = row[_N_4], row[_N_5]
        return waves_at(
            pool[waves : waves + size_1 * size_2 * size_3].reshape((size_1, size_2, size_3)),
            pool[start:loads],
            pool[loads:waves],
            (speed_m_s, load_n),
            along,
        )
    picture = pool[start : start + size_1 * size_2].reshape((size_1, size_2))
    return picture_at(picture, u, v, row[_N_1], row[_N_2], row[_N_3] != 0.0, row[_N_4] != 0.0)
