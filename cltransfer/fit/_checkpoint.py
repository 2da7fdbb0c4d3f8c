"""Lightning's checkpoints of a level as safetensors and JSON, looked at before a level goes on from one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pytorch_lightning.plugins.io import CheckpointIO
from torch import Tensor

from ..errors import InputError
from ._state_file import read_state, write_state

ANEW = "delete the file, and its level begins anew"

Keys = tuple[str | int, ...]

PARTS: Mapping[Keys, type] = {
    ("pytorch-lightning_version",): str,
    ("epoch",): int,
    ("global_step",): int,
    ("state_dict",): dict,
    ("callbacks",): dict,
    ("loops", "fit_loop", "epoch_progress", "total", "ready"): int,
    ("loops", "fit_loop", "epoch_loop.state_dict", "_batches_that_stepped"): int,
    ("loops", "fit_loop", "epoch_loop.batch_progress", "total", "ready"): int,
    ("optimizer_states", 0, "state"): dict,
    ("lr_schedulers", 0, "last_epoch"): int,
}
"""Without one of which Lightning ends in a traceback, or goes on from somewhere else and says nothing."""


class StateFiles(CheckpointIO):
    """Reads and writes checkpoints; a pickle is neither written nor read.

    Args:
        shapes: of the parameters that Adam trains, by name, in its order.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]]) -> None:
        self.shapes = shapes

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        """Write ``checkpoint``, whole or not at all."""
        write_state(Path(path), checkpoint)

    def load_checkpoint(self, path: Any, map_location: Any = None, weights_only: bool | None = None) -> Any:
        """Checkpoint of ``path``, on the CPU.

        Raises:
            InputError: it is damaged, or no checkpoint of these parameters.
        """
        state = read_state(Path(path))
        for keys, kind in PARTS.items():
            if not isinstance(_within(state, keys), kind):
                raise _unfit(path, keys, kind.__name__, _within(state, keys))
        for number, (name, shape) in enumerate(self.shapes.items()):
            moments: Keys = ("optimizer_states", 0, "state", number)
            for keys in (("state_dict", name), (*moments, "exp_avg"), (*moments, "exp_avg_sq")):
                value = _within(state, keys)
                if not isinstance(value, Tensor) or tuple(value.shape) != shape:
                    raise _unfit(path, keys, f"tensor {shape}", value)
        return state

    def remove_checkpoint(self, path: Any) -> None:
        """Delete the file where there is one."""
        Path(path).unlink(missing_ok=True)


def _within(state: Any, keys: Keys) -> Any:
    """What nested ``state`` holds under ``keys``; None where it does not reach so far."""
    for key in keys:
        try:
            state = state[key]
        except (IndexError, KeyError, TypeError):
            return None
    return state


def _unfit(path: Any, keys: Keys, expected: str, value: Any) -> InputError:
    came = "nothing" if value is None else type(value).__name__
    came = f"tensor {tuple(value.shape)}" if isinstance(value, Tensor) else came
    where = ".".join(map(str, keys))
    return InputError(path, where, f"expected {expected}, got {came}", ANEW)
