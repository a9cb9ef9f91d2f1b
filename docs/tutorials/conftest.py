"""Tutorials on one part or body run as a reader follows them: in an empty folder, with the part that the page offers."""

import shutil
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FILES = {"gmsh-part.md": ["bracket.msh"], "drop-a-body.md": []}


@pytest.fixture(autouse=True)
def empty_folder(request, tmp_path, monkeypatch):
    """Change to a new folder that holds the files of the tutorial."""
    if request.path.name in FILES:
        for name in FILES[request.path.name]:
            shutil.copy(HERE.parent / "scenes" / name, tmp_path)
        monkeypatch.chdir(tmp_path)
