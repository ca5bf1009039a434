# SPDX-License-Identifier: Apache-2.0
"""What the tests share: meshes in memory, and a store of two objects."""
from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest


def hills(side: int = 120, seed: int = 1) -> tuple[Any, Any, dict[str, Any]]:
    """A hilly square: vertices on multiples of 1/64, faces, attributes."""
    rng = np.random.default_rng(seed)
    y, x = (a.ravel() for a in np.mgrid[0:side, 0:side])
    z = 6 * np.sin(0.11 * x) * np.cos(0.07 * y) + rng.random(side * side)
    vertices = np.stack([x * 0.5, y * 0.5, np.round(z * 64) / 64], axis=1)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)]
    )
    attributes = {
        "red": (x % 256).astype(np.uint8),
        "green": (y % 256).astype(np.uint8),
        "blue": np.full(side * side, 9, np.uint8),
        "heat": (x + y).astype(np.float32),
    }
    return vertices, faces, attributes


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("store") / "a.mtdb"
    with mtdb.open(path, create=True) as db:
        vertices, faces, attributes = hills()
        db.ingest(vertices, faces, name="hills", attributes=attributes)
        db.ingest(*hills(20, 2)[:2], name="small")
    return path


@pytest.fixture
def db(store: Path) -> Any:
    with mtdb.open(store) as database:
        yield database


@pytest.fixture
def mtdb_command() -> str:
    command = os.environ.get("MTDB_BINARY", "")
    if not command:
        pytest.skip("MTDB_BINARY does not say where the mtdb command is")
    return command
