"""A level goes on from a checkpoint of its own, and from nothing else."""

from __future__ import annotations

import shutil

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.fit._state_file import read_state, write_state
from cltransfer.fit._training import _going_on
from cltransfer.fit.nerf_grid import NerfGridFit

OPTIONS = NerfGridFit(first=200, most=200, steps=9, look=3, rays=64, degree=0)
SH = ("optimizer_states", 0, "state", 1, "exp_avg")


class Stop(Exception):
    """What interrupts a fit."""


@pytest.fixture(scope="module")
def interrupted(views, tmp_path_factory):
    """Folder of a fit whose level 0 was interrupted after a look."""

    def interrupt(step: str, done: int, total: int) -> None:
        if done == 5:
            raise Stop

    folder = tmp_path_factory.mktemp("fit")
    with pytest.raises(Stop):
        OPTIONS.fit(views, folder, interrupt)
    return folder


def write_with(path, keys, value):
    """Write another ``value`` into a checkpoint."""
    state = within = read_state(path)
    for key in keys[:-1]:
        within = within[key]
    within[keys[-1]] = value
    write_state(path, state)


@pytest.mark.parametrize(
    ("keys", "value", "line"),
    [
        (("state_dict",), None, "state_dict: expected dict, got nothing"),
        (("pytorch-lightning_version",), None, "pytorch-lightning_version: expected str, got nothing"),
        (("global_step",), "3", "global_step: expected int, got str"),
        (("loops", "fit_loop"), {}, "loops.fit_loop.epoch_progress.total.ready: expected int, got nothing"),
        (("optimizer_states",), [], "optimizer_states.0.state: expected dict, got nothing"),
        (("lr_schedulers", 0), {}, "lr_schedulers.0.last_epoch: expected int, got nothing"),
        (("state_dict", "thickness"), "x", "state_dict.thickness: expected tensor (6, 7, 7), got str"),
        (
            ("state_dict", "thickness"),
            torch.ones(2),
            "state_dict.thickness: expected tensor (6, 7, 7), got tensor (2,)",
        ),
        (SH, torch.ones(2), "optimizer_states.0.state.1.exp_avg: expected tensor (6, 7, 7, 1, 3), got tensor (2,)"),
    ],
)
def test_a_part_that_does_not_fit_is_told_in_one_line(views, interrupted, keys, value, line):
    path = interrupted / "level_0.safetensors"
    whole = path.read_bytes()
    write_with(path, keys, value)
    try:
        with pytest.raises(InputError) as caught:
            OPTIONS.fit(views, interrupted, lambda *step: None)
        assert str(caught.value) == f"{path}: {line} (delete the file, and its level begins anew)"
    finally:
        path.write_bytes(whole)


LOOPS, ADAM = ("loops", "fit_loop"), ("optimizer_states", 0, "param_groups", 0)


@pytest.mark.parametrize(
    ("keys", "value", "kind"),
    [
        (("pytorch-lightning_version",), "new", "InvalidVersion"),
        ((*LOOPS, "epoch_loop.scheduler_progress"), {}, "KeyError: 'total'"),
        ((*LOOPS, "epoch_loop.batch_progress", "total", "completed"), None, "TypeError"),
        (("callbacks", "EarlyStopping{'monitor': 'psnr', 'mode': 'max'}", "wait_count"), "x", "TypeError"),
        (("callbacks", "EarlyStopping{'monitor': 'psnr', 'mode': 'max'}", "best_score"), None, "AttributeError"),
        (("callbacks", "Clock"), {"hours": 1}, "KeyError: 'seconds'"),
        ((*ADAM, "betas"), [1], "ValueError"),
        ((*ADAM, "differentiable"), 1, "RuntimeError"),
    ],
)
def test_a_part_that_only_lightning_knows_is_told_in_one_line(views, interrupted, tmp_path, keys, value, kind):
    folder = shutil.copytree(interrupted, tmp_path / "fit")
    path = folder / "level_0.safetensors"
    write_with(path, keys, value)
    with pytest.raises(InputError) as caught:
        OPTIONS.fit(views, folder, lambda *step: None)
    assert str(caught.value).startswith(f"{path}: cannot be gone on from: {kind}")
    assert str(caught.value).endswith("(delete the file, and its level begins anew)")
    assert "\n" not in str(caught.value)


def test_what_fails_in_a_step_is_no_fault_of_a_checkpoint(views, interrupted, tmp_path):
    def report(step: str, done: int, total: int) -> None:
        raise ValueError("of whom is told")

    with pytest.raises(ValueError, match="of whom is told"):
        OPTIONS.fit(views, shutil.copytree(interrupted, tmp_path / "fit"), report)


def test_a_list_is_no_checkpoint(views, interrupted):
    path = interrupted / "level_0.safetensors"
    whole = path.read_bytes()
    write_state(path, [1])
    try:
        with pytest.raises(InputError, match=r"level_0\.safetensors: pytorch-lightning_version: expected str, got not"):
            OPTIONS.fit(views, interrupted, lambda *step: None)
    finally:
        path.write_bytes(whole)


def test_what_fails_in_a_level_that_goes_on_from_nothing_is_told_as_it_is(tmp_path):
    with pytest.raises(ValueError, match=r"^torn$"), _going_on(tmp_path / "level_0.safetensors"):
        raise ValueError("torn")
