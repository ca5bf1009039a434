# SPDX-License-Identifier: Apache-2.0
"""What the panel's settings ask for, as queries of docs/query.md. Knows nothing of Blender."""
from __future__ import annotations

import math
from typing import Any, Optional, Sequence
from urllib.parse import quote, urlsplit


def source_of(source: str, name: str) -> str:
    """What mtdb.open takes: a path, or the URL of a packed file. Of a server of `mtdb serve`, the object's."""
    url = urlsplit(source)
    if url.scheme in ("http", "https") and url.path in ("", "/", "/objects", "/objects/"):
        return f"{url.scheme}://{url.netloc}/objects/{quote(name, safe='')}/packed"
    return source


def catalog_of(source: str) -> Optional[str]:
    """The URL that lists the objects of a server; None: it is no server."""
    opened = source_of(source, "")
    return None if opened == source else opened[: -len("//packed")]


def focus_query(
    point: Sequence[float], radius: float, error: float, fall_off: float, max_triangles: int, clip: bool
) -> dict[str, Any]:
    """`error` (0: full resolution) within `radius` of the point; beyond, `fall_off` more for each unit
    of distance, or, with 0, as coarse as can be."""
    query: dict[str, Any] = {}
    centre = [float(x) for x in point]
    if fall_off > 0 and not clip:
        beyond = {"linear": {"point": centre, "base": error - fall_off * radius, "slope": fall_off}}
        query["threshold"] = {"largest": [error, beyond]} if error > 0 else beyond
    else:
        query["region"] = {"sphere": {"centre": centre, "radius": radius}}
        query["threshold"] = error if error > 0 else "full"
    return _limited(query, max_triangles, clip)


def camera_query(camera: dict[str, Any], pixels: float, max_triangles: int, clip: bool) -> dict[str, Any]:
    """What the camera sees, drawn at most so many pixels from where it belongs."""
    query = {
        "region": {"frustum": camera},
        "threshold": {"screen": {"camera": camera, "pixels": pixels}},
    }
    return _limited(query, max_triangles, clip)


def box_query(points: Sequence[Sequence[float]]) -> dict[str, Any]:
    """The full resolution of the box around the points, and nothing else."""
    low = [min(p[i] for p in points) for i in range(3)]
    high = [max(p[i] for p in points) for i in range(3)]
    return {"region": {"box": {"min": low, "max": high}}, "clip": True}


def vertical_fov(scale_y: float) -> float:
    """In degrees, of a projection that has `scale_y` in its second row."""
    return math.degrees(2 * math.atan(1 / scale_y))


def _limited(query: dict[str, Any], max_triangles: int, clip: bool) -> dict[str, Any]:
    if max_triangles > 0:
        query["max_triangles"] = max_triangles
    if clip:
        query["clip"] = True
    return query
