import math
from pathlib import Path

import numpy as np
import onnx
import onnx.compose
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from cltransfer.clips.clip import read_clip
from cltransfer.errors import UsageError
from cltransfer.extractors.detect_yolox import DetectYolox
from cltransfer.extractors.pose_blazepose import BODY, HIPS, PoseBlazepose, body_orientation, whole_bodies
from cltransfer.features import Features
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.registry import EXTRACTORS

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
NAN = math.nan
LEFT_SHOULDER, LEFT_WRIST, RIGHT_ANKLE = 0, 4, 11  # of the 14 joints
SIZE = (300, 260)


def world(left, up):
    """39 world landmarks of a body with its left and up along these axes."""
    points = np.zeros((39, 3), np.float32)
    left, up = np.array(left), np.array(up)
    points[[11, 23]], points[[12, 24]] = left / 2, -left / 2
    points[[11, 12]] += up
    return points


def offsets(up=(0.0, -50.0)):
    """Landmarks [px of the crop] about the red patch, with their visibility logits, (39, 5)."""
    table = np.zeros((39, 5), np.float32)
    table[:, 3] = 4
    table[11, :2], table[15, :4] = (30, -40), (60, 10, 0, -3)  # left shoulder, left wrist (hidden)
    table[28, :2] = (-20, 110)  # right ankle
    table[HIPS, :2], table[BODY, :2] = 0, up
    return table


def blazepose(path, table, points):
    """A network of BlazePose's shapes whose landmarks hang about the middle of what is red."""
    x, y = np.meshgrid(np.arange(256) + 0.5, np.arange(256) + 0.5)
    spread = np.zeros((2, 195), np.float32)  # the middle (x, y) moves every landmark
    spread[0, 0::5], spread[1, 1::5] = 1, 1
    arrays = {
        "redness": np.array([1, -0.5, -0.5], np.float32).reshape(1, 3, 1, 1),
        "grid": np.stack([x, y])[None].astype(np.float32),
        "spread": spread,
        "table": table.reshape(1, 195),
        "world": points.reshape(1, 117),
        "heat": np.zeros((1, 39, 64, 64), np.float32),
        "one": np.float32([[1]]),
        "few": np.float32([[1e-6]]),
        "gain": np.float32(20),
        "level": np.float32(10),
    }
    weights = [numpy_helper.from_array(np.asarray(v), n) for n, v in arrays.items()]
    weights.append(numpy_helper.from_array(np.array([2, 3]), "axes"))
    node = helper.make_node
    nodes = [
        node("Conv", ["input", "redness"], ["signed"]),
        node("Relu", ["signed"], ["red"]),
        node("ReduceSum", ["red", "axes"], ["all"], keepdims=0),
        node("Mul", ["red", "grid"], ["moment"]),
        node("ReduceSum", ["moment", "axes"], ["first"], keepdims=0),
        node("Add", ["all", "few"], ["some"]),
        node("Div", ["first", "some"], ["middle"]),
        node("MatMul", ["middle", "spread"], ["moved"]),
        node("Add", ["moved", "table"], ["output0"]),
        node("Min", ["all", "one"], ["output1"]),
        node("Mul", ["red", "gain"], ["steep"]),
        node("Sub", ["steep", "level"], ["output2"]),
        node("Identity", ["heat"], ["output3"]),
        node("Identity", ["world"], ["output4"]),
    ]
    shapes = {"output0": [1, 195], "output1": [1, 1], "output2": [1, 1, 256, 256]}
    shapes |= {"output3": [1, 39, 64, 64], "output4": [1, 117]}
    outputs = [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in shapes.items()]
    image = helper.make_tensor_value_info("input", TensorProto.FLOAT, [1, 3, 256, 256])
    graph = helper.make_graph(nodes, "blazepose", [image], outputs, weights)
    onnx.save_model(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))


