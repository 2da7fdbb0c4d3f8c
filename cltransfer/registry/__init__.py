"""Components by name. A name is the same in the file, the registry, the config, the report and the test."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import math
import pkgutil
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Generic, TypeVar

from ..errors import ModelError, UsageError, named
from .declared import EXTRACTOR, FITTER, LOSS, RENDERER, SEARCH, Declared, check_declared
from .plugin_code import remember
from .typed import nearest, typed

T = TypeVar("T")
NAME = re.compile("[a-z][a-z0-9_]*")
# columns and metrics beside those of losses
COLUMNS = "total|frames?|time|flags|method|clip|reason|row|trials|failed|jerk|.*_defined|.*_coverage"


class Registry(Generic[T]):
    """Classes of one kind, by the name their module, YAML key and table column share.

    Built-in ``name`` lives in ``<package>/<name>.py`` and is imported on first use. A plugin's module registers
    its class by the decorator when the user has allowed it (:mod:`cltransfer.plugins`).

    Args:
        kind: what one is called.
        package: of the built-in ones.
        section: of a config, under which they are named; empty where their options are named alone.
        declared: what a class declares.
        reserved: pattern of the names that tables have for something else; empty where they have none.
    """

    def __init__(self, kind: str, package: str, section: str, declared: Sequence[Declared], reserved: str = "") -> None:
        self.kind, self.package, self.section, self.declared = kind, package, section, declared
        self.reserved = reserved
        self._classes: dict[str, type[T]] = {}

    def register(self, name: str) -> Callable[[type[T]], type[T]]:
        """Decorate a frozen dataclass to make it component ``name``; one that is defined again replaces itself.

        Raises:
            ModelError: the name is taken or cannot be written in a config, or the class is no frozen dataclass, has an
                option without a type or lacks what its kind declares.
        """
        if not NAME.fullmatch(name):
            reason = "expected small letters, digits and _, a letter first, so that key=value can name it"
            raise ModelError("", f"{self.kind} {name!r}", reason, "choose another name")
        if re.fullmatch(self.reserved, name):
            raise ModelError("", f"{self.kind} {name!r}", "the name is that of another column; choose another")

        def add(cls: type[T]) -> type[T]:
            check_declared(f"{self.kind} {name!r}", cls, self.declared)
            foreign = not cls.__module__.startswith("cltransfer.")
            if foreign and name in self._built_in():
                raise ModelError("", f"{self.kind} {name!r}", "the name is taken; choose another")
            other = self._classes.get(name, cls)
            if (_place(other), other.__qualname__) == (_place(cls), cls.__qualname__):
                self._classes[name] = cls  # defined again, as a cell of a notebook is that runs twice
            else:
                reason = f"the name is taken by {_file_of(other)}; choose another"
                raise ModelError(_file_of(cls), f"{self.kind} {name!r}", reason)
            remember(cls)
            return cls

        return add

    def _built_in(self) -> set[str]:
        package = importlib.import_module(self.package)
        return {m.name for m in pkgutil.iter_modules(package.__path__) if not m.name.startswith("_") and not m.ispkg}

    def given_by(self, plugin: str) -> list[str]:
        """Names that a plugin has registered: an installed one by its module, a file or a folder by its whole path."""
        place, found = Path(plugin).resolve(), []
        for name, cls in self._classes.items():
            within = f"{cls.__module__}.".startswith(f"{plugin}.") or _place(cls).is_relative_to(place)
            if within and not cls.__module__.startswith("cltransfer."):
                found.append(name)
        return found

    def names(self) -> list[str]:
        """Every known name, built-in or registered, sorted."""
        return sorted(self._built_in() | self._classes.keys())

    def registered(self) -> dict[str, type[T]]:
        """Classes by name whose modules are imported, those of all allowed plugins among them."""
        return dict(self._classes)

    def get(self, name: str) -> type[T]:
        """The class called ``name``.

        Raises:
            UsageError: there is none; the line names the nearest.
        """
        if name not in self._classes:
            if name not in self._built_in():
                raise UsageError("", f"{self.kind} {name!r}", "no such component", nearest(name, self.names()))
            importlib.import_module(f"{self.package}.{name}")  # its decorator registers it
        return self._classes[name]

    def name_of(self, component: object) -> str:
        """The name of ``component``, or of its class; empty where neither is registered."""
        return next((name for name, cls in self._classes.items() if cls in (component, type(component))), "")

    def holds(self, module: str) -> bool:
        """Whether a class is registered that is of ``module``, or of one in it."""
        return any(f"{cls.__module__}.".startswith(f"{module}.") for cls in self._classes.values())

    def forget(self, module: str) -> None:
        """Take out the classes that are of ``module``, or of one in it."""
        for name in [n for n, c in self._classes.items() if f"{c.__module__}.".startswith(f"{module}.")]:
            del self._classes[name]

    def build(self, name: str, options: Mapping[str, Any] | None = None) -> T:
        """Component ``name`` with ``options`` checked and converted by its own fields.

        Raises:
            UsageError: no such component, no such option, or a value of the wrong type or range.
            ModelError: the class itself fails.
        """
        cls = self.get(name)
        above = f"{self.section}.{name}" if self.section else ""
        if not isinstance(options, Mapping | None):
            raise UsageError("", above or name, f"expected a mapping of options, got {options!r:.40}")
        _check_finite(above, options or {}, options or {})
        try:
            with named(f"{self.kind} {name!r}", "expected a component of these options"):
                built = typed(cls, options or {})
        except UsageError as error:
            raise UsageError("", _key(above, error.field), error.reason, error.hint) from None
        _check_finite(above, options or {}, built)  # it may have been text, "nan" or "inf"
        for declared in self.declared:
            value = getattr(built, declared.name) if declared.option else None
            if declared.option and not declared.right(value):
                raise UsageError("", _key(above, declared.name), f"expected {declared.expected}, got {value}")
        return built

    def declared_options(self, name: str) -> list[str]:
        """Option names of component ``name``, read from the source: nothing is imported for a built-in."""
        if name in self._classes:
            return [f.name for f in dataclasses.fields(self._classes[name])]  # type: ignore[arg-type]
        source = resources.files(self.package).joinpath(f"{name}.py").read_text(encoding="utf-8")
        for node in ast.parse(source).body:
            if isinstance(node, ast.ClassDef) and any(f"'{name}'" in ast.unparse(d) for d in node.decorator_list):
                fields = [line for line in node.body if isinstance(line, ast.AnnAssign)]
                return [ast.unparse(f.target) for f in fields if "ClassVar" not in ast.unparse(f.annotation)]
        raise ModelError("", f"{self.kind} {name!r}", f"{self.package}.{name} registers no class of that name")

    def options(self, name: str) -> dict[str, Any]:
        """Option names and defaults of component ``name``; required ones are ``'???'``."""
        return {f.name: _default(f) for f in dataclasses.fields(self.get(name))}  # type: ignore[arg-type]


def _file_of(cls: type[Any]) -> str:
    return getattr(sys.modules.get(cls.__module__), "__file__", None) or cls.__module__


def _place(cls: type[Any]) -> Path:
    return Path(_file_of(cls)).resolve()


def _key(*parts: str) -> str:
    return ".".join(filter(None, parts))


def _check_finite(key: str, given: Any, value: Any) -> None:
    """Refuse a number that is none in ``value``, so far as it is of what was ``given``: a default may be infinite."""
    if isinstance(value, float) and not math.isfinite(value):
        raise UsageError("", key, f"expected a finite number, got {value}")
    if isinstance(given, Mapping):
        for name, part in given.items():
            held = value.get(name) if isinstance(value, Mapping) else getattr(value, str(name), None)
            _check_finite(_key(key, str(name)), part, held)
    elif isinstance(given, list | tuple) and isinstance(value, list | tuple):
        for i, (part, held) in enumerate(zip(given, value)):
            _check_finite(f"{key}[{i}]", part, held)


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    return "???" if field.default_factory is dataclasses.MISSING else field.default_factory()


RENDERERS: Registry[Any] = Registry("renderer", "cltransfer.renderers", "renderer", RENDERER)
EXTRACTORS: Registry[Any] = Registry("extractor", "cltransfer.extractors", "extractors", EXTRACTOR)
LOSSES: Registry[Any] = Registry("loss", "cltransfer.losses", "losses", LOSS, COLUMNS)
SEARCHES: Registry[Any] = Registry("search", "cltransfer.search", "search", SEARCH)
FITTERS: Registry[Any] = Registry("fitter", "cltransfer.fit", "", FITTER)
