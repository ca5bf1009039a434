# SPDX-License-Identifier: Apache-2.0
"""One call each: simplify and distance; and what Python says in its own names."""
from __future__ import annotations

import copy
import pickle
import sys
import warnings
from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest
from conftest import hills

ROOT = Path(__file__).resolve().parents[2]


def test_simplify_keeps_its_error_and_attributes() -> None:
    vertices, faces, attributes = hills(80)
    small = mtdb.simplify(vertices, faces, error=0.5, attributes=attributes)
    assert 0 < small.error_bound <= 0.5 and len(small.faces) < len(faces) / 4
    assert set(small.attributes) == set(attributes) and small.shortfall is None
    found = mtdb.distance((vertices, faces), small, tolerance=1.05 * small.error_bound)
    assert found.verdict == "within"
    # Of a mesh, or a file, as well.
    again = mtdb.simplify(mtdb.Mesh(vertices, faces), error=0.5)
    np.testing.assert_array_equal(again.faces, small.faces)


def test_simplify_to_a_number_of_triangles() -> None:
    vertices, faces, _ = hills(80)
    small = mtdb.simplify(vertices, faces, triangles=1000)
    assert 700 < len(small.faces) <= 1000
    assert mtdb.simplify(vertices, faces, triangles=1000, error=3).error_bound <= 3


def test_simplify_takes_a_finer_grid_where_the_error_needs_one(tmp_path: Path) -> None:
    vertices, faces, _ = hills(30)
    vertices = vertices + np.random.default_rng(3).random(vertices.shape) * 0.01
    small = mtdb.simplify(vertices, faces, error=1e-5)
    assert small.error_bound <= 1e-5 and small.shortfall is None
    mtdb.Mesh(vertices, faces).save(tmp_path / "a.ply")
    assert mtdb.simplify(tmp_path / "a.ply", error=0.5).error_bound <= 0.5


