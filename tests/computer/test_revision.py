"""The commit that a benchmark says it was measured at."""

import shutil
import subprocess
from pathlib import Path

import pytest

from cltransfer import __version__
from cltransfer.computer.revision import commit


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    for name in ("cltransfer/a.py", "docs/a.svg"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("1")
    who = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    for command in (["init", "-q"], ["add", "-A"], [*who, "commit", "-q", "-m", "a"]):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    return tmp_path


def test_a_figure_that_was_written_does_not_make_the_code_another(checkout: Path) -> None:
    clean = commit(checkout)
    (checkout / "docs" / "a.svg").write_text("2")
    (checkout / "docs" / "b.svg").write_text("2")
    assert commit(checkout) == clean
    assert len(clean) >= 7
    assert not clean.endswith("-dirty")


def test_code_that_was_changed_or_added_does(checkout: Path) -> None:
    clean = commit(checkout)
    (checkout / "cltransfer" / "b.py").write_text("2")
    assert commit(checkout) == f"{clean}-dirty"


def test_a_folder_in_the_repository_of_another_project_is_the_version(checkout: Path) -> None:
    assert commit(checkout / "cltransfer") == f"cltransfer {__version__}"


def test_no_checkout_is_the_version(tmp_path: Path) -> None:
    assert commit(tmp_path) == f"cltransfer {__version__}"
