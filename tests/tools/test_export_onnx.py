"""Stand-ins for the packages that build the real networks go through the tool's own path."""

from __future__ import annotations

import importlib.util
import pickle
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import onnxruntime
import pytest
import torch
from torch import Tensor, nn

from cltransfer.errors import InputError, ModelError
from cltransfer.extractors.depth_onnx import DepthOnnx
from cltransfer.extractors.flow_raft import FlowRaft
from cltransfer.extractors.orient_anything import OrientAnything
from cltransfer.extractors.pose_topdown import PoseTopdown
from cltransfer.features import Features

TOOL = Path(__file__).resolve().parents[2] / "tools" / "export_onnx.py"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("export_onnx", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def package(monkeypatch, tmp_path):
    """Make an importable package of one module with these names in it."""
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    made: list[str] = []

    def build(dotted: str, **names: object) -> None:
        folder = tmp_path / "packages"
        for part in dotted.split("."):
            folder = folder / part
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "__init__.py").touch()
        importlib.invalidate_caches()
        vars(importlib.import_module(dotted)).update(names)
        made.append(dotted.split(".")[0])

    yield build
    for loaded in [name for name in sys.modules if name.split(".")[0] in made]:
        del sys.modules[loaded]


class Shift(nn.Module):
    """Called like torchvision's RAFT: a list of flows, the last of which is ten times the change of red."""

    def __init__(self) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.zeros(()))

    def forward(self, image1: Tensor, image2: Tensor, num_flow_updates: int = 3) -> list[Tensor]:
        change = self.gain * (image2 - image1)[:, :2]
        return [0 * change] * (num_flow_updates - 1) + [change]


def test_raft_is_scaled_to_its_own_range_and_read_by_the_extractor(tool, package, tmp_path, monkeypatch, capsys):
    package("torchvision.models.optical_flow", raft_large=Shift, raft_small=Shift)
    torch.save({"gain": torch.tensor(10.0)}, tmp_path / "raft.pth")
    sizes = ["--height", "128", "--width", "136"]
    assert tool.main(["raft", str(tmp_path / "raft.pth"), str(tmp_path / "raft.onnx"), *sizes]) == 0
    assert "sha256" in capsys.readouterr().out
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    now, before = torch.full((2, 3, 128, 136), 0.2), torch.full((2, 3, 128, 136), 0.4)
    extractor = FlowRaft("raft.onnx", height=128, width=136, check=False)
    flow = extractor(Features((136, 128), image=now), Features((136, 128), image=before)).flow
    torch.testing.assert_close(flow, torch.full_like(flow, 10 * 2 * 0.2), atol=1e-3, rtol=0)


class Poses(nn.Module):
    """Built like mmpose's estimators; the head knows of 14 joints."""

    def __init__(self, simcc: bool) -> None:
        super().__init__()
        self.backbone = nn.Conv2d(3, 14, 1)
        self.head = Distributions() if simcc else nn.AvgPool2d(4)


class Distributions(nn.Module):
    def forward(self, maps: Tensor) -> tuple[Tensor, Tensor]:
        return maps.amax(2).repeat_interleave(2, 2), maps.amax(3).repeat_interleave(2, 2)


@pytest.mark.parametrize(("network", "decode"), [("hrnet", "quarter"), ("rtmpose", "simcc")])
def test_mmpose_networks_get_our_names(tool, package, tmp_path, monkeypatch, network, decode):
    built = Poses(simcc=decode == "simcc")
    package("mmpose.apis", init_model=lambda config, checkpoint, device: built)
    torch.save({"meta": {"epoch": 3}, "state_dict": built.state_dict()}, tmp_path / "net.pth")
    arguments = [network, str(tmp_path / "net.pth"), str(tmp_path / "net.onnx")]
    assert tool.main(arguments) == 3  # no config named
    assert tool.main([*arguments, "--config", "any.py"]) == 0
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    features = Features((60, 80), image=torch.rand(2, 3, 80, 60), box=torch.tensor([[10.0, 10, 30, 60, 1]] * 2))
    assert PoseTopdown("net.onnx", decode, "crowdpose")(features).keypoints.isfinite().all()


class Red(nn.Module):
    def forward(self, pixel_values: Tensor) -> SimpleNamespace:
        return SimpleNamespace(
            predicted_depth=pixel_values[:, 0] + 3, last_hidden_state=pixel_values.flatten(2)[..., :384]
        )


def test_depth_is_read_by_the_extractor(tool, package, tmp_path, monkeypatch):
    asked = []

    def from_pretrained(folder: Path, **options: bool) -> nn.Module:
        asked.append(options)
        return Red()

    package("transformers", AutoModelForDepthEstimation=SimpleNamespace(from_pretrained=from_pretrained))
    sizes = ["--height", "28", "--width", "42"]
    assert tool.main(["depth_anything", str(tmp_path), str(tmp_path / "depth.onnx"), *sizes]) == 0
    assert asked == [{"local_files_only": True, "use_safetensors": True}]  # nothing fetched, nothing unpickled
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    features = Features((42, 28), image=torch.full((1, 3, 28, 42), 0.485))
    depth = DepthOnnx("depth.onnx", "depth", 42, 28)(features).depth
    torch.testing.assert_close(depth, torch.full((1, 28, 42), 3.0), atol=0.02, rtol=0)


