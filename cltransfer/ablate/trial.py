"""One trial: a row of the table on one case, run and measured; what goes wrong becomes its reason."""

from __future__ import annotations

import functools
import hashlib
import json
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from .. import __version__
from ..config.layers import origin
from ..config.options import RunConfig
from ..errors import CltransferError, ModelError, UsageError
from ..models.content import read_by, read_otherwise
from ..reading.scene_source import split_scene
from ..registry.declared import BUILTIN
from ..registry.plugin_code import own_code
from ..run.result import Result
from .content import Digest, codes_of, digests, parts_content, read_here
from .outcome import Case, Metric, Outcome
from .sweep import SceneConfig, Sweep


@dataclass(frozen=True)
class Trial:
    """One run of a sweep.

    Args:
        key: digest of everything the outcome depends on.
        row: of the table.
        case: what it is run on.
        scene: the same, to be loaded.
        reference: the same, to be read.
        config: of the run, with its seed.
        metrics: config by which the result is measured.
        codes: of the plugins that both name, which ``key`` is made of too.
        files: digest of the files that both name, and of the networks if any is read.
        sources: the scene, its view and person's file, and the reference, each by name, with what identified it.
    """

    key: str
    row: str
    case: Case
    scene: SceneConfig
    reference: str
    config: RunConfig
    metrics: RunConfig
    codes: tuple[str, ...]
    files: str
    sources: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Job:
    """What every worker is told.

    Args:
        plugins: to import, as :func:`cltransfer.plugins.settle` tells them.
        runs: folder for whole runs, None keeps none.
        codes: of the plugins that the trials were told apart by, see :func:`cltransfer.ablate.content.plugin_codes`.
        code: of cltransfer, see :func:`cltransfer.registry.plugin_code.own_code`; empty lets any worker run them.
        elsewhere: whether workers may be on other computers: of those here code is other only where it has changed.
        readers: what the command reads pictures by, see :func:`cltransfer.models.content.read_by`; empty lets any
            worker run them.
    """

    plugins: tuple[str, ...] = ()
    runs: str | None = None
    codes: tuple[str, ...] = ()
    code: str = ""
    elsewhere: bool = True
    readers: tuple[Any, ...] = ()


def trials(sweep: Sweep, drawn: dict[tuple[str, int], str], digest: Digest | None = None) -> list[Trial]:
    """Every row on every case, case by case, so that a sweep that is cut short has compared something.

    Args:
        sweep: the ablation.
        drawn: references that were made for it, by name and seed.
        digest: what identifies a source, where some were read before.

    Raises:
        InputError: a file is missing.
        UsageError: a scene and a reference come to the same as others that are named, or a row to another one, as by a
            scene under another name.
    """
    found, digest, cases = list[Trial](), digest or digests(), dict[tuple[str, str], Case]()
    rows: dict[str, str] = {}
    parts = [(parts_content(row.config), codes_of(row.config, sweep.metrics)) for row in sweep.rows]
    measures = parts_content(sweep.metrics)
    for scene, reference, case in _cases(sweep):
        source = drawn.get((reference, case.seed), reference)
        for row, (own, codes) in zip(sweep.rows, parts):
            used = row.scene or scene
            config = replace(row.config, seed=case.seed)
            whom = used.subject if isinstance(used.subject, int) else digest(used.subject)
            names = (used.scene, used.init, used.subject, source)
            sources = {name: digest(name) for name in names if isinstance(name, str)}
            content = [digest(used.scene), digest(used.init), whom, used.up, digest(source)]
            answers = [
                [__version__, own_code(), read_by()],
                asdict(config),
                asdict(sweep.metrics),
                content,
                [own, measures],
            ]
            key = _digest(answers)[:24]
            twin = cases.setdefault((row.name, key), case)
            if twin != case:  # as one more value it would make an interval narrow
                told = f"{case.reference} in {case.scene} is the same as {twin.reference} in {twin.scene}"
                raise UsageError("", "references", told, "name each scene and reference once")
            if (first := rows.setdefault(key, row.name)) != row.name:
                at = origin(sweep.origins, f"rows.{row.name}")
                raise UsageError(at, f"rows.{row.name}", f"is the same run as {first!r}", "remove one of them")
            files = _files(used, source, (config, own), (sweep.metrics, measures))
            found.append(
                Trial(key, row.name, case, used, source, config, sweep.metrics, codes, files, tuple(sources.items()))
            )
    return found


