"""What a plugin's code is known again by, so that nothing is kept of other code than gave it.

A result is cached, a run taken up and a trial left out where what it depends on is the same; a plugin's code is part of
that. What comes with cltransfer is known by :func:`own_code`. No torch, nothing is imported here.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

_IMPORTED: dict[Path, str] = {}  # digest of what was imported last, by its file or package


def code_of(component: object) -> str:
    """SHA-256 of a plugin's code as it was imported: the file of its class, or all Python files of its package.

    ``component`` is one, or its class. Empty for what comes with cltransfer. Hidden files and folders are none of it.
    What has no file, as a cell of a notebook, is known by what its functions do.
    """
    cls = component if isinstance(component, type) else type(component)
    if _ours(cls):
        return ""
    place = _home(cls)
    if place in _IMPORTED:
        return _IMPORTED[place]
    return _code_at(place) if place is not None and place.exists() else _code_without_file(cls)


def remember(cls: type[Any]) -> None:
    """Keep what the code of ``cls`` is now, as it is imported: this process goes on with that when it is edited."""
    place = None if _ours(cls) else _home(cls)
    if place is not None and place.exists():
        _IMPORTED[place] = _code_at(place)


def raised_in(error: BaseException) -> Path | None:
    """The plugin's file or package whose code ``error`` was raised in, or called what raised it; None of ours alone."""
    traceback, found = error.__traceback__, None
    while traceback is not None:
        file = Path(traceback.tb_frame.f_code.co_filename)
        found = next((place for place in _IMPORTED if file == place or place in file.parents), found)
        traceback = traceback.tb_next
    return found


def code_in(package: Path) -> str:
    """SHA-256 of the names and contents of every Python file in a folder that is not hidden."""
    digest = hashlib.sha256()
    for part in sorted(package.rglob("*.py"), key=lambda part: part.relative_to(package).parts):  # on any system
        if not part.is_file() or any(name.startswith(".") for name in part.relative_to(package).parts):
            continue
        digest.update(
            f"{part.relative_to(package).as_posix()}\0{hashlib.sha256(part.read_bytes()).hexdigest()}\0".encode()
        )
    return digest.hexdigest()


@functools.cache
def own_code(*parts: str) -> str:
    """SHA-256 of the code of cltransfer itself, as it lies here when a process first asks.

    Of ``parts`` alone, if any are named: packages and modules by their paths, as ``scenes/person`` and ``features``.
    """
    root = Path(__file__).parents[1]
    if not parts:
        return code_in(root)
    places = (root / part if (root / part).is_dir() else root / f"{part}.py" for part in sorted(parts))
    return hashlib.sha256("".join(map(_code_at, places)).encode()).hexdigest()


def _ours(cls: type[Any]) -> bool:
    return cls.__module__.partition(".")[0] == "cltransfer"


def _home(cls: type[Any]) -> Path | None:
    """The file of a class, or the package that it lies in; None where it has none."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    return None if file is None else _package(Path(file)) or Path(file)


def _code_at(place: Path) -> str:
    return code_in(place) if place.is_dir() else hashlib.sha256(place.read_bytes()).hexdigest()


def _package(file: Path) -> Path | None:
    """The outermost folder of the package that ``file`` lies in, None where it is part of none."""
    folders = list(takewhile(lambda folder: (folder / "__init__.py").is_file(), file.parents))
    return folders[-1] if folders else None


def _code_without_file(cls: type[Any]) -> str:
    """SHA-256 of the functions of ``cls``, and of what they name in its module: functions, classes and plain values."""
    module = vars(sys.modules[cls.__module__]) if cls.__module__ in sys.modules else {}
    told: dict[str, str] = {}
    waiting: list[tuple[str, Any]] = [(cls.__qualname__, cls)]
    while waiting:
        name, value = waiting.pop()
        value = _function(value)
        if name in told:
            continue
        if isinstance(value, FunctionType):
            told[name] = repr([_plain(value.__code__), *filter(_is_plain, (value.__defaults__, value.__kwdefaults__))])
            own_names = _names(value.__code__) if value.__module__ == cls.__module__ else ()
            waiting += [(used, module[used]) for used in own_names if used in module]
        elif isinstance(value, type) and value.__module__ == cls.__module__:
            told[name] = ""
            waiting += [(base.__qualname__, base) for base in value.__bases__]
            parts = {own: _function(part) for own, part in vars(value).items()}
            parts = {own: p for own, p in parts.items() if isinstance(p, FunctionType) or not own.startswith("__")}
            waiting += [(f"{name}.{own}", part) for own, part in parts.items()]
        elif _is_plain(value):
            told[name] = repr(value)
    return hashlib.sha256(repr(sorted(told.items())).encode()).hexdigest()


def _function(value: Any) -> Any:
    """The function of a method, a property or what keeps its answers; anything else as it is."""
    for inside in () if isinstance(value, type) else ("__func__", "fget", "func", "__wrapped__"):
        value = getattr(value, inside, value)
    return value


def _names(code: CodeType) -> Iterator[str]:
    """What a function names, and what those in it do, as comprehensions are in Python 3.11."""
    yield from code.co_names
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _names(const)


def _plain(code: CodeType) -> str:
    """What a function does, without where it stands."""
    consts = []
    for const in code.co_consts:
        if isinstance(const, frozenset):  # in another order in every process
            const = sorted(map(repr, const))
        consts.append(_plain(const) if isinstance(const, CodeType) else repr(const))
    return repr([code.co_code, code.co_names, code.co_varnames, consts])


def _is_plain(value: object) -> bool:
    """Whether what is written of it tells all, in every process: of another object it may be where that lies."""
    if isinstance(value, dict):
        return all(_is_plain(part) for pair in value.items() for part in pair)
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, str | int | float)
