# SPDX-License-Identifier: Apache-2.0
"""Types, and the wheel."""
from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_types_are_strict(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed")
    example = tmp_path / "example.py"
    example.write_text(
        "import mtdb\nimport numpy as np\n"
        "db = mtdb.open('x', create=True)\n"
        "def use(db: mtdb.Database) -> int:\n"
        "    mesh = db['a'].extract(error=0.5, box=np.zeros((2, 3)))\n"
        "    return len(mesh.vertices) + db['a'].session().update(error=1).triangles\n"
        "reveal_type(db['a'].extract().faces)\n"
        "db['a'].extract(wrong=1)\n"
    )
    told = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "pyproject.toml",
         "--cache-dir", tmp_path / "cache", ROOT / "tools/python/mtdb", example],
        capture_output=True, text=True, cwd=ROOT / "tools/python",
    )
    errors = [line for line in told.stdout.splitlines() if ": error:" in line]
    assert len(errors) == 1 and 'keyword argument "wrong"' in errors[0], told.stdout
    assert "ndarray" in told.stdout


def test_a_wheel_brings_its_library(tmp_path: Path) -> None:
    library = os.environ.get("MTDB_LIBRARY", "")
    if not library:
        pytest.skip("MTDB_LIBRARY does not say where libmtdb.so is")
    sys.path.insert(0, str(ROOT / "tools/python"))
    try:
        import backend
    finally:
        del sys.path[0]
    name = backend.build_wheel(str(tmp_path), {"library": library})
    assert name.startswith("mtdb-") and "-py3-none-linux" in name
    with zipfile.ZipFile(tmp_path / name) as wheel:
        names = wheel.namelist()
        assert "mtdb/libmtdb.so" in names and "mtdb/py.typed" in names
        wheel.extractall(tmp_path / "there")
    environment = {k: v for k, v in os.environ.items() if k != "MTDB_LIBRARY"}
    environment["PYTHONPATH"] = str(tmp_path / "there")
    told = subprocess.run(
        [sys.executable, "-c", "import mtdb; print(mtdb.__file__, mtdb.__version__)"],
        env=environment, check=True, capture_output=True, text=True,
    )
    assert told.stdout.split() == [str(tmp_path / "there/mtdb/__init__.py"), backend.version()]
    source = backend.build_sdist(str(tmp_path))
    assert (tmp_path / source).stat().st_size > 500_000


def test_another_library_is_refused_with_its_reason() -> None:
    """A library without the functions of this package is named, with what to do."""
    told = subprocess.run(
        [sys.executable, "-c", "import mtdb"], capture_output=True, text=True,
        env={**os.environ, "MTDB_LIBRARY": "libm.so.6"},
    )
    assert told.returncode == 1
    last = told.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: libm.so.6: is not the libmtdb of this package"), last
    assert "of one version" in last
