"""What this computer has, and whether the program can work on it."""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .computer.packages import PACKAGES, installed


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Args:
        what: its name.
        ok: whether the program can work with it.
        says: what was found.
        needed: whether nothing works without it.
    """

    what: str
    ok: bool
    says: str
    needed: bool = True


def examine() -> list[Finding]:
    """Look at everything; nothing is changed."""
    from . import __version__

    found = [Finding("cltransfer", True, f"{__version__}, Python {platform.python_version()}, {platform.machine()}")]
    found += [_package(name) for name in PACKAGES]
    found += [_try("threads", _threads), _try("video codecs", _codecs), _try("cache", _cache)]
    found += [_try("compiled kernels", _kernels, needed=False)]
    found += [*_try_all("networks", _models), _try("networks run on", _providers)]
    found += [_try("CUDA", _cuda, needed=False), _try("self-test", _self_test)]
    return found


def healthy(findings: Sequence[Finding]) -> bool:
    """Whether everything that is needed is there."""
    return all(f.ok for f in findings if f.needed)


def _try(what: str, look: Callable[[], str], needed: bool = True) -> Finding:
    try:
        return Finding(what, True, look(), needed)
    except Exception as error:  # a doctor reports every fault, whatever its kind
        return Finding(what, False, f"{type(error).__name__}: {error}", needed)


def _try_all(what: str, look: Callable[[], list[Finding]]) -> list[Finding]:
    try:
        return look()
    except Exception as error:  # likewise: a library that it needs may be missing
        return [Finding(what, False, f"{type(error).__name__}: {error}")]


def _package(name: str) -> Finding:
    by, version = installed(name)
    if version is None:
        return Finding(name, False, f"missing; pip install {name}")
    return Finding(name, True, version if by == name else f"{version}, of {by}")


def _threads() -> str:
    from .computer.threads import thread_count

    return f"{thread_count()} used of {os.cpu_count()}"


def _codecs() -> str:
    import av.codec

    missing = [name for name in ("libx264", "ffv1") if name not in av.codec.codecs_available]
    if missing:
        raise RuntimeError(f"no encoder {', '.join(missing)} in PyAV")
    return "libx264, ffv1"


def _cache() -> str:
    from .storage.files import cache_dir

    folder = cache_dir()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder):
        free = shutil.disk_usage(folder).free / 2**30
    return f"{folder}, {free:.0f} GiB free"


def _kernels() -> str:
    from .computer.compiled import folder

    place = folder()
    if place is None:
        raise RuntimeError(
            "not kept: each start compiles them anew; set NUMBA_CACHE_DIR to a folder that can be written"
        )
    return str(place)


def _models() -> list[Finding]:
    from .errors import CltransferError
    from .extractors.detect_yolox import DetectYolox
    from .extractors.pose_blazepose import PoseBlazepose

    def look(reader: DetectYolox | PoseBlazepose) -> Finding:
        try:
            _ = reader.network.session
            return Finding(reader.model, True, str(reader.network.path), needed=False)
        except CltransferError as error:
            return Finding(reader.model, False, str(error), needed=False)

    return [look(reader) for reader in (DetectYolox(), PoseBlazepose())]


def _providers() -> str:
    from .models.onnx import runs_on

    return ", ".join(name.removesuffix("ExecutionProvider") for name in runs_on())


def _cuda() -> str:
    import torch

    if not torch.cuda.is_available():
        return "none; everything runs on the CPU"
    return torch.cuda.get_device_name()


def _self_test() -> str:
    """Render one frame of a built-in scene twice; it must show the subject, and the same bits."""
    import torch

    from .camera import Camera
    from .registry import RENDERERS
    from .scenes.builtin import builtin_scene

    start = time.perf_counter()
    scene = builtin_scene("courtyard")
    person = scene.subject
    assert person is not None
    eye = person.anchor + 2.5 * person.height * person.facing
    camera = Camera.look_at(eye[None], person.anchor[None], person.up, 0.7, (160, 90))
    renderer = RENDERERS.build("gaussian_splats")
    first, second = (renderer.render(scene, camera, frozenset({"image", "label"})) for _ in range(2))
    if not torch.equal(first.image, second.image):
        raise RuntimeError("two renders of one camera differ")
    if float(first.label.max()) < 0.5:
        raise RuntimeError("the subject of the built-in scene is not seen")
    return f"rendered the built-in scene twice, same bits, {time.perf_counter() - start:.1f} s"
