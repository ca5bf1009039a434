# SPDX-License-Identifier: Apache-2.0
"""The add-on for Blender (tools/blender), in Blender without a window, against the package's own answers."""
from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENE = Path(__file__).with_name("blender_scene.py")


@pytest.fixture(scope="module")
def told(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("Blender is not installed (Debian's package blender: 70 MB to download, 490 MB on the disk)")
    out = tmp_path_factory.mktemp("blender")
    archive = shutil.make_archive(str(out / "mtdb_blender"), "zip", ROOT / "tools/blender", "mtdb_blender")
    library = os.environ["MTDB_LIBRARY"]
    with mtdb.open(store) as db, db.serve() as server:
        command = [blender, "-b", "--factory-startup", "--python-exit-code", "1", "--python", str(SCENE), "--"]
        command += [archive, str(ROOT / "tools/python"), library, str(store), server.url, str(out)]
        run = subprocess.run(
            command, env={**os.environ, "BLENDER_USER_SCRIPTS": str(out / "scripts")}, capture_output=True, text=True,
            timeout=300,
        )
    assert run.returncode == 0, run.stdout + run.stderr
    answer = json.loads((out / "told.json").read_text())
    answer["out"] = out
    return answer


def check(state: Any, mesh: mtdb.Mesh) -> None:
    assert (state["vertices"], state["faces"]) == (len(mesh.vertices), len(mesh.faces))
    assert state["sides"] == [3]
    points = np.array(state["points"]).reshape(-1, 3) + np.array(state["origin"])
    assert np.abs(points - mesh.vertices).max() < 1e-4
    if mesh.colours is None:
        assert state["colours"] is None
    else:
        colours = np.array(state["colours"]).reshape(-1, 4)
        assert (colours[:, :3] == mesh.colours).all()
        assert (colours[:, 3] == 255).all()
    assert state["bound"] == pytest.approx(mesh.error_bound)


def fall_off(base: float) -> Any:
    return {"linear": {"point": [20, 30, 0], "base": base, "slope": 0.02}}


def test_a_focus_with_a_fall_off_fetches_what_the_query_gives(told: Any, store: Path) -> None:
    hills = mtdb.open(store)["hills"]
    assert told["names"] == ["hills", "small"]
    mesh = hills.extract(threshold=fall_off(-0.1))
    assert len(mesh.faces) < hills.triangles / 2
    check(told["focus"], mesh)
    assert told["focus"]["name"] == "hills"


def test_a_mesh_that_was_moved_turned_and_scaled_is_fine_around_the_same_focus(told: Any, store: Path) -> None:
    # In the store's units half the radius, and the same fall-off for each of them. Rounding of the places
    # decides about few triangles.
    mesh = mtdb.open(store)["hills"].extract(threshold=fall_off(-0.1))
    assert told["turned"]["faces"] == pytest.approx(len(mesh.faces), rel=0.01)
    assert told["turned"]["mesh"] == told["focus"]["mesh"]
    assert told["turned"]["matrix"][0][3] == pytest.approx(7)


def test_a_radius_alone_and_budgets(told: Any, store: Path) -> None:
    hills = mtdb.open(store)["hills"]
    check(told["clipped"], hills.extract(sphere=[20, 30, 0, 5], error=0.25, clip=True))
    check(told["limited"], hills.extract(sphere=[20, 30, 0, 5], error=0.25, max_triangles=500))


def test_the_scene_s_camera_is_the_query_s(told: Any, store: Path) -> None:
    # Blender's angle is that of the longer side.
    fov = math.degrees(2 * math.atan(math.tan(0.35) * 240 / 320))
    camera = {
        "eye": [10, -20, 30], "direction": [0, math.sin(0.9), -math.cos(0.9)],
        "up": [0, math.cos(0.9), math.sin(0.9)], "fov": fov, "viewport": [320, 240],
    }
    mesh = mtdb.open(store)["hills"].extract(camera=camera, pixels=2)
    assert told["camera"]["faces"] == pytest.approx(len(mesh.faces), rel=0.01)
    assert len(mesh.faces) < mtdb.open(store)["hills"].triangles / 2


def test_a_selection_s_box_is_written_at_full_resolution(told: Any, store: Path) -> None:
    written = mtdb.open(told["out"] / "again.mtdb", create=True)
    written.ingest(told["out"] / "box.ply", name="box")
    box = mtdb.open(store)["hills"].extract(box=[[21, 22, -30], [29, 28, 30]], clip=True)
    assert written["box"].triangles == len(box.faces)
    assert box.error_bound < 1e-9


def test_objects_of_a_server(told: Any, store: Path) -> None:
    assert told["served"] == ["hills", "small"]
    check(told["small"], mtdb.open(store)["small"].extract())


def test_what_is_missing_is_said_in_a_sentence(told: Any) -> None:
    expected = {
        "no_store": "Choose a store first", "no_file": ".not", "no_focus": "Choose an object as the focus",
        "stretched": "scaled differently", "no_camera": "has no camera", "orthographic": "only perspective",
        "nothing_selected": "Select what marks the box", "no_server": "no server of mtdb serve",
    }
    for key, part in expected.items():
        assert part in told[key], key
