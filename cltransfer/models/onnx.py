"""ONNX networks: checked before they run, checked after."""

from __future__ import annotations

import functools
import hashlib
import os
import shlex
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..computer.memory import VARIABLE as MEMORY
from ..computer.memory import free_bytes, require_free
from ..computer.threads import thread_count
from ..errors import ModelError, UsageError
from .catalogue import catalogue, entry_of_file, pinned_file
from .interface import Port, Shape, differs, joined, ports
from .onnx_unbounded import is_sparse, uses_text

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

BYTE_LIMIT = 2 * 2**30
SMALL = 2**24  # bytes of a network of which several rows run at once; what they take together stays bounded
VARIABLE = "CLTRANSFER_NETWORKS"
CUDA, CPU = "CUDAExecutionProvider", "CPUExecutionProvider"
_ARENA = "BFCArena"  # names whose limit it was, in onnxruntime's errors
IDENTITY = (
    b'\x08\x08:6\n\x10\n\x01x\x12\x01y"\x08Identity\x12\x00Z\x0f\n\x01x\x12\n\n\x08\x08\x01\x12\x04\n\x02\x08\x01'
    b"b\x0f\n\x01y\x12\n\n\x08\x08\x01\x12\x04\n\x02\x08\x01B\x04\n\x00\x10\x11"
)  # an ONNX network: y (1,) = x (1,) float32
_EXTERNAL = b"\n\x08location"  # the key by which a tensor names another file


def providers() -> list[str]:
    """What networks run on, by ``CLTRANSFER_NETWORKS``: cpu, cuda, or auto (CUDA where onnxruntime is built for it).

    Raises:
        UsageError: the variable is another word.
        ModelError: CUDA is asked for and onnxruntime has none.
    """
    import onnxruntime

    wish = os.environ.get(VARIABLE) or "auto"
    if wish not in ("auto", "cpu", "cuda"):
        raise UsageError("", VARIABLE, f"expected auto, cpu or cuda, got {wish!r}")
    has_cuda = CUDA in onnxruntime.get_available_providers()
    if wish == "cuda" and not has_cuda:
        raise ModelError("onnxruntime", VARIABLE, "is not built for CUDA", "pip install onnxruntime-gpu in its place")
    return [CUDA, CPU] if has_cuda and wish != "cpu" else [CPU]


LOADING = 3  # times its size that a file takes while it is loaded: itself, as read by protobuf, and its weights
LEAST_BOUND = 256  # bytes; a limit of one or two is taken for none


@functools.cache
def memory_bound() -> int | None:
    """Bytes that all networks of this process may take together on the CPU: what was free before the first was loaded.

    Where the system does not say it is None, and they may take what there is.
    """
    import onnxruntime

    free = free_bytes()
    info = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    most = 0 if free is None else max(LEAST_BOUND, free)  # 0 is no limit, and neither are 1 and 2
    as_asked, default = 1, -1  # the arena grows by what is asked for
    onnxruntime.create_and_register_allocator(info, onnxruntime.OrtArenaCfg(most, as_asked, default, default))
    return free


