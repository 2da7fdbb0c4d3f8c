"""What a run leaves behind, and how it is read again. Every file is whole or not there; DONE is written last."""

from __future__ import annotations

import os
import platform
import re
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import __version__
from ..clips.clip import write_video
from ..computer.packages import versions
from ..computer.processor import processor
from ..computer.revision import commit
from ..computer.threads import default_count
from ..config import to_yaml
from ..config.options import RunConfig
from ..driver.journal_header import PERSON, VIEW
from ..export.lens import filmable
from ..export.nerfstudio import write_camera_path
from ..reading.depth_alignment import depth_network
from ..reading.named_scenes import remember
from ..registry.declared import BUILTIN
from ..report.data import ReportData
from ..report.metrics import metrics_json, metrics_table, write_metrics
from ..report.page import write_report
from ..report.side_by_side import side_by_side
from ..report.strip import write_strip
from ..scenes.meshes.moment import split_moment
from ..scenes.person.lifted import save_labels
from ..storage.files import told_from_here, write_json, write_text
from ..storage.run_files import (
    BESIDE,
    CAMERA_PATH,
    CONFIG,
    DONE,
    FORMAT,
    FRAMES,
    MANIFEST,
    REPORT,
    STRIP,
    SUBJECT,
    TRAJECTORY,
    VIDEO,
    clear,
    open_run,
)
from .flags import run_flags
from .inputs import Inputs
from .result import Result

CONTENTS = ("network of ", "files of ", "code of ")  # that are digests, in the header of a journal


def default_folder(scene: str, reference: str) -> Path:
    """``outputs/<scene>/<reference>/<UTC time>-<process>``: runs that are begun at one time keep apart."""
    stamp = datetime.now(UTC).strftime(f"%Y%m%d-%H%M%S-{os.getpid()}")
    return Path("outputs") / _name(scene) / _name(reference) / stamp


def _name(source: str) -> str:
    without_moment = re.sub("#[^@]*", "", source.removeprefix(BUILTIN))
    name = Path(without_moment).stem.replace("@", "-")
    return "run" if name in ("", "..") else name  # a folder that is named by where it lies


def write_run(
    folder: Path, result: Result, inputs: Inputs, config: RunConfig, plugins: Sequence[str] = ()
) -> ReportData:
    """Write everything a run leaves behind; returns what its report shows.

    Args:
        folder: where to, a run's or one that is to be made.
        result: of ``inputs`` by ``config``.
        inputs: what was transferred.
        config: of the run.
        plugins: files and packages that were allowed for it.

    Raises:
        UsageError: there is something else in ``folder`` than a run.
        InputError: a part of it leads elsewhere.
    """
    open_run(folder)
    manifest = _manifest(result, inputs, config, plugins)
    clear(folder)
    write_json(folder / MANIFEST, manifest)
    write_text(folder / CONFIG, to_yaml(_settled(config, result)))
    trajectory, reference = result.trajectory, result.reference
    trajectory.save(folder / TRAJECTORY)
    write_camera_path(folder / CAMERA_PATH, filmable(trajectory, centred=True))
    write_video(folder / FRAMES, result.image, trajectory.times, lossless=True)
    write_video(folder / VIDEO, result.image, trajectory.times)
    if reference.image is not None:
        both = side_by_side(reference.image, result.image, trajectory.times)
        write_video(folder / BESIDE, both, trajectory.times)
        write_strip(folder / STRIP, reference.image, result.image, trajectory.times)
    if result.scene.subject is not None:
        result.scene.subject.save(folder / SUBJECT)
        save_labels(folder, result.scene.geometry.label)
    report = report_data(folder, result, inputs, plugins)
    write_metrics(folder, report)
    write_report(folder, report)
    write_text(folder / DONE, "")
    if isinstance(inputs.scene, str):
        remember(result.scene.digest, inputs.scene)
    return report


def _settled(config: RunConfig, result: Result) -> RunConfig:
    """``config`` with what the run found out for itself, so that the same clip is read the same way again."""
    if result.alignment is None:
        return config
    name = depth_network(config.extractors)
    network = {**config.extractors[name], "affine": list(result.alignment.affine)}
    return replace(config, extractors={**config.extractors, name: network})


