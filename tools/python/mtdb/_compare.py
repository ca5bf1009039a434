# SPDX-License-Identifier: Apache-2.0
"""How far two objects are apart, and where, with a proof."""
from __future__ import annotations

import ctypes as C
from dataclasses import dataclass
from typing import Any, Mapping, Optional, Sequence

import numpy as np
import numpy.typing as npt

from . import _library as L
from . import _query
from ._database import Object
from ._errors import InvalidArgument
from ._mesh import Array
from ._query import Json
from ._work import interruptible

ASKS = ("both", "a", "b")


@dataclass(frozen=True)
class Place:
    """A part of one object that is farther than the tolerance from the other one, or may be."""

    box: Array  #: (2, 3): around it
    point: Array  #: (3,): in it, at least `low` away from the other object
    low: float  #: the distance of its farthest point is at least this
    high: float  #: and at most this
    verdict: str  #: exceeds, undecided
    missing: bool  #: some of it is farther away than `reach`


@dataclass(frozen=True)
class OneSided:
    """How far one object is from the other one."""

    low: float  #: the distance of the farthest point that asks is at least this
    high: float  #: and at most this
    verdict: str  #: within, exceeds, undecided
    point: Optional[Array]  #: (3,): where `low` was found; None while it is 0
    places: list[Place]  #: with a tolerance, the farthest first


@dataclass(frozen=True)
class Comparison:
    """How far two objects are apart."""

    verdict: str  #: within, exceeds, undecided; without a tolerance undecided
    low: float  #: the larger distance of both ways is at least this
    high: float  #: and at most this
    identical: bool  #: both are copies of one object
    out_of_time: bool
    a_to_b: Optional[OneSided]  #: None when the points of a did not ask
    b_to_a: Optional[OneSided]
    triangles: int  #: that asked, at all accuracies
    clusters_read: int
    clusters_total: int
    bytes_read: int


def _length(value: Optional[float]) -> float:
    return float("inf") if value is None else value


def _interval(found: Mapping[str, Any]) -> tuple[float, float]:
    return _length(found["distance"]["low"]), _length(found["distance"]["high"])


def _place(found: Mapping[str, Any]) -> Place:
    box = np.array([found["box"]["min"], found["box"]["max"]])
    return Place(box, np.array(found["point"]), *_interval(found), found["verdict"],
                 found["missing"])


def _one_sided(found: Optional[Mapping[str, Any]]) -> Optional[OneSided]:
    if found is None:
        return None
    point = np.array(found["point"]) if "point" in found else None
    return OneSided(*_interval(found), found["verdict"], point,
                    [_place(place) for place in found["places"]])


def compare(
    a: Object,
    b: Object,
    *,
    tolerance: Optional[float] = None,
    width: Optional[float] = None,
    reach: Optional[float] = None,
    max_milliseconds: Optional[float] = None,
    box: Optional[npt.ArrayLike] = None,
    sphere: Optional[Sequence[float]] = None,
    region: Json = None,
    transform: Optional[npt.ArrayLike] = None,
    asks: str = "both",
    as_stored: bool = False,
    threads: int = 0,
) -> Comparison:
    """How far two objects are apart, and where: intervals with a proof, rounding included.

    tolerance: is each point of one object within it of the other one? Every place is decided.
    width: the interval of the largest distance becomes so narrow; without both 1/10,000 of the diagonal.
    reach: what is farther away is missing, and how far is not looked for.
    max_milliseconds: what was proved until then.
    box, sphere, region: which points ask; as for `extract`.
    transform: a 4x4 matrix that maps b into the coordinates of a.
    asks: whose points ask for the other object: both, a or b.
    as_stored: of what is stored, not of the inputs, which were rounded when they were stored.
    """
    if asks not in ASKS:
        raise InvalidArgument(f"asks: expected one of {ASKS}, found {asks!r}")
    numbers = None
    if transform is not None:
        matrix = np.asarray(transform, float)
        if matrix.shape != (4, 4):
            raise InvalidArgument(f"transform: expected a 4x4 matrix, found one of {matrix.shape}")
        numbers = (C.c_double * 16)(*matrix.ravel().tolist())
    query = a._query(_query.build(box=box, sphere=sphere, region=region))
    with interruptible() as control:
        options = L.CompareOptions(
            has_tolerance=tolerance is not None, tolerance=tolerance or 0.0, width=width or 0.0,
            reach=reach or 0.0, has_max_milliseconds=max_milliseconds is not None,
            max_milliseconds=max_milliseconds or 0.0, query=query.value,
            transform=C.cast(numbers, C.c_void_p) if numbers is not None else None,
            asks=ASKS.index(asks), as_stored=as_stored, threads=threads, control=control.value,
        )
        found = L.json_of("compare", a._handle, b._handle, C.byref(options))
    return Comparison(
        found["verdict"], *_interval(found), found["identical"], found["out_of_time"],
        _one_sided(found.get("a_to_b")), _one_sided(found.get("b_to_a")), found["triangles"],
        found["clusters_read"], found["clusters_total"], found["bytes_read"],
    )


