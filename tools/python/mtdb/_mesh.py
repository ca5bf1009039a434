# SPDX-License-Identifier: Apache-2.0
"""Mesh: what a query, a session or a file has, as numpy arrays."""
from __future__ import annotations

import base64
import ctypes as C
import os
import struct
import zlib
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Mapping, Optional, Sequence

import numpy as np
import numpy.typing as npt

from . import _library as L
from ._errors import InvalidArgument

if TYPE_CHECKING:
    import open3d
    import pyvista
    import trimesh

Array = npt.NDArray[Any]
Path = "str | os.PathLike[str]"

# By mtdb_scalar.
_TYPES = ("i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8")


class _View:
    """Memory of the library as numpy sees it; the array's base, which keeps the memory's owner."""

    __slots__ = ("__array_interface__", "_owner")

    def __init__(self, address: int, shape: tuple[int, ...], kind: str, owner: Any) -> None:
        self.__array_interface__ = {
            "data": (address, True),
            "shape": shape,
            "typestr": kind,
            "version": 3,
        }
        self._owner = owner


def view(address: Optional[int], shape: tuple[int, ...], kind: str, owner: Any) -> Array:
    """A read-only array over memory that lives as long as `owner`."""
    if not address or 0 in shape:
        empty = np.empty(shape, kind)
        empty.flags.writeable = False
        return empty
    return np.asarray(_View(address, shape, kind, owner))


def layout(ask: str, handle: L.Handle, count: int, row_bytes: int) -> Optional[np.dtype[Any]]:
    """The rows of a mesh as a structured dtype; None when it has no attributes."""
    if count == 0:
        return None
    names, formats, offsets = [], [], []
    for i in range(count):
        attribute = L.Attribute()
        L.call(ask, handle, i, C.byref(attribute))
        names.append(attribute.name.decode())
        formats.append(_TYPES[attribute.type])
        offsets.append(attribute.offset)
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": row_bytes}
    )


def columns(rows: Array, names: Sequence[str], kind: str) -> Optional[Array]:
    """Three attributes that lie side by side as an (n, 3) array; None when they do not."""
    dtype = rows.dtype
    if dtype.fields is None or any(n not in dtype.fields for n in names):
        return None
    size = np.dtype(kind).itemsize
    first = dtype.fields[names[0]][1]
    for i, name in enumerate(names):
        if dtype.fields[name][0] != np.dtype(kind) or dtype.fields[name][1] != first + i * size:
            return None
    joined = np.dtype(
        {"names": ["v"], "formats": [(kind, (3,))], "offsets": [first], "itemsize": dtype.itemsize}
    )
    return rows.view(joined)["v"]


@dataclass(frozen=True)
class Shortfall:
    """Where a mesh is farther from the input than was asked for."""

    triangles: int
    excess: float
    bounds: Array  #: (2, 3): smallest and largest corner


def shortfall_of(s: "L.Stats | L.Update") -> Optional[Shortfall]:
    if s.shortfall_triangles == 0:
        return None
    return Shortfall(s.shortfall_triangles, s.shortfall_excess,
                     np.array([list(s.shortfall_bounds_min), list(s.shortfall_bounds_max)]))


LIMITS = ("accuracy", "triangles", "bytes", "time", "missing")


@dataclass(frozen=True)
class ExtractStats:
    """What an extraction cost, and what ended it."""

    limit: str  #: "accuracy", "triangles", "bytes", "time" or "missing"
    active_triangles: int
    nodes_applied: int
    clusters_read: int
    clusters_cached: int
    clusters_used: int
    clusters_total: int
    bytes_read: int
    select_seconds: float
    load_seconds: float
    emit_seconds: float
    #: Nothing of the surface is in the region that was asked for; a `RegionMissed` warns of it.
    region_missed: bool = False
    file: Optional[Saved] = None  #: of a mesh that went to a file


class Saved(float):
    """How far writing a mesh file moved a vertex at most, and what else became of the mesh."""

    positions: str  #: "float32", "float64", "decimal" or "quantised"
    origin: Optional[Array]  #: positions in the file are offsets from here (.stl, .drc), or None
    node_origin: Optional[Array]  #: likewise in .glb, whose node adds it for every reader
    not_written: list[str]  #: attributes that the format has no place for
    notes: list[str]  #: what else was changed

    @classmethod
    def _of(
        cls, function: str, handle: L.Handle, path: "str | os.PathLike[str]", normals: bool,
        double: bool,
    ) -> Saved:
        options = L.FileOptions(normals=bool(normals), double_positions=bool(double))
        told = L.json_of(function, handle, L.path_bytes(path), C.byref(options))
        made = cls(told["rounding"])
        made.positions = told["positions"]
        made.origin = None if told["origin"] is None else np.array(told["origin"])
        made.node_origin = None if told["node_origin"] is None else np.array(told["node_origin"])
        made.not_written = told["not_written"]
        made.notes = told["notes"]
        return made


