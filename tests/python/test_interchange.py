# SPDX-License-Identifier: Apache-2.0
"""Meshes of other libraries, those that are installed."""
from __future__ import annotations

from typing import Any

import mtdb
import numpy as np
import pytest
from conftest import hills


def coloured() -> mtdb.Mesh:
    vertices, faces, attributes = hills(10)
    return mtdb.Mesh(vertices, faces, attributes)


def check(mesh: mtdb.Mesh, expected: mtdb.Mesh) -> None:
    np.testing.assert_allclose(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    assert mesh.colours is not None and expected.colours is not None
    np.testing.assert_array_equal(mesh.colours, expected.colours)


def test_open3d(db: mtdb.Database) -> None:
    pytest.importorskip("open3d", reason="python3-open3d is not installed")
    mesh = coloured()
    check(mtdb.Mesh.from_open3d(mesh.to_open3d()), mesh)
    extracted = db["hills"].extract(error=0.2, normals=True, dtype=np.float32)
    made = extracted.to_open3d()
    assert len(made.triangles) == len(extracted.faces)
    np.testing.assert_allclose(np.asarray(made.vertices), extracted.vertices + extracted.origin)
    assert made.has_vertex_normals() and made.has_vertex_colors()


def test_vtk() -> None:
    """from_pyvista takes what VTK has, too."""
    vtk = pytest.importorskip("vtkmodules.vtkCommonDataModel", reason="python3-vtk9 is not there")
    core = pytest.importorskip("vtkmodules.vtkCommonCore")
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    mesh = coloured()
    data = vtk.vtkPolyData()
    points = core.vtkPoints()
    points.SetData(support.numpy_to_vtk(mesh.vertices, deep=1))
    data.SetPoints(points)
    cells = vtk.vtkCellArray()
    for face in mesh.faces:
        cells.InsertNextCell(3, [int(v) for v in face])
    data.SetPolys(cells)
    colours = support.numpy_to_vtk(np.ascontiguousarray(mesh.colours), deep=1)
    colours.SetName("RGB")
    data.GetPointData().AddArray(colours)
    check(mtdb.Mesh.from_pyvista(data), mesh)


@pytest.mark.parametrize("library", ["trimesh", "pyvista"])
def test_others(library: str) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed")
    mesh = coloured()
    made = getattr(mesh, "to_" + library)()
    check(getattr(mtdb.Mesh, "from_" + library)(made), mesh)


class FakeTrimesh:
    """What from_trimesh reads of one."""

    def __init__(self, mesh: mtdb.Mesh) -> None:
        self.vertices, self.faces = mesh.vertices, mesh.faces
        assert mesh.colours is not None
        alpha = np.full((len(mesh.vertices), 1), 255, np.uint8)
        colours = np.hstack([mesh.colours, alpha])
        self.visual = type("Visual", (), {"kind": "vertex", "vertex_colors": colours})()


def test_what_trimesh_has_is_read() -> None:
    check(mtdb.Mesh.from_trimesh(FakeTrimesh(coloured())), coloured())


def test_nothing_is_imported_before_it_is_asked_for() -> None:
    import subprocess
    import sys

    told = subprocess.run(
        [sys.executable, "-c", "import mtdb, sys; print([m for m in "
         "('open3d', 'trimesh', 'pyvista', 'vtkmodules', 'tqdm') if m in sys.modules])"],
        check=True, capture_output=True, text=True,
    )
    assert told.stdout.strip() == "[]"
