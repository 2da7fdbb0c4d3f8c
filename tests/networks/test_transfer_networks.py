"""Transfers whose frames are read by networks: rounds of correction, networks in the search, what both of them cost."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver.guard import PARTLY
from cltransfer.driver.journal import _record
from cltransfer.features import nobody
from cltransfer.models.onnx import Network
from cltransfer.run.rounds import UNBIASED, UNHIDDEN, UNSEEN
from cltransfer.scenes import Scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.simplify import joined
from cltransfer.scenes.splats import Splats
from cltransfer.shots import Setup
from cltransfer.transfer import Inputs, Record, Result, transfer

SMALL = ("search_side=96", "output_side=240", "threads=1")
PASSES = 3  # of YOLOX one, of BlazePose two
SHIPPED = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")

Transfer = Callable[..., Result]


@pytest.fixture
def transferred(
    networks: tuple[str, ...],
    scene_file: Path,
    film: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Transfer:
    """Transfer a film of the painted stage back into it."""
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))

    def run(
        frames: int, *overrides: str, shot: str = "push_in", record: Record | None = None, scene: Path = scene_file
    ) -> Result:
        inputs = Inputs(str(scene), str(film(shot, frames)), subject=scene.with_name("subject.json"))
        return transfer(inputs, load_config(overrides=[*networks, *SMALL, *overrides]), record=record)

    return run


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many images were run through a network, run by run; they are run all the same."""
    counts: list[int] = []
    run = Network.__call__

    def counted(self: Network, inputs: Any) -> Any:
        counts.append(len(next(iter(inputs.values()))))
        return run(self, inputs)

    monkeypatch.setattr(Network, "__call__", counted)
    return counts


def means(result: Result) -> list[float]:
    return [float(attempt.shown.scores.totals.mean()) for attempt in result.attempts]


def test_a_known_bias_is_aimed_off_once_and_the_networks_read_less_of_it(transferred: Transfer) -> None:
    result = transferred(5, "preset=fast", "extract.corrections=1")
    first, second = means(result)
    assert second < 0.8 * first
    assert (result.best, result.note, result.family) == (1, "", "image")
    assert float(result.verified.totals.mean()) == second
    assert torch.equal(result.image, result.attempts[1].shown.image)
    assert not torch.equal(result.image, result.attempts[0].shown.image)
    assert torch.equal(result.trajectory.camera.w2c, result.attempts[1].cameras.w2c)


def test_of_too_few_frames_no_bias_is_known_and_every_look_is_counted(transferred: Transfer, looks: list[int]) -> None:
    result = transferred(3, "preset=fast", "extract.corrections=1")
    assert (len(result.attempts), result.best, result.note) == (1, 0, f"no {UNBIASED}")
    assert result.spent.network_passes == 3 * PASSES + 2 * PASSES  # the result, and its first view held still
    assert sum(looks) == 3 * PASSES + result.spent.network_passes  # the reference is read beside it


def test_the_round_that_reads_best_is_kept_whichever_it_is(transferred: Transfer) -> None:
    """Each frame's own bias needs no neighbours, and of an orbit it is too rough to be aimed off twice."""
    result = transferred(3, "preset=fast", "extract.corrections=2", "extract.bias=frame", shot="orbit")
    first, second, third = means(result)
    assert second < min(first, third)
    assert (result.best, result.note) == (1, "")
    assert result.verified is result.attempts[result.best].shown.scores
    for attempt in result.attempts:
        assert attempt.shown.features.names() == {"keypoints", "box", "orientation"}  # no maps, once they were scored
        assert attempt.shown.read.names > {"keypoints", "box", "orientation", "flow"}
    assert result.spent.network_passes == 3 * 3 * PASSES + 2 * PASSES


def test_a_run_that_goes_on_has_networks_read_what_they_had_not_read(
    transferred: Transfer, looks: list[int], tmp_path: Path
) -> None:
    """Killed at the end, while what the second round found is read, and while what the first one found is."""
    journal, asked = tmp_path / "journal.bin", (5, "preset=fast", "extract.corrections=1")
    whole = transferred(*asked, record=Record(journal))
    complete, ends = journal.read_bytes(), [0]
    with journal.open("rb") as stream:
        while (payload := _record(stream)) is not None:
            ends += [stream.tell()] if b'"places"' in payload else []
    assert len(ends) == 1 + len(whole.attempts) == 3
    for cut, rounds in ((len(complete), 0), (ends[2] - 1, 1), (ends[1] - 1, 2)):
        journal.write_bytes(complete[:cut])
        looks.clear()
        again = transferred(*asked, record=Record(journal, resume=True))
        assert sum(looks) == (5 * rounds + 2) * PASSES  # 2: the first view held still
        assert journal.read_bytes() == complete
        assert again.spent == whole.spent
        assert torch.equal(again.trajectory.camera.w2c, whole.trajectory.camera.w2c)
        assert (means(again), again.best, again.note) == (means(whole), whole.best, whole.note)


