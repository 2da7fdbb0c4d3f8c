"""The command line as a test sees it: in this process, or in a fresh one with the time it takes."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when torch is imported: small operations on many threads wait for
# each other where cores are shared, and a process for every core runs these tests

import fcntl
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest
from torch import Tensor

import cltransfer
from cltransfer.cli.app import main
from cltransfer.computer import threads
from cltransfer.features import Features
from cltransfer.registry import LOSSES, RENDERERS, plugin_code

STANDARD = "import asyncio, http.client, unittest.mock, xml.dom.minidom, email.mime.text, multiprocessing.pool"
DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"
USUAL = 0.1  # [s] of processor time that such a process is taken to need on a quiet machine

VARIABLES = ("CLTRANSFER_CACHE", "CLTRANSFER_MODELS", "CLTRANSFER_CATALOGUE", "CLTRANSFER_THREADS")
ASKED = os.environ.get(threads.VARIABLE)  # by who runs the tests
SHIPPED = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")
TINY = ("frames=3", "generations=2", "output_side=96", "search_side=48")


@dataclass(frozen=True)
class Answer:
    """What a command said, and its processor time [s]: the wall clock of a busy machine says little."""

    code: int
    out: str
    err: str
    seconds: float = 0.0


Command = Callable[..., Answer]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that needs real data which is not here, naming it, before its fixtures are made."""
    for mark in item.iter_markers("needs"):
        for path in mark.args:
            if not (DATA / path).exists():
                pytest.skip(f"needs {DATA / path}")


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def apart(cache: Path) -> Iterator[None]:
    """A test's process as if it were the first: no networks or catalogue of the caller, one cache for the session.

    Afterwards environment and threads are what they were. What a test does not import is not imported for it.
    """
    threads._set = ("nothing", 0)  # what a fixture of a module has run may have set them
    os.environ.pop(threads.VARIABLE, None)
    if ASKED is not None:
        os.environ[threads.VARIABLE] = ASKED
    environment, written = dict(os.environ), threads._set
    before = {name: get() for name, (get, _) in _thread_counts().items()}
    for name in ("CLTRANSFER_MODELS", "CLTRANSFER_CATALOGUE"):
        os.environ.pop(name, None)
    os.environ["CLTRANSFER_CACHE"] = str(cache)
    yield
    threads._set = written
    for name, (get, put) in _thread_counts().items():
        if get() != before.get(name, 0):
            put(before.get(name, -1))  # OpenCV's word for its own choice, where the test imported it
    for name in VARIABLES:
        if name in environment:
            os.environ[name] = environment[name]
        else:
            os.environ.pop(name, None)


