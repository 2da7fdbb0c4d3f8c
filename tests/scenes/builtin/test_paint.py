import numpy as np

from cltransfer.scenes.builtin.paint import bricks, checker, openings, plain, shade, visibility
from cltransfer.scenes.builtin.surfaces import Cells, Panel, box

SUN = np.array([0.6, 0.0, 0.8])


def test_checker_alternates_with_the_tile():
    uv = np.array([[0.1, 0.1], [0.6, 0.1], [0.6, 0.6]])
    rgb = checker((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.5)(uv, np.random.default_rng(0))
    assert rgb[1].max() == 0
    assert rgb[[0, 2]].min() > 0.5


def test_openings_are_dark_below_their_arch_only():
    paint = openings(plain((1.0, 1.0, 1.0), 0.0), (0.0, 0.0, 0.0), period=2.0, width=1.0, band=(0.0, 2.0))
    uv = np.array([[1.0, 1.0], [1.0, 2.4], [1.0, 2.6], [0.2, 1.0], [3.0, 1.0]])
    assert paint(uv, np.random.default_rng(0))[:, 0].tolist() == [0, 0, 1, 1, 0]


def test_paint_repeats_with_its_seed_and_differs_with_another():
    uv = np.random.default_rng(1).uniform(0, 5, (50, 2))
    paint = bricks((0.5, 0.4, 0.3))
    np.testing.assert_array_equal(paint(uv, np.random.default_rng(2)), paint(uv, np.random.default_rng(2)))
    assert np.abs(paint(uv, np.random.default_rng(2)) - paint(uv, np.random.default_rng(3))).max() > 0.01


def test_a_block_shades_the_ground_away_from_the_sun_and_nothing_else():
    ground = Panel((-4, -4, 0), (8, 0, 0), (0, 8, 0)).cells(0.1)
    block = Cells.concatenate([panel.cells(0.1) for panel in box((-0.5, -0.5, 0), (0.5, 0.5, 1.6))])
    occluders = np.concatenate([ground.center, block.center])
    light = visibility(ground.center, occluders, SUN, 0.12, 0.2)
    behind = (ground.center[:, 0] < -0.8) & (ground.center[:, 0] > -1.4) & (np.abs(ground.center[:, 1]) < 0.3)
    before = ground.center[:, 0] > 0.8
    assert light[behind].max() < 0.1
    assert light[before].min() > 0.9


def test_a_corner_gets_less_sky_than_open_ground():
    ground = Panel((-4, -4, 0), (8, 0, 0), (0, 8, 0)).cells(0.15)
    wall = Panel((-4, -4, 0), (0, 8, 0), (0, 0, 4)).cells(0.15)
    cells = Cells.concatenate([ground, wall])
    light = shade(cells, cells.center, SUN).sum(1)[: len(ground)]
    corner, open_ground = ground.center[:, 0] < -3.7, ground.center[:, 0] > 2
    assert light[corner].mean() < 0.9 * light[open_ground].mean()
