"""ONNX networks: found by name, checked before they run, checked after."""

from __future__ import annotations

import functools
import hashlib
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ModelError, UsageError
from ..files import cache_dir, content_hash
from ..memory import VARIABLE as MEMORY
from ..memory import free_bytes
from ..registry import code_of
from ..threads import thread_count
from .catalogue import entry_of_file, stand_ins
from .interface import Port, Shape, differs, joined, ports

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

BYTE_LIMIT = 2 * 2**30
VARIABLE = "CLTRANSFER_NETWORKS"
CUDA, CPU = "CUDAExecutionProvider", "CPUExecutionProvider"
_ARENA = "BFCArena"  # names whose limit it was, in onnxruntime's errors
_EXTERNAL = b"\n\x08location"  # the key by which a tensor names another file


def model_places(name: str) -> list[Path]:
    """Where the network ``name`` is looked for: the folders of ``CLTRANSFER_MODELS``, then the cache.

    A name with a folder in it (``weights/depth.onnx``) is taken as it stands.
    """
    if Path(name).name != name:
        return [Path(name)]
    named = os.environ.get("CLTRANSFER_MODELS", "").split(os.pathsep)
    folders = [Path(folder) for folder in named if folder] + [cache_dir() / "models"]
    return [folder / name for folder in folders]


def find_model(name: str) -> Path:
    """File of the network ``name``, at the first of :func:`model_places` that has it, or one that stands in for it.

    Raises:
        ModelError: there is no such file; the line says what to get and where to put it.
    """
    found = _found(name)
    if found is not None:
        return found
    places = model_places(name)
    known = next(iter(stand_ins(Path(name).name)), entry_of_file(Path(name).name))
    if known is None:
        raise ModelError(name, "model", "no such file", f"put it in {places[0].parent}")
    digest = f" with sha256 {known.sha256}" if known.sha256 else ""
    accept = "" if known.sha256 else " --accept-new"
    get = f"cltransfer models pull {known.name}{accept}" if known.address else known.made_by
    what = f"no such file{digest} ({known.licence}, from {known.source})"
    raise ModelError(name, "model", what, f"run: {get}; or put it in {places[0].parent}")


def _found(name: str) -> Path | None:
    """The file that ``name`` means; a name with a folder in it means itself."""
    others = [entry.file for entry in stand_ins(name)]
    places = [place for file in (name, *others) for place in model_places(file)]
    return next((place for place in places if place.is_file()), None)


def reading(extractor: Any) -> dict[str, Any]:
    """What an extractor's answers depend on: its options, what its files hold, and its code where it is a plugin."""
    model, files = own_model(extractor), files_content(extractor)
    network = {} if model is None else {"sha256": model_content(model)}
    return {**asdict(extractor), **network, **({"files": files} if files else {}), "code": code_of(extractor)}


def own_model(component: Any) -> str | None:
    """The network that a component names in its option ``model``, None where it has no such option."""
    named = {field.name for field in fields(component)}
    return component.model if "model" in named and isinstance(component.model, str) else None


def files_content(component: Any) -> dict[str, list[str]]:
    """SHA-256 of every file that a plugin's options name, by how it is named there; of several places in order.

    A folder counts where it is named with a slash and is not around the one that we are in: a text is a path by chance.
    What comes with cltransfer names its one file as :func:`own_model`.
    """
    if type(component).__module__.partition(".")[0] == "cltransfer":
        return {}
    found = {}
    options = [getattr(component, field.name) for field in fields(component)]
    for name in sorted(set(_texts(options))):
        places = dict.fromkeys([Path(name), *model_places(name)])
        if contents := [content for place in places if (content := _named_content(name, place))]:
            found[name] = contents
    return found


def _named_content(name: str, place: Path) -> str:
    if os.path.isfile(place):  # no error of a text that can be no path
        return _content(place, place.stat().st_mtime_ns, place.stat().st_size)
    folder = Path(name).name != name and os.path.isdir(place) and not Path.cwd().is_relative_to(place.resolve())
    return content_hash(place) if folder else ""