def test_the_papers_setting_has_every_candidate_read_by_networks(transferred: Transfer, looks: list[int]) -> None:
    result = transferred(2, "preset=paper", "search_side=96", "generations=2", "popsize=4", "extract.corrections=1")
    spent = result.spent
    assert spent.generations == 2 * 2
    assert spent.evaluations >= 2 * 2 * 4
    assert spent.network_passes == PASSES * spent.renders + 2 * PASSES
    assert spent.network_passes > PASSES * spent.evaluations
    assert spent.evaluations < sum(looks) <= spent.network_passes + 2 * PASSES  # no pose where nobody is found
    assert (len(result.attempts), result.family) == (1, "image")  # no bias between two networks
    assert result.note == "no correction: extract.inner=image searches by the networks themselves"
    assert all(term.defined for term in result.verified.terms if term.name != "filmic_space")


@pytest.fixture
def behind_a_board(scene_file: Path, stage: Scene) -> Path:
    """The painted stage as a file, a board before the person's legs where an unmoved camera films them from."""
    subject = stage.subject
    assert subject is not None
    towards = math.cos(Setup.azimuth) * subject.facing + math.sin(Setup.azimuth) * subject.left
    across, along = (
        torch.cartesian_prod(torch.arange(-1, 1, 0.03), torch.arange(-0.5, 0.05, 0.03)).double().T[..., None]
    )
    place = 0.6 * towards + across * torch.linalg.cross(subject.up, towards) + along * subject.up
    n, ones = len(place), torch.ones(len(place))
    sizes, turns = torch.full((n, 3), 0.03 * subject.height), torch.eye(4)[:1].expand(n, 4)
    grey = torch.zeros(n, *stage.geometry.sh.shape[1:])
    board = Splats((subject.anchor + subject.height * place).float(), sizes, turns, ones, grey, torch.zeros(n))
    whole, folder = joined(stage.geometry, board), scene_file.parent / "board"
    folder.mkdir(exist_ok=True)
    write_splats(folder / "stage.ply", whole)
    save_labels(folder, whole.label)
    subject.save(folder / "subject.json")
    return folder / "stage.ply"


@pytest.mark.parametrize("guard", [True, False])
def test_who_is_lost_behind_something_is_shown_whole_by_the_next_round(
    transferred: Transfer, behind_a_board: Path, guard: bool
) -> None:
    """The detector finds only who is slender, as the person is whole, and not by half."""
    wanted = ("preset=fast", f"guard={str(guard).lower()}", "extractors.detect_yolox.model=whole.onnx")
    result = transferred(2, *wanted, shot="static", scene=behind_a_board)
    assert nobody(result.attempts[0].shown.features).all()
    if not guard:
        assert (len(result.attempts), result.note) == (1, UNSEEN)
        return
    assert (len(result.attempts), result.best, result.note) == (2, 1, f"no correction: {UNHIDDEN}")
    assert not nobody(result.kept.shown.features).any()
    assert result.attempts[0].doubtful[PARTLY].all()
    assert not result.kept.doubtful[PARTLY].any()
    first, second = means(result)
    assert second < 0.5 * first


def test_corrections_after_such_a_round_go_on_from_it(transferred: Transfer, behind_a_board: Path) -> None:
    """Also from one that reads a little worse, as the seventh here: the first, that sees nobody, is none."""
    wanted = ("preset=fast", "extract.corrections=8", "extract.bias=frame", "extractors.detect_yolox.model=whole.onnx")
    result = transferred(2, *wanted, shot="static", scene=behind_a_board)
    later = means(result)[1:]
    assert len(later) == 8
    assert not any(nobody(attempt.shown.features).any() for attempt in result.attempts[1:])
    assert result.note == ""


@pytest.mark.parametrize(
    ("preset", "losses"),
    [pytest.param("max", SHIPPED, marks=pytest.mark.slow), ("jaws_losses_cma", ("jaws_pose", "jaws_flow"))],
)
def test_presets_that_no_other_test_runs_come_nearer_than_standing_still(preset: str, losses: tuple[str, ...]) -> None:
    tiny = ("generations=2", "frames=2", "search_side=48", "output_side=96", "threads=1")
    result = transfer(Inputs("builtin:room", "builtin:push_in"), load_config(overrides=[f"preset={preset}", *tiny]))
    assert tuple(term.name for term in result.verified.terms) == losses
    assert all(term.defined for term in result.verified.terms)
    assert float(result.verified.totals.mean()) < float(result.held.totals.mean())
    assert result.spent.generations > 0
    assert (result.spent.network_passes, len(result.attempts), result.family) == (0, 1, "scene")
