from __future__ import annotations

import numpy as np

from cltransfer.renderers.kernels.grid_pack import BRICK, FAR, distance_to_matter


def test_distance_counts_bricks_to_the_nearest_matter():
    rng = np.random.Generator(np.random.PCG64(0))
    density = np.zeros((30, 41, 25), np.float32)
    for z, y, x in rng.integers(0, density.shape, (3, 3)):
        density[z, y, x] = 1
    distance = distance_to_matter(density)
    assert distance.shape == (4, 5, 3)
    full = [b for b in np.ndindex(*distance.shape) if _slab(density, b).any()]
    for brick in np.ndindex(*distance.shape):
        assert distance[brick] == min(np.abs(np.subtract(brick, other)).max() for other in full)


def test_matter_on_a_shared_face_fills_the_bricks_on_both_sides():
    density = np.zeros((2 * BRICK + 1, 9, 9), np.float32)
    density[BRICK, 4, 4] = 1
    assert distance_to_matter(density).ravel().tolist() == [0, 0]


def test_an_empty_grid_is_far_from_matter_everywhere():
    assert (distance_to_matter(np.zeros((20, 20, 20), np.float32)) == FAR).all()


def _slab(density, brick):
    return density[tuple(slice(b * BRICK, b * BRICK + BRICK + 1) for b in brick)]
