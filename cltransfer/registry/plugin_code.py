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
from weakref import WeakKeyDictionary

_IMPORTED: dict[Path, str] = {}  # digest of what was imported last, by its file or package
_KNOWN: WeakKeyDictionary[type[Any], str] = WeakKeyDictionary()  # digest of what a class was imported with
_BY_VERSION = {"kornia", "numpy", "pytorch_lightning", "torch", *sys.stdlib_module_names}  # not by their code


def code_of(component: object) -> str:
    """SHA-256 of a plugin's code as it was imported: the file of its class, or all Python files of its package.

    Of all files and packages that the classes it is derived from stand in, too. ``component`` is one, or its class.
    Empty for what comes with cltransfer. Hidden files and folders are none of it. What has no file, as a cell of a
    notebook, is known by what its functions do.
    """
    cls = component if isinstance(component, type) else type(component)
    codes = list(dict.fromkeys(map(_code_of, _foreign(cls))))
    return codes[0] if len(codes) == 1 else hashlib.sha256("".join(codes).encode()).hexdigest() if codes else ""


def _code_of(cls: type[Any]) -> str:
    place = _home(cls)
    known = _KNOWN.get(cls) or (_IMPORTED.get(place) if place is not None else None)
    if known is not None:
        return known
    return _code_at(place) if place is not None and place.exists() else _code_without_file(cls)


def remember(cls: type[Any]) -> None:
    """Keep what the code of ``cls`` is now, as it is imported: this process goes on with that when it is edited.

    A class that it is derived from goes on with what it was imported with itself.
    """
    for base in _foreign(cls):
        place = _home(base)
        if base not in _KNOWN and place is not None and place.exists():
            _KNOWN[base] = _code_at(place)
    if (place := _home(cls)) is not None and cls in _KNOWN:
        _IMPORTED[place] = _KNOWN[cls]  # its own alone: an error is told to be of what was registered


def edited(cls: type[Any]) -> bool:
    """Whether the code of a registered class is another now than it was imported with."""
    place = _home(cls)
    return cls in _KNOWN and place is not None and place.exists() and _code_at(place) != _KNOWN[cls]


def raised_in(error: BaseException) -> Path | None:
    """The plugin's file or package whose code ``error`` was raised in, or called what raised it; None of ours alone."""
    traceback, found = error.__traceback__, None
    while traceback is not None:
        file = Path(traceback.tb_frame.f_code.co_filename)
        found = next((place for place in _IMPORTED if file == place or place in file.parents), found)
        traceback = traceback.tb_next
    return found


def code_in(package: Path) -> str:
    """SHA-256 of the names and contents of every Python file in a folder that is not hidden, nor installed there."""
    digest = hashlib.sha256()
    for part in sorted(package.rglob("*.py"), key=lambda part: part.relative_to(package).parts):  # on any system
        names = part.relative_to(package).parts
        if not part.is_file() or any(name.startswith(".") or name == "site-packages" for name in names):
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


def _foreign(cls: type[Any]) -> list[type[Any]]:
    """``cls`` and what it is derived from, of each module one; none of what comes with cltransfer or Python."""
    first: dict[str, type[Any]] = {}
    for base in cls.__mro__:
        top = base.__module__.partition(".")[0]
        if top != "cltransfer" and (base is cls or top not in _BY_VERSION):
            first.setdefault(base.__module__, base)
    return list(first.values())


def _home(cls: type[Any]) -> Path | None:
    """The file of a class, or the package that it lies in; None where it has none."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    if file is None:
        return None
    path, top = Path(file), sys.modules.get(cls.__module__.partition(".")[0])
    around = [Path(folder) for folder in getattr(top, "__path__", ())]  # of a package without __init__.py too
    packages = [folder for folder in (_package(path), *around) if folder is not None and folder in path.parents]
    return min(packages, key=lambda folder: len(folder.parts), default=path)


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
