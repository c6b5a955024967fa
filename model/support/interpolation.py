"""Interpolation as a matrix: what the value at each node counts at each place.

Without scipy, which takes longer to import than a surface to solve.
"""

from __future__ import annotations

import numpy as np

from model.support.arrays import Array


def linear_weights(nodes: Array, at: Array) -> Array:
    """[..., n] for rising nodes [n] at any places [...]; beyond the ends, the value at the end."""
    return np.stack([np.interp(at, nodes, one) for one in np.eye(nodes.size)], axis=-1)


def polynomial_weights(nodes: Array, at: Array, count: int) -> Array:
    """[m, n] for rising nodes [n] at places [m]: by the polynomial through the `count` nearest
    nodes (Lagrange's).
    """
    count = min(count, nodes.size)
    first = np.clip(np.searchsorted(nodes, at) - count // 2, 0, nodes.size - count)
    near = nodes[first[:, None] + np.arange(count)]
    weights = np.zeros((at.size, nodes.size))
    for k in range(count):
        others = np.delete(near, k, axis=1)
        weights[np.arange(at.size), first + k] = np.prod(
            (at[:, None] - others) / (near[:, [k]] - others), axis=1
        )
    return weights
