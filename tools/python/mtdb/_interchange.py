# SPDX-License-Identifier: Apache-2.0
"""Meshes of other libraries, which are imported when they are asked for. Arrays are copied: Open3D
refuses read-only ones."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._mesh import Array, Mesh

if TYPE_CHECKING:
    import open3d
    import pyvista
    import trimesh


def _points(mesh: Mesh) -> Array:
    return np.asarray(mesh.vertices, np.float64) + mesh.origin


def to_open3d(mesh: Mesh) -> "open3d.geometry.TriangleMesh":
    import open3d

    made = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(_points(mesh)),
        open3d.utility.Vector3iVector(np.array(mesh.faces)),
    )
    if mesh.normals is not None:
        made.vertex_normals = open3d.utility.Vector3dVector(mesh.normals.astype(np.float64))
    if mesh.colours is not None:
        kind = mesh.colours.dtype
        scale = 1.0 if kind.kind == "f" else 65535.0 if kind == np.uint16 else 255.0
        made.vertex_colors = open3d.utility.Vector3dVector(mesh.colours.astype(float) / scale)
    return made


def _attributes(normals: Any, colors: Any) -> dict[str, Array]:
    """As PLY names them. Colours: 0..1 or 0..255, three or four each."""
    found: dict[str, Array] = {}
    if colors is not None and len(colors):
        values = np.asarray(colors)
        if values.dtype.kind == "f":
            values = np.rint(255 * np.clip(values, 0, 1))
        values = values.astype(np.uint8)
        found.update(zip(("red", "green", "blue"), np.ascontiguousarray(values[:, :3].T)))
    if normals is not None and len(normals):
        found.update(zip(("nx", "ny", "nz"), np.ascontiguousarray(normals, np.float32).T))
    return found


def from_open3d(mesh: Any) -> Mesh:
    return Mesh(
        np.asarray(mesh.vertices),
        np.asarray(mesh.triangles),
        _attributes(np.asarray(mesh.vertex_normals), np.asarray(mesh.vertex_colors)),
    )


def to_trimesh(mesh: Mesh) -> "trimesh.Trimesh":
    import trimesh

    return trimesh.Trimesh(
        vertices=_points(mesh),
        faces=np.asarray(mesh.faces, np.int64),
        vertex_normals=mesh.normals,
        vertex_colors=mesh.colours,
        process=False,
    )


def from_trimesh(mesh: Any) -> Mesh:
    visual: Any = getattr(mesh, "visual", None)
    colors = visual.vertex_colors if getattr(visual, "kind", None) == "vertex" else None
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), _attributes(None, colors))


def to_pyvista(mesh: Mesh) -> "pyvista.PolyData":
    import pyvista

    faces = np.empty((len(mesh.faces), 4), np.int64)
    faces[:, 0] = 3
    faces[:, 1:] = mesh.faces
    made = pyvista.PolyData(_points(mesh), faces.ravel())
    for name, values in mesh.attributes.items():
        made.point_data[name] = np.ascontiguousarray(values)
    if mesh.normals is not None:
        made.point_data["Normals"] = np.ascontiguousarray(mesh.normals)
    if mesh.colours is not None:
        made.point_data["RGB"] = np.ascontiguousarray(mesh.colours)
    return made


def from_pyvista(mesh: Any) -> Mesh:
    """Of a PolyData of pyvista or of VTK."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if mesh.GetPolys().GetNumberOfCells() != mesh.GetNumberOfCells():
        raise ValueError("expected a mesh of polygons only; triangulate it, or extract its surface")
    cells = vtk_to_numpy(mesh.GetPolys().GetData()).reshape(-1)
    if len(cells) % 4 or np.any(cells.reshape(-1, 4)[:, 0] != 3):
        raise ValueError("expected triangles only; call triangulate() before")
    points = vtk_to_numpy(mesh.GetPoints().GetData())
    data = mesh.GetPointData()
    colors = next(
        (vtk_to_numpy(a) for a in map(data.GetArray, ("RGB", "RGBA", "Colors")) if a is not None),
        None,
    )
    normals = data.GetNormals() or data.GetArray("Normals")
    return Mesh(
        np.array(points, np.float64 if points.dtype == np.float64 else np.float32),
        np.array(cells.reshape(-1, 4)[:, 1:], np.int64),
        _attributes(None if normals is None else vtk_to_numpy(normals), colors),
    )