@dataclass(frozen=True)
class LargestChange:
    """The largest difference of heights in one direction; 0 where there is none."""

    low: float  #: it is at least this
    high: float  #: and at most this
    point: Optional[Array]  #: (3,): on b, where `low` was found; None while that is 0


@dataclass(frozen=True)
class HeightChange:
    """How much higher or lower one terrain is than another one; pairs are at least, at most."""

    verdict: str  #: within, exceeds, undecided; without a tolerance undecided
    identical: bool  #: both are copies of one object
    rise: LargestChange  #: of b above a
    fall: LargestChange  #: of b below a
    fill_volume: tuple[float, float]  #: above a and below b
    cut_volume: tuple[float, float]  #: below a and above b
    net_volume: tuple[float, float]  #: fill less cut
    area_both: tuple[float, float]  #: that both cover, in units of x times y
    area_a: tuple[float, float]  #: that a alone covers
    area_b: tuple[float, float]  #: that b alone covers
    metres_of_unit: tuple[float, float]  #: what 1 along x and along y is in units of height
    out_of_time: bool
    triangles: int  #: of all cuts that were looked at
    clusters_read: int
    clusters_total: int
    bytes_read: int


def _pair(found: Mapping[str, Any]) -> tuple[float, float]:
    return _length(found["low"]), _length(found["high"])


def _largest(found: Mapping[str, Any]) -> LargestChange:
    point = np.array(found["point"]) if "point" in found else None
    return LargestChange(*_pair(found["height"]), point)


def compare_heights(
    a: Object,
    b: Object,
    *,
    tolerance: Optional[float] = None,
    width: Optional[float] = None,
    max_milliseconds: Optional[float] = None,
    window: Optional[Sequence[float]] = None,
    as_stored: bool = False,
    threads: int = 0,
) -> HeightChange:
    """How much higher or lower terrain b is than a, straight up and down, and the volumes of cut and fill.

    tolerance: is no height of b farther from that of a than this?
    width: rise and fall become known to within it, and volumes to within it times the area of both;
        without both 1/10,000 of the range of heights.
    max_milliseconds: what was proved until then.
    window: least x and y, largest x and y: of this part of the plane.
    as_stored: of what is stored, not of the inputs, which were rounded when they were stored.
    """
    corners = None
    if window is not None:
        if len(window) != 4:
            raise InvalidArgument(f"window: expected four numbers, found {len(window)}")
        corners = (C.c_double * 4)(*(float(v) for v in window))
    with interruptible() as control:
        options = L.HeightChangeOptions(
            has_tolerance=tolerance is not None, tolerance=tolerance or 0.0,
            has_width=width is not None, width=width or 0.0,
            has_max_milliseconds=max_milliseconds is not None,
            max_milliseconds=max_milliseconds or 0.0,
            window=C.cast(corners, C.c_void_p) if corners is not None else None,
            as_stored=as_stored, threads=threads, control=control.value,
        )
        found = L.json_of("compare_heights", a._handle, b._handle, C.byref(options))
    metres = found["metres_of_unit"]
    return HeightChange(
        found["verdict"], found["identical"], _largest(found["rise"]), _largest(found["fall"]),
        _pair(found["fill_volume"]), _pair(found["cut_volume"]), _pair(found["net_volume"]),
        _pair(found["area_both"]), _pair(found["area_a"]), _pair(found["area_b"]),
        (metres[0], metres[1]), found["out_of_time"], found["triangles"], found["clusters_read"],
        found["clusters_total"], found["bytes_read"],
    )
