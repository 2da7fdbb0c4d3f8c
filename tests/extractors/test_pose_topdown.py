import numpy as np
import pytest
import torch

from cltransfer.computer import memory
from cltransfer.errors import ModelError, ResourceError
from cltransfer.extractors._pixels import MOST
from cltransfer.extractors.pose_topdown import PoseTopdown
from cltransfer.features import Features
from cltransfer.testing import ExtractorCase

WIDTH, HEIGHT = 192, 256
RED, GREEN, BLUE = 0, 6, 12  # which of the network's joints sits on which colour
MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])


def colours(joints):
    """1x1 convolution that undoes the normalisation: joint RED is how red a pixel is, and so on."""
    weight, bias = np.zeros((joints, 3, 1, 1), np.float32), np.zeros(joints, np.float32)
    for channel, joint in enumerate((RED, GREEN, BLUE)):
        mix = np.full(3, -0.5)
        mix[channel] = 1
        weight[joint, :, 0, 0], bias[joint] = mix * STD, (mix * MEAN).sum()
    return {"colour": weight, "level": bias}


def bump(joints, sigma, radius):
    """A Gaussian for each joint by itself, (joints, 1, n, n), whose answer to a square of 12 px is about 1."""
    axis = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    return np.tile((np.outer(axis, axis) / 130).astype(np.float32), (joints, 1, 1, 1))


@pytest.fixture
def planted(network, node):
    def build(decode, joints="crowdpose", batch="batch", **options):
        count = 17 if joints == "coco" else 14
        constants = {**colours(count), "bump": bump(count, 8, 20)}
        nodes = [node("Conv", "input colour level", "signed"), node("Relu", "signed", "seen")]
        stride = 4 if decode in ("quarter", "dark") else 1  # heatmap cell i is centred on pixel 4 i
        smooth = {"pads": [20, 20, 20, 20], "strides": [stride, stride], "group": count}
        nodes.append(node("Conv", "seen bump", "maps", **smooth))
        outputs = {"output": [batch, count, 64, 48]}
        if decode == "simcc":
            constants |= {"rows": np.array([2]), "columns": np.array([3])}
            constants |= {"none": np.float32([]), "twice": np.float32([1, 1, 2])}
            nodes += [
                node("ReduceMax", "maps rows", "x", keepdims=0),
                node("ReduceMax", "maps columns", "y", keepdims=0),
            ]
            how = {"mode": "linear", "coordinate_transformation_mode": "asymmetric"}  # bin i is pixel i / 2
            nodes += [node("Resize", f"{axis} none twice", f"simcc_{axis}", **how) for axis in "xy"]
            outputs = {"simcc_x": [batch, count, 2 * WIDTH], "simcc_y": [batch, count, 2 * HEIGHT]}
        elif decode == "udp":
            constants |= {"none": np.float32([]), "part": np.float32([1, 1, 64 / 256, 48 / 192])}
            nodes.append(
                node(
                    "Resize", "maps none part", "output", coordinate_transformation_mode="align_corners", mode="linear"
                )
            )
        else:
            nodes[-1].output[0] = "output"
        model = network(nodes, {"input": [batch, 3, HEIGHT, WIDTH]}, outputs, constants)
        return PoseTopdown(model, decode, joints, **options)

    return build


def frames(*places, size=(300, 260), box=(60.0, 20.0, 90.0, 200.0)):
    """One frame for each triple of places (x, y): squares of 12 px, red, green and blue, on grey."""
    image = torch.full((len(places), 3, size[1], size[0]), 0.4)
    for frame, triple in zip(image, places):
        for channel, (x, y) in enumerate(triple):
            frame[:, y - 6 : y + 6, x - 6 : x + 6] = torch.eye(3)[channel][:, None, None]
    return Features(size, image=image, box=torch.tensor([[*box, 0.9]]).repeat(len(places), 1))


THREE = [(80, 60), (125, 110), (104, 190)]
OTHER = [(100, 200), (90, 40), (130, 140)]


