#!/usr/bin/env python
"""Turn the public PyTorch checkpoints of the paper's networks into the ONNX files that cltransfer reads.

    python tools/export_onnx.py raft raft_large_C_T_SKHT_V2-ff5fadd5.pth raft_large.onnx --height 432 --width 768

A network is built by its own package, which has to be installed beside cltransfer (docs/models.md names them, and
the licences). A checkpoint is opened with weights_only=True: it can hold numbers and nothing that runs. The file is
kept only if onnxruntime gives what torch gives, for one image and, unless --one is given, for two.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from cltransfer.errors import CltransferError, InputError, ModelError, ResourceError
from cltransfer.models.onnx import Network
from cltransfer.storage.files import atomic, content_hash

OPSET = 17
TOLERANCE = 1e-3  # of the largest absolute value of an output


DINO = {384: (12, 6), 768: (12, 12), 1024: (24, 16)}  # width of DINOv2: its layers and heads


@dataclass(frozen=True)
class Recipe:
    """How one family is exported.

    Args:
        build: from the parsed arguments to a module that maps the inputs to the outputs.
        inputs: names of the inputs, each an image (B, 3, height, width).
        outputs: names of the outputs.
        package: what builds the network.
        size: default height and width [px].
    """

    build: Callable[[argparse.Namespace], nn.Module]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    package: str
    size: tuple[int, int]


class Wrapped(nn.Module):
    """A module that calls ``inner`` as ``forward`` says; its weights are those of ``inner``."""

    def __init__(self, inner: nn.Module, call: Callable[..., Tensor | tuple[Tensor, ...]]) -> None:
        super().__init__()
        self.inner, self.call = inner, call

    def forward(self, *images: Tensor) -> Tensor | tuple[Tensor, ...]:
        """Outputs of images (B, 3, H, W)."""
        return self.call(self.inner, *images)


class OrientAnything(nn.Module):
    """DINOv2 and two linear layers on its class token; the names are those of the authors' checkpoint."""

    def __init__(self, backbone: nn.Module, width: int, bins: int) -> None:
        super().__init__()
        self.dinov2 = backbone
        net1 = nn.Sequential(nn.Linear(width, bins), nn.BatchNorm1d(bins), nn.ReLU())
        net2 = nn.Sequential(nn.Linear(bins, bins), nn.BatchNorm1d(bins))
        self.down_sampler = nn.ModuleDict({"net1": net1, "net2": net2})

    def forward(self, pixel_values: Tensor) -> Tensor:
        """Logits (B, bins) of normalised images (B, 3, 224, 224)."""
        token = self.dinov2(pixel_values=pixel_values).last_hidden_state[:, 0]
        return self.down_sampler["net2"](self.down_sampler["net1"](token))


def weights(path: Path) -> dict[str, Tensor]:
    """The state dict in a checkpoint.

    Raises:
        InputError: it is missing, or holds more than numbers.
    """
    if not path.is_file():
        raise InputError(path, "checkpoint", "no such file")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # pickle's and torch's errors have no narrower common class
        hint = "where you trust it, save its state_dict alone and give that"
        raise InputError(path, "checkpoint", str(error).strip().splitlines()[0][:200], hint) from None
    for key in ("state_dict", "model"):
        content = content.get(key, content) if isinstance(content, dict) else content
    named = isinstance(content, dict) and all(isinstance(name, str) for name in content)
    if not named or not all(isinstance(value, Tensor) for value in content.values()):
        raise InputError(path, "checkpoint", "expected a state dict of named tensors")
    return {name.removeprefix("module."): value for name, value in content.items()}


def load(module: nn.Module, path: Path) -> nn.Module:
    """``module`` with the weights of a checkpoint, all of them and no others."""
    try:
        module.load_state_dict(weights(path))
    except RuntimeError as error:
        raise InputError(path, "checkpoint", " ".join(str(error).split())[:200]) from None
    return module


