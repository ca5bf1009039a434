# SPDX-License-Identifier: Apache-2.0
"""Queries: keyword arguments as the JSON of docs/query.md."""
from __future__ import annotations

import json
from typing import Any, Mapping, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from ._errors import InvalidArgument

#: A query, a region or a threshold as docs/query.md has it: numbers, lists and dicts.
Json = Union[None, bool, int, float, str, Sequence[Any], Mapping[str, Any]]


def _plain(value: Any) -> Any:
    """numpy's numbers and arrays as JSON has them."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a query cannot hold {type(value).__name__}")


class Text(str):
    """The JSON text of a query, and what its parts are called as keyword arguments."""

    names: dict[str, str]  #: by the paths that messages begin with
    has_region: bool

    @classmethod
    def of(cls, text: str, names: Optional[Mapping[str, str]] = None) -> Text:
        made = cls(text)
        made.names = dict(names or {})
        try:
            asked = json.loads(text) if text else {}
        except ValueError:  # the library says what is wrong with it
            asked = {}
        made.has_region = isinstance(asked, dict) and "region" in asked
        return made

    def in_python(self, message: str) -> str:
        """A message of the library about this query, with the keyword that it is about."""
        for path in sorted(self.names, key=len, reverse=True):
            if message.startswith(path) and message[len(path):len(path) + 1] in (":", ".", "["):
                return self.names[path] + message[len(path):]
        return message


def _listed(parts: Sequence[tuple[Any, Mapping[str, str]]], path: str, together: str,
            names: dict[str, str]) -> Any:
    """Several parts together, or the only one. Of each: what it is, and the names below its path."""
    for i, (_, below) in enumerate(parts):
        own = path if len(parts) == 1 else f"{path}.{together}[{i}]"
        names.update({own + end: name for end, name in below.items()})
    return parts[0][0] if len(parts) == 1 else {together: [part for part, _ in parts]}


def text_of(query: Union[str, Mapping[str, Any]]) -> str:
    return query if isinstance(query, str) else json.dumps(query, default=_plain)


def _box(box: npt.ArrayLike) -> dict[str, Any]:
    corners = np.asarray(box, float)
    if corners.size != 6:
        raise InvalidArgument(f"box: expected its smallest and largest corner, found {box!r}")
    low, high = corners.reshape(2, 3).tolist()
    return {"box": {"min": low, "max": high}}


def _camera(camera: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in camera.items() if v is not None}


def build(
    query: Union[str, Mapping[str, Any], None] = None,
    *,
    box: Optional[npt.ArrayLike] = None,
    sphere: Optional[Sequence[float]] = None,
    region: Json = None,
    camera: Optional[Mapping[str, Any]] = None,
    error: Optional[float] = None,
    relative: Optional[float] = None,
    pixels: Optional[float] = None,
    threshold: Json = None,
    max_triangles: Optional[int] = None,
    max_bytes: Optional[int] = None,
    max_milliseconds: Optional[float] = None,
    clip: bool = False,
    normals: bool = False,
) -> Text:
    """The JSON text of a query. Several regions: what lies in at least one of them. Several
    thresholds: all of them hold."""
    asked = (box, sphere, region, camera, error, relative, pixels, threshold)
    limits = (max_triangles, max_bytes, max_milliseconds)
    if query is not None:
        if any(a is not None for a in asked + limits) or clip:
            raise InvalidArgument("query: goes with normals only; put the rest into the query")
        if not normals:
            return Text.of(text_of(query))
        given = json.loads(query) if isinstance(query, str) else dict(query)
        return Text.of(text_of({**given, "normals": True}))
    if pixels is not None and camera is None:
        raise InvalidArgument("pixels: needs a camera")
    regions: list[tuple[Any, Mapping[str, str]]] = []
    if box is not None:
        regions.append((_box(box), {".box": "box"}))
    if sphere is not None:
        ball = np.asarray(sphere, float).ravel()
        if ball.shape != (4,):
            raise InvalidArgument(f"sphere: expected x, y, z, radius, found {sphere!r}")
        around = {"centre": ball[:3].tolist(), "radius": float(ball[3])}
        regions.append(({"sphere": around}, {".sphere": "sphere"}))
    if region is not None:
        regions.append((region, {"": "region"}))
    thresholds: list[tuple[Any, Mapping[str, str]]] = []
    if camera is not None:
        regions.append(({"frustum": _camera(camera)}, {".frustum": "camera"}))
        if pixels is not None or not any(x is not None for x in (error, relative, threshold)):
            seen = {"camera": _camera(camera), "pixels": 1 if pixels is None else pixels}
            thresholds.append(
                ({"screen": seen}, {".screen.camera": "camera", ".screen.pixels": "pixels"}))
    if error is not None:
        thresholds.append((error, {"": "error"}))
    if relative is not None:
        thresholds.append(({"relative": relative}, {".relative": "relative"}))
    if threshold is not None:
        thresholds.append((threshold, {"": "threshold"}))
    made: dict[str, Any] = {}
    names: dict[str, str] = {}
    if regions:
        made["region"] = _listed(regions, "region", "union", names)
    if thresholds:
        made["threshold"] = _listed(thresholds, "threshold", "smallest", names)
    for key, value in zip(("max_triangles", "max_bytes", "max_milliseconds"), limits):
        if value is not None:
            made[key] = value
    if clip:
        made["clip"] = True
    if normals:
        made["normals"] = True
    return Text.of(text_of(made), names)