Told = tuple[RunConfig, list[list[Any]]]  # a config and the content of its parts


def _files(scene: SceneConfig, reference: str, row: Told, metrics: Told) -> str:
    """Digest of what else is read here; scenes that are made by code are read by geometry alone."""
    made = all(name.startswith(BUILTIN) for name in (scene.scene, (split_scene(reference) or (reference,))[0]))
    networks = not made or row[0].extract.inner != "geometric"
    return _digest([read_here(*told, networks) for told in (row, metrics)])


def _digest(told: object) -> str:
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _cases(sweep: Sweep) -> Iterator[tuple[SceneConfig, str, Case]]:
    scenes, references = sweep.file.scenes, sweep.file.references
    named = list(zip(scenes, _shown([scene.scene for scene in scenes])))
    for seed in sweep.file.seeds:
        for scene, scene_name in named:
            for reference, name in zip(references, _shown(references)):
                yield scene, reference, Case(scene_name, name, seed)


def _shown(sources: Sequence[str]) -> list[str]:
    """Names for tables: without the folders; numbered where that makes them the same, or one scene has two people.

    >>> _shown(["a/clip.mp4", "b/clip.mp4", "a/other.mp4"])
    ['clip.mp4 (1)', 'clip.mp4 (2)', 'other.mp4']
    """
    parts = [split_scene(source) or (source,) for source in sources]
    names = ["@".join(part if ":" in part else Path(part).name for part in named) for named in parts]
    alike, before = Counter(names), Counter[str]()
    told: list[str] = []
    for name in names:
        shown = name
        while alike[name] > 1 and (shown == name or shown in alike):  # a file may be called like a number
            before[name] += 1
            shown = f"{name} ({before[name]})"
        told.append(shown)
    return told


def run_trial(trial: Trial, job: Job) -> Outcome:
    """Run and measure ``trial``; a failure is an outcome too, so that the sweep goes on.

    Raises:
        ModelError: the code, a package, a plugin's code, a network, a scene or another file is not what the trials were
            told apart by, so that the outcome would be another's.
    """
    start = time.perf_counter()
    other: ModelError | None = None
    try:
        other = _allowed(job) or _other(trial, job)
        outcome = _run(trial, job) if other is None else Outcome(trial.key, trial.row, trial.case, failed=str(other))
    except CltransferError as error:
        outcome = Outcome(trial.key, trial.row, trial.case, failed=str(error))
    except (Exception, SystemExit) as error:
        outcome = Outcome(trial.key, trial.row, trial.case, failed=f"{type(error).__name__}: {error}")
    if other is not None:
        _allow.cache_clear()  # a worker that lives on imports them anew
        raise other
    return replace(outcome, seconds=round(time.perf_counter() - start, 3))


def _allowed(job: Job) -> ModelError | None:
    """Import the plugins; why one cannot be, as where it is not installed here."""
    try:
        _allow(job.plugins, job.codes)
    except ModelError as error:
        return error
    return None