def pretrained(family: Any, folder: Path) -> nn.Module:
    """A network of transformers from its folder; nothing is fetched, and nothing unpickled.

    Raises:
        InputError: the folder does not hold it.
    """
    try:
        net: nn.Module = family.from_pretrained(folder, local_files_only=True, use_safetensors=True)
    except OSError as error:
        raise InputError(folder, "checkpoint", " ".join(str(error).split())[:200]) from None
    return net


def raft(options: argparse.Namespace) -> nn.Module:
    """RAFT of torchvision, fed with RGB 0-255."""
    from torchvision.models.optical_flow import raft_large, raft_small

    def call(net: nn.Module, image1: Tensor, image2: Tensor) -> Tensor:
        return net(image1 / 127.5 - 1, image2 / 127.5 - 1, num_flow_updates=options.updates)[-1]

    return Wrapped(load(raft_small() if options.small else raft_large(), options.checkpoint), call)


def mmpose(options: argparse.Namespace) -> nn.Module:
    """HRNet's heatmaps or RTMPose's two distributions, of mmpose 1.x."""
    from mmpose.apis import init_model

    if options.config is None:
        raise InputError(options.checkpoint, "--config", "is missing", "give mmpose's config file of this checkpoint")
    net = init_model(str(options.config), None, device="cpu")
    return Wrapped(load(net, options.checkpoint), lambda inner, image: inner.head(inner.backbone(image)))


def vitpose(options: argparse.Namespace) -> nn.Module:
    """ViTPose of transformers, from a folder with config.json and model.safetensors."""
    from transformers import VitPoseForPoseEstimation

    net = pretrained(VitPoseForPoseEstimation, options.checkpoint)
    return Wrapped(net, lambda inner, image: inner(pixel_values=image).heatmaps)


def depth_anything(options: argparse.Namespace) -> nn.Module:
    """Depth Anything V1 or V2 of transformers, relative or metric, from a folder like that of ViTPose."""
    from transformers import AutoModelForDepthEstimation

    net = pretrained(AutoModelForDepthEstimation, options.checkpoint)
    return Wrapped(net, lambda inner, image: inner(pixel_values=image).predicted_depth)


def orient_anything(options: argparse.Namespace) -> nn.Module:
    """Orient Anything, small, base or large as the checkpoint is.

    Raises:
        InputError: the checkpoint has no layer behind DINOv2, or one of another width.
    """
    from transformers import Dinov2Config, Dinov2Model

    content, layer = weights(options.checkpoint), "down_sampler.net1.0.weight"
    shape = tuple(content[layer].shape) if layer in content else ()  # bins, width
    if len(shape) != 2 or shape[1] not in DINO:
        came = shape or f"no such tensor, but {', '.join(list(content)[:3]) or 'none'}"
        wanted = f"expected Orient Anything's (bins, {' or '.join(map(str, DINO))})"
        raise InputError(options.checkpoint, layer, f"{wanted}, got {came}")
    depth, heads = DINO[shape[1]]
    config = Dinov2Config(hidden_size=shape[1], num_hidden_layers=depth, num_attention_heads=heads, image_size=518)
    return load(OrientAnything(Dinov2Model(config), shape[1], shape[0]), options.checkpoint)


RECIPES = {
    "hrnet": Recipe(mmpose, ("input",), ("output",), "mmpose", (256, 192)),
    "rtmpose": Recipe(mmpose, ("input",), ("simcc_x", "simcc_y"), "mmpose", (256, 192)),
    "vitpose": Recipe(vitpose, ("input",), ("output",), "transformers", (256, 192)),
    "raft": Recipe(raft, ("image1", "image2"), ("flow",), "torchvision", (432, 768)),
    "depth_anything": Recipe(depth_anything, ("pixel_values",), ("predicted_depth",), "transformers", (518, 518)),
    "orient_anything": Recipe(orient_anything, ("pixel_values",), ("logits",), "transformers", (224, 224)),
}