def _texts(value: Any) -> Iterator[str]:
    """Every text in an option, whatever holds it."""
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, Mapping):
        yield from _texts(list(value.values()))
    elif isinstance(value, Sequence):
        for item in value:
            yield from _texts(item)


def model_content(name: str) -> str:
    """SHA-256 of the network ``name``; empty where there is no such file, so that nothing was read by it.

    A file of the catalogue is not read for it: one of another content is refused before it runs.
    """
    place = _found(name)
    known = entry_of_file(Path(name).name if place is None else place.name)
    if known is not None and known.sha256:
        return known.sha256
    return "" if place is None else _content(place, place.stat().st_mtime_ns, place.stat().st_size)


@functools.cache
def _content(path: Path, changed: int, size: int) -> str:
    return content_hash(path)


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
    most = 0 if free is None else max(1, free)  # 0 is no limit
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
        parts = [self._run({n: v[i : i + step] for n, v in feeds.items()}) for i in range(0, batch, step)]
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

    def _run(self, feeds: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        session, given, taken = self._loaded
        fed = {given[name].name: given[name].fed(value) for name, value in feeds.items()}
        try:
            got = session.run([port.name for port in taken.values()], fed)
        except Exception as error:  # onnxruntime's errors have no narrower common class
            raise self._failure("run", error) from None
        return {name: port.read(value) for (name, port), value in zip(taken.items(), got)}

    def _failure(self, what: str, error: Exception) -> ModelError:
        bound = memory_bound()
        if bound is not None and _ARENA in str(error):
            reason = f"takes more than the {bound / 2**20:.0f} MB that were free"
            return ModelError(self.path, "memory", reason, f"raise the limit of the system or of {MEMORY}")
        return ModelError(self.path, what, _first_line(error))

    @property
    def _any_batch(self) -> bool:
        return all(not isinstance(entry.shape[0], int) for entry in self.session.get_inputs())

    @property
    def session(self) -> InferenceSession:
        """The loaded network.

        Raises:
            ModelError: the file is missing, foreign, reaches for other files, or has other inputs or outputs.
        """
        return self._loaded[0]

    @cached_property
    def _loaded(self) -> tuple[InferenceSession, dict[str, Port], dict[str, Port]]:
        """The session, and where it has the inputs and outputs."""
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        options.intra_op_num_threads = thread_count()
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning slows torch down
        options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
        options.add_session_config_entry("session.use_env_allocators", "1")  # those of memory_bound
        data, wanted = self._read(), providers()
        memory_bound()
        try:
            session = onnxruntime.InferenceSession(data, options, providers=wanted)
        except Exception as error:  # onnxruntime's errors have no narrower common class
            raise self._failure("model", error) from None
        if session.get_providers()[0] != wanted[0]:  # onnxruntime falls back by itself and says so only in its log
            raise ModelError(self.path, "CUDA", "did not start", f"{VARIABLE}=cpu runs it on the CPU")
        given = ports(self.path, "input", self.inputs, session.get_inputs(), self.by_shape)
        return session, given, ports(self.path, "output", self.outputs, session.get_outputs(), self.by_shape)

    def _read(self) -> bytes:
        if not self.path.is_file():
            raise ModelError(self.path, "model", "no such file")
        if self.path.stat().st_size > BYTE_LIMIT:
            raise ModelError(self.path, "model", f"expected at most {BYTE_LIMIT} bytes")
        data = self.path.read_bytes()
        known = entry_of_file(self.path.name)
        digest = hashlib.sha256(data).hexdigest()
        if known and known.sha256 not in ("", digest):
            reason = f"expected {known.sha256}, got {digest}"
            hint = "rename the file if it is another network"
            if not known.address:
                hint += f"; if you made it: cltransfer models adopt {known.name} {shlex.quote(str(self.path))}"
            raise ModelError(self.path, "sha256", reason, hint)
        if _EXTERNAL in data:
            raise ModelError(self.path, "external data", "weights in another file are refused", "store them inside")
        return data


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
