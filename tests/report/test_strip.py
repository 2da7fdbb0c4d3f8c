import cv2
import pytest
import torch

from cltransfer.report.strip import WIDTH, evenly, strip, write_strip


def clips(count=5):
    reference = torch.zeros(count, 3, 90, 160, dtype=torch.uint8)
    render = torch.zeros(count, 3, 120, 160, dtype=torch.uint8)
    for i in range(count):
        reference[i, 0], render[i, 2] = 40 * (i + 1), 40 * (i + 1)
    return reference, render, torch.arange(count) / 10


@pytest.mark.parametrize("count", [1, 2, 5, 24, 1000])
def test_evenly_has_both_ends_and_no_frame_twice(count):
    shown = evenly(count, 4)
    assert shown[0] == 0
    assert shown[-1] == count - 1
    assert len(shown) == len(set(shown)) == min(4, count)


def test_strip_stands_the_render_below_the_frame_of_its_time():
    reference, render, times = clips()
    picture = strip(reference, render, times, columns=3)
    assert picture.shape == (20 + 180 + 20 + 240, 3 * WIDTH + 2 * 4, 3)
    for column, frame in enumerate((0, 2, 4)):
        middle = column * (WIDTH + 4) + WIDTH // 2
        assert tuple(picture[110, middle]) == (40 * (frame + 1), 0, 0)
        assert tuple(picture[340, middle]) == (0, 0, 40 * (frame + 1))


def test_strip_writes_times_and_names():
    reference, render, times = clips()
    first, later = (strip(reference, render, times + shift, columns=2)[:20] for shift in (0, 1))
    assert (first[:, : WIDTH // 2] == later[:, : WIDTH // 2]).all()
    assert first[:, : WIDTH // 2].max() > 200
    assert (first[:, WIDTH // 2 :] != later[:, WIDTH // 2 :]).any()


def test_a_strip_of_narrow_frames_is_no_taller_than_a_picture_can_be(tmp_path):
    narrow = torch.full((2, 3, 960, 4), 250, dtype=torch.uint8)
    picture = strip(narrow, narrow, torch.arange(2) / 10)
    assert picture.shape == (2 * (20 + 1280), 2 * WIDTH + 4, 3)
    assert (picture[20:1300, WIDTH // 2] == 250).all()
    write_strip(tmp_path / "strip.jpg", narrow, narrow, torch.arange(2) / 10)


def test_strip_refuses_clips_of_different_lengths():
    reference, render, times = clips()
    with pytest.raises(ValueError, match="expected equally many, got 5, 4, 5"):
        strip(reference, render[:4], times)


def test_write_strip_makes_a_jpeg_of_the_right_colours(tmp_path):
    write_strip(tmp_path / "strip.jpg", *clips())
    picture = cv2.imread(str(tmp_path / "strip.jpg"))[..., ::-1]
    assert picture.shape == (460, 5 * WIDTH + 4 * 4, 3)
    assert abs(picture[110, -WIDTH // 2].astype(int) - [200, 0, 0]).max() < 12
