# SPDX-License-Identifier: Apache-2.0
"""Heights of terrains as numpy arrays."""
from __future__ import annotations

import ctypes as C
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Optional, Sequence

import numpy as np
import numpy.typing as npt

from . import _library as L
from ._errors import InvalidArgument
from ._mesh import view
from ._work import interruptible, probe_options

if TYPE_CHECKING:
    from ._database import Object

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class HeightGrid:
    """Heights on a grid: `heights[row, column]` is that at `x[column]`, `y[row]`; NaN where there is
    none. `numpy.asarray` of it is `heights`."""

    heights: Floats
    x: Floats
    y: Floats
    error_bound: float  #: no height is farther from the input's

    def __array__(self, dtype: npt.DTypeLike = None) -> npt.NDArray[Any]:
        return self.heights if dtype is None else self.heights.astype(dtype)


@dataclass(frozen=True)
class Profile:
    """Heights along a line, (n,) each: a point for each corner and for each crossing with an edge,
    so that heights between two points are on a straight line. height: NaN where a hole begins."""

    distance: Floats
    x: Floats
    y: Floats
    height: Floats
    error_bound: float


def _numbers(name: str, values: Any, count: int) -> Any:
    array = np.asarray(values, float).ravel()
    if array.shape != (count,):
        raise InvalidArgument(f"{name}: expected {count} numbers, found {values!r}")
    return (C.c_double * count)(*array)


def _places(name: str, points: npt.ArrayLike) -> Floats:
    places = np.ascontiguousarray(points, float)
    if places.ndim != 2 or places.shape[1] != 2:
        raise InvalidArgument(f"{name}: expected the shape (n, 2), found {places.shape}")
    return places


def heights(terrain: "Object", window: Optional[Sequence[float]],
            spacing: "float | Sequence[float] | None", error: Optional[float]) -> HeightGrid:
    within = None if window is None else _numbers("window", window, 4)
    if spacing is not None and np.ndim(spacing) == 0:
        spacing = (float(spacing),) * 2  # type: ignore[arg-type]
    apart = None if spacing is None else _numbers("spacing", spacing, 2)
    raster, cost = L.Raster(), L.HeightCost()
    L.call("get_raster", terrain._handle, within, apart, C.byref(raster))
    found = np.empty((raster.rows, raster.columns))
    with interruptible() as control:
        L.call("sample_heights", terrain._handle, C.byref(raster), C.byref(probe_options(error, control)),
               found.ctypes.data, found.size, C.byref(cost))
    return HeightGrid(found, raster.x0 + raster.dx * np.arange(raster.columns),
                      raster.y0 + raster.dy * np.arange(raster.rows), cost.error_bound)


def heights_at(terrain: "Object", points: npt.ArrayLike, error: Optional[float]) -> Floats:
    places = _places("points", points)
    found = np.empty(len(places))
    with interruptible() as control:
        L.call("find_heights", terrain._handle, places.ctypes.data, len(places),
               C.byref(probe_options(error, control)), found.ctypes.data, None)
    return found


def profile(terrain: "Object", line: npt.ArrayLike, error: Optional[float]) -> Profile:
    corners = _places("line", line)
    cost = L.HeightCost()
    with interruptible() as control:
        found = L.Handle("profile", "find_profile", terrain._handle, corners.ctypes.data,
                         len(corners), C.byref(probe_options(error, control)), after=(C.byref(cost),))
    count = L.ask("count_profile_points", found)
    table = view(L.ask("get_profile_points", found), (count, 4), "<f8", found)
    return Profile(table[:, 0], table[:, 1], table[:, 2], table[:, 3], cost.error_bound)


def height_array(array: npt.ArrayLike, geotransform: Optional[Sequence[float]], crs: Optional[str],
                 height_units: Optional[str]) -> tuple[L.HeightArray, Floats]:
    """The struct, and the array that it points to."""
    kept = np.ascontiguousarray(array, float)
    if kept.ndim != 2:
        raise InvalidArgument(f"heights: expected the shape (rows, columns), found {kept.shape}")
    given = L.HeightArray(
        columns=kept.shape[1], rows=kept.shape[0], heights=kept.ctypes.data,
        crs=None if crs is None else crs.encode(),
        height_units=None if height_units is None else height_units.encode(),
    )
    if geotransform is not None:
        given.geotransform = _numbers("geotransform", geotransform, 6)
    return given, kept
