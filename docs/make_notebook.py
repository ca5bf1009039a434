# SPDX-License-Identifier: Apache-2.0
"""Writes docs/python.ipynb, from the cells below. tests/python/test_notebook.py runs them."""
from __future__ import annotations

import json
from pathlib import Path

CELLS = [
    "# mtdb from Python\n\nStores a surface at every level of detail, takes a region and a camera's "
    "view of it, follows a session, and hands a mesh to Open3D. [python.md](python.md) tells the "
    "rest.",
    """import tempfile

import mtdb
import numpy as np

folder = tempfile.mkdtemp()
db = mtdb.open(folder + "/hills.mtdb", create=True)
db""",
    "## Ingest\n\nA hilly square with a colour at each vertex. `db.ingest` also takes an iterable of "
    "chunks, for meshes that are larger than memory.",
    """side = 400
y, x = (a.ravel() for a in np.mgrid[0:side, 0:side])
z = 12 * np.sin(0.03 * x) * np.cos(0.05 * y) + np.sin(0.4 * x + 0.3 * y)
vertices = np.stack([x, y, z], axis=1).astype(float)
a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
faces = np.concatenate(
    [np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)]
)
height = ((z - z.min()) / (z.max() - z.min()) * 255).astype(np.uint8)
colours = {"red": height, "green": np.full_like(height, 140), "blue": 255 - height}

hills = db.ingest(vertices, faces, name="hills", attributes=colours)
hills""",
    "## A region\n\nFull resolution in a box; elsewhere as coarse as it goes, in one mesh without "
    "cracks.",
    """region = hills.extract(box=[[100, 100, -50], [200, 180, 50]])
print(region.vertices.shape, region.faces.shape, region.error_bound)
region""",
    "## What a camera sees\n\nNothing of it is drawn more than one pixel from where it belongs.",
    """camera = {"eye": [200, -150, 120], "target": [200, 150, 0], "fov": 40, "viewport": [640, 480]}
view = hills.extract(camera=camera, pixels=1)
picture = view.render((640, 480), camera=camera)
print(len(view.faces), "of", hills.triangles, "triangles;", picture.shape)
view""",
    "## A session\n\nThe camera flies; only what changes is computed. `changed_faces` are the slots "
    "that a GPU's buffer has to be written in anew.",
    """with hills.session() as session:
    for step in range(5):
        eye = [200, -150 + 40 * step, 120]
        moved = {**camera, "eye": eye}
        update = session.update(camera=moved, pixels=2)
        written = int((update.changed_faces[:, 1] - update.changed_faces[:, 0]).sum())
        print(f"{update.triangles} triangles; {update.insertions} vertices came, "
              f"{update.removals} went; {written} slots written, {update.bytes} bytes")
    last = session.mesh()""",
    "## Probes",
    """hit = hills.cast_ray([200, 200, 1000], [0, 0, -1])
near = hills.closest_point([200, 200, 30])
print(hit.point, near.distance)""",
    "## On to Open3D\n\nWhere it is installed; `to_trimesh` and `to_pyvista` likewise.",
    """try:
    shape = last.to_open3d()
    shape.compute_vertex_normals()
    print(shape)
except ImportError:
    print("open3d is not installed")""",
    """db.close()""",
]


def main() -> None:
    cells = []
    for i, text in enumerate(CELLS):
        code = not text.startswith("#")
        cell: dict[str, object] = {
            "cell_type": "code" if code else "markdown",
            "id": f"cell-{i}",
            "metadata": {},
            "source": text.splitlines(keepends=True),
        }
        if code:
            cell.update(execution_count=None, outputs=[])
        cells.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook = {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    path = Path(__file__).with_name("python.ipynb")
    path.write_text(json.dumps(notebook, indent=1) + "\n")


if __name__ == "__main__":
    main()