@pytest.fixture
def planted(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))

    def build(table=None, points=None, **options):
        table = offsets() if table is None else table
        blazepose(tmp_path / "planted.onnx", table, world((1, 0, 0), (0, -1, 0)) if points is None else points)
        return PoseBlazepose(model="planted.onnx", **options)

    return build


def frames(*middles, size=SIZE, box=(50.0, 20.0, 80.0, 160.0)):
    """One frame per middle of a red square of 12 px on grey, None for none; all share one person box."""
    image = torch.full((len(middles), 3, size[1], size[0]), 0.4)
    for frame, middle in zip(image, middles):
        if middle is not None:
            x, y = middle
            frame[:, y - 6 : y + 6, x - 6 : x + 6] = torch.tensor([1.0, 0, 0])[:, None, None]
    return Features(size, image=image, box=torch.tensor([[*box, 0.9]]).repeat(len(middles), 1))


def test_joints_come_back_from_the_crop_to_the_frame(planted):
    joints = planted(second_crop=False)(frames((100, 90))).keypoints
    scale = 160 * 1.25 / 256  # px of the frame in one of the crop
    expected = torch.tensor([[100 + 30 * scale, 90 - 40 * scale], [100 + 60 * scale, 90 + 10 * scale]])
    torch.testing.assert_close(joints[0, [LEFT_SHOULDER, LEFT_WRIST], :2], expected, atol=0.05, rtol=0)
    confidence = torch.tensor([1 / (1 + math.exp(-4)), 1 / (1 + math.exp(3))])
    torch.testing.assert_close(joints[0, [LEFT_SHOULDER, LEFT_WRIST], 2], confidence)


def test_it_gives_what_it_is_asked_for(planted):
    got = planted(give=("orientation", "keypoints"))(frames((100, 90)))
    assert got.names() == {"image", "box", "keypoints", "orientation"}
    built = EXTRACTORS.build("pose_blazepose", {"give": ["orientation"]})
    assert built.provides == ("orientation",)
    for wrong in ([], ["flow"]):
        with pytest.raises(UsageError, match="give must be some of"):
            EXTRACTORS.build("pose_blazepose", {"give": wrong})


def test_the_mask_covers_the_red_pixels(planted):
    features = frames((100, 90))
    got = planted(second_crop=False)(features).subject[0]
    red = features.image[0, 1] == 0
    assert (got & red).sum() > 0.85 * (got | red).sum()


def test_a_joint_out_of_the_frame_keeps_its_place_and_is_not_visible(planted):
    features = frames((100, 98), size=(300, 170), box=(50.0, 20.0, 80.0, 140.0))
    joints = planted(second_crop=False)(features).keypoints
    scale = 140 * 1.25 / 256
    expected = torch.tensor([100 - 20 * scale, 98 + 110 * scale, 0.0])
    torch.testing.assert_close(joints[0, RIGHT_ANKLE], expected, atol=0.05, rtol=0)


def test_pixels_are_those_of_the_features_size(planted):
    small = frames((100, 90))
    large = Features((600, 520), image=small.image, box=small.box * 2)
    pose = planted(second_crop=False)
    torch.testing.assert_close(pose(large).keypoints[..., :2], 2 * pose(small).keypoints[..., :2])


def test_the_second_crop_stands_a_lying_body_upright(planted):
    """The first look sees the body point right; in the second look right is up, and all turns back with it."""
    features = frames((140, 110), box=(90.0, 60.0, 100.0, 100.0))
    got = planted(offsets(up=(50.0, 0.0)), second_crop=True)(features)
    side = 2 * 1.25 * 50 * (100 * 1.25 / 256)  # of the second crop
    shoulder = torch.tensor([140 + 40 * side / 256, 110 + 30 * side / 256])  # (30, -40) turned clockwise
    torch.testing.assert_close(got.keypoints[0, LEFT_SHOULDER, :2], shoulder, atol=0.2, rtol=0)
    torch.testing.assert_close(torch.rad2deg(got.orientation[0]), torch.tensor([0.0, 0, 90]), atol=1e-3, rtol=0)
    assert planted(second_crop=True).passes == 2
    assert planted(second_crop=False).passes == 1