@dataclass(frozen=True)
class Network:
    """One ONNX file that runs on batches, whether or not its batch size is fixed at 1.

    Args:
        path: the file; a file of the catalogue must have the content it has there.
        inputs: name and shape of every input, float32.
        outputs: name and shape of the outputs to compute, float32; a shape of None is any.
        by_shape: inputs and outputs that the file calls otherwise are known by their shapes, images with their channels
            first or last; feeds and results are as stated here all the same.
    """

    path: Path
    inputs: Mapping[str, Shape]
    outputs: Mapping[str, Shape | None]
    by_shape: bool = False

    def __call__(self, feeds: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Outputs (B, ...) float32 of inputs (B, ...) float32.

        Raises:
            ModelError: the network fails or takes more memory than :func:`memory_bound`, or an output is not finite or
                not of the stated shape.
        """
        batch = len(next(iter(feeds.values())))
        step = batch if self._any_batch else 1
        parts = self._side_by_side([{n: v[i : i + step] for n, v in feeds.items()} for i in range(0, batch, step)])
        outputs = {name: joined(self.path, name, [part[name] for part in parts]) for name in self.outputs}
        for name, value in outputs.items():
            if differs(self.outputs[name], value.shape):
                reason = f"expected shape {self.outputs[name]}, got {value.shape}"
                raise ModelError(self.path, f"output {name}", reason)
            if len(value) != batch:
                raise ModelError(self.path, f"output {name}", f"expected {batch} rows, got {len(value)}")
            if not np.isfinite(value).all():
                raise ModelError(self.path, f"output {name}", "is not finite")
        return outputs

    def _side_by_side(self, feeds: list[dict[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        """What :meth:`_run` gives for each; a small network fills no two threads, so several run at once."""
        small = self._loaded[3] and self.session.get_providers()[0] == CPU
        at_once = min(thread_count(), len(feeds)) if small else 1
        if at_once < 2:
            return [self._run(part) for part in feeds]
        with ThreadPoolExecutor(at_once) as pool:
            return list(pool.map(self._run, feeds))

    def _run(self, feeds: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        session, given, taken, _ = self._loaded
        fed = {given[name].name: given[name].fed(value) for name, value in feeds.items()}
        try:
            got = session.run([port.name for port in taken.values()], fed)
        except Exception as error:  # onnxruntime's errors have no narrower common class
            raise _failure(self.path, "run", error) from None
        return {name: port.read(value) for (name, port), value in zip(taken.items(), got)}

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or another process needs: the session is opened anew there."""
        return {name: value for name, value in vars(self).items() if name != "_loaded"}

    @property
    def _any_batch(self) -> bool:
        return all(not isinstance(entry.shape[0], int) for entry in self.session.get_inputs())

    @property
    def session(self) -> InferenceSession:
        """The loaded network.

        Raises:
            ModelError: the file is missing, foreign, reaches for other files, uses text or sparse tensors, or has other
                inputs or outputs.
            ResourceError: there is no memory to load it.
        """
        return self._loaded[0]

    @cached_property
    def _loaded(self) -> tuple[InferenceSession, dict[str, Port], dict[str, Port], bool]:
        """The session, where it has the inputs and outputs, and whether the file is :data:`SMALL`."""
        data, known = self._read()
        session = _opened(self.path, data, known)
        given = ports(self.path, "input", self.inputs, session.get_inputs(), self.by_shape)
        taken = ports(self.path, "output", self.outputs, session.get_outputs(), self.by_shape)
        return session, given, taken, len(data) <= SMALL

    def _read(self) -> tuple[bytes, bool]:
        """What the file holds, and whether the catalogue knows that."""
        if not self.path.is_file():
            raise ModelError(self.path, "model", "no such file")
        if self.path.stat().st_size > BYTE_LIMIT:
            raise ModelError(self.path, "model", f"expected at most {BYTE_LIMIT} bytes")
        require_free(LOADING * self.path.stat().st_size, self.path, "its weights", "take a smaller network")
        memory_bound()  # without what is read here
        data = self.path.read_bytes()
        known = entry_of_file(self.path.name)
        wanted, digest = known.sha256 if known else pinned_file(self.path), hashlib.sha256(data).hexdigest()
        if wanted not in ("", digest):
            reason = f"expected {wanted}, got {digest}"
            hint = "rename the file if it is another network"
            if known and not known.address:
                hint += f"; if you made it: cltransfer models adopt {known.name} {shlex.quote(str(self.path))}"
            raise ModelError(self.path, "sha256", reason, hint)
        if _EXTERNAL in data:
            raise ModelError(self.path, "external data", "weights in another file are refused", "store them inside")
        _refuse_unbounded(self.path, data)
        return data, digest in {entry.sha256 for entry in catalogue("model").values()}


def _refuse_unbounded(path: Path, data: bytes) -> None:
    try:
        text, sparse = uses_text(data), is_sparse(data)
    except ValueError as error:
        reason = f"expected an ONNX network, it is no protobuf message: {error}"
        raise ModelError(path, "model", reason) from None
    unbounded = "are refused, nothing bounds the memory that they take"
    if text:
        hint = "export the network without its labels, of numbers alone"
        raise ModelError(path, "text", f"tensors of text {unbounded}", hint)
    if sparse:
        raise ModelError(path, "sparse", f"sparse tensors {unbounded}", "export the network with dense weights")


def runs_on() -> list[str]:
    """What a network is in fact run on, by opening one that hands on what it is given.

    Raises:
        UsageError, ModelError: as :func:`providers`; or CUDA does not start.
    """
    return list(_opened("onnxruntime", IDENTITY).get_providers())


def _opened(where: str | Path, data: bytes, known: bool = False) -> InferenceSession:
    """A session of ``data``.

    What follows from constants alone is worked out in advance where the network is ``known``: it is not counted to
    the arena then, and a few bytes may ask for any size.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    options.intra_op_num_threads = thread_count()
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.load_model_format", "ONNX")  # not ORT, which nobody has looked into
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning slows torch down
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    options.add_session_config_entry("session.use_env_allocators", "1")  # those of memory_bound
    wanted, off = providers(), [] if known else ["ConstantFolding"]
    try:
        session = onnxruntime.InferenceSession(data, options, providers=wanted, disabled_optimizers=off)
    except Exception as error:  # onnxruntime's errors have no narrower common class
        raise _failure(where, "model", error) from None
    if session.get_providers()[0] != wanted[0]:  # onnxruntime falls back by itself and says so only in its log
        raise ModelError(where, "CUDA", "did not start", f"{VARIABLE}=cpu runs it on the CPU")
    return session


def _failure(where: str | Path, what: str, error: Exception) -> ModelError:
    bound = memory_bound()
    if bound is not None and _ARENA in str(error):
        reason = f"takes more than the {bound / 2**20:.0f} MB that were free"
        return ModelError(where, "memory", reason, f"raise the limit of the system or of {MEMORY}")
    return ModelError(where, what, _first_line(error))


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
