# SPDX-License-Identifier: Apache-2.0
"""docs/python.ipynb runs from its first cell to its last."""
from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs" / "python.ipynb"


def test_the_cells_run(capsys: pytest.CaptureFixture[str]) -> None:
    """What a cell shows at its end is shown here too: pictures are made."""
    place: dict[str, object] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] != "code":
            continue
        source = "".join(cell["source"])
        lines = source.rstrip().split("\n")
        exec(compile(source, str(NOTEBOOK), "exec"), place)
        if lines[-1].isidentifier():
            assert place[lines[-1]]._repr_html_()  # type: ignore[attr-defined]
    printed = capsys.readouterr().out
    assert "triangles; (480, 640, 3)" in printed and "vertices came" in printed


def test_it_is_what_make_notebook_writes(tmp_path: Path) -> None:
    script = tmp_path / "make_notebook.py"
    script.write_text((ROOT / "docs" / "make_notebook.py").read_text())
    subprocess.run([sys.executable, script], check=True)
    assert (tmp_path / "python.ipynb").read_text() == NOTEBOOK.read_text()


def test_jupyter_runs_it(tmp_path: Path) -> None:
    pytest.importorskip("nbconvert", reason="jupyter-nbconvert is not installed")
    pytest.importorskip("ipykernel", reason="python3-ipykernel is not installed")
    environment = {**os.environ, "JUPYTER_DATA_DIR": str(tmp_path), "IPYTHONDIR": str(tmp_path)}
    told = subprocess.run(
        [sys.executable, "-m", "nbconvert", "--to", "notebook", "--execute", "--output-dir",
         str(tmp_path), "--ExecutePreprocessor.timeout=600", str(NOTEBOOK)],
        env=environment, capture_output=True, text=True,
    )
    assert told.returncode == 0, told.stderr
    run = json.loads((tmp_path / "python.ipynb").read_text())
    pictures = [o for c in run["cells"] for o in c.get("outputs", [])
                if "data:image/png" in "".join(o.get("data", {}).get("text/html", []))]
    assert len(pictures) >= 3