def report_data(folder: Path, result: Result, inputs: Inputs, plugins: Sequence[str]) -> ReportData:
    """The run as its report shows it."""
    spent: dict[str, int | float | str] = dict(asdict(result.spent))
    for name in ("evaluations", "network_passes"):
        spent[f"{name}_per_frame"] = round(getattr(result.spent, name) / len(result.trajectory), 1)
    spent |= {f"seconds, {step}": round(seconds, 2) for step, seconds in result.seconds.items()}
    spent["seconds"] = round(sum(result.seconds.values()), 2)
    stops = Counter(minimum.stop for minimum in result.kept.found.frames)
    spent["stopped by"] = ", ".join(f"{reason} {count}" for reason, count in sorted(stops.items()))
    spent["engine"] = result.schedule.engine
    spent["path"] = "every frame" if result.kept.path is None else result.kept.path.name
    totals = [round(attempt.shown.scores.total, 4) for attempt in result.attempts]
    spent["noise floor"] = round(result.noise, 4)
    spent["total by round"] = ", ".join(map(str, totals)) + (f" (kept {result.best + 1})" if len(totals) > 1 else "")
    spent["read by"] = "networks" if result.family == "image" else "geometry"
    spent["total in the search"] = round(result.searched.total, 4)
    return ReportData(
        title=f"{result.reference.name} in {result.scene.name}",
        times=result.trajectory.times,
        scores=result.verified,
        baseline=result.held,
        trajectory=result.trajectory,
        subject=result.scene.subject,
        reference_frames=result.reference.image,
        render_frames=result.image,
        flags=run_flags(result),
        spent=spent,
        command=command_again(folder, inputs, plugins),
    )


def command_again(folder: Path, inputs: Inputs, plugins: Sequence[str]) -> str:
    """The shell line that makes the run in ``folder`` again, with the plugins it was allowed; empty where none can."""
    if not isinstance(inputs.scene, str):  # a value that Python has made
        return ""
    command = ["cltransfer", "transfer", inputs.scene, inputs.reference, "--init", inputs.init]
    if inputs.subject is not None:
        command += ["--subject", str(inputs.subject)]
    if inputs.up is not None:
        command += ["--up", ",".join(repr(float(value)) for value in inputs.up)]
    for plugin in plugins:
        command += ["--allow-plugin", plugin]
    return shlex.join([*command, "--config", str(folder / CONFIG)])


def _manifest(result: Result, inputs: Inputs, config: RunConfig, plugins: Sequence[str]) -> dict[str, Any]:
    reference = {"name": result.reference.name, "sha256": result.reference.digest, "part": inputs.part}
    scene = result.scene
    about = {"name": scene.name, "sha256": scene.digest, "up": scene.up.tolist(), "harmonics": scene.harmonics}
    file = split_moment(inputs.scene)[0].suffix.lower() if isinstance(inputs.scene, str) else None
    said = ("init", VIEW, "subject", PERSON, "networks run on")
    header = {key: v for key, v in result.header.items() if key in said or key.startswith(CONTENTS)}
    return {
        "format": FORMAT,
        "version": 1,
        "cltransfer": __version__,
        "scene": {**about, "file": file},  # its suffix; null of a scene that Python gave
        "reference": reference,
        "packages": versions(),
        "python": platform.python_version(),
        "machine": processor(),
        "commit": commit(),
        "seed": config.seed,
        "threads": config.threads or default_count(),
        "plugins": list(plugins),
        **header,
    }


def summary_values(folder: Path, report: ReportData) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {"folder": str(folder), **metrics_json(report)}


def summary_lines(folder: Path, report: ReportData) -> str:
    """The table of metrics, the flags of the whole run, where everything is, and what goes on from there."""
    lines = [report.title, "", metrics_table(report), ""]
    lines += [f"note: {note}" for note in report.findings]
    for path in (folder / name for name in (BESIDE, VIDEO, STRIP, TRAJECTORY, CAMERA_PATH, REPORT)):
        if path.is_file():
            lines.append(f"{path.name:<18} {told_from_here(path)}")
    run = shlex.quote(told_from_here(folder))
    lines += [
        "",
        f"next: cltransfer render {run} --fps 24 --out film.mp4",
        f"      cltransfer export {run} --out shot.py",
    ]
    return "\n".join(lines)
