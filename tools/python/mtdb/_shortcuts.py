# SPDX-License-Identifier: Apache-2.0
"""One call each: a mesh made smaller, and how far two meshes are apart. Both go through a store in
the folder of temporary files, which is gone afterwards."""
from __future__ import annotations

import os
import tempfile
from contextlib import ExitStack
from typing import Any, Mapping, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from ._compare import Comparison, compare
from ._database import Object, open_database
from ._errors import InvalidArgument
from ._mesh import Mesh, checked
from ._work import Progress

#: What `distance` takes: an object of a store, a mesh, its arrays (vertices, faces), or the path of a
#: mesh file.
Shape = Union[Object, Mesh, Tuple[npt.ArrayLike, npt.ArrayLike], str, "os.PathLike[str]"]


def simplify(
    vertices: Union[npt.ArrayLike, Mesh, str, "os.PathLike[str]"],
    faces: Optional[npt.ArrayLike] = None,
    *,
    error: Optional[float] = None,
    triangles: Optional[int] = None,
    attributes: Optional[Mapping[str, npt.ArrayLike]] = None,
    orient: bool = False,
    memory_bytes: int = 1 << 30,
    tmp_directory: Optional[str] = None,
    progress: Progress = None,
) -> Mesh:
    """The mesh with fewer triangles: the smallest within `error` of the input, measured both ways,
    or the best of at most so many `triangles`; of both, what is reached first.

    vertices, faces, attributes: as for `Database.ingest`: arrays, a `Mesh`, or the path of a mesh file.
    `error_bound` of the answer says within what it is; with `triangles`, `shortfall` is not None when
    the error was not reached. Whoever wants several accuracies of one mesh stores it instead: storing it is
    nearly all of the time.
    """
    if error is None and triangles is None:
        raise InvalidArgument("error, triangles: give one of them, or both")
    if triangles is not None and triangles < 1:
        raise InvalidArgument(f"triangles: expected a number above 0, found {triangles}")
    if error is not None and not error >= 0:
        raise InvalidArgument(f"error: expected a number that is not negative, found {error}")
    with tempfile.TemporaryDirectory(prefix="mtdb", dir=tmp_directory) as folder:
        with open_database(os.path.join(folder, "simplify.mtdb"), create=True) as db:
            def store(bits: Optional[int]) -> Object:
                return db.ingest(vertices, faces, name="mesh", attributes=attributes, orient=orient,
                                 bits=bits, memory_bytes=memory_bytes, progress=progress, replace=True)

            stored = store(None)
            if error is not None and stored.rounding_error > error / 4:
                stored = store(24)  # the grid that suits the mesh is too coarse for the error
            return stored.extract(error=error, max_triangles=triangles)


def _finest(mesh: Mesh) -> dict[str, Any]:
    """How to store it so that rounding adds as little as may be."""
    points = np.asarray(mesh.vertices, np.float64) + mesh.origin
    return {"lossless": True} if (points == points.astype(np.float32)).all() else {"bits": 24}


def _stored(shape: Shape, name: str, folder: str, opened: ExitStack) -> Object:
    if isinstance(shape, Object):
        return shape
    options: dict[str, Any] = {}
    given: Any = shape
    if isinstance(shape, tuple):
        if len(shape) != 2:
            raise InvalidArgument(f"{name}: expected (vertices, faces), found {len(shape)} things")
        given = Mesh(*checked(*shape))
    elif not isinstance(shape, (Mesh, str, os.PathLike)):
        raise InvalidArgument(f"{name}: expected an object, a mesh, (vertices, faces) or a path, "
                              f"found {type(shape).__name__}")
    if isinstance(given, Mesh):
        options = _finest(given)
        given = Mesh(given.vertices, given.faces, origin=given.origin.tolist())
    db = opened.enter_context(open_database(os.path.join(folder, name + ".mtdb"), create=True))
    return db.ingest(given, name=name, weld=False, **options)


def distance(
    a: Shape,
    b: Shape,
    *,
    width: Optional[float] = None,
    tolerance: Optional[float] = None,
    reach: Optional[float] = None,
    asks: str = "both",
    max_milliseconds: Optional[float] = None,
    tmp_directory: Optional[str] = None,
) -> Comparison:
    """How far two surfaces are apart at most, with a proof: `low` and `high` of the answer hold the
    largest distance of a point of one from the other (the Hausdorff distance), of all points and not
    of samples; `a_to_b` and `b_to_a` each way.

    a, b: objects of stores, meshes, (vertices, faces), or paths of mesh files.
    width, tolerance, reach, asks, max_milliseconds: as for `compare`.
    """
    with tempfile.TemporaryDirectory(prefix="mtdb", dir=tmp_directory) as folder:
        opened = ExitStack()
        with opened:
            found = compare(
                _stored(a, "a", folder, opened), _stored(b, "b", folder, opened), width=width,
                tolerance=tolerance, reach=reach, asks=asks, max_milliseconds=max_milliseconds,
            )
        return found