def test_frames_without_box_or_person_are_nan_and_the_others_as_alone(planted):
    features = frames((100, 90), None, (100, 90), (90, 100))
    features.box[2] = NAN
    for second_crop in (False, True):
        pose = planted(second_crop=second_crop)
        got = pose(features)
        assert got.keypoints[1:3].isnan().all()
        assert got.orientation[1:3].isnan().all()
        assert not got.subject[1:3].any()
        for i in (0, 3):
            alone = pose(features[i])
            for name in ("keypoints", "orientation", "subject"):
                assert torch.equal(got.require(name)[i : i + 1], alone.require(name))


def test_no_person_at_all_is_nan_everywhere(planted):
    features = frames(None, None)
    got = planted()(features)
    assert got.keypoints.isnan().all()
    assert got.keypoints.shape == (2, 14, 3)
    features.box[:] = NAN
    assert planted()(features).orientation.isnan().all()


@pytest.mark.parametrize(
    ("left", "up", "degrees"),
    [
        ((1, 0, 0), (0, -1, 0), (0, 0, 0)),
        ((0, 0, -1), (0, -1, 0), (90, 0, 0)),  # its left towards the camera: the camera is on its left
        ((0, 0, 1), (0, -1, 0), (-90, 0, 0)),
        ((1, 0, 0), (0, -0.8, -0.6), (0, 36.87, 0)),  # head towards the camera: seen from above
        ((0.8, 0.6, 0), (0.6, -0.8, 0), (0, 0, 36.87)),  # leans right in the image
    ],
)
def test_orientation_has_the_signs_of_the_features(left, up, degrees):
    got = torch.rad2deg(body_orientation(torch.from_numpy(world(left, up))[None])[0])
    torch.testing.assert_close(got, torch.tensor(degrees, dtype=torch.float32), atol=0.01, rtol=0)


def test_a_box_cut_by_the_lower_edge_goes_on_to_the_feet():
    boxes = np.array([[0, 20, 40, 79.0], [0, 20, 40, 60], [0, 10, 20, 89]])
    np.testing.assert_array_equal(whole_bodies(boxes, 100)[:, 3], [120, 60, 89])


@pytest.mark.parametrize(
    ("box", "height"),
    [
        ([0, 700, 1400, 300], 300),  # lies along the lower edge
        ([300, 400, 900, 600], 2700),  # sits at a table that cuts it
        ([0, 0, 2390, 1000], 7170),  # fills the frame
    ],
)
def test_a_body_that_lies_at_the_lower_edge_is_not_taken_for_a_standing_one(box, height):
    assert whole_bodies(np.array([box], float), 1000)[0, 3] == height


def test_a_box_is_doubted_unless_every_box_has_a_person():
    steps = [Step("pose_blazepose", PoseBlazepose(min_presence=presence)) for presence in (0.5, 0.01, 0.0)]
    guessed = [Plan((step,), frozenset(), frozenset(), {}).doubts_boxes for step in steps]
    assert guessed == [True, True, False]


def test_options_out_of_range_are_refused():
    with pytest.raises(ValueError, match="min_presence"):
        PoseBlazepose(min_presence=-0.1)


