"""Tutorials run as a reader follows them: in an empty folder, with the part that the page offers or the file that it shows."""

import re
import shutil
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FILES = {"gmsh-part.md": ["bracket.msh"], "drop-a-body.md": [], "scenes.md": []}


@pytest.fixture(autouse=True)
def empty_folder(request, tmp_path, monkeypatch):
    """Change to a new folder that holds the files of the tutorial."""
    if request.path.name in FILES:
        for name in FILES[request.path.name]:
            shutil.copy(HERE.parent / "scenes" / name, tmp_path)
        for name, text in re.findall(r"^```toml\n# ([\w.]+)\n(.*?)^```", request.path.read_text(encoding="utf-8"), re.M | re.S):
            (tmp_path / name).write_text(text, encoding="utf-8")
        monkeypatch.chdir(tmp_path)
