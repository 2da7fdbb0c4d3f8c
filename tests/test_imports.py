"""What may import what, what no source may contain, and what is shipped."""

from __future__ import annotations

import ast
import configparser
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from cltransfer.models.content import READERS

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "cltransfer").rglob("*.py"))

VALUES = (
    "camera",
    "features",
    "subject",
    "trajectory",
    "skeleton",
    "placement",
    "orientation",
    "along_clip",
    "errors",
    "computer",
    "storage",
    "registry",
)
COMPONENTS = ("renderers", "extractors", "losses", "search", "scenes")
DRIVING = (
    "driver",
    "reading",
    "run",
    "transfer",
    "evaluate",
    "inspect_clip",
    "describe",
    "ablate",
    "report",
    "export",
    "cli",
)
ALLOWED = {
    # search matches the reference's joints by the pure functions of the losses
    ("cltransfer.search.*", "cltransfer.losses"),
}
FORBIDDEN_CALLS = {
    *("eval", "exec", "builtins.eval", "builtins.exec", "os.system", "os.popen"),
    *("yaml.load", "yaml.unsafe_load", "yaml.full_load", "torch.load", "joblib.load"),
    *("random.seed", "numpy.random.seed", "torch.seed", "torch.manual_seed", "torch.random.manual_seed"),
    *("torch.cuda.manual_seed", "torch.cuda.manual_seed_all", "pytorch_lightning.seed_everything"),
}
FORBIDDEN_IMPORTS = {"pickle", "_pickle", "cloudpickle", "dill", "marshal", "shelve", "random", "joblib.numpy_pickle"}
DRAWS = {f"torch.{name}" for name in ("rand", "randn", "randint", "randperm", "normal", "bernoulli", "multinomial")}
OWN_RANDOM = {"numpy.random.Generator", "numpy.random.PCG64", "numpy.random.default_rng"}


def module_of(path: Path) -> str:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    return name.removesuffix(".__init__")


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path, top: bool = False) -> tuple[str, ...]:
    """Modules that ``path`` imports when it runs, anywhere in it or (``top``) outside its functions; not those of
    ``if TYPE_CHECKING``.
    """
    return tuple(imported(path, top))


def imported(path: Path, top: bool) -> Iterator[str]:
    package = module_of(path) if path.name == "__init__.py" else module_of(path).rpartition(".")[0]
    tree = tree_of(path)
    typing = {
        below
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for below in ast.walk(node)
    }
    inner = {n for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)} if top else set()
    for node in ast.walk(tree):
        if node in typing or node in inner:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def inside(module: str, names: tuple[str, ...]) -> bool:
    return any(module == f"cltransfer.{name}" or module.startswith(f"cltransfer.{name}.") for name in names)


def allowed(source: str, target: str) -> bool:
    return any(fnmatch(source, one) and fnmatch(f"{target}.", f"{other}.*") for one, other in ALLOWED)


def crossings(sources: tuple[str, ...], targets: tuple[str, ...]) -> list[str]:
    return [
        f"{module_of(path)} imports {target}"
        for path in SOURCES
        for target in sorted(set(imports(path)))
        if inside(module_of(path), sources) and inside(target, targets) and not allowed(module_of(path), target)
    ]


def test_values_import_no_component_and_nothing_that_drives() -> None:
    assert crossings(VALUES, COMPONENTS + DRIVING) == []


def test_whatever_reads_a_picture_imports_what_its_readings_are_known_by_or_what_cannot_change_them() -> None:
    known = tuple(part.replace("/", ".") for part in READERS)
    beside = (
        "computer",
        "config",
        "drawing",
        "errors",
        "feature_values",
        "near_plane",
        "progress",
        "registry",
        "storage",
    )
    readers = (*(part for part in known if part != "reading"), "reading.frames")  # the others read scenes
    modules = {module_of(path) for path in SOURCES} - {"cltransfer.scenes"}
    found = {one for path in SOURCES if inside(module_of(path), readers) for one in imports(path)}
    assert {one for one in found & modules if not inside(one, known + beside)} == set()


def test_components_import_nothing_that_drives() -> None:
    assert crossings(COMPONENTS, DRIVING) == []


@pytest.mark.parametrize("kind", ["losses", "extractors"])
def test_losses_and_extractors_do_not_know_the_other_components(kind: str) -> None:
    assert crossings((kind,), tuple(other for other in COMPONENTS if other != kind)) == []


