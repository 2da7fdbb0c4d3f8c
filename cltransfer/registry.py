"""Components by name. A name is the same in the file, the registry, the config, the report and the test."""

from __future__ import annotations

import ast
import dataclasses
import difflib
import hashlib
import importlib
import math
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Generic, TypeVar

from .declared import EXTRACTOR, FITTER, LOSS, RENDERER, SEARCH, Declared, check_declared
from .errors import ModelError, UsageError

T = TypeVar("T")


class Registry(Generic[T]):
    """Classes of one kind, by the name their module, YAML key and table column share.

    Built-in ``name`` lives in ``<package>/<name>.py`` and is imported on first use. A plugin's module registers
    its class by the decorator when the user has allowed it (:mod:`cltransfer.plugins`).
    """

    def __init__(self, kind: str, package: str, declared: Sequence[Declared]) -> None:
        self.kind, self.package, self.declared = kind, package, declared
        self._classes: dict[str, type[T]] = {}

    def register(self, name: str) -> Callable[[type[T]], type[T]]:
        """Decorate a frozen dataclass to make it component ``name``.

        Raises:
            ModelError: the name is taken, or the class is no frozen dataclass or lacks what its kind declares.
        """

        def add(cls: type[T]) -> type[T]:
            params = getattr(cls, "__dataclass_params__", None)
            if params is None or not params.frozen:
                raise ModelError("", f"{self.kind} {name!r}", "expected @dataclass(frozen=True) below @register")
            check_declared(f"{self.kind} {name!r}", cls, self.declared)
            foreign = not cls.__module__.startswith("cltransfer.")
            if (foreign and name in self._built_in()) or self._classes.setdefault(name, cls) is not cls:
                raise ModelError("", f"{self.kind} {name!r}", "the name is taken; choose another")
            return cls

        return add

    def _built_in(self) -> set[str]:
        package = importlib.import_module(self.package)
        return {m.name for m in pkgutil.iter_modules(package.__path__) if not m.name.startswith("_") and not m.ispkg}

    def names(self) -> list[str]:
        """Every known name, built-in or registered, sorted."""
        return sorted(self._built_in() | self._classes.keys())

    def get(self, name: str) -> type[T]:
        """The class called ``name``.

        Raises:
            UsageError: there is none; the line names the nearest.
        """
        if name not in self._classes:
            if name not in self._built_in():
                close = difflib.get_close_matches(name, self.names(), n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(self.names())}"
                raise UsageError("", f"{self.kind} {name!r}", "no such component", hint)
            importlib.import_module(f"{self.package}.{name}")  # its decorator registers it
        return self._classes[name]

    def build(self, name: str, options: Mapping[str, Any] | None = None) -> T:
        """Component ``name`` with ``options`` checked and converted by its own fields.

        Raises:
            UsageError: no such component, no such option, or a value of the wrong type or range.
        """
        from omegaconf import OmegaConf
        from omegaconf.errors import OmegaConfBaseException

        cls = self.get(name)
        for option, value in (options or {}).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise UsageError("", f"{self.kind}.{name}.{option}", f"expected a finite number, got {value}")
        try:
            merged = OmegaConf.merge(OmegaConf.structured(cls), dict(options or {}))
            return OmegaConf.to_object(merged)  # type: ignore[return-value]
        except (OmegaConfBaseException, ValueError, TypeError) as error:
            reason = str(error).strip().splitlines()[0]
            key = getattr(error, "full_key", None)
            raise UsageError("", f"{self.kind}.{name}.{key}" if key else f"{self.kind}.{name}", reason) from None

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


def code_of(component: object) -> str:
    """SHA-256 of the file in which a plugin has written its component; empty for what comes with cltransfer."""
    module = type(component).__module__
    file = getattr(sys.modules.get(module), "__file__", None)
    if module.partition(".")[0] == "cltransfer" or file is None:
        return ""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    return "???" if field.default_factory is dataclasses.MISSING else field.default_factory()


RENDERERS: Registry[Any] = Registry("renderer", "cltransfer.renderers", RENDERER)
EXTRACTORS: Registry[Any] = Registry("extractor", "cltransfer.extractors", EXTRACTOR)
LOSSES: Registry[Any] = Registry("loss", "cltransfer.losses", LOSS)
SEARCHES: Registry[Any] = Registry("search", "cltransfer.search", SEARCH)
FITTERS: Registry[Any] = Registry("fitter", "cltransfer.fit", FITTER)