class Mesh:
    """Triangles over vertices. What a query returns is read-only: views on memory of the library,
    which lives as long as one of them. Of arrays, `Mesh(vertices, faces)` makes one to draw, to
    write to a file, or to store.

    vertices: (n, 3) float64, in the object's units; or float32, less `origin`.
    faces: (m, 3) int32, counter-clockwise from outside.
    attributes: by name, (n,) each.
    corners: of textured objects, (m, 3, 2) float32: u and v of the corners of `faces`; None of
        others. u goes to the right and v up, from 0 to 1 across an image.
    pages: likewise (m,) uint32: which image, of `Object.read_page`; 0xffffffff: none.
    """

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        attributes: Optional[Mapping[str, npt.ArrayLike]] = None,
        *,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        points, corners = checked(vertices, faces)
        limits = np.iinfo(np.int32)
        if corners.size and not limits.min <= corners.min() <= corners.max() <= limits.max:
            raise InvalidArgument(f"faces: {corners.max()} is no vertex that int32 can number")
        self.vertices: Array = points
        self.faces: Array = corners.astype(np.int32, copy=False)
        self.origin: Array = np.asarray(origin, np.float64)
        self.attributes: Mapping[str, Array] = MappingProxyType(
            {n: np.asarray(a) for n, a in (attributes or {}).items()}
        )
        self.error_bound: float = 0.0
        self.stats: Optional[ExtractStats] = None
        self.shortfall: Optional[Shortfall] = None
        self.corners: Optional[Array] = None
        self.pages: Optional[Array] = None
        self._normals: Optional[Array] = None
        self._colours: Optional[Array] = None
        self._handle: Optional[L.Handle] = None

    def __setattr__(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)
        if name in ("vertices", "faces", "origin", "attributes"):  # no longer what the library has
            self._handle = self._normals = self._colours = None

    @classmethod
    def _of(cls, handle: L.Handle) -> "Mesh":
        look = L.MeshView()
        L.call("view_mesh", handle, C.byref(look))
        mesh = cls.__new__(cls)
        n, m = look.vertices, look.triangles
        if look.positions_float:
            mesh.vertices = view(look.positions_float, (n, 3), "<f4", handle)
        else:
            mesh.vertices = view(look.positions, (n, 3), "<f8", handle)
        mesh.origin = np.array(look.origin)
        mesh.faces = view(look.indices, (m, 3), "<i4", handle)
        mesh.corners = mesh.pages = None
        if look.corners:
            mesh.corners = view(look.corners, (m, 3, 2), "<f4", handle)
            mesh.pages = view(look.pages, (m,), "<u4", handle)
        mesh.error_bound = 0.0
        mesh.stats = mesh.shortfall = None
        dtype = layout("get_mesh_attribute", handle, look.attributes, look.row_bytes)
        mesh.attributes = MappingProxyType({})
        if dtype is not None and dtype.names is not None:
            rows = view(look.rows, (n, look.row_bytes), "|u1", handle)
            table = rows.view(dtype)[:, 0] if n else np.empty(0, dtype)
            mesh.attributes = MappingProxyType({name: table[name] for name in dtype.names})
            mesh._normals = columns(table, ("nx", "ny", "nz"), "<f4")
            mesh._colours = columns(table, ("red", "green", "blue"), "u1")
        mesh._handle = handle
        return mesh

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: arrays of its own, which need no library."""
        state = {name: value for name, value in self.__dict__.items() if not name.startswith("_")}
        for name in ("vertices", "faces", "corners", "pages"):
            if state[name] is not None:
                state[name] = np.array(state[name])
        state["attributes"] = {name: np.array(a) for name, a in self.attributes.items()}
        return state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)
        self.attributes = MappingProxyType(state["attributes"])  # which no handle stands for

    @property
    def normals(self) -> Optional[Array]:
        """(n, 3) float32 unit normals: those that are stored, or that the query asked for."""
        if self._normals is None and all(n in self.attributes for n in ("nx", "ny", "nz")):
            return np.stack([self.attributes[n] for n in ("nx", "ny", "nz")], axis=1)
        return self._normals

    @property
    def colours(self) -> Optional[Array]:
        """(n, 3), uint8 as mostly: red, green, blue."""
        if self._colours is None and all(n in self.attributes for n in ("red", "green", "blue")):
            return np.stack([self.attributes[n] for n in ("red", "green", "blue")], axis=1)
        return self._colours

    @property
    def bounds(self) -> Array:
        """(2, 3): smallest and largest corner, origin included."""
        if len(self.vertices) == 0:
            return np.full((2, 3), np.nan)
        corners: Array = np.stack([self.vertices.min(0), self.vertices.max(0)]).astype(float)
        return corners + self.origin

    def __repr__(self) -> str:
        bound = f", error_bound={self.error_bound:.3g}" if self.stats else ""
        return f"<mtdb.Mesh: {len(self.vertices)} vertices, {len(self.faces)} faces{bound}>"

    def _repr_html_(self) -> str:
        if len(self.faces) == 0:
            return f"<p>{self._caption()}</p>"
        data = base64.b64encode(png(self.render(size=(480, 360), wireframe=len(self.faces) < 20000)))
        return (
            f'<figure><img src="data:image/png;base64,{data.decode()}" width="480" height="360">'
            f"<figcaption>{self._caption()}</figcaption></figure>"
        )

    def _caption(self) -> str:
        bound = f", within {self.error_bound:.3g}" if self.stats else ""
        return f"{len(self.vertices):,} vertices, {len(self.faces):,} triangles{bound}"

    def _c_mesh(self) -> L.Handle:
        if self._handle is not None:
            return self._handle
        with Packed(self.vertices, self.faces, self.attributes, self.origin) as packed:
            handle = L.Handle("mesh", "create_mesh", C.byref(packed.struct))
        return handle

    def save(
        self, path: "str | os.PathLike[str]", *, normals: bool = False, double_positions: bool = False
    ) -> Saved:
        """Writes a mesh file: .ply, .obj, .stl, .off, .glb or .drc. Returns how far the format's
        float32 moved a vertex at most, with what else became of the mesh: `origin`, `not_written`.

        normals: .off has them, too. double_positions: .ply has float64 positions, also where float32 is enough.
        """
        return Saved._of("write_mesh", self._c_mesh(), path, normals, double_positions)

    def render(
        self,
        size: tuple[int, int] = (1200, 900),
        *,
        camera: Optional[Mapping[str, Any]] = None,
        view_direction: Optional[Sequence[float]] = None,
        view: str = "auto",
        up: "str | Sequence[float] | None" = None,
        frame: Optional[npt.ArrayLike] = None,
        wireframe: bool = False,
        smooth: bool = False,
        hillshade: bool = False,
        draft: bool = False,
        colour: "str | Mesh | None" = None,
        range: Optional[tuple[float, float]] = None,
        legend: bool = True,
        scale_bar: bool = False,
        background: "str | Sequence[int] | None" = None,
    ) -> npt.NDArray[np.uint8]:
        """Draws the mesh: (height, width, 3) uint8; (height, width, 4) without a background.

        camera: {"eye": ..., "target": ..., "up": ..., "fov": degrees}, as in a query.
        view_direction: else; or view: "front", "back", "left", "right", "top", "bottom",
        "iso", "auto". up: "y", "-z" or a vector; found from the mesh when it is not given. frame: (2, 3), the box that
        fills the picture. colour: "none", "normal", "height", an attribute's name, or a Mesh to show each
        point's distance from; without, the mesh's own colours. range: the values of the
        first and the last colour. hillshade: lit as maps are. background: (red, green, blue), or "transparent".
        """
        options = L.RenderOptions(
            width=size[0], height=size[1], wireframe=int(wireframe), smooth=int(smooth),
            hillshade=int(hillshade), draft=int(draft), view=view.encode(), no_legend=int(not legend),
            scale_bar=int(scale_bar),
        )
        if size[0] < 1 or size[1] < 1:
            raise InvalidArgument(f"size: expected width and height in pixels, found {size}")
        if view_direction is not None:
            options.view_direction = triple("view_direction", view_direction)
        options.up = triple("up", up_vector(up))
        if frame is not None:
            box = np.asarray(frame, float).reshape(2, 3)
            options.has_frame = 1
            options.frame_min, options.frame_max = (triple("frame", b) for b in box)
        if camera is not None:
            put_camera(options, camera)
        reference = put_colour(options, colour)
        if range is not None:
            options.has_range, options.range = 1, (C.c_double * 2)(*range)
        if background == "transparent":
            options.transparent = 1
        elif background is not None:
            options.has_background = 1
            options.background = colour_bytes(background)
        picture = np.empty((size[1], size[0], 4 if options.transparent else 3), np.uint8)
        mesh = self._c_mesh()
        L.call("render", mesh, C.byref(options), picture.ctypes.data, picture.nbytes)
        del reference  # lived until here
        return picture

    def to_open3d(self) -> "open3d.geometry.TriangleMesh":
        """An open3d.geometry.TriangleMesh: a copy."""
        from ._interchange import to_open3d

        return to_open3d(self)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """A trimesh.Trimesh: a copy, without merging or reordering."""
        from ._interchange import to_trimesh

        return to_trimesh(self)

    def to_pyvista(self) -> "pyvista.PolyData":
        """A pyvista.PolyData: a copy."""
        from ._interchange import to_pyvista

        return to_pyvista(self)

    @classmethod
    def from_open3d(cls, mesh: Any) -> "Mesh":
        from ._interchange import from_open3d

        return from_open3d(mesh)

    @classmethod
    def from_trimesh(cls, mesh: Any) -> "Mesh":
        from ._interchange import from_trimesh

        return from_trimesh(mesh)

    @classmethod
    def from_pyvista(cls, mesh: Any) -> "Mesh":
        """Of a pyvista.PolyData or a vtkPolyData of triangles."""
        from ._interchange import from_pyvista

        return from_pyvista(mesh)


def read_mesh(path: "str | os.PathLike[str]") -> Mesh:
    """A mesh file: PLY, OBJ, STL, OFF, glTF or Draco, also compressed by gzip."""
    return Mesh._of(L.Handle("mesh", "read_mesh", L.path_bytes(path)))


def png(picture: npt.NDArray[np.uint8]) -> bytes:
    """A picture, (height, width, 3 or 4) uint8, as the bytes of a PNG file."""
    height, width, channels = picture.shape

    def chunk(kind: bytes, data: bytes) -> bytes:
        checked = kind + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    lines = np.zeros((height, 1 + channels * width), np.uint8)  # each begins with its filter, none
    lines[:, 1:] = picture.reshape(height, channels * width)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    data = zlib.compress(lines.tobytes(), 6)
    signature = b"\x89PNG\r\n\x1a\n"
    return signature + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def triple(name: str, point: Any) -> Any:
    values = np.asarray(point, float).ravel()
    if values.shape != (3,):
        raise InvalidArgument(f"{name}: expected three numbers, found {point!r}")
    return (C.c_double * 3)(*values)


def up_vector(up: "str | Sequence[float] | None") -> Sequence[float]:
    """(0, 0, 0): not said."""
    if up is None:
        return (0.0, 0.0, 0.0)
    if isinstance(up, str):
        axis = up.lstrip("+-")
        if len(up) - len(axis) > 1 or axis not in ("x", "y", "z"):
            raise InvalidArgument(f"up: expected x, y, z, -x, -y, -z or a vector, found {up!r}")
        sign = -1.0 if up.startswith("-") else 1.0
        return tuple(sign * (axis == a) for a in "xyz")
    vector = [float(x) for x in up]
    if len(vector) != 3 or not any(vector):
        raise InvalidArgument(f"up: expected three numbers, not all of them 0, found {vector}")
    return vector


def check_shape(name: str, array: Array, width: int) -> None:
    if array.ndim != 2 or array.shape[1] != width:
        raise InvalidArgument(f"{name}: expected the shape (n, {width}), found {array.shape}")


def checked(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[Array, Array]:
    """Both as arrays that the library can read: (n, 3) float32 or float64, (m, 3) integers."""
    points, corners = np.asarray(vertices), np.asarray(faces)
    if points.dtype.kind not in "fiub":
        raise InvalidArgument(f"vertices: expected real numbers, found {points.dtype}")
    if points.dtype != np.float32:
        points = points.astype(np.float64, copy=False)
    check_shape("vertices", points, 3)
    check_shape("faces", corners, 3)
    if corners.size and corners.dtype.kind not in "iu":
        raise InvalidArgument(f"faces: expected integers, found {corners.dtype}")
    return points, corners


def put_camera(options: L.RenderOptions, camera: Mapping[str, Any]) -> None:
    unknown = set(camera) - {"eye", "target", "up", "fov", "viewport", "near", "far", "direction"}
    if unknown or "eye" not in camera or not ("target" in camera or "direction" in camera):
        raise InvalidArgument("camera: expected eye, target (or direction), up, fov")
    eye = np.asarray(camera["eye"], float)
    target = camera["target"] if "target" in camera else eye + np.asarray(camera["direction"])
    options.has_camera = 1
    options.eye = triple("camera.eye", eye)
    options.target = triple("camera.target", target)
    options.up = triple("camera.up", camera.get("up", (0, 0, 1)))
    options.fov = camera.get("fov", 45)


def put_colour(options: L.RenderOptions, colour: "str | Mesh | None") -> Optional[L.Handle]:
    """Says what the colours mean. Returns what must live until the picture is drawn."""
    if isinstance(colour, Mesh):
        reference = colour._c_mesh()
        options.colour, options.reference = 4, reference.value
        return reference
    if colour is not None:
        options.colour = {"none": 1, "normal": 2, "height": 5}.get(colour, 3)
        options.attribute = colour.encode()
    return None


def colour_bytes(colour: "str | Sequence[int]") -> Any:
    if isinstance(colour, str) or len(colour) != 3 or not all(0 <= c <= 255 for c in colour):
        raise InvalidArgument(f'background: expected (red, green, blue) or "transparent", found {colour!r}')
    return (C.c_ubyte * 3)(*colour)


@dataclass
class Layout:
    """The attributes of a mesh that is stored: names and types, in their order."""

    names: list[str]
    formats: list[str]
    _kept: list[bytes] = field(default_factory=list)

    @classmethod
    def of(cls, attributes: Mapping[str, Array]) -> "Layout":
        names, formats = [], []
        for name, array in attributes.items():
            dtype = np.dtype(array.dtype).newbyteorder("<").str.replace("|", "")
            if dtype not in _TYPES:
                raise InvalidArgument(
                    f"attributes[{name!r}]: expected int8 to uint32, float32 or float64, found "
                    f"{array.dtype}"
                )
            names.append(name)
            formats.append(dtype)
        return cls(names, formats)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(list(zip(self.names, self.formats)))

    def structs(self) -> Any:
        self._kept = [n.encode() for n in self.names]
        made = (L.Attribute * max(1, len(self.names)))()
        for i, (name, kind) in enumerate(zip(self._kept, self.formats)):
            made[i] = L.Attribute(name=name, type=_TYPES.index(kind))
        return made

    def pack(self, attributes: Mapping[str, Array], count: int) -> Optional[Array]:
        """Rows side by side without gaps."""
        if list(attributes) != self.names:
            raise InvalidArgument(
                f"attributes: expected {self.names}, found {list(attributes)}"
            )
        if not self.names:
            return None
        rows = np.empty(count, self.dtype)
        for name in self.names:
            values = np.asarray(attributes[name])
            if values.shape != (count,):
                raise InvalidArgument(
                    f"attributes[{name!r}]: expected the shape ({count},), found {values.shape}"
                )
            rows[name] = values
        return rows


class Packed:
    """Arrays as an mtdb_input. They live as long as this."""

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        attributes: Mapping[str, Array],
        origin: Any = (0.0, 0.0, 0.0),
        layout_: Optional[Layout] = None,
    ) -> None:
        vertices, faces = checked(vertices, faces)
        self.layout = layout_ or Layout.of(attributes)
        self.struct = L.Input()
        struct = self.struct
        struct.vertices, struct.triangles = len(vertices), len(faces)
        if vertices.dtype == np.float32:
            self.points = np.ascontiguousarray(vertices)
            struct.positions_float = self.points.ctypes.data
            struct.origin = triple("origin", origin)
        else:
            self.points = np.ascontiguousarray(vertices, np.float64)
            if np.any(origin):
                self.points = self.points + np.asarray(origin)
            struct.positions = self.points.ctypes.data
        if faces.dtype in (np.int32, np.uint32):
            self.corners = np.ascontiguousarray(faces)
            struct.indices = self.corners.ctypes.data
        else:
            self.corners = np.ascontiguousarray(faces, np.int64)
            struct.indices_long = self.corners.ctypes.data
        self.rows = self.layout.pack(attributes, len(vertices))
        if self.rows is not None:
            struct.rows = self.rows.ctypes.data
        self.kept = self.layout.structs()
        struct.attributes = self.kept
        struct.attribute_count = len(self.layout.names)

    def __enter__(self) -> "Packed":
        return self

    def __exit__(self, *_: Any) -> None:
        pass