@pytest.mark.needs(
    "models/yolox_nano.onnx", "models/mp_pose_landmark_lite.onnx", "video/lp_s20.mp4", "video/sav_05_juggle.mp4"
)
class TestRealWeights:
    def read(self, monkeypatch, name, frames):
        monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
        features = DetectYolox()(read_clip(DATA / "video" / name, frames=frames).features())
        return PoseBlazepose()(features)

    def test_a_medium_shot_has_head_above_shoulders_above_hips_in_every_frame(self, monkeypatch):
        got = self.read(monkeypatch, "lp_s20.mp4", 5)
        y = got.keypoints[..., 1]
        head, shoulders, hips = y[:, 12], y[:, :2].mean(1), y[:, 6:8].mean(1)
        assert ((shoulders - head > 150) & (hips - shoulders > 250)).all()
        assert (got.keypoints[:, 0, 0] > got.keypoints[:, 1, 0] + 100).all()  # she faces us
        assert (torch.rad2deg(got.orientation).abs() < 25).all()
        assert (got.subject.float().mean((1, 2)) > 0.25).all()

    def test_a_full_figure_has_ankles_below_knees_below_hips(self, monkeypatch):
        got = self.read(monkeypatch, "sav_05_juggle.mp4", 4)
        y = got.keypoints[:3, :, 1]  # he still stands on both feet
        hips, knees, ankles = y[:, 6:8].mean(1), y[:, 8:10].mean(1), y[:, 10:12].mean(1)
        assert ((knees - hips > 50) & (ankles - knees > 50)).all()
        assert (got.keypoints[:3, :, 2] > 0.5).float().mean() > 0.9
        assert (torch.rad2deg(got.orientation[:3, 0]).abs() < 20).all()
        inside = got.subject[:3].float().sum((1, 2)) / (got.box[:3, 2] * got.box[:3, 3])
        assert ((inside > 0.3) & (inside < 0.8)).all()

    def test_people_seen_from_behind_turn_their_back_and_empty_frames_are_nan(self, monkeypatch):
        got = self.read(monkeypatch, "intel_one_by_one_person.mp4", 12)
        empty = [0, 7, 11]
        assert got.orientation[empty].isnan().all()
        assert got.keypoints[empty].isnan().all()
        assert not got.subject[empty].any()
        seen = [i for i in range(12) if i not in empty]
        assert (torch.rad2deg(got.orientation[seen, 0]).abs() > 150).all()

    def test_the_same_network_with_channels_last_and_other_names_reads_the_same(self, monkeypatch, tmp_path):
        """As tf2onnx leaves it, and OpenCV publishes it."""
        network = onnx.load(str(DATA / "models" / "mp_pose_landmark_lite.onnx"))
        onnx.save_model(as_tf2onnx_leaves_it(network), str(tmp_path / "other.onnx"))
        monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
        features = DetectYolox()(read_clip(DATA / "video" / "sav_05_juggle.mp4", frames=2).features())
        ours, other = PoseBlazepose()(features), PoseBlazepose(model=str(tmp_path / "other.onnx"))(features)
        for name in ("keypoints", "subject", "orientation"):
            torch.testing.assert_close(getattr(other, name), getattr(ours, name), rtol=0, atol=0)


def as_tf2onnx_leaves_it(network):
    """``network`` with images channels last, and TensorFlow's names."""
    graph = onnx.compose.add_prefix(network, "own_").graph
    image, outputs = graph.input[0], list(graph.output)
    turn = helper.make_node("Transpose", ["input_1"], [image.name], perm=(0, 3, 1, 2))
    nodes, given = [turn, *graph.node], []
    for number, output in enumerate(outputs):
        name = f"Identity_{number}" if number else "Identity"
        shape = [d.dim_value for d in output.type.tensor_type.shape.dim]
        if len(shape) == 4:
            nodes.append(helper.make_node("Transpose", [output.name], [name], perm=(0, 2, 3, 1)))
            shape = [shape[i] for i in (0, 2, 3, 1)]
        else:
            nodes.append(helper.make_node("Identity", [output.name], [name]))
        given.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))
    fed = [helper.make_tensor_value_info("input_1", TensorProto.FLOAT, [1, 256, 256, 3])]
    made = helper.make_graph(nodes, "tf2onnx", fed, given, graph.initializer)
    return helper.make_model(made, opset_imports=network.opset_import, ir_version=network.ir_version)