def _other(trial: Trial, job: Job) -> ModelError | None:
    """What is not here as it was where the ablation began."""
    if job.code and job.code != own_code():
        if not job.elsewhere:
            return _changed("the code of cltransfer was changed")
        told = "a worker has other code of cltransfer than the command"
        return ModelError("", "engine", told, "give every worker the command's; what is done is kept")
    if job.readers and (apart := read_otherwise(job.readers)):
        if not job.elsewhere:
            return _changed(f"what pictures are read by was changed ({apart})")
        told = f"a worker has other packages than the command: {apart}"
        return ModelError("", "engine", told, "give every worker the command's; what is done is kept")
    if trial.codes != codes_of(trial.config, trial.metrics):
        told = "the code of a plugin is not what it was when the ablation began"
        hint = "run it again, of an installed one in a new kernel, with new workers: what is done is kept"
        return ModelError("", "--allow-plugin", told, hint)
    row, metrics = ((config, parts_content(config)) for config in (trial.config, trial.metrics))
    if trial.files != _files(trial.scene, trial.reference, row, metrics):
        if not job.elsewhere:
            return _changed("a network or a file of a plugin was changed")
        told = "a worker has other networks or files of a plugin than the command had when the ablation began"
        return ModelError("", "engine", told, "give every worker the same, and run it again: what is done is kept")
    return _edited(trial) if job.code else None


def _changed(what: str) -> ModelError:
    return ModelError("", "engine", f"{what} while the ablation ran", "run it again: what is done is kept")


def _edited(trial: Trial) -> ModelError | None:
    """What a trial is run on, if it is not there, or not as it was where the ablation began."""
    for source, known in trial.sources:
        try:
            now = digests()(source)
        except CltransferError as error:
            told = f"what the command has read cannot be read here: {error}"
            return ModelError("", "engine", told, "scenes, references and --out lie at one place for every worker")
        if now != known:
            told = "is not what it was when the ablation began"
            return ModelError(source, "engine", told, "run it again: what is done is kept")
    return None


def _run(trial: Trial, job: Job) -> Outcome:
    from ..computer.threads import default_count, set_threads
    from ..losses.camera_movement import weight_note
    from ..transfer import Inputs, transfer
    from .measure import measured

    scene = trial.scene
    up = None if scene.up is None else (scene.up[0], scene.up[1], scene.up[2])
    subject = Path(scene.subject) if isinstance(scene.subject, str) else scene.subject
    inputs = Inputs(scene.scene, trial.reference, scene.init, subject, up)
    set_threads(trial.config.threads or default_count())  # of what is measured too
    result = transfer(inputs, trial.config)
    found = measured(result, trial.reference, trial.config, trial.metrics)
    scores = found.scores
    if job.runs is not None:
        from ..run.folder import write_run

        write_run(Path(job.runs) / trial.key, result, inputs, trial.config, job.plugins)
    metrics = {
        term.name: Metric(_number(found.priced[:, i].nanmean()), term.unit, term.defined, term.reason)
        for i, term in enumerate(scores.terms)
    }
    metrics["total"] = Metric(_number(scores.total), "", int(scores.totals.isfinite().sum()), "")
    ways = {name: Metric(_number(way.mean), way.unit, way.defined, "") for name, way in found.directions.items()}
    weight = weight_note(result.objective.losses, result.reference.features.size[0])
    without = [f"{t.name}: {t.reason}" for t in result.verified.terms if t.reason and t.name not in metrics]
    notes = (result.schedule.note, *without, weight, _lens_note(trial.config, result), found.note)
    said = dict.fromkeys(filter(None, notes))  # of both sides: once
    return Outcome(
        trial.key, trial.row, trial.case, "", metrics, len(scores.totals), result.spent.evaluations,
        result.spent.network_passes, directions=ways, note="; ".join(said),
        lasts=found.lasts and result.lasts,
    )  # fmt: skip


def _lens_note(config: RunConfig, result: Result) -> str:
    """Why a row that leaves filmic space out differs from the others by more than that."""
    from ..losses.filmic_space import counted

    if result.schedule.free_lens or config.zoom not in ("auto", "still") or counted(result.objective.losses):
        return ""
    return "the focal length is kept where filmic space does not count: zoom=free lets it change"


def _number(value: float | Tensor) -> float | None:
    return float(value) if math.isfinite(value) else None


@functools.lru_cache(maxsize=1)
def _allow(plugins: tuple[str, ...], codes: tuple[str, ...]) -> None:
    """Import the plugins, once a sweep; those of other code than in the last one, as a worker may outlive it, anew."""
    from ..plugins import import_settled

    import_settled(plugins)
