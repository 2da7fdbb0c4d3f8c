"""The verb, on a posed set that is written here."""

from __future__ import annotations

import json
import os
import shlex
import signal
import threading
import time

import cv2
import pytest
import torch
import typer
from typer.testing import CliRunner

from cltransfer.cli.app import app
from cltransfer.cli.fit import OURS, _command
from cltransfer.cli.shared import up_of
from cltransfer.config import load_config
from cltransfer.errors import InputError, ResourceError, UsageError
from cltransfer.fit._folder import STATE
from cltransfer.fit.gaussian_splats import SCENE
from cltransfer.registry import FITTERS
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.nerf_grid import NerfGrid
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.splats import Splats
from cltransfer.storage.alone import alone


@pytest.fixture
def posed(views, tmp_path):
    """The analytic views as a transforms.json with images."""
    folder = tmp_path / "set"
    (folder / "images").mkdir(parents=True)
    frames = []
    for index, (c2w, image) in enumerate(zip(views.camera.to_opengl().tolist(), views.image)):
        name = f"images/{index:03}.png"
        cv2.imwrite(str(folder / name), image.permute(1, 2, 0).numpy()[..., ::-1])
        frames.append({"file_path": name, "transform_matrix": c2w})
    focal = float(views.camera.focal[0])
    head = {"w": 48, "h": 48, "fl_x": focal, "fl_y": focal, "cx": 24.0, "cy": 24.0}
    (folder / "transforms.json").write_text(json.dumps({**head, "frames": frames}))
    return folder


def test_a_posed_set_becomes_a_scene_that_loads(posed, tmp_path):
    options = ["first=2000", "most=2000", "steps=40", "look=20", "rays=256", "degree=0"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".tmp-7-0123abcd-fit.json").touch()  # by a fit that was killed as it wrote
    got = CliRunner().invoke(app, ["fit", str(posed), "-o", str(tmp_path / "out"), "--json", "-q", *options])
    assert got.exit_code == 0, got.output
    told = json.loads(got.stdout)
    assert told["notes"] == []
    assert told["up"] == [0, 0, 1]
    (level,) = told["levels"]
    assert level["steps"] == 40
    assert level["psnr"] > 12
    assert isinstance(load_scene(tmp_path / "out" / "grid.safetensors").geometry, NerfGrid)
    assert not list((tmp_path / "out").glob(".tmp-*"))


@pytest.mark.parametrize("as_json", [False, True])
def test_images_that_are_not_there_are_told(posed, tmp_path, as_json):
    for name in ("003.png", "007.png"):
        (posed / "images" / name).unlink()
    words = ["fit", str(posed), "-o", str(tmp_path / "out"), "-q", "first=200", "most=200", "steps=2", "rays=64"]
    got = CliRunner().invoke(app, [*words, "--json"] if as_json else words)
    assert got.exit_code == 0, got.output
    line = "2 of 25 images are not there, e.g. images/003.png"
    if as_json:
        assert json.loads(got.stdout)["notes"] == [line]
    else:
        assert got.stdout.startswith(f"note: {line}\n")


def test_the_command_that_a_fit_prints_transfers_into_its_scene(posed, tmp_path):
    out = tmp_path / "a grid"
    words = ["fit", str(posed), "-o", str(out), "-q", "first=200", "most=200", "steps=2", "rays=64"]
    got = CliRunner().invoke(app, words)
    folder, _, command = got.stdout.splitlines()[-1].partition("; ")
    assert folder == str(out)
    _, verb, *words = shlex.split(command)
    given = typer.main.get_command(app).commands[verb].make_context(verb, words).params
    assert (given["reference"], list(given["more"])) == ("CLIP", ["renderer.nerf_grid={}"])
    assert [load_scene(given["scene"]).geometry.renderer] == list(load_config(overrides=given["more"]).renderer)
    assert given["up"] == "0,0,1"  # by the photographs, where nothing in a grid tells it
    assert OURS["gaussian_splats"][:2] == (SCENE, [])


def test_up_is_said_to_a_transfer_where_a_scene_is_not_taken_so_by_itself(tmp_path):
    splats = Splats(*(torch.ones(2, *shape) for shape in ((3,), (3,), (4,), (), (1, 3), ())))
    for up, z_up, said in (
        ((0.0, 0.0, 1.0), True, False),
        ((0.0, 0.0, 1.0), False, True),
        ((0.0, -1.0, 0.0), False, False),
        ((0.0, -1.0, 0.0), True, True),
        (None, False, False),
    ):
        write_splats(tmp_path / SCENE, splats, z_up)
        words = shlex.split(_command(tmp_path, "gaussian_splats", up))
        assert ("--up" in words) == said
        scene = load_scene(tmp_path / SCENE, up_of(words[words.index("--up") + 1]) if said else None)
        assert scene.up.tolist() == list(up or (0.0, -1.0, 0.0))
    assert "--up 0,-0.6,-0.8" in _command(tmp_path, "nerf_grid", (0.0, -0.6, -0.8))


