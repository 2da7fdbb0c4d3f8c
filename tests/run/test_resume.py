"""Killed at any moment, a run goes on and ends in the same bits."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.drawing import drawn_by
from cltransfer.driver import stage
from cltransfer.driver.journal import _record
from cltransfer.driver.stage import Spent
from cltransfer.features import Features, OfThisRun
from cltransfer.pipeline.components import Components
from cltransfer.progress import silent
from cltransfer.reading.reference import Reading, _from_scene, read_reference
from cltransfer.registry.plugin_code import code_in
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.run.inputs import Inputs
from cltransfer.run.record import Record, run_header
from cltransfer.scenes import columns
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import cached_lift, with_person
from cltransfer.scenes.ply import write_splats
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.storage.run_files import DONE, JOURNAL, RESULTS
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import transfer

ARGS = ("builtin:courtyard", "builtin:orbit", "frames=3", "generations=6", "search_side=64", "output_side=96")
ARGS += ("threads=1", "-q")
NO_READERS = Components(GaussianSplats(), {}, {})
STOPS = {  # shares of the whole run's journal at which a run is stopped, and by what
    "refine": ((0.3, signal.SIGKILL), (0.7, signal.SIGTERM)),
    "cma": ((0.5, signal.SIGKILL),),
    "adam": ((0.5, signal.SIGKILL),),
}


def stopped_at(size: int, sent: signal.Signals, cache: Path, run: Path, *arguments: str) -> tuple[int, str, str]:
    """Begin ``run``, or go on with it, and send it a signal as soon as its journal has ``size`` bytes.

    Returns exit status and words of the command.
    """
    folder = "--resume" if run.exists() else "--out"
    command = [sys.executable, "-m", "cltransfer", "transfer", *arguments, folder, str(run)]
    env, journal = {**os.environ, "CLTRANSFER_CACHE": str(cache)}, run / JOURNAL
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, env=env, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
    try:
        deadline = time.monotonic() + 200
        while process.poll() is None and time.monotonic() < deadline:
            if journal.exists() and journal.stat().st_size >= size:
                break
            time.sleep(0.002)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, sent)
        said, complained = process.communicate(timeout=30)
    return process.returncode, said, complained


def answers(journal: Path) -> int:
    """Whole answers in a journal; its header is none."""
    with journal.open("rb") as stream:
        return sum(1 for _ in iter(lambda: _record(stream), None)) - 1


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The inode of the file of every fsync from now on."""
    files, sync = list[int](), os.fsync

    def listed(descriptor: int) -> None:
        files.append(os.fstat(descriptor).st_ino)
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", listed)
    return files


def spent(run: Path) -> dict[str, Any]:
    """What a run says that it cost, without its seconds."""
    said = json.loads((run / "metrics.json").read_text())["spent"]
    return {what: cost for what, cost in said.items() if not what.startswith("seconds")}


@pytest.mark.parametrize(
    "engine", ["refine", *(pytest.param(name, marks=pytest.mark.slow) for name in ("cma", "adam"))]
)
def test_a_run_that_was_stopped_goes_on_to_the_same_bits_and_computes_only_what_was_lost(
    command: Callable[..., Any],
    cache: Path,
    tmp_path: Path,
    synced: list[int],
    monkeypatch: pytest.MonkeyPatch,
    engine: str,
) -> None:
    arguments, whole, run = (*ARGS, f"engine={engine}"), tmp_path / "whole", tmp_path / "a take"
    terminated = f"error: terminated (the same command with --resume '{run}' goes on from here)\n"
    ends = {signal.SIGKILL: (-signal.SIGKILL, "", ""), signal.SIGTERM: (143, "", terminated)}  # and no trace
    assert command("transfer", *arguments, "--out", whole).code == 0
    complete, kept = (whole / JOURNAL).read_bytes(), 0
    for share, sent in STOPS[engine]:
        assert stopped_at(int(share * len(complete)), sent, cache, run, *arguments) == ends[sent]
        left = (run / JOURNAL).read_bytes()
        assert complete.startswith(left)
        assert [path.name for path in run.rglob("*")] == [JOURNAL]  # nothing half-written
        assert kept < (kept := answers(run / JOURNAL))
    synced.clear()
    monkeypatch.setattr("cltransfer.driver.journal.SYNC", 0.0)
    resumed = command("transfer", *arguments, "--resume", run)
    assert resumed.code == 0, resumed.err
    computed = synced.count((run / JOURNAL).stat().st_ino)
    assert computed == answers(whole / JOURNAL) - kept > 0
    written = [(run / name).stat().st_ino for name in RESULTS if (run / name).exists()]
    assert len(written) == len(RESULTS)
    assert {*written} <= {*synced}
    assert max(map(synced.index, written)) == synced.index((run / DONE).stat().st_ino)  # DONE is the last
    for name in ("trajectory.json", "metrics.csv", JOURNAL):
        assert (run / name).read_bytes() == (whole / name).read_bytes()
    assert spent(run) == spent(whole)
    assert min(spent(run)[what] for what in ("evaluations", "renders")) > answers(whole / JOURNAL)


