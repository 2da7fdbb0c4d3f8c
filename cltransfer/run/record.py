"""The journal of a run, and what the answers in it depend on."""

from __future__ import annotations

import os
import shlex
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from ..computer.packages import versions
from ..computer.threads import thread_count
from ..config.options import RunConfig
from ..driver.journal import Journal
from ..driver.journal_header import PERSON
from ..errors import UsageError
from ..models.content import files_content, model_content, own_model
from ..models.onnx import VARIABLE
from ..pipeline.components import Components
from ..reading.reference import Reference
from ..registry.plugin_code import code_of, own_code
from ..scenes import Scene
from ..storage.run_files import DONE
from .inputs import Inputs


@dataclass
class Record:
    """The journal of a run.

    Args:
        path: of the file.
        resume: go on with what is there.
        ours: whether what lies there is of this run, which can go on from it.
    """

    path: Path
    resume: bool = False
    ours: bool = field(init=False)

    def __post_init__(self) -> None:
        self.ours = self.resume

    def open(self, header: dict[str, Any]) -> Journal:
        """The journal of a run that depends on ``header``; what another has left there stays until :meth:`settle`.

        Raises:
            InputError: it is resumed, and is of another run or no journal.
            UsageError: it is not, and this very run was begun here and has not come to its end.
        """
        folder = self.path.parent
        if not (self.resume or self.path.with_name(DONE).is_file()) and Journal.begun(self.path, header):
            hint = f"go on with --resume {shlex.quote(str(folder))}, or name another --out"
            raise UsageError(folder, "--out", "this run was begun there and has not come to its end", hint)
        journal = Journal(self.path, header, self.resume, patient=True)
        self.ours = journal.settled
        return journal

    def settle(self, journal: Journal) -> None:
        """Nothing refuses the run of ``journal`` any more: what lies beside it is not finished from now on."""
        self.path.with_name(DONE).unlink(missing_ok=True)  # first: the run that was begun there could go on
        journal.settle()
        self.ours = True


def run_header(
    inputs: Inputs, config: RunConfig, parts: Components, search: Any, scene: Scene, reference: Reference
) -> dict[str, Any]:
    """What the answers of a run depend on."""
    networks = {name: own_model(extractor) for name, extractor in parts.extractors.items()}
    named = {f"extractor {name}": extractor for name, extractor in parts.extractors.items()}
    named |= {f"loss {name}": loss for name, loss in parts.losses.items()}  # an extractor may have the same name
    named |= {"the renderer": parts.renderer, "the search": search}
    # what a scene's file says is in its digest; a path that stands in it is nobody's option
    code = {**{name: code_of(part) for name, part in named.items()}, "the scene": scene.code}
    return {
        **{f"config.{key}": value for key, value in asdict(config).items()},
        "order of losses and extractors": [list(config.losses), list(config.extractors)],  # that of the terms recorded
        "scene": scene.digest,
        "harmonics of the scene": scene.harmonics,
        PERSON: scene.person_digest,
        "reference": reference.digest,
        "unread of the reference": sorted(reference.features.reasons),  # this time: OfThisRun
        "part of the reference": inputs.part,
        "init": inputs.init,
        "subject": None if inputs.subject is None else str(inputs.subject),
        **{f"network of {name}": model_content(model) for name, model in networks.items() if model is not None},
        **{f"files of {name}": content for name, part in named.items() if (content := files_content(part))},
        **{f"code of {name}": content for name, content in code.items() if content},
        "versions": {**{name: metadata.version(name) for name in ("cltransfer", "numpy")}, **versions()},
        "code of cltransfer": own_code(),
        "networks run on": os.environ.get(VARIABLE) or "auto",
        "threads": thread_count(),
    }