@pytest.mark.parametrize(("decode", "within"), [("quarter", 2.0), ("dark", 0.3), ("udp", 0.3), ("simcc", 0.5)])
@pytest.mark.parametrize("batch", ["batch", 1])
def test_planted_joints_come_back_from_the_crop_to_the_frame(planted, decode, within, batch):
    joints = planted(decode, batch=batch)(frames(THREE, OTHER)).keypoints
    found = joints[:, [RED, GREEN, BLUE]]
    torch.testing.assert_close(found[..., :2], torch.tensor([THREE, OTHER]).float(), atol=within, rtol=0)
    assert (found[..., 2] > 0.6).all()
    assert (joints[:, [1, 5, 13], 2] == 0).all()  # joints of no colour


def test_dark_and_udp_find_the_middle_to_a_tenth_of_a_pixel(planted):
    for decode in ("dark", "udp"):
        found = planted(decode)(frames(THREE)).keypoints[0, [RED, GREEN, BLUE], :2]
        assert (found - torch.tensor(THREE)).abs().mean() < 0.1


def test_a_wide_box_and_another_input_size_are_fitted_to_the_aspect(planted):
    features = frames([(60, 100), (150, 140), (230, 90)], box=(40.0, 60.0, 210.0, 100.0))
    found = planted("dark")(features).keypoints[0, [RED, GREEN, BLUE], :2]
    torch.testing.assert_close(found, torch.tensor([(60.0, 100), (150, 140), (230, 90)]), atol=0.4, rtol=0)


def test_coco_joints_become_the_fourteen(planted):
    joints = planted("dark", "coco")(frames(THREE)).keypoints[0]
    # COCO 6 is the right shoulder, ours 1; COCO 12 the right hip, ours 7
    torch.testing.assert_close(joints[[1, 7], :2], torch.tensor(THREE[1:]).float(), atol=0.3, rtol=0)
    assert joints.shape == (14, 3)


def test_joints_are_in_pixels_of_the_features_size(planted):
    small = frames(THREE)
    large = Features((600, 780), image=small.image, box=small.box * torch.tensor([2, 3, 2, 3, 1]))
    found = planted("dark")(large).keypoints[0, [RED, GREEN, BLUE], :2]
    torch.testing.assert_close(found, torch.tensor(THREE) * torch.tensor([2.0, 3.0]), atol=0.8, rtol=0)


def test_a_frame_without_a_box_is_nan(planted):
    features = frames(THREE, OTHER)
    features.box[0] = torch.nan
    joints = planted("quarter")(features).keypoints
    assert joints[0].isnan().all()
    assert joints[1].isfinite().all()


def test_options_and_networks_of_other_joints_are_refused(planted):
    for wrong in ({"decode": "argmax"}, {"joints": "mpii"}, {"width": 4}, {"margin": 0.5}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            PoseTopdown(**{"model": "a.onnx", "decode": "dark", "joints": "coco", **wrong})
    coco = planted("dark", "coco")
    with pytest.raises(ModelError, match="expected shape"):
        PoseTopdown(coco.model, "dark", "crowdpose")(frames(THREE))
    with pytest.raises(ModelError, match="expected simcc_x, simcc_y"):
        PoseTopdown(coco.model, "simcc", "coco")(frames(THREE))


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted("dark")


@pytest.mark.parametrize("size", [(7, 256), (192, 7), (MOST + 1, 256), (192, 2**40)])
def test_a_size_that_no_network_has_is_refused(size):
    with pytest.raises(ValueError, match=f"width and height must be 8 to 4096, got {size[0]} and {size[1]}"):
        PoseTopdown("a.onnx", "udp", "coco", *size)
    assert PoseTopdown("a.onnx", "udp", "coco", MOST, 8).width == MOST


def test_crops_are_held_against_the_memory(planted, monkeypatch):
    box = torch.tensor([[2.0, 2, 20, 40, 1]])
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError, match=r"memory: frames at 256x256 for the network need 2 MB"):
        planted("udp")(Features((64, 48), image=torch.zeros(1, 3, 48, 64), box=box))