def _ends(journal: Path) -> list[int]:
    """Where each record of a journal ends, that of its header first."""
    with journal.open("rb") as stream:
        return [stream.tell() for _ in iter(lambda: _record(stream), None)]


CUTS = 3  # places at which a journal is cut, evenly spread, and once more behind its last answer


@pytest.mark.parametrize(
    "options",
    [
        ("builtin:courtyard", "builtin:orbit", "preset=fast"),
        ("builtin:courtyard", "builtin:static", "preset=balanced"),  # it stands: frames are those before them
        # scenes that are merged on the way
        pytest.param(("builtin:courtyard", "builtin:pan", "preset=fast", "lod=2"), marks=pytest.mark.slow),
        pytest.param(("builtin:plaza", "builtin:dolly_zoom", "preset=max"), marks=pytest.mark.slow),
    ],
)
def test_wherever_a_run_was_killed_it_ends_in_the_same_bits_and_renders_the_less_the_later_that_was(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, reference, *overrides = options
    small = ("frames=4", "search_side=48", "output_side=48", "threads=1", "extract.verify=false")
    config, journal, drawn = load_config(overrides=[*overrides, *small]), tmp_path / JOURNAL, list[int]()

    def counted(renderer: Any, scene: Any, cameras: Camera, buffers: frozenset[str]) -> Features:
        drawn.append(len(cameras))
        return drawn_by(renderer, scene, cameras, buffers)

    monkeypatch.setattr(stage, "drawn_by", counted)

    def made(resume: bool) -> tuple[bytes, bytes, Spent, int]:
        drawn.clear()
        found = transfer(Inputs(scene, reference), config, record=Record(journal, resume))
        camera = found.trajectory.camera
        return camera.w2c.numpy().tobytes(), camera.K.numpy().tobytes(), found.spent, sum(drawn)

    *whole, most = made(False)
    complete, ends = journal.read_bytes(), _ends(journal)
    places = [ends[i * (len(ends) - 1) // (CUTS + 1)] for i in range(1, CUTS + 1)]
    renders = []
    for place in (*places, len(complete)):
        journal.write_bytes(complete[: place + 1])  # the next answer is torn
        *resumed, again = made(True)
        assert resumed == whole
        assert journal.read_bytes() == complete
        renders.append(again)
    assert most > renders[0]
    assert renders == sorted(renders, reverse=True)
    assert renders[-1] < 0.2 * most  # what is read back, and to see that nothing changes where a camera stands


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (("--init", "RUN/trajectory.json"), "init: the run was begun with 'auto', this is "),
        (("--init", "RUN/trajectory.json"), "(go on with --init auto, or start over with another --out)"),
        (("seed=5",), "config.seed: the run was begun with 0, this is 5 (go on with seed=0, or "),
    ],
)
def test_a_resumed_run_with_another_start_is_refused_by_what_differs(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, changed: tuple[str, ...], reason: str
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    words = (word.replace("RUN", str(run)) for word in changed)
    refused = command("transfer", "-c", run / "config.yaml", "-q", "--resume", run, *words)
    assert refused.code == 3
    assert reason in refused.err
    assert refused.err.count("\n") == 1
    assert {path.name for path in tiny_run.iterdir()} == {path.name for path in run.iterdir()}


def test_a_run_is_resumed_in_its_folder_however_that_is_named_and_in_no_other(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    words = ("transfer", "-c", run / "config.yaml", "-q", "seed=5", "--resume", run, "--out")
    assert "--out: a run is resumed in its own folder" in command(*words, tmp_path / "other").err
    assert "the run was begun with 0, this is 5" in command(*words, tmp_path / "other" / ".." / "run").err


def test_a_run_of_other_threads_says_how_to_go_on(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    begun = json.loads((run / "manifest.json").read_text())["threads"]
    words = ("transfer", "-c", run / "config.yaml", "-q", "--resume", run)
    monkeypatch.setenv("CLTRANSFER_THREADS", str(begun + 1))
    refused = command(*words)
    assert refused.code == 3
    assert f"(go on with CLTRANSFER_THREADS={begun}, or start over with another --out)" in refused.err


def test_a_run_that_was_killed_is_not_begun_anew_in_its_folder_nor_by_other_threads(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (run / DONE).unlink()
    kept = (run / JOURNAL).read_bytes()
    same = ("transfer", "-c", tiny_run / "config.yaml", "--out", run)
    begun = json.loads((run / "manifest.json").read_text())["threads"]
    for threads in (begun + 1, begun):
        monkeypatch.setenv("CLTRANSFER_THREADS", str(threads))
        refused = command(*same)
        assert refused.code == 2
        assert "will be replaced, unless this is its own command" in refused.err
        assert f"this run was begun there and has not come to its end (go on with --resume {run}, or " in refused.err
        assert (run / JOURNAL).read_bytes() == kept
    assert command(*same, "seed=5").code == 0  # another run: what lies there is of no use to it
    assert (run / DONE).is_file()


def test_a_command_that_is_refused_leaves_the_run_in_its_folder_as_it_was(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    """By what is known last: an initial view within the person, and that no view shows them."""
    run = shutil.copytree(tiny_run, tmp_path / "run")
    found, middle = Trajectory.load(run / "trajectory.json"), Subject.load(run / "subject.json").anchor
    w2c = found.camera.w2c.clone()
    w2c[:, :3, 3] = -(w2c[:, :3, :3] @ middle)
    Trajectory(replace(found.camera, w2c=w2c), found.times).save(tmp_path / "amid.json")
    for words, told in (
        (("--init", tmp_path / "amid.json"), "expected a camera beside the person, got one at the middle of the body"),
        (("renderer.gaussian_splats.near=1000", "guide=0"), "no view around the subject shows it"),
    ):
        refused = command("transfer", "-c", tiny_run / "config.yaml", "-q", *words, "--out", run)
        assert refused.code == 3
        assert told in refused.err
        assert {path.name for path in tiny_run.iterdir()} == {path.name for path in run.iterdir()}
        assert (run / JOURNAL).read_bytes() == (tiny_run / JOURNAL).read_bytes()


@dataclass(frozen=True)
class Plugin(GaussianSplats):
    """A renderer whose code lies in this file."""

    colours: str = ""


def test_a_journal_is_of_the_code_and_the_files_of_every_plugin(tmp_path: Path) -> None:
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, scene = Components.build(config), load_scene("builtin:plaza")
    reference = read_reference("builtin:static", parts, Reading(2, 64, "scene"))
    ours = run_header(given, config, parts, SubjectOrbit(), scene, reference)
    plugged = run_header(given, config, replace(parts, renderer=Plugin()), SubjectOrbit(), scene, reference)
    assert {key for key in plugged if plugged[key] != ours.get(key)} == {"code of the renderer"}
    assert plugged["code of the renderer"] == code_in(Path(__file__).parents[1])  # tests is a package
    (tmp_path / "lut").write_text("red")
    parts = replace(parts, renderer=Plugin(colours=str(tmp_path / "lut")))
    with_file = run_header(given, config, parts, SubjectOrbit(), scene, reference)
    assert {key for key in with_file if with_file[key] != plugged.get(key)} == {"files of the renderer"}


class Plain:
    """A geometry of a plugin that is no dataclass; its file names another file."""

    label = torch.zeros(1)

    def __init__(self, texture: str) -> None:
        self.texture = texture


@dataclass(frozen=True, eq=False)
class Textured:
    """One that is."""

    texture: str
    label: torch.Tensor = Plain.label


@pytest.mark.parametrize("kind", [Plain, Textured])
def test_a_journal_looks_into_no_file_that_a_scene_names(kind: type[Any], tmp_path: Path) -> None:
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, other = Components.build(config), tmp_path / "other"
    reference = read_reference("builtin:static", parts, Reading(2, 64, "scene"))
    scene, told = replace(load_scene("builtin:plaza"), geometry=kind(str(other))), []
    for content in ("one", "another"):
        other.write_text(content)
        told.append(run_header(given, config, parts, SubjectOrbit(), scene, reference))
    assert told[0] == told[1]
    assert told[0]["code of the scene"] == code_in(Path(__file__).parents[1])  # tests is a package


def test_a_journal_is_of_the_harmonics_that_there_was_memory_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_splats(tmp_path / "room.ply", synthetic_room(500))
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, told, lifts, references = Components.build(config), [], set[Path](), set[str]()
    Trajectory(room_cameras(2, (32, 18)), torch.arange(2.0)).save(tmp_path / "path.json")
    person, label = load_scene("builtin:plaza").subject, torch.ones(500)
    assert person is not None
    for degree in (0, 3):
        monkeypatch.setattr(columns, "free_bytes", lambda degree=degree: columns.needed_bytes(500, degree))
        scene = load_scene(tmp_path / "room.ply")
        lifts.add(cached_lift(scene, parts.renderer, {}))
        scene = with_person(scene, person, label)
        source = f"{tmp_path / 'room.ply'}@{tmp_path / 'path.json'}"
        reference = _from_scene(source, NO_READERS, Reading(2, 64, "image"), silent)
        references.add(reference.digest)
        told.append(run_header(given, config, parts, SubjectOrbit(), scene, replace(reference, digest="")))
    assert [header.pop("harmonics of the scene") for header in told] == [0, 3]
    assert told[0] == told[1]
    assert (len(lifts), len(references)) == (2, 2)


def test_a_journal_is_of_what_could_be_read_of_the_reference_this_time() -> None:
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, scene = Components.build(config), load_scene("builtin:plaza")
    reference = read_reference("builtin:static", parts, Reading(2, 64, "scene"))
    told = []
    for late in ({}, {"depth": "7 of 24 frames"}, {"depth": "9 of 24 frames"}):
        reasons = {name: OfThisRun(f"time ran out with {when}") for name, when in late.items()}
        read = replace(reference, features=replace(reference.features, reasons=reasons))
        told.append(run_header(given, config, parts, SubjectOrbit(), scene, read))
    assert told[1] == told[2] != told[0]


def test_a_journal_is_of_losses_in_one_order_which_its_terms_have() -> None:
    given, scene = Inputs("builtin:plaza", "builtin:static"), load_scene("builtin:plaza")
    told = []
    for names in (("jaws_pose", "jaws_flow"), ("jaws_flow", "jaws_pose")):
        config = load_config(overrides=["preset=fast", *(f"losses.{name}={{}}" for name in names)])
        parts = Components.build(config)
        reference = read_reference("builtin:static", parts, Reading(2, 64, "scene"))
        told.append(run_header(given, config, parts, SubjectOrbit(), scene, reference))
    assert told[0] != told[1]


@dataclass(frozen=True)
class Gaze:
    """A loss of a plugin, and its extractor."""

    weights: str = ""


def test_a_journal_is_of_an_extractor_that_bears_the_name_of_a_loss(tmp_path: Path) -> None:
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, weights = Components.build(config), tmp_path / "gaze.pt"
    scene, reference = (
        load_scene("builtin:plaza"),
        read_reference("builtin:static", parts, Reading(2, 64, "scene")),
    )
    parts = replace(parts, extractors={"gaze": Gaze(str(weights))}, losses={"gaze": Gaze()})
    told = []
    for content in ("one", "another"):
        weights.write_text(content)
        told.append(run_header(given, config, parts, SubjectOrbit(), scene, reference))
    assert {key for key in told[0] if told[0][key] != told[1][key]} == {"files of extractor gaze"}


def test_a_journal_is_of_the_scene_its_person_and_the_reference() -> None:
    config, given = load_config(overrides=["preset=fast"]), Inputs("builtin:plaza", "builtin:static")
    parts, scene = Components.build(config), load_scene("builtin:plaza")
    reference = read_reference("builtin:static", parts, Reading(2, 64, "scene"))
    ours = run_header(given, config, parts, SubjectOrbit(), scene, reference)
    assert scene.subject is not None
    others = {
        "scene": (replace(scene, digest="0" * 64), reference),
        "person": (replace(scene, subject=replace(scene.subject, height=2.0)), reference),
        "reference": (scene, replace(reference, digest="0")),
    }
    for key, other in others.items():
        header = run_header(given, config, parts, SubjectOrbit(), *other)
        assert {name for name in header if header[name] != ours.get(name)} == {key}
    assert {"code of cltransfer", "networks run on"} <= set(ours)