def export(module: nn.Module, recipe: Recipe, size: tuple[int, int], out: Path, most: int = 2) -> None:
    """Write ``module`` as ``out``, if onnxruntime then gives what torch gives.

    Args:
        module: maps images (B, 3, H, W) to the recipe's outputs.
        recipe: names of inputs and outputs.
        size: height and width of the images [px].
        out: the ONNX file.
        most: images at a time: 1 fixes the batch, 2 leaves it free.

    Raises:
        ModelError: it cannot be exported, or the file gives something else.
    """
    module.eval()
    generator = torch.Generator().manual_seed(0)
    images = {name: 255 * torch.rand(most, 3, *size, generator=generator) for name in recipe.inputs}
    free = {name: {0: "batch"} for name in (*recipe.inputs, *recipe.outputs)} if most > 1 else {}
    with atomic(out) as temporary:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the tracer's, about what it holds fixed; the comparison decides
                torch.onnx.export(
                    module,
                    tuple(image[:1] for image in images.values()),
                    str(temporary),
                    input_names=list(recipe.inputs),
                    output_names=list(recipe.outputs),
                    dynamic_axes=free,
                    opset_version=OPSET,
                    dynamo=False,
                )
        except (RuntimeError, torch.onnx.errors.OnnxExporterError) as error:
            raise ModelError(out, "export", str(error).strip().splitlines()[0]) from None
        compare(module, recipe, images, temporary)


def compare(module: nn.Module, recipe: Recipe, images: Mapping[str, Tensor], path: Path) -> None:
    """Refuse a file whose outputs for one image, or for all, are not those of ``module``."""
    most, _, height, width = next(iter(images.values())).shape
    network = Network(path, dict.fromkeys(recipe.inputs, (None, 3, height, width)), dict.fromkeys(recipe.outputs))
    for count in range(1, most + 1):
        with torch.inference_mode():
            wanted: Any = module(*(image[:count] for image in images.values()))
        got = network({name: image[:count].numpy() for name, image in images.items()})
        for name, value in zip(recipe.outputs, wanted if isinstance(wanted, tuple) else (wanted,)):
            miss = float(np.abs(got[name] - value.numpy()).max() / value.abs().max().clamp_min(1e-12))
            if not miss <= TOLERANCE:
                raise ModelError(path, f"output {name}", f"differs from torch by {miss:.2g} of its largest value")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; a failure is one line and an exit code."""
    options = parser().parse_args(arguments)
    recipe = RECIPES[options.network]
    size = options.height or recipe.size[0], options.width or recipe.size[1]
    try:
        if importlib.util.find_spec(recipe.package) is None:
            raise ModelError(options.network, recipe.package, "is not installed", f"pip install {recipe.package}")
        export(recipe.build(options), recipe, size, options.out, 1 if options.one else 2)
    except CltransferError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"error: {error.filename or options.out}: {error.strerror or error}", file=sys.stderr)
        return ResourceError.exit_code
    print(f"{options.out} sha256 {content_hash(options.out)} {options.out.stat().st_size} bytes")
    return 0


def parser() -> argparse.ArgumentParser:
    """Arguments of the command line."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("network", choices=sorted(RECIPES))
    made.add_argument("checkpoint", type=Path, help="file, or folder for vitpose and depth_anything")
    made.add_argument("out", type=Path, help="ONNX file to write")
    made.add_argument("--height", type=int, help="of the network's input [px]")
    made.add_argument("--width", type=int, help="likewise")
    made.add_argument("--one", action="store_true", help="fix the batch at one image, where a free one fails")
    made.add_argument("--config", type=Path, help="mmpose's config file (hrnet, rtmpose)")
    made.add_argument("--small", action="store_true", help="the small RAFT")
    made.add_argument("--updates", type=int, default=12, help="RAFT's iterations")
    return made


if __name__ == "__main__":
    sys.exit(main())