def test_nothing_imports_the_command_line() -> None:
    others = [path for path in SOURCES if path.parent.name != "cli" and path.name != "__main__.py"]
    assert [module_of(path) for path in others if any(inside(target, ("cli",)) for target in imports(path))] == []


def test_every_module_can_be_imported_first() -> None:
    """No circle of imports at the top of modules; importing ``a.b.c`` runs ``a.b`` as well."""
    paths = {module_of(path): path for path in SOURCES}
    waits_for = {module: set(loads_first(path)) & set(paths) for module, path in paths.items()}
    assert circles(waits_for) == []
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}}) != []


def loads_first(path: Path) -> Iterator[str]:
    """What must be loaded before ``path`` is: of what stands outside its functions, with the packages around it."""
    own = module_of(path)
    for target in imports(path, top=True):
        parts = target.split(".")
        for end in range(1, len(parts) + 1):
            module = ".".join(parts[:end])
            if not f"{own}.".startswith(f"{module}."):  # a package that is being loaded already
                yield module


def circles(waits_for: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(waits_for).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


def test_kernels_import_no_torch() -> None:
    kernels = [path for path in SOURCES if path.parent.name == "kernels" or path.name == "_kernels.py"]
    assert len(kernels) > 4
    assert [p.name for p in kernels if any(t.partition(".")[0] == "torch" for t in imports(p))] == []


@pytest.mark.parametrize(
    "code", ["import cltransfer.cli.app", "import cltransfer.config, cltransfer.registry, cltransfer.plugins"]
)
def test_starting_up_loads_nothing_heavy(code: str) -> None:
    heavy = (
        "{'torch', 'kornia', 'numba', 'cv2', 'onnxruntime', 'pytorch_lightning', 'matplotlib', 'av', 'cma', 'scipy'}"
    )
    check = f"import sys; {code}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"


def misused(tree: ast.Module) -> list[str]:
    """Calls and imports that run foreign code, or seed or draw from what the whole process shares."""
    whole, found = {}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            whole |= {
                a.asname or a.name.partition(".")[0]: a.name if a.asname else a.name.partition(".")[0]
                for a in node.names
            }
            found += [a.name for a in node.names if a.name in FORBIDDEN_IMPORTS]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            whole |= {a.asname or a.name: f"{node.module}.{a.name}" for a in node.names}
            found += [node.module for _ in node.names[:1] if node.module in FORBIDDEN_IMPORTS]
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        first, dot, rest = ast.unparse(node.func).partition(".")
        called, named = whole.get(first, first) + dot + rest, {k.arg: ast.unparse(k.value) for k in node.keywords}
        pickled = named.get("allow_pickle", "False") != "False" or (called == "numpy.load" and len(node.args) > 2)
        shared = called in DRAWS and "generator" not in named
        shared |= re.fullmatch(r"numpy\.random\.\w+", called) is not None and called not in OWN_RANDOM
        if called in FORBIDDEN_CALLS or pickled or shared:
            found.append(called)
    return found


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_a_source_seeds_nothing_global_and_runs_no_foreign_code(path: Path) -> None:
    assert misused(tree_of(path)) == []


@pytest.mark.parametrize(
    "code",
    [
        "eval(x)", "import builtins; builtins.eval(x)", "from os import system; system(x)",
        "from torch import load as l; l(p)",
        "import pytorch_lightning as pl; pl.seed_everything(0)", "import torch as t; t.random.manual_seed(0)",
        "import torch; torch.cuda.manual_seed(0)", "import numpy as np; np.load(p, None, True)",
        "import numpy as np; np.load(p, allow_pickle=True)", "import joblib; joblib.load(p)", "import _pickle",
        "from cloudpickle import loads", "import torch; torch.rand(3)", "import numpy as np; np.random.rand(3)",
    ],
)  # fmt: skip
def test_each_spelling_of_what_no_source_may_do_is_found(code: str) -> None:
    assert len(misused(ast.parse(code))) == 1


def test_what_is_a_source_s_own_is_none_of_it() -> None:
    code = "import torch, numpy as np\ntorch.rand(3, generator=g)\nnp.random.default_rng(0).random(3)\nnp.load(p)"
    assert misused(ast.parse(code)) == []


def test_setup_names_every_package() -> None:
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    named = set(setup["options"]["packages"].split())
    on_disk = {module_of(path) for path in SOURCES if path.name == "__init__.py"}
    assert named == on_disk | {"cltransfer.configs"}


def test_what_is_installed_includes_the_data_files() -> None:
    setuptools = pytest.importorskip("setuptools")
    code = (
        "from setuptools import Distribution\n"
        "made = Distribution()\nmade.parse_config_files()\n"
        "build = made.get_command_obj('build_py')\nbuild.ensure_finalized()\n"
        "for package, _, folder, files in build.data_files:\n"
        "    for name in files:\n        print(package + '/' + name)\n"
    )
    assert setuptools.__version__
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    shipped = set(done.stdout.split())
    presets = {f"cltransfer.configs/{path.name}" for path in (ROOT / "configs").glob("*.yaml")}
    for folder in ("ablations", "networks", "scenes"):
        presets |= {f"cltransfer.configs/{folder}/{path.name}" for path in (ROOT / "configs" / folder).iterdir()}
    pages = {f"cltransfer/study/page.{kind}" for kind in ("html", "css", "js")}
    pages |= {f"cltransfer/report/{path.name}" for path in (ROOT / "cltransfer" / "report").glob("*.[hj]*")}
    assert len(pages) == 6
    assert presets | pages | {"cltransfer/py.typed", "cltransfer/models/catalogue.yaml"} <= shipped


SHARED_LAYER = {("scenes", "renderers")}  # scenes/ asks renderers/ what draws a scene, as the README says


@cache
def layers() -> list[list[str]]:
    """The lines of the README's architecture, top to bottom: the paths below cltransfer/ that stand in each."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").partition("```\ncltransfer/\n")[2]
    lines = [line for line in text.partition("\nconfigs/")[0].splitlines() if not line.startswith(" " * 8)]
    return [[re.sub(r"/$|\.py$", "", name) for name in line.split("   ")[0].split()] for line in map(str.strip, lines)]


@cache
def rank(module: str) -> int:
    """In which line a module stands: that of the longest path that holds it; -1 for cltransfer itself."""
    path = module.removeprefix("cltransfer").lstrip(".").replace(".", "/")
    if not path or path == "__main__":
        return -1
    nested = {"stress": "bench/stress"}
    fits = [
        (len(name), line)
        for line, names in enumerate(layers())
        for name in (nested.get(name, name) for name in names)
        if fnmatch(f"{path}/", f"{name}/*") or fnmatch(path, name)
    ]
    assert fits, f"{module} stands nowhere in the README's architecture"
    return max(fits)[1]


def test_every_import_goes_down_the_architecture_of_the_readme() -> None:
    modules = {module_of(path) for path in SOURCES}
    upwards = []
    for path in SOURCES:
        own = module_of(path)
        if own == "cltransfer":
            continue
        for target in sorted(set(imports(path)) & modules - {"cltransfer"}):
            kinds = own.split(".")[1], target.split(".")[1]
            if rank(own) > rank(target) and kinds[0] != kinds[1] and kinds not in SHARED_LAYER:
                upwards.append(f"{own} imports {target}")
    assert upwards == []


def test_the_architecture_names_what_is_there() -> None:
    for names in layers():
        for name in names:
            place = "bench/stress" if name == "stress" else name
            assert any((ROOT / "cltransfer").glob(f"{place}.py")) or (ROOT / "cltransfer" / place).is_dir(), name


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "plugins" / "README.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_source_that_a_page_names_is_there(page: Path) -> None:
    named = set(re.findall(r"[\w.]+(?:/\w+)+\.py\b", page.read_text(encoding="utf-8")))
    roots = (ROOT, ROOT / "cltransfer", page.parent)
    assert [name for name in sorted(named) if not any((root / name).is_file() for root in roots)] == []


def test_tests_stand_where_what_they_test_stands() -> None:
    own = {"contracts", "networks", "plugins", "reference", "stability", "tools"}  # of the project as a whole
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")}
    mirrored = [folder for folder in folders if folder.parts and folder.parts[0] not in own]
    assert len(mirrored) > 20
    assert [str(folder) for folder in mirrored if not (ROOT / "cltransfer" / folder).is_dir()] == []
