"""Textures that are given by points, looked up between them: compiled, a tick asks for 21 places.

A function for one place stands beside one for many, [n].
"""

from __future__ import annotations

import numpy as np

from haptic_driver.render.compiled import kernel
from haptic_driver.signals import Array


@kernel
def places_ahead(finger: tuple[float, float, float, float], ahead_s: Array) -> tuple[Array, Array]:
    """Where a finger will be, by its position and velocity along x and y."""
    x_m, y_m, vx_m_s, vy_m_s = finger
    return x_m + vx_m_s * ahead_s, y_m + vy_m_s * ahead_s


@kernel
def picture_at_points(
    picture: Array,
    x_m: Array,
    y_m: Array,
    pitch_x_m: float,
    pitch_y_m: float,
    tile: bool,
    ends: bool,
) -> Array:
    cof = np.empty(x_m.size)
    for m in range(x_m.size):
        cof[m] = picture_at(picture, x_m[m], y_m[m], pitch_x_m, pitch_y_m, tile, ends)
    return cof


@kernel
def picture_at(
    picture: Array,
    x_m: float,
    y_m: float,
    pitch_x_m: float,
    pitch_y_m: float,
    tile: bool,
    ends: bool,
) -> float:
    """Friction at a distance from the corner of `picture` [row, column], between pixels' centres.

    Beyond the outer centres it begins again (`tile`) or goes on with its edge. Beyond the picture
    there is nothing where it `ends`.
    """
    rows, columns = picture.shape
    u, v = x_m / pitch_x_m, y_m / pitch_y_m
    if ends and not (0.0 <= u <= columns and 0.0 <= v <= rows):
        return np.nan
    left, right, share_x = neighbours(u - 0.5, columns, tile)
    low, high, share_y = neighbours(v - 0.5, rows, tile)
    at_low = towards(picture[low, left], picture[low, right], share_x)
    at_high = towards(picture[high, left], picture[high, right], share_x)
    return towards(at_low, at_high, share_y)


@kernel
def waves_at_points(
    waves: Array, speed_m_s: Array, normal_force_n: Array, met: tuple[float, float], along: Array
) -> Array:
    cof = np.empty(along.size)
    for m in range(along.size):
        cof[m] = waves_at(waves, speed_m_s, normal_force_n, met, along[m])
    return cof


@kernel
def waves_at(
    waves: Array, speed_m_s: Array, normal_force_n: Array, met: tuple[float, float], along: float
) -> float:
    """Friction as far `along` as so many places of `waves` [speed, load, place], which begin again.

    `met`: speed and load of the finger; beyond the first and the last the nearest holds.
    """
    left, right, share = neighbours(along, waves.shape[2], True)
    speed_index, load_index = index_of(met[0], speed_m_s), index_of(met[1], normal_force_n)
    slow, fast, speed_share = neighbours(speed_index, speed_m_s.size, False)
    light, heavy, load_share = neighbours(load_index, normal_force_n.size, False)
    cof = 0.0
    for speed, of_speed in ((slow, 1.0 - speed_share), (fast, speed_share)):
        for load, of_load in ((light, 1.0 - load_share), (heavy, load_share)):
            wave = towards(waves[speed, load, left], waves[speed, load, right], share)
            cof += of_speed * of_load * wave
    return cof


@kernel
def profile_at_points(position_m: Array, cof: Array, x_m: Array, tile: bool, ends: bool) -> Array:
    found = np.empty(x_m.size)
    for m in range(x_m.size):
        found[m] = profile_at(position_m, cof, x_m[m], tile, ends)
    return found


@kernel
def profile_at(position_m: Array, cof: Array, x_m: float, tile: bool, ends: bool) -> float:
    """Friction between rising positions of points.

    Beyond the outer ones it begins again (`tile`), is nothing where the profile `ends`, or goes on
    with the nearest.
    """
    first_m, last_m = position_m[0], position_m[-1]
    if ends and not first_m <= x_m <= last_m:
        return np.nan
    if tile and not first_m <= x_m <= last_m:
        x_m = min(first_m + (x_m - first_m) % (last_m - first_m), last_m)
    return between_points(position_m, cof, x_m)


@kernel
def between_points(position_m: Array, cof: Array, place_m: float) -> float:
    """Straight from point to point; clamped."""
    if place_m <= position_m[0]:
        return float(cof[0])
    if place_m >= position_m[-1]:
        return float(cof[-1])
    k = np.searchsorted(position_m, place_m, side="right") - 1
    slope = (cof[k + 1] - cof[k]) / (position_m[k + 1] - position_m[k])
    return float(slope * (place_m - position_m[k]) + cof[k])


@kernel
def index_of(value: float, nodes: Array) -> float:
    """Which of rising nodes a value is, with the share of the way to the next; clamped."""
    if value <= nodes[0]:
        return 0.0
    if value >= nodes[-1]:
        return nodes.size - 1.0
    k = np.searchsorted(nodes, value, side="right") - 1
    return float(1.0 / (nodes[k + 1] - nodes[k]) * (value - nodes[k]) + k)


@kernel
def neighbours(pixels: float, count: int, tile: bool) -> tuple[int, int, float]:
    """The two pixels around a distance in pixels from the first centre; the way between them."""
    if tile:
        pixels %= count
        index = min(int(pixels), count - 1)  # -1e-20 % 96 is 96.0
        return index, (index + 1) % count, pixels - index
    pixels = min(max(pixels, 0.0), count - 1.0)
    index = int(pixels)
    return index, min(index + 1, count - 1), pixels - index


@kernel
def towards(first: float, second: float, share: float) -> float:
    """Some share of the way from one number to another."""
    return first + share * (second - first)
