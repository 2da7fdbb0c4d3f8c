"""The command line's entry: every verb in one app, every failure one line and an exit code."""

from __future__ import annotations

import logging
import os
import signal
import sys
from io import TextIOWrapper
from typing import Annotated, NoReturn, TextIO

import typer

from .. import __version__
from ..bench.verbs import app as bench_app
from ..errors import CltransferError, ModelError, UsageError, shortened
from ..registry.plugin_code import raised_in
from .ablate import ablate
from .cache import app as cache_app
from .describe import describe, inspect
from .evaluate import evaluate
from .fit import fit
from .models import assets_app, models_app
from .plugins import app as plugins_app
from .scenes import bake, lift, simplify
from .shared import STOPS, Json, Terminated, fail, printable, show, stopped
from .slips import check_once, command_of, meant_as_option, options_of, told
from .study import study
from .transfer import export, render, transfer

HELP = """Transfer the camera language of a reference clip into a 3D scene, and score it.

**Try it**: `cltransfer transfer` runs on built-in scenes, nothing to download.

**Your own**: `cltransfer transfer scene.ply clip.mp4 --out run frames=24`

**Score two clips**: `cltransfer evaluate clip.mp4 render.mp4`

**Quick or exact**: `preset=fast` previews, `balanced` is the default, `max` takes longer; `paper`, `jaws_clean`,
`jaws_code`, `jaws_losses_cma` and `five_adam` are there to compare.

Anything in a config can be set as key=value, `generations=20 losses.framing=null search.paper_box={}`:
`cltransfer plugins show config` explains the keys, `cltransfer plugins list` has the components.
"""

app = typer.Typer(
    help=HELP, no_args_is_help=True, rich_markup_mode="markdown", pretty_exceptions_enable=False, add_completion=True
)
app.add_typer(bench_app, name="bench")
app.add_typer(plugins_app, name="plugins")
app.add_typer(models_app, name="models")
app.add_typer(assets_app, name="assets")
app.add_typer(cache_app, name="cache")


def main() -> NoReturn:
    """Run the command line; every failure is one line on stderr and an exit code."""
    before = signal.signal(signal.SIGTERM, _terminate)
    _open_streams()
    _format_logs(_Printable())
    try:
        _run()
    finally:
        _format_logs(None)
        for stream in (sys.stdout, sys.stderr):
            _give_up_if_broken(stream)
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)  # all is said, and nobody would catch it any more


def _run() -> NoReturn:
    verb, said = command_of(typer.main.get_command(app), sys.argv[1:])
    try:
        check_once(verb, said)
        code = app(standalone_mode=False)
        if code == 130:  # the parser's word for an interrupt
            stopped(KeyboardInterrupt())
        sys.stdout.flush()  # lest the interpreter does, which tells a full disk in its own words
    except CltransferError as error:
        if error.__cause__ is not None and _debugging():
            raise
        if isinstance(error, UsageError):
            error = meant_as_option(error, options_of(verb), sys.argv)
        fail(error, error.exit_code)
    except (typer.Abort, *STOPS) as stop:
        stopped(stop)
    except MemoryError:
        fail("out of memory (fewer frames, or smaller search_side and output_side)", 5)
    except BrokenPipeError:  # who reads the output has left, and wants no word about it
        sys.exit(1)
    except OSError as error:
        fail(f"{shortened(error.filename or 'file')}: {shortened(error.strerror or error)}", 5)
    except Exception as error:
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # usage errors of the parser
            line = told(error, sys.argv)
            if not line:  # of a command of commands by itself, which has shown its help
                sys.exit(error.exit_code)
            fail(line, error.exit_code)
        if _debugging():
            raise
        plugin = raised_in(error)
        whose = "cltransfer" if plugin is None else f"the plugin {plugin.name}"
        told_by = f"{type(error).__name__}: {shortened(error)} (a fault of {whose}; CLTRANSFER_DEBUG=1 shows where)"
        fail(told_by, 1 if plugin is None else ModelError.exit_code)
    sys.exit(code if isinstance(code, int) else 0)


def _open_streams() -> None:
    """Letters that the terminal or the pipe does not know, as in names that are no UTF-8, are shown escaped.

    A stream that is closed, as by ``2>&-``, leads nowhere.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 as long as the process
        elif isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class _Printable(logging.Formatter):
    """Log lines as they are, without signs that a terminal would act on."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def _format_logs(formatter: logging.Formatter | None) -> None:
    """How lines are shown that no handler takes, on stderr as Python does; who has set up handlers keeps them."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(formatter)


def _give_up_if_broken(stream: TextIO) -> None:
    """Drop what nobody can take any more: the interpreter would send it, with a word and an exit code of its own."""
    try:
        stream.flush()
    except OSError:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def _debugging() -> bool:
    return os.environ.get("CLTRANSFER_DEBUG") == "1"


def _terminate(number: int, frame: object) -> NoReturn:
    raise Terminated


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        print(__version__)
        raise typer.Exit


VERBS = (transfer, render, evaluate, ablate, export, inspect, describe, lift, fit, bake, simplify, study)
for verb in VERBS:  # as `--help` lists them
    app.command()(verb)


@app.command()
def doctor(as_json: Json = False) -> None:
    """What this computer has: versions, threads, codecs, models and where they are looked for, a self-test."""
    from ..doctor import examine, healthy

    findings = examine()
    width = max(len(f.what) for f in findings)
    text = "\n".join(f"{'ok ' if f.ok else 'NO '} {f.what:<{width}}  {f.says}" for f in findings)
    show([vars(f) for f in findings], text, as_json)
    if not healthy(findings):
        raise typer.Exit(4)
