import numpy as np
import pytest
import torch

from cltransfer.computer import memory
from cltransfer.errors import ModelError, ResourceError
from cltransfer.extractors._pixels import MOST
from cltransfer.extractors.segment_yolo import Letterbox, SegmentYolo, main_person
from cltransfer.features import Features
from cltransfer.pipeline.plan import make_plan
from cltransfer.reading.frames import clip_features, read_frames, render_features
from cltransfer.testing import ExtractorCase
from cltransfer.testing.samples import sample_cameras, sample_subject

SIDE, CLASSES = 128, 3


@pytest.fixture
def planted(network, node):
    """YOLOv8-seg at 128 px: a person of 40 x 64 px about each red cell of stride 8; its mask is what is blue."""

    def build(batch="batch", **options):
        y, x = np.mgrid[:16, :16] * 8 + 4.0
        cells = np.stack([x.ravel(), y.ravel(), np.full(256, 40.0), np.full(256, 64.0)])
        rest = np.zeros((1, 4 + CLASSES + 32, 80), np.float32)  # strides 16 and 32 see nothing
        coefficients = np.zeros((1, 32, 256), np.float32)
        coefficients[:, 3] = 1
        prototypes = np.zeros((32, 3, 1, 1), np.float32)
        prototypes[3, :, 0, 0] = -10, -10, 20
        level = np.zeros(32, np.float32)
        level[3] = -10
        constants = {
            "red": np.float32([1, -0.5, -0.5]).reshape(1, 3, 1, 1),
            "boxes": cells[None].astype(np.float32),
            "others": np.zeros((1, CLASSES - 1, 256), np.float32),
            "coefficients": coefficients,
            "rest": rest,
            "prototypes": prototypes,
            "level": level,
            "row": np.array([1, 1, 256]),
        }
        nodes = [
            node("Conv", "images red", "redness"),
            node("AveragePool", "redness", "cells", kernel_shape=[8, 8], strides=[8, 8]),
            node("Reshape", "cells row", "person"),
            node("Concat", "boxes person others coefficients", "small", axis=1),
            node("Concat", "small rest", "output0", axis=2),
            node("AveragePool", "images", "quarter", kernel_shape=[4, 4], strides=[4, 4]),
            node("Conv", "quarter prototypes level", "output1"),
        ]
        outputs = {"output0": [1, 4 + CLASSES + 32, 336], "output1": [1, 32, SIDE // 4, SIDE // 4]}
        return SegmentYolo(network(nodes, {"images": [1, 3, SIDE, SIDE]}, outputs, constants), SIDE, **options)

    return build


@pytest.mark.parametrize("side", [0, 31, 100, MOST + 32, 2**40])
def test_a_side_that_no_network_has_is_refused(side):
    with pytest.raises(ValueError, match=f"side must be a multiple of 32 from 32 to 4096, got {side}"):
        SegmentYolo("a.onnx", side)
    assert SegmentYolo("a.onnx", MOST).side == MOST


def test_squares_are_held_against_the_memory(planted, monkeypatch):
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError, match=r"memory: frames at 128x128 for the network need 2 MB"):
        planted()(Features((64, 48), image=torch.zeros(3, 3, 48, 64)))


def scene(size, cell, person=True):
    """A frame of ``size`` whose cell (x, y) of the letterboxed square is red, on a blue right half.

    Gives the frame, the box that is planted and the mask: what is blue of that box.
    """
    frame = Letterbox(SIDE, size)
    scale, corner = np.array(size) / np.array(frame.size), np.array(frame.corner)
    image = torch.full((1, 3, size[1], size[0]), 0.4)
    half = size[0] // 2
    image[:, :, :, half:] = torch.tensor([0, 0, 1.0])[:, None, None]
    low = np.floor((8 * np.array(cell) - corner) * scale).astype(int)
    high = np.ceil((8 * np.array(cell) + 8 - corner) * scale).astype(int)
    if person:
        image[:, :, low[1] : high[1], low[0] : high[0]] = torch.tensor([1.0, 0, 0])[:, None, None]
    box = np.append((8 * np.array(cell) + 4 - [20, 32] - corner) * scale, np.array([40, 64]) * scale)
    x, y = np.arange(size[0]) + 0.5, np.arange(size[1])[:, None] + 0.5
    mask = (x >= half) & (x > box[0]) & (x < box[0] + box[2]) & (y > box[1]) & (y < box[1] + box[3])
    mask[low[1] : high[1], low[0] : high[0]] &= not person
    return image, torch.tensor(box).float(), torch.tensor(mask)


SCENES = [((256, 256), (8, 8)), ((400, 225), (9, 7)), ((150, 300), (8, 9)), ((97, 131), (7, 8))]


@pytest.mark.parametrize(("size", "cell"), SCENES)
def test_a_planted_person_is_found_wherever_the_letterbox_puts_it(planted, size, cell):
    image, box, mask = scene(size, cell)
    got = planted()(Features(size, image=image))
    torch.testing.assert_close(got.box[0, :4], box, atol=0.01, rtol=0)
    assert got.box[0, 4] > 0.85
    assert (got.subject[0] & mask).sum() > 0.93 * (got.subject[0] | mask).sum()


def test_box_is_in_pixels_of_the_features_size_and_the_mask_in_those_of_the_image(planted):
    image, box, mask = scene((400, 225), (9, 7))
    got = planted()(Features((800, 675), image=image))
    torch.testing.assert_close(got.box[0, :4], box * torch.tensor([2, 3, 2, 3]), atol=0.02, rtol=0)
    assert got.subject.shape == (1, *mask.shape)


def test_frames_without_a_person_are_nan_and_empty_and_the_others_as_alone(planted):
    image, _, _ = scene((400, 225), (9, 7))
    nobody, _, _ = scene((400, 225), (9, 7), person=False)
    got = planted()(Features((400, 225), image=torch.cat([nobody, image, nobody])))
    assert got.box[[0, 2]].isnan().all()
    assert not got.subject[[0, 2]].any()
    alone = planted()(Features((400, 225), image=image))
    assert torch.equal(got.box[1:2], alone.box)
    assert torch.equal(got.subject[1:2], alone.subject)


def two_people():
    """A blue frame of one person in the upper left, and of another in the middle, who is less sure."""
    image = torch.zeros(1, 3, SIDE, SIDE, dtype=torch.uint8)
    image[:, 2] = 255
    for cell, red in (((2, 3), 255), ((8, 8), 204)):
        column, row = (slice(8 * i, 8 * i + 8) for i in cell)
        image[:, :, row, column] = torch.tensor([red, 0, 0])[:, None, None]
    return image, torch.tensor([[0, -4, 40, 64], [48, 36, 40, 64.0]])


def plan_of(extractor):
    return make_plan(frozenset({"box", "subject"}), {"segment_yolo": extractor}, frozenset({"image"}), "image")


def test_all_persons_are_told_and_one_is_followed(planted):
    image, boxes = two_people()
    plan, frames = plan_of(planted()), image.expand(3, -1, -1, -1)
    (found,) = planted().persons(Features((SIDE, SIDE), image=image.float() / 255))
    np.testing.assert_allclose(found, [[*boxes[0], 1.0], [*boxes[1], 0.8]], atol=0.01)
    for who in (0, 1):
        features, _ = read_frames(frames, plan, who)
        torch.testing.assert_close(features.box[:, :4], boxes[who].expand(3, 4), atol=0.01, rtol=0)
        x, y = (features.subject[0].any(i).nonzero()[:, 0] for i in (0, 1))
        low, high = boxes[who, :2].clamp_min(0), boxes[who, :2] + boxes[who, 2:]
        assert [int(x[0]), int(y[0]), int(x[-1]) + 1, int(y[-1]) + 1] == [*low.int().tolist(), *high.int().tolist()]
    assert (plan.passes, plan.clip_passes) == (1, 2)


def test_of_a_render_the_filmed_person_is_read_though_another_is_surer(planted):
    image, boxes = two_people()
    camera, plan = sample_cameras(0, 1, (SIDE, SIDE)), plan_of(planted())
    features = render_features(image, camera, sample_subject(), plan)
    torch.testing.assert_close(features.box[0, :4], boxes[1], atol=0.01, rtol=0)
    torch.testing.assert_close(clip_features(image, plan).box[0, :4], boxes[0], atol=0.01, rtol=0)


def test_a_box_that_shows_nobody_has_no_pixels(planted):
    image = two_people()[0]
    for given in (torch.full((1, 5), torch.nan), torch.tensor([[90.0, 90, 30, 30, 1]])):
        got = planted()(Features((SIDE, SIDE), image=image.float() / 255, box=given))
        assert torch.equal(got.box.nan_to_num(), given.nan_to_num())
        assert not got.subject.any()


def columns(*people):
    """Raw output of boxes (centre x, y, width, height), each with its three class scores."""
    raw = np.zeros((4 + CLASSES + 32, len(people)), np.float32)
    for column, (box, scores) in enumerate(people):
        raw[:4, column], raw[4 : 4 + CLASSES, column] = box, scores
    return raw


def test_of_overlapping_boxes_the_surest_stays_and_of_the_rest_the_largest_times_score():
    sure, larger = ((50, 50, 40, 80), (0.9, 0, 0)), ((50, 50, 44, 84), (0.85, 0, 0))
    far = ((110, 50, 20, 40), (0.95, 0, 0))
    assert main_person(columns(larger, sure, far), 0.25, 0.7) == 1
    assert main_person(columns(larger, sure, far), 0.25, 1.0) == 0  # nothing is suppressed
    assert main_person(columns(sure, far), 0.92, 0.7) == 1


def test_scores_that_are_all_0_are_nobody_even_where_that_is_enough():
    raw = np.zeros((4 + CLASSES + 32, 3), np.float32)
    raw[:4] = np.float32([40, 40, 20, 30])[:, None]
    assert main_person(raw, 0.0, 0.5) is None


def test_overlap_is_that_of_boxes_about_their_centres():
    sure, larger = ((50, 50, 40, 80), (0.9, 0, 0)), ((70, 50, 80, 80), (0.8, 0, 0))  # 30-70 and 30-110: half
    assert main_person(columns(sure, larger), 0.25, 0.45) == 0
    assert main_person(columns(sure, larger), 0.25, 0.55) == 1


def test_a_box_that_is_surer_of_another_class_is_no_person():
    dog, person = ((50, 50, 90, 90), (0.5, 0.8, 0)), ((50, 50, 20, 40), (0.4, 0.3, 0))
    assert main_person(columns(dog, person), 0.25, 0.7) == 1
    assert main_person(columns(dog), 0.25, 0.7) is None


def test_options_and_foreign_networks_are_refused(planted):
    for wrong in ({"side": 100}, {"min_score": 1.5}, {"max_overlap": -0.1}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            SegmentYolo("a.onnx", **wrong)
    other = SegmentYolo(planted().model, 640)
    with pytest.raises(ModelError, match="input images"):
        other(Features((64, 64), image=torch.zeros(1, 3, 64, 64)))


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted(min_score=0.05)


@pytest.mark.parametrize("shape", [[1, 300, 38], [1, 336, 39], [1, 36, 336]], ids=["after NMS", "turned", "no classes"])
def test_another_layout_of_the_boxes_is_refused(network, node, shape):
    nodes = [
        node("ReduceMean", "images", "mean", keepdims=0),
        node("Mul", "mean ones", "output0"),
        node("Mul", "mean level", "output1"),
    ]
    constants = {"ones": np.ones(shape, np.float32), "level": np.ones((1, 32, 32, 32), np.float32)}
    outputs = {"output0": shape, "output1": [1, 32, 32, 32]}
    found = SegmentYolo(network(nodes, {"images": [1, 3, SIDE, SIDE]}, outputs, constants), SIDE)
    with pytest.raises(ModelError, match=r"output0: expected \(B, 4 \+ classes \+ 32, 336\), got .*nms=False"):
        found(Features((64, 64), image=torch.rand(1, 3, 64, 64)))
