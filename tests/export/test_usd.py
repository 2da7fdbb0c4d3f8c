"""USD's text: one camera worked out by hand, and a path read back by OpenUSD itself where it is installed."""

import pytest

from cltransfer.errors import InputError
from cltransfer.export.usd import write_usd


def test_one_camera_worked_out_by_hand(tmp_path, still):
    write_usd(tmp_path / "shot.usda", still, 24)
    text = (tmp_path / "shot.usda").read_text()
    # right is +x, up +z, backward -y: rows of the matrix, the place below them
    assert "xformOp:transform = ((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (1, 2, 3, 1))\n" in text
    assert "float focalLength = 0.09\n" in text  # 50 px of 200 are 9 of 36 mm; in tenths of a metre
    assert "float horizontalAperture = 0.36\n" in text
    assert "float verticalAperture = 0.18\n" in text
    assert "float horizontalApertureOffset = 0\n" in text


def test_a_lens_off_the_middle_worked_out_by_hand(tmp_path, path):
    write_usd(tmp_path / "shot.usda", path, 20)
    text = (tmp_path / "shot.usda").read_text()
    # the axis is 40 px right of the middle and 25 above it: the gate lies to its left and below
    assert "float horizontalApertureOffset = -0.01125\n" in text  # 0.36 * 40 / 1280
    assert "float verticalApertureOffset = -0.00703125\n" in text  # 0.36 * 25 / 1280


def test_what_programs_turn_is_told(tmp_path, still):
    for y_up, axis in ((False, "Z"), (True, "Y")):
        write_usd(tmp_path / "shot.usda", still, 24, y_up)
        assert f'    upAxis = "{axis}"\n' in (tmp_path / "shot.usda").read_text()


def test_cameras_stand_at_their_times(tmp_path, path):
    write_usd(tmp_path / "shot.usda", path, 20)
    text = (tmp_path / "shot.usda").read_text()
    assert "    timeCodesPerSecond = 20\n" in text  # five in 0.2 s
    assert "    endTimeCode = 4\n" in text
    lens = text.partition("focalLength.timeSamples = {")[2].partition("}")[0]
    assert [float(line.split(":")[0]) for line in lens.split("\n")[1:-1]] == [0, 0.8, 2, 2.6, 4]


def test_pixels_that_are_not_square_are_refused(tmp_path, path):
    path.camera.K[:, 0, 0] *= 1.1
    with pytest.raises(InputError, match="expected square pixels"):
        write_usd(tmp_path / "shot.usda", path, 20)
    assert not (tmp_path / "shot.usda").exists()


def test_openusd_sees_what_we_see(tmp_path, path, seen):
    usd = pytest.importorskip("pxr.Usd", reason="OpenUSD is not installed: pip install usd-core")
    from pxr import Gf, UsdGeom

    write_usd(tmp_path / "shot.usda", path, 20)
    stage = usd.Stage.Open(str(tmp_path / "shot.usda"))
    prim, (width, height) = UsdGeom.Camera(stage.GetDefaultPrim()), path.camera.size
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    for time, points in zip(path.times.tolist(), seen):
        frustum = prim.GetCamera(usd.TimeCode(round(time * stage.GetTimeCodesPerSecond(), 6))).frustum
        view = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        for point, pixel in points:
            x, y, _ = view.Transform(Gf.Vec3d(*point))
            assert ((x + 1) / 2 * width, (1 - y) / 2 * height) == pytest.approx(pixel, abs=1e-3)