@pytest.fixture
def once_begun():
    """Send this process a signal as soon as a file is there, if that is before the test ends."""
    ended = threading.Event()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def wait(file, number):
        while not file.exists() and not ended.is_set():
            time.sleep(0.005)
        if not ended.is_set():
            os.kill(os.getpid(), number)

    def watch(file, number):
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell would have it ignored
        signal.signal(signal.SIGTERM, lambda *_: None)
        threading.Thread(target=wait, args=(file, number), daemon=True).start()

    yield watch
    ended.set()
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_fit_that_is_stopped_tells_that_the_same_command_goes_on(
    posed, tmp_path, command, once_begun, number, code, word
):
    out, long = tmp_path / "out", ("first=200", "most=200", "steps=100000", "patience=100000", "rays=64")
    once_begun(out / STATE, number)
    answer = command("fit", posed, "-o", out, "-q", *long)
    assert (answer.code, answer.out) == (code, "")
    assert answer.err == f"error: {word} (the same command goes on from here: {out})\n"


def test_an_unknown_option_and_a_path_among_options_are_named(posed, tmp_path):
    for words, line in (
        (["degre=1"], "degre: no such key (did you mean 'degree'?)"),
        (["degree"], "expected key=value"),
    ):
        got = CliRunner().invoke(app, ["fit", str(posed), "-o", str(tmp_path / "out"), *words])
        assert isinstance(got.exception, UsageError)
        assert line in str(got.exception)
    assert not (tmp_path / "out").exists()


def test_of_two_fits_in_one_folder_the_second_is_refused(posed, tmp_path):
    words = ["fit", str(posed), "-o", str(tmp_path / "out"), "-q", "first=200", "most=200", "steps=2", "rays=64"]
    with alone(tmp_path / "out", "fits a scene"):
        got = CliRunner().invoke(app, words)
        assert isinstance(got.exception, ResourceError)
        assert "--out: another process fits a scene there (wait until it ends, or name" in str(got.exception)
        assert not list((tmp_path / "out").iterdir())
    assert CliRunner().invoke(app, words).exit_code == 0


def test_a_set_that_cannot_be_fitted_leaves_no_folder(posed, tmp_path):
    for file in (posed / "images").iterdir():
        file.unlink()
    got = CliRunner().invoke(app, ["fit", str(posed), "-o", str(tmp_path / "out"), "-q"])
    assert isinstance(got.exception, InputError)
    assert "images: expected at least 3, got 0" in str(got.exception)
    assert not (tmp_path / "out").exists()


PLUGIN = """
from dataclasses import dataclass
from cltransfer import FITTERS

@FITTERS.register("mine")
@dataclass(frozen=True)
class Mine:
    side: int = 16
    shade: float = 0.5

    def require(self):
        pass

    def fit(self, views, folder, report):
        (folder / "scene.txt").write_text(f"{len(views.image)} views, {self.shade}")
        return []
"""


def test_somebody_else_s_fitter_fits_where_it_is_allowed(posed, tmp_path):
    (tmp_path / "mine.py").write_text(PLUGIN)
    words = ["fit", str(posed), "--as", "mine", "-o", str(tmp_path / "out"), "shade=0.25", "-q"]
    got = CliRunner().invoke(app, words)
    assert "fitter 'mine': no such component" in str(got.exception)
    try:
        got = CliRunner().invoke(app, [*words, "--allow-plugin", str(tmp_path / "mine.py")])
        assert got.exit_code == 0, got.exception
        assert (tmp_path / "out" / "scene.txt").read_text().endswith("views, 0.25")
    finally:
        FITTERS._classes.pop("mine", None)


@pytest.mark.parametrize("value", ["${oc.env:HOME}", '"\\x24{oc.env:HOME}"'])
def test_an_option_reads_no_environment(posed, tmp_path, monkeypatch, value):
    monkeypatch.setenv("HOME", "/not/to/be/told")
    got = CliRunner().invoke(app, ["fit", str(posed), "-o", str(tmp_path / "out"), f"budget={value}"])
    assert isinstance(got.exception, UsageError)
    assert "budget: interpolation is not part of the grammar" in str(got.exception)
    assert "/not/to/be/told" not in str(got.exception)


def test_a_folder_with_something_else_is_refused_and_left_alone(posed, tmp_path):
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "curve.csv").write_text("mine")
    got = CliRunner().invoke(app, ["fit", str(posed), "-o", str(out), "first=2000", "most=2000", "steps=1", "-q"])
    assert isinstance(got.exception, UsageError)
    assert f"{out}: --out: is neither empty nor a fit, it has no fit.json (name another folder)" in str(got.exception)
    assert [(p.name, p.read_text()) for p in out.iterdir()] == [("curve.csv", "mine")]