def test_orient_anything_takes_its_shape_from_the_checkpoint(tool, package, tmp_path, monkeypatch):
    made = []

    def config(**values: int) -> dict[str, int]:
        made.append(values)
        return values

    package("transformers", Dinov2Config=config, Dinov2Model=lambda config: Red())
    state = tool.OrientAnything(Red(), 384, 902).state_dict()
    torch.save(state, tmp_path / "orient.pt")
    assert tool.main(["orient_anything", str(tmp_path / "orient.pt"), str(tmp_path / "orient.onnx")]) == 0
    assert (made[0]["hidden_size"], made[0]["num_hidden_layers"], made[0]["num_attention_heads"]) == (384, 12, 6)
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    image, subject = torch.rand(1, 3, 50, 50), torch.ones(1, 50, 50, dtype=torch.bool)
    features = OrientAnything("orient.onnx", min_confidence=0)(Features((50, 50), image=image, subject=subject))
    assert features.orientation.isfinite().all()


@pytest.mark.parametrize(
    ("state", "told"),
    [
        ({"loss": (1,), "gain": (2,)}, "no such tensor, but loss, gain"),
        ({}, "no such tensor, but none"),
        ({"NAME": (902, 1536)}, "(902, 1536)"),
        ({"NAME": (902,)}, "(902,)"),
    ],
)
def test_a_checkpoint_that_is_none_of_orient_anything_is_told_in_one_line(tool, package, tmp_path, capsys, state, told):
    layer = "down_sampler.net1.0.weight"
    package("transformers", Dinov2Config=dict, Dinov2Model=lambda config: Red())
    torch.save({name.replace("NAME", layer): torch.zeros(shape) for name, shape in state.items()}, tmp_path / "bad.pt")
    assert tool.main(["orient_anything", str(tmp_path / "bad.pt"), str(tmp_path / "orient.onnx")]) == 3
    said = f"{layer}: expected Orient Anything's (bins, 384 or 768 or 1024), got {told}"
    assert capsys.readouterr().err == f"error: {tmp_path / 'bad.pt'}: {said}\n"


class Forgetful(nn.Module):
    """What tracing cannot see: the answer to one image is not that to two."""

    def forward(self, image: Tensor) -> Tensor:
        return image if len(image) == 1 else 2 * image


def test_a_file_that_gives_something_else_than_torch_is_not_kept(tool, tmp_path):
    recipe = tool.Recipe(lambda options: Forgetful(), ("image",), ("same",), "torch", (8, 8))
    with pytest.raises(ModelError, match="differs from torch by"):
        tool.export(Forgetful(), recipe, (8, 8), tmp_path / "net.onnx")
    assert list(tmp_path.iterdir()) == []
    tool.export(Forgetful(), recipe, (8, 8), tmp_path / "one.onnx", most=1)
    shape = onnxruntime.InferenceSession(str(tmp_path / "one.onnx")).get_inputs()[0].shape
    assert shape == [1, 3, 8, 8]


class Runs:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (print, ("ran",))


def test_a_checkpoint_that_would_run_code_is_refused_and_runs_nothing(tool, tmp_path, capsys):
    for name, write in (("zip.pth", lambda path: torch.save(Runs(), path)), ("raw.pth", None)):
        path = tmp_path / name
        write(path) if write else path.write_bytes(pickle.dumps(Runs()))
        with pytest.raises(InputError, match="checkpoint") as caught:
            tool.weights(path)
        assert "\n" not in str(caught.value)
    assert capsys.readouterr().out == ""
    with pytest.raises(InputError, match="no such file"):
        tool.weights(tmp_path / "none.pth")
    for name, content in (("numbers", {"a": 1}), ("numbered", {1: torch.zeros(1)})):
        torch.save(content, tmp_path / f"{name}.pth")
        with pytest.raises(InputError, match="state dict of named tensors"):
            tool.weights(tmp_path / f"{name}.pth")


def test_other_weights_than_the_network_has_are_refused(tool, tmp_path):
    torch.save({"module.gain": torch.tensor(1.0)}, tmp_path / "good.pth")
    assert float(tool.load(Shift(), tmp_path / "good.pth").gain) == 1
    torch.save({"loss": torch.tensor(1.0)}, tmp_path / "bad.pth")
    with pytest.raises(InputError, match="Missing key"):
        tool.load(Shift(), tmp_path / "bad.pth")


def test_arguments_and_missing_packages_are_told_in_one_line(tool, tmp_path, capsys):
    assert tool.main(["hrnet", "net.pth", str(tmp_path / "net.onnx")]) == 4
    assert capsys.readouterr().err == "error: hrnet: mmpose: is not installed (pip install mmpose)\n"
    with pytest.raises(SystemExit) as caught:
        tool.main(["midas", "a", "b"])
    assert caught.value.code == 2
    options = tool.parser().parse_args(["raft", "a.pth", "b.onnx", "--width", "640", "--small"])
    assert (options.checkpoint, options.out, options.width, options.small) == (Path("a.pth"), Path("b.onnx"), 640, True)


def test_a_folder_that_cannot_be_made_or_holds_no_network_is_one_line(tool, package, tmp_path, capsys):
    def from_pretrained(folder: Path, **options: bool) -> nn.Module:
        if not folder.is_dir():
            raise OSError(f"{folder} is not a local folder\nand holds\nno config.json")
        return Red()

    package("transformers", AutoModelForDepthEstimation=SimpleNamespace(from_pretrained=from_pretrained))
    (tmp_path / "file").touch()
    for folder, out, code, line in (
        (tmp_path, tmp_path / "file" / "net.onnx", 5, f"error: {tmp_path / 'file'}: "),
        (tmp_path / "none", tmp_path / "net.onnx", 3, "none: checkpoint: "),
    ):
        assert tool.main(["depth_anything", str(folder), str(out), "--height", "28", "--width", "42"]) == code
        said = capsys.readouterr().err
        assert line in said
        assert said.count("\n") == 1