def _thread_counts() -> dict[str, tuple[Callable[[], int], Callable[[int], None]]]:
    """How to read and write the threads of every library that is imported by now."""
    counts: dict[str, tuple[Callable[[], int], Callable[[int], None]]] = {}
    if "torch" in sys.modules:
        counts["torch"] = (sys.modules["torch"].get_num_threads, sys.modules["torch"].set_num_threads)
    if "cv2" in sys.modules:
        counts["cv2"] = (sys.modules["cv2"].getNumThreads, sys.modules["cv2"].setNumThreads)
    return counts


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What there is as soon as a process that is started imports joblib or numpy from the folder that we are in."""
    from joblib.externals.loky import get_reusable_executor

    here, marker = tmp_path / "a stranger's", tmp_path / "was imported"
    here.mkdir()
    for name in ("joblib", "numpy"):
        (here / f"{name}.py").write_text(f"open({str(marker)!r}, 'w').close()\nraise SystemExit(1)\n")
    get_reusable_executor(max_workers=1, kill_workers=True).shutdown(kill_workers=True)  # of tests before
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.chdir(here)
    return marker


@pytest.fixture
def command(cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run a command line in this process."""

    def run(*arguments: str | Path) -> Answer:
        monkeypatch.setenv("CLTRANSFER_CACHE", str(cache))
        monkeypatch.setattr(sys, "argv", ["cltransfer", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main()
        said = capsys.readouterr()
        return Answer(int(caught.value.code or 0), said.out, said.err)

    return run


@dataclass(frozen=True)
class MeanFlow:
    """Difference of the mean flow: unlike the losses that we ship it needs no person, so no network to find one."""

    weight: float = 1.0

    requires: ClassVar[tuple[str, ...]] = ("flow",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 10.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (reference.require("flow") - rendered.require("flow")).flatten(2).mean(-1).norm(dim=1)


@pytest.fixture(scope="session")
def own_loss() -> str:
    """Text of a file that registers a loss called mine, its class open at the end."""
    return """from dataclasses import dataclass
from cltransfer.registry import LOSSES

@LOSSES.register("mine")
@dataclass(frozen=True)
class Mine:
    weight: float = 1.0
    requires, unit, penalty = ("keypoints",), "frame", 1.0
    __call__ = print
"""


@pytest.fixture
def forgotten_renderers() -> Iterator[None]:
    """Renderers of plugins that a test registers are forgotten after it."""
    yield
    for name, cls in RENDERERS.registered().items():
        if not cls.__module__.startswith("cltransfer."):
            del RENDERERS._classes[name]


@pytest.fixture
def mean_flow() -> Iterator[tuple[str, ...]]:
    """Overrides by which :class:`MeanFlow` is the only loss; it is forgotten after the test."""
    LOSSES.register("mean_flow")(MeanFlow)
    yield ("losses.mean_flow={}", *(f"losses.{name}=null" for name in SHIPPED))
    LOSSES._classes.pop("mean_flow")


@pytest.fixture
def fresh(cache: Path, tmp_path: Path) -> Command:
    """Run a command line in a process of its own, in the test's folder."""

    def run(*arguments: str | Path, **environment: str) -> Answer:
        start = _child_seconds()
        done = subprocess.run(
            [sys.executable, "-m", "cltransfer", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, "CLTRANSFER_CACHE": str(cache), **environment},
            capture_output=True,
            text=True,
            timeout=120,
        )
        return Answer(done.returncode, done.stdout, done.stderr, _child_seconds() - start)

    return run


def _child_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.fixture
def room() -> Iterator[Callable[[int], None]]:
    """Let no file become larger than so many bytes, as on a full disk, until the test ends."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, usual)


@pytest.fixture(scope="session")
def tiny_run(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished run on the built-in scenes; copy it before you damage it."""
    own = tmp_path_factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own  # one run for all workers
    folder = shared / "tiny" / "run"
    folder.parent.mkdir(exist_ok=True)
    count = str(threads.default_count())  # as a run in this process takes them, whatever one before it has set
    with (shared / "tiny.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "DONE").is_file():
            subprocess.run(
                [sys.executable, "-m", "cltransfer", "transfer", "--quiet", "--out", str(folder), *TINY],
                env={**os.environ, "CLTRANSFER_CACHE": str(cache), threads.VARIABLE: count},
                stdout=subprocess.DEVNULL,
                check=True,
                timeout=240,
            )
    return folder


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Any]:
    """A headless Chromium that keeps its console."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("needs chromium and chromedriver on the PATH (Debian: chromium, chromium-driver)")
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium, of the extra cltransfer[dev]")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    flags = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync")
    flags += ("--disable-component-update", "--disable-dev-shm-usage", "--window-size=1280,860")
    for flag in (*flags, f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(flag)
    (tmp_path / "downloads").mkdir()
    options.add_experimental_option("prefs", {"download.default_directory": str(tmp_path / "downloads")})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield opened
    opened.quit()


@pytest.fixture
def blue_network(tmp_path: Path) -> Path:
    """A depth network that takes blue less green for disparity, which no scene bears out."""
    import numpy as np
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    weight = numpy_helper.from_array(np.array([0.0, -0.5, 1.0], np.float32).reshape(1, 3, 1, 1), "w")
    node = helper.make_node("Conv", ["pixel_values", "w"], ["predicted_depth"])
    image = helper.make_tensor_value_info("pixel_values", TensorProto.FLOAT, ["b", 3, 16, 32])
    depth = helper.make_tensor_value_info("predicted_depth", TensorProto.FLOAT, ["b", 1, 16, 32])
    graph = helper.make_graph([node], "depth", [image], [depth], [weight])
    opset = [helper.make_opsetid("", 17)]
    path = tmp_path / "blue.onnx"
    onnx.save_model(helper.make_model(graph, opset_imports=opset, ir_version=9), str(path))
    return path


@pytest.fixture
def within() -> Callable[[float, float], bool]:
    """Whether seconds are fewer than a limit, or than as much more as a process takes to start here just now."""

    def seconds() -> float:
        begun = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", STANDARD], check=True)
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        return ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime

    def check(took: float, limit: float) -> bool:
        return took < limit or took < limit * max(seconds() for _ in range(3)) / USUAL

    return check


@pytest.fixture
def edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Goes on as if a module of cltransfer, as ``clips/cuts.py``, were another from now on."""
    copy = tmp_path / "edited" / "cltransfer"

    def edit(module: str) -> None:
        if not copy.exists():
            shutil.copytree(Path(cltransfer.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
            monkeypatch.setattr(plugin_code, "__file__", str(copy / "registry" / "plugin_code.py"))
        with (copy / module).open("a") as file:
            file.write("# edited\n")
        plugin_code.own_code.cache_clear()

    yield edit
    plugin_code.own_code.cache_clear()