def test_simplify_leaves_no_file(tmp_path: Path) -> None:
    vertices, faces, _ = hills(20)
    mtdb.simplify(vertices, faces, error=1, tmp_directory=str(tmp_path))
    with pytest.raises(mtdb.BadInput):
        mtdb.simplify(vertices * np.nan, faces, error=1, tmp_directory=str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_distance_is_right_and_takes_all_kinds(tmp_path: Path, db: Any) -> None:
    vertices, faces, _ = hills(20, 2)
    moved = vertices + np.array([0.0, 0.0, 0.75])
    raised = vertices.copy()
    raised[20 * 10 + 10, 2] += 40
    found = mtdb.distance((vertices, faces), (raised, faces), width=1e-3)
    assert found.high - found.low <= 1e-3 and 30 < found.low <= found.high <= 40 + 1e-3
    mtdb.Mesh(vertices, faces).save(tmp_path / "a.ply")
    for other in ((vertices, faces), mtdb.Mesh(vertices, faces), tmp_path / "a.ply",
                  str(tmp_path / "a.ply"), db["small"]):
        assert mtdb.distance(other, (moved, faces), tolerance=0.76).verdict == "within"
        assert mtdb.distance(other, (vertices, faces)).high < 1e-3
    one_way = mtdb.distance((vertices, faces), (moved[:-20], faces[(faces < 380).all(1)]), asks="b")
    assert one_way.a_to_b is None and one_way.b_to_a is not None and one_way.high < 0.76


def test_distance_of_maps_in_metres_is_not_rounded_away() -> None:
    vertices, faces, _ = hills(20)
    far = vertices + np.array([5e5, 4e6, 0])
    found = mtdb.distance((far, faces), mtdb.Mesh(vertices, faces, origin=(5e5, 4e6, 0)))
    assert found.high < 1e-3


def test_orient_turns_triangles_over(tmp_path: Path) -> None:
    vertices, faces, _ = hills(20)
    mixed = faces.copy()
    mixed[::5] = mixed[::5][:, [0, 2, 1]]
    with mtdb.open(tmp_path / "a.mtdb", create=True) as db:
        plain = db.ingest(vertices, mixed, name="plain")
        assert plain.info["input"]["inconsistent_edges"] > 0
        made = db.ingest(vertices, mixed, name="oriented", orient=True)
        assert made.info["input"]["inconsistent_edges"] == 0
        assert made.info["input"]["turned_triangles"] == len(mixed[::5])
        right = db.ingest(vertices, faces, name="right")
        np.testing.assert_array_equal(made.extract().faces, right.extract().faces)
    a = mtdb.simplify(vertices, mixed, error=1, orient=True)
    assert len(a.faces) < len(mtdb.simplify(vertices, mixed, error=1).faces)


def test_meshes_can_be_pickled_and_copied(db: Any) -> None:
    mesh = db["hills"].extract(error=1, normals=True)
    for other in (pickle.loads(pickle.dumps(mesh)), copy.copy(mesh), copy.deepcopy(mesh)):
        np.testing.assert_array_equal(other.vertices, mesh.vertices)
        np.testing.assert_array_equal(other.faces, mesh.faces)
        np.testing.assert_array_equal(other.colours, mesh.colours)
        np.testing.assert_array_equal(other.normals, mesh.normals)
        assert other.error_bound == mesh.error_bound and other.stats == mesh.stats
        assert set(other.attributes) == set(mesh.attributes)
        other.render((20, 10))
        other.vertices[0] = 7  # its own
        assert (mesh.vertices[0] != 7).any()


def test_a_missed_region_warns_and_is_flagged(db: Any, tmp_path: Path) -> None:
    away = [[1e4, 1e4, 0], [1e4 + 1, 1e4 + 1, 1]]
    with pytest.warns(mtdb.RegionMissed, match="hills") as caught:
        mesh = db["hills"].extract(box=away)
    assert caught[0].filename == __file__
    assert mesh.stats is not None and mesh.stats.region_missed
    with pytest.warns(mtdb.RegionMissed, match="empty"):
        assert len(db["hills"].extract(box=away, clip=True).faces) == 0
    with pytest.warns(mtdb.RegionMissed):
        assert db["hills"].extract_to(tmp_path / "a.ply", box=away).region_missed
    with pytest.warns(mtdb.RegionMissed):
        db["hills"].extract({"region": {"box": {"min": away[0], "max": away[1]}}})
    with db["hills"].session() as session:
        assert session.update(box=away).region_missed
        assert not session.update(error=1).region_missed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not db["hills"].extract(box=[[0, 0, 0], [1, 1, 1]]).stats.region_missed
        assert not db["hills"].extract(error=1).stats.region_missed


@pytest.mark.parametrize("wrong, begins", [
    ({"error": -1}, "error:"),
    ({"relative": -1}, "relative:"),
    ({"error": 1, "relative": -1}, "relative:"),
    ({"error": -1, "threshold": 3}, "error:"),
    ({"box": [[1, 1, 1], [0, 0, 0]]}, "box:"),
    ({"sphere": [0, 0, 0, -1]}, "sphere.radius:"),
    ({"box": [[0, 0, 0], [1, 1, 1]], "sphere": [0, 0, 0, -1]}, "sphere.radius:"),
    ({"camera": {"eye": [0, 0, 0], "target": [0, 0, 0]}}, "camera.target:"),
    ({"camera": {"eye": [0, 0, 0], "target": [0, 0, 1]}, "pixels": -1}, "pixels:"),
    ({"region": {"bxo": 1}}, "region:"),
    ({"threshold": {"smallest": []}}, "threshold.smallest:"),
    ({"max_triangles": -3}, "max_triangles:"),
])
def test_queries_are_refused_by_their_keywords(db: Any, wrong: Any, begins: str) -> None:
    with pytest.raises(mtdb.InvalidArgument) as told:
        db["hills"].extract(**wrong)
    assert str(told.value).startswith(begins)
    with db["hills"].session() as session, pytest.raises(mtdb.InvalidArgument) as told:
        session.update(**wrong)
    assert str(told.value).startswith(begins)


@pytest.mark.parametrize("wrong, begins", [
    ({"bits": 30}, "bits:"),
    ({"bits": 3, "step": 1.0}, "give either bits or step"),
    ({"normal_bits": 30}, "normal_bits:"),
    ({"memory_bytes": 1000}, "memory_bytes:"),
    ({"resume": True}, "resume: needs a journal_path"),
    ({"lossless": True, "bits": 3}, "lossless:"),
    ({"threads": 10**6}, "threads:"),
    ({"fill": 3}, "fill:"),
    ({"attribute_steps": {"heat": -1}}, "attribute_steps['heat']:"),
])
def test_ingests_are_refused_by_their_keywords(tmp_path: Path, wrong: Any, begins: str) -> None:
    vertices, faces, _ = hills(10)
    with mtdb.open(tmp_path / "a.mtdb", create=True) as db:
        with pytest.raises(mtdb.InvalidArgument) as told:
            db.ingest(vertices, faces, name="a", **wrong)
        assert str(told.value).startswith(begins)
        with pytest.raises(mtdb.BadInput, match=r"^faces\[81\]: "):
            db.ingest(vertices, faces + 90 * (np.arange(len(faces)) == 81)[:, None], name="a")
        with pytest.raises(mtdb.BadInput, match=r"^vertices\[3\]: "):
            db.ingest(vertices + np.where(np.arange(100) == 3, np.inf, 0)[:, None], faces, name="a")


@pytest.mark.parametrize("call", [
    lambda v, f: mtdb.simplify(v, f),
    lambda v, f: mtdb.simplify(v, f, triangles=0),
    lambda v, f: mtdb.simplify(v, f, error=-1),
    lambda v, f: mtdb.distance(3, (v, f)),
    lambda v, f: mtdb.distance((v, f, f), (v, f)),
    lambda v, f: mtdb.distance((v, f), (v, f), asks="c"),
])
def test_what_means_nothing_is_refused(call: Any) -> None:
    with pytest.raises(mtdb.InvalidArgument):
        call(*hills(10)[:2])


def test_a_build_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    sys.path.insert(0, str(ROOT / "tools/python"))
    try:
        import backend
    finally:
        del sys.path[0]
    lines = (ROOT / "cmake/packages.txt").read_text().splitlines()
    assert {*backend.HEADERS.values(), *backend.PROGRAMS.values()} <= set(lines)
    monkeypatch.setitem(backend.HEADERS, "no/such/header.h", "libnothing-dev")
    assert "libnothing-dev" in backend.missing_packages()
    with pytest.raises(SystemExit, match="apt install .*libnothing-dev"):
        backend.get_requires_for_build_wheel()
    assert backend.get_requires_for_build_wheel({"library": "x.so"}) == []
    monkeypatch.setenv("PATH", "/nowhere")
    assert {"cmake", "ninja-build", "build-essential"} <= set(backend.missing_packages())
