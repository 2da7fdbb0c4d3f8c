import numpy as np
import pytest

from cltransfer.scenes.builtin.surfaces import Cells, Panel, ball, box, capsule


def area(cells: Cells) -> float:
    return float(4 * np.linalg.norm(np.cross(cells.half_u, cells.half_v), axis=1).sum())


def test_panel_cells_cover_its_area_and_face_one_way():
    cells = Panel((1, 2, 3), (2, 0, 0), (0, 0, 1)).cells(0.1)
    assert len(cells) == 200
    assert area(cells) == pytest.approx(2.0)
    np.testing.assert_allclose(cells.normal, np.tile([0, -1, 0], (200, 1)), atol=1e-12)
    np.testing.assert_allclose(cells.center.mean(0), [2, 2, 3.5])
    assert cells.uv.max(0) == pytest.approx([1.95, 0.95])


def test_ball_has_the_area_of_a_sphere_and_faces_outwards():
    center = np.array([1.0, -2.0, 0.5])
    cells = ball(center, 0.7).cells(0.04)
    assert area(cells) == pytest.approx(4 * np.pi * 0.7**2, rel=0.01)
    out = (cells.center - center) / np.linalg.norm(cells.center - center, axis=1, keepdims=True)
    assert (np.sum(out * cells.normal, 1)).min() > 0.98


def test_ball_stretches_along_the_axes_it_says():
    reach = np.ptp(ball((0, 0, 0), 1.0, tall=1.5, flat=0.5).cells(0.02).center, axis=0)
    np.testing.assert_allclose(reach, [1.0, 2.0, 3.0], rtol=0.01)


def test_capsule_reaches_a_radius_beyond_its_joints():
    cells = capsule((0, 0, 1), (0, 0, 3), 0.2, 0.1).cells(0.02)
    assert cells.center[:, 2].min() == pytest.approx(0.8, abs=0.01)
    assert cells.center[:, 2].max() == pytest.approx(3.1, abs=0.01)
    assert np.linalg.norm(cells.center[:, :2], axis=1).max() == pytest.approx(0.2, rel=0.02)


def test_scaling_a_lathe_scales_its_cells():
    small, large = capsule((0, 1, 0), (0, 1, 1), 0.2, 0.1), capsule((0, 2, 0), (0, 2, 2), 0.4, 0.2)
    np.testing.assert_allclose(small.scaled(2).cells(0.1).center, large.cells(0.1).center)


def test_box_faces_point_away_from_its_middle():
    cells = Cells.concatenate([panel.cells(0.25) for panel in box((0, 0, 0), (1, 2, 3))])
    assert (np.sum((cells.center - [0.5, 1, 1.5]) * cells.normal, 1) > 0).all()
