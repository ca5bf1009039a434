# SPDX-License-Identifier: Apache-2.0
"""Stores and their objects."""
from __future__ import annotations

import ctypes as C
import inspect
import json
import os
import threading
import warnings
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Callable, Iterable, Iterator, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _library as L
from . import _query, _terrain
from ._errors import InvalidArgument, NotFound, RegionMissed
from ._mesh import (
    LIMITS,
    Array,
    ExtractStats,
    Layout,
    Mesh,
    Packed,
    Saved,
    checked,
    shortfall_of,
    triple,
    up_vector,
)
from ._query import Text as QueryText
from ._session import Session
from ._terrain import HeightGrid, Profile
from ._work import Progress, Watched, interruptible, probe_options

#: vertices, faces, and attributes of the vertices. Either may be empty; a face may name a vertex that
#: comes later. Vertices are numbered through all chunks.
Chunk = Union[
    Tuple[npt.ArrayLike, npt.ArrayLike],
    Tuple[npt.ArrayLike, npt.ArrayLike, Mapping[str, npt.ArrayLike]],
]
LEVELS = ("fast", "full", "global")
# An array is handed over in parts of so many rows.
_PART = 1 << 18


@dataclass(frozen=True)
class Hit:
    """Where a probe met the surface."""

    point: Array  #: (3,)
    distance: float  #: of the point from that of the probe, or from the ray's origin
    parameter: float  #: ray: the t of origin + t * direction; closest point: 0
    front: bool  #: the probe comes from outside
    triangle: Array  #: (3, 3): its corners
    error_bound: float
    excess: float  #: what error_bound has above the error that was asked for


class Object:
    """A surface of a store, at every level of detail, with its cache of decoded clusters. Threads
    may share one."""

    def __init__(self, database: L.Handle, name: Optional[str], cache_bytes: int, threads: int,
                 implicit: bool) -> None:
        options = L.ObjectOptions(cache_bytes=cache_bytes, threads=threads, form=int(implicit))
        self._handle = L.Handle(
            "object", "open_object", database,
            None if name is None else name.encode(), C.byref(options),
        )
        self._info = L.Info()
        L.call("get_object_info", self._handle, C.byref(self._info))
        text: bytes = L.ask("get_object_name", self._handle)
        #: Its name when it was opened.
        self.name = text.decode()

    @property
    def triangles(self) -> int:
        """At full resolution."""
        return int(self._info.triangles)

    @property
    def vertices(self) -> int:
        return int(self._info.vertices)

    @property
    def bounds(self) -> Array:
        """(2, 3): smallest and largest corner."""
        return np.array([list(self._info.bounds_min), list(self._info.bounds_max)])

    @property
    def rounding_error(self) -> float:
        """No vertex of the input is farther than this from where it is stored."""
        return float(self._info.rounding_error)

    @property
    def up(self) -> Optional[Array]:
        """What is up, of length 1; None of objects that an older program stored."""
        up = self.info.get("up")
        return None if up is None else np.array(up)

    @property
    def units(self) -> str:
        """Of lengths, as ingest was told: "mm", "m" ...; empty: not said."""
        return str(self.info["units"])

    @property
    def error_max(self) -> float:
        """Of the coarsest mesh."""
        return float(self._info.error_max)

    @property
    def info(self) -> dict[str, Any]:
        """All that is known of it, as `mtdb info --json` prints it: digest, grid, rounds ..."""
        made: dict[str, Any] = L.json_of("get_object_json", self._handle)
        return made

    def read_page(self, page: int) -> bytes:
        """The image file of a page of its texture, as it came; empty when the store has none. What
        pages there are, and of which type: `info["texture"]["pages"]`."""
        parts: list[bytes] = []
        raised: list[BaseException] = []

        def receive(_user: Any, address: int, size: int) -> int:
            try:
                parts.append(C.string_at(address, size))
                return 0
            except BaseException as error:  # no memory, Ctrl-C
                raised.append(error)
                return 1

        try:
            L.call("read_page", self._handle, page, L.ReceiveFunction(receive), None)
        except Exception:
            if raised:
                raise raised[0] from None
            raise
        return b"".join(parts)

    @property
    def digest(self) -> str:
        """32 hexadecimal digits over content; equal for equal meshes that were ingested alike."""
        return str(self.info["digest"])

    def extract(
        self,
        query: Union[str, Mapping[str, Any], None] = None,
        *,
        box: Optional[npt.ArrayLike] = None,
        sphere: Optional[Sequence[float]] = None,
        region: _query.Json = None,
        camera: Optional[Mapping[str, Any]] = None,
        error: Optional[float] = None,
        relative: Optional[float] = None,
        pixels: Optional[float] = None,
        threshold: _query.Json = None,
        max_triangles: Optional[int] = None,
        max_bytes: Optional[int] = None,
        max_milliseconds: Optional[float] = None,
        clip: bool = False,
        normals: bool = False,
        dtype: npt.DTypeLike = np.float64,
        origin: Optional[Sequence[float]] = None,
    ) -> Mesh:
        """The smallest mesh that satisfies the query; without arguments, full resolution.

        Where: `box` (2, 3) smallest and largest corner; `sphere` x, y, z, radius; `region` as in
        docs/query.md; `camera` {"eye", "target", "up", "fov" in degrees, "viewport"}: what it sees.
        Elsewhere the mesh is as coarse as can be, or left out with `clip`.
        How accurate: `error` in units, `relative` to the diagonal, `pixels` of the camera (1 when
        there is nothing else), `threshold` as in docs/query.md.
        How much: `max_triangles`, `max_bytes`, `max_milliseconds`; the largest errors are refined first.
        `query`: all of that as a dict or a JSON text instead.
        dtype: float32 gives vertices less `origin` (the bounds' centre, or the given one).
        """
        text = _query.build(
            query, box=box, sphere=sphere, region=region, camera=camera, error=error,
            relative=relative, pixels=pixels, threshold=threshold, max_triangles=max_triangles,
            max_bytes=max_bytes, max_milliseconds=max_milliseconds, clip=clip, normals=normals,
        )
        base = self._origin(dtype, origin)
        with interruptible() as control:
            cut = self._select(text, control)
            mesh = Mesh._of(L.Handle("mesh", "get_cut_mesh", cut, base))
        mesh.stats, stats = self._stats(text, cut)
        mesh.error_bound, mesh.shortfall = stats.error_bound, shortfall_of(stats)
        return mesh

    def extract_to(self, path: "str | os.PathLike[str]",
                   query: Union[str, Mapping[str, Any], None] = None, *, double_positions: bool = False,
                   **asked: Any) -> ExtractStats:
        """Writes what `extract` would return to a mesh file, without holding it in memory; with
        `normals`, .off has them. double_positions: .ply has float64 positions, also where float32 is enough.
        `file` of the answer tells what became of the mesh."""
        text = _query.build(query, **asked)
        normals = bool(json.loads(text).get("normals")) if text else False
        with interruptible() as control:
            cut = self._select(text, control)
            file = Saved._of("write_cut", cut, path, normals, double_positions)
        return replace(self._stats(text, cut)[0], file=file)

    def _origin(self, dtype: npt.DTypeLike, origin: Optional[Sequence[float]]) -> Any:
        kind = np.dtype(dtype)
        if kind == np.float64:
            if origin is not None:
                raise InvalidArgument("origin: goes with dtype=float32")
            return None
        if kind != np.float32:
            raise InvalidArgument(f"dtype: expected float64 or float32, found {kind}")
        return triple("origin", self.bounds.mean(0) if origin is None else origin)

    def _query(self, text: QueryText) -> L.Handle:
        try:
            return L.Handle("query", "create_query", self._handle, text.encode())
        except InvalidArgument as error:
            raise InvalidArgument(text.in_python(error.message)) from None

    def _select(self, text: QueryText, control: L.Handle) -> L.Handle:
        return L.Handle("cut", "select", self._handle, self._query(text), control)

    def _stats(self, text: QueryText, cut: L.Handle) -> tuple[ExtractStats, L.Stats]:
        """Warns, for the caller of its caller, where the region is missed."""
        stats = L.Stats()
        L.call("get_cut_stats", cut, C.byref(stats))
        made = ExtractStats(
            LIMITS[stats.limit], stats.active_triangles, stats.nodes_applied,
            stats.clusters_read, stats.clusters_cached, stats.clusters_used,
            stats.clusters_total, stats.bytes_read, stats.select_seconds,
            stats.load_seconds, stats.emit_seconds,
            region_missed=text.has_region and stats.active_triangles == 0,
        )
        if made.region_missed:
            low, high = self.bounds.tolist()
            what = "the mesh is as coarse as it goes" if stats.triangles else "the mesh is empty"
            warnings.warn(f"nothing of {self.name} is in the region, so {what}; it lies within "
                          f"{low} and {high}", RegionMissed, stacklevel=3)
        return made, stats

    def closest_point(self, point: Sequence[float], *, error: Optional[float] = None,
                      limit: float = np.inf) -> Optional[Hit]:
        """The point of the surface that is closest to `point`, at full resolution or on a surface
        within `error`; None when nothing is within `limit`."""
        return self._probe("find_closest_point", triple("point", point), limit, error=error)

    def cast_ray(self, origin: Sequence[float], direction: Sequence[float], *,
                 error: Optional[float] = None, limit: float = np.inf) -> Optional[Hit]:
        """The first hit of the ray at 0 <= t <= limit; None when there is none."""
        return self._probe("cast_ray", triple("origin", origin), triple("direction", direction),
                           limit, error=error)

    def _probe(self, function: str, *place: Any, error: Optional[float]) -> Optional[Hit]:
        hit = L.Hit()
        with interruptible() as control:
            L.call(function, self._handle, *place, C.byref(probe_options(error, control)),
                   C.byref(hit))
        if not hit.found:
            return None
        return Hit(np.array(hit.point), hit.distance, hit.parameter, bool(hit.front),
                   np.array(hit.triangle).reshape(3, 3), hit.error_bound, hit.excess)

    def heights(self, window: Optional[Sequence[float]] = None,
                spacing: Union[float, Sequence[float], None] = None, *,
                error: Optional[float] = None) -> HeightGrid:
        """The heights of a terrain on a grid: the samples of its raster, or others, `spacing` apart
        (one number, or x and y), in `window` (least x, y, largest x, y); exact, or within `error`
        in units of height."""
        return _terrain.heights(self, window, spacing, error)

    def heights_at(self, points: npt.ArrayLike, *,
                   error: Optional[float] = None) -> npt.NDArray[np.float64]:
        """The heights of a terrain at points (n, 2): (n,) float64, NaN where there is none."""
        return _terrain.heights_at(self, points, error)

    def profile(self, line: npt.ArrayLike, *, error: Optional[float] = None) -> Profile:
        """The heights of a terrain along the line through corners (n, 2)."""
        return _terrain.profile(self, line, error)

    def verify(self, level: str = "fast") -> list[str]:
        """What is wrong, a line each; nothing when the list is empty. fast: pages and checksums of
        the file; full: also decodes every cluster; global: also rebuilds the whole surface and
        compares it with what was ingested."""
        if level not in LEVELS:
            raise InvalidArgument(f"level: expected one of {LEVELS}, found {level!r}")
        with interruptible() as control:
            return L.texts("verify", self._handle, LEVELS.index(level), control)

    def session(self, remembered_vertices: int = 65536, coded_holes: bool = False) -> Session:
        """A mesh that follows queries, of which only what changes is computed. `coded_holes`: of
        terrains, what Session.stream's clients get has triangles, too, so that they need not
        compute them."""
        return Session._local(self, remembered_vertices, coded_holes)

    def render(self, size: tuple[int, int] = (1200, 900), **asked: Any) -> npt.NDArray[np.uint8]:
        """Draws what `extract` would return: (height, width, 3) uint8. A camera is looked through;
        a region or accuracy goes along as in `extract`. Without: a mesh that is right to a pixel or
        so. How it is drawn (wireframe, smooth, view, colour, ...) goes along as in `Mesh.render`;
        terrains are drawn as maps."""
        style = {key: asked.pop(key) for key in _STYLES if key in asked}
        if "raster" in self.info and "colour" not in style:
            style = {"hillshade": True, "colour": "height", "up": (0, 0, 1), **style}
        camera = asked.get("camera")
        if camera is not None:
            asked["camera"] = {**camera, "viewport": list(size)}
        elif not asked:
            asked["relative"] = 0.5 / max(size)
        return self.extract(**asked).render(size, camera=camera, **style)

    def __repr__(self) -> str:
        return f"<mtdb.Object {self.name!r}: {self.triangles} triangles>"

    def _repr_html_(self) -> str:
        mesh = self.extract(relative=0.002, max_triangles=200_000)
        return f"<b>{self.name}</b>: {self.triangles:,} triangles" + mesh._repr_html_()


# What Mesh.render takes beside the camera.
_STYLES = tuple(name for name, parameter in inspect.signature(Mesh.render).parameters.items()
                if parameter.kind == inspect.Parameter.KEYWORD_ONLY and name != "camera")


class Database(Mapping[str, Object]):
    """A store or a packed file: a mapping of names to objects. Threads may share one; to write, it
    opens the store when the first change is asked for."""

    def __init__(self, path: "str | os.PathLike[str]", *, create: bool = False,
                 cache_bytes: int = 0, threads: int = 0,
                 cache_directory: "str | os.PathLike[str] | None" = None,
                 cache_directory_bytes: int = 4 << 30) -> None:
        self.path = os.fspath(path)
        self._cache_bytes, self._threads = cache_bytes, threads
        self._cache = (None if cache_directory is None else L.path_bytes(cache_directory), cache_directory_bytes)
        self._lock = threading.RLock()
        self._writer: Optional[L.Handle] = None
        self._reader: Optional[L.Handle] = None
        self._objects: dict[str, Object] = {}
        if create and not os.path.exists(self.path):
            self._writer = self._open_writable()
        self._reader = self._open()

    def _open(self) -> L.Handle:
        directory, size = self._cache
        options = L.OpenOptions(cache_directory=directory, cache_directory_bytes=size)
        return L.Handle("database", "open_abi", L.ABI_VERSION, L.path_bytes(self.path),
                        C.byref(options))

    def _open_writable(self) -> L.Handle:
        return L.Handle("database", "open_writable_abi", L.ABI_VERSION, L.path_bytes(self.path))

    def _read(self) -> L.Handle:
        if self._reader is None:
            raise InvalidArgument(f"{L.shown(self.path)}: the database is closed")
        return self._reader

    def _write(self) -> L.Handle:
        with self._lock:
            self._read()
            if self._writer is None:
                self._writer = self._open_writable()
            return self._writer

    def close(self) -> None:
        """Lets the file go. Meshes, and objects that somebody still has, go on."""
        with self._lock:
            self._reader = self._writer = None
            self._objects.clear()

    def __enter__(self) -> "Database":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], value: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()

    def _names(self) -> list[str]:
        return L.texts("list_objects", self._read())

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __getitem__(self, name: str) -> Object:
        if name not in self._names():
            raise NotFound(f"{L.shown(self.path)}: no object {name!r}; it has {self._names()}")
        with self._lock:
            if name not in self._objects:
                self._objects[name] = self.open_object(name)
            return self._objects[name]

    def open_object(self, name: Optional[str] = None, *, cache_bytes: Optional[int] = None,
                    threads: Optional[int] = None, implicit: bool = False) -> Object:
        """Opens an object anew, with a cache of its own; without a name, the only one. implicit: the
        cache keeps clusters as in the store, some 15 times smaller, and every query decodes."""
        return Object(self._read(), name,
                      self._cache_bytes if cache_bytes is None else cache_bytes,
                      self._threads if threads is None else threads, implicit)

    def _forget(self, name: str) -> None:
        with self._lock:
            self._objects.pop(name, None)

    def __delitem__(self, name: str) -> None:
        L.call("remove_object", self._write(), name.encode())
        self._forget(name)

    def rename(self, name: str, new_name: str) -> None:
        L.call("rename_object", self._write(), name.encode(), new_name.encode())
        self._forget(name)

    def ingest(
        self,
        vertices: Union[npt.ArrayLike, Mesh, Iterable[Chunk], str, "os.PathLike[str]"],
        faces: Optional[npt.ArrayLike] = None,
        *,
        name: str,
        attributes: Optional[Mapping[str, npt.ArrayLike]] = None,
        replace: bool = False,
        lossless: bool = False,
        bits: Optional[int] = None,
        step: Optional[float] = None,
        weld: Union[float, bool, None] = None,
        orient: bool = False,
        normal_bits: Optional[int] = None,
        attribute_steps: Optional[Mapping[str, float]] = None,
        memory_bytes: int = 1 << 30,
        threads: int = 0,
        tmp_directory: Optional[str] = None,
        max_tmp_bytes: Optional[int] = None,
        journal_path: Optional[str] = None,
        resume: bool = False,
        height_step: Optional[float] = None,
        fill: int = 0,
        terrain: bool = False,
        up: Union[str, Sequence[float], None] = None,
        units: Optional[str] = None,
        progress: Progress = None,
    ) -> Object:
        """Stores a mesh at every level of detail.

        vertices (n, 3) and faces (m, 3): arrays; or instead of both a `Mesh`, the path of a mesh
        file or of a raster of heights, a list of paths of rasters that adjoin, or an iterable of chunks (vertices, faces) or (vertices, faces, attributes), of which
        one is in memory at a time: the ingest is out of core.
        attributes: by name, (n,) each; names as in PLY ("red", "nx"), or anything.
        lossless: float32 positions bit for bit; else they are rounded to a grid that suits the mesh,
        of `bits`, or of multiples of `step`. weld: joins vertices within that distance,
        0 or True those of equal positions; without, those of equal positions and attributes where
        the mesh was cut along edges; False keeps all as they are.
        orient: turns triangles over where those of a sheet disagree about the outside, as few as possible.
        normal_bits, attribute_steps: what rounds normals and attributes. memory_bytes: at most so many bytes.
        terrain: the mesh is a height field, z above x and y: errors are differences in height.
        height_step: heights of rasters are rounded to its multiples (without: as in
        `ingest_heights`). fill: holes of rasters of up to
        so many columns and rows are closed.
        max_tmp_bytes: temporary files and the journal take at most so many bytes of the disk.
        up: what is up for who draws it: "x", "-y" ..., or a vector; else it is found from the shape.
        units: of lengths, "um", "mm", "cm", "m", "km", "in" or "ft"; kept, and changes no number.
        journal_path, resume: a file by which an ingest that was killed goes on.
        progress: True for a bar by tqdm, or a function of (stage, 0..1); False from it stops.
        """
        Ingest(name, replace=replace, lossless=lossless, bits=bits, step=step, weld=weld, orient=orient,
               normal_bits=normal_bits, attribute_steps=attribute_steps, memory_bytes=memory_bytes,
               threads=threads, tmp_directory=tmp_directory, journal_path=journal_path,
               resume=resume, height_step=height_step, fill=fill, terrain=terrain,
               max_tmp_bytes=max_tmp_bytes, up=up, units=units).run(
            self._write(), vertices, faces, attributes, Watched(progress))
        self._forget(name)
        return self[name]

    def ingest_heights(
        self,
        heights: npt.ArrayLike,
        *,
        name: str,
        geotransform: Optional[Sequence[float]] = None,
        height_step: Optional[float] = None,
        crs: Optional[str] = None,
        height_units: Optional[str] = None,
        fill: int = 0,
        replace: bool = False,
        memory_bytes: int = 1 << 30,
        threads: int = 0,
        tmp_directory: Optional[str] = None,
        max_tmp_bytes: Optional[int] = None,
        progress: Progress = None,
    ) -> Object:
        """Stores heights (rows, columns) as a terrain; NaN: a hole. Errors are vertical then.

        geotransform: (x0, dx, 0, y0, 0, dy) gives the sample of row 0 and column 0, and the steps to
        the next column and row, in the order of GDAL; without, x is the column
        and y minus the row.
        height_step: heights are rounded to its multiples; without, integers and decimals stay as they are,
        and other heights are rounded so that it is small beside their range and differences. crs: of x and y. height_units: of
        heights. fill and the rest: as in `ingest`.
        """
        given, kept = _terrain.height_array(heights, geotransform, crs, height_units)
        Ingest(name, replace=replace, memory_bytes=memory_bytes, threads=threads,
               tmp_directory=tmp_directory, height_step=height_step, fill=fill,
               max_tmp_bytes=max_tmp_bytes).run_heights(self._write(), given, Watched(progress))
        del kept  # the struct pointed to it
        self._forget(name)
        return self[name]

    def copy(self, path: "str | os.PathLike[str]", *, progress: Progress = None) -> "Database":
        """A new store at `path` with all objects as they are at one moment."""
        Watched(progress).run(
            lambda watch: L.call("copy_store", self._read(), L.path_bytes(path), watch)
        )
        return Database(path)

    def copy_from(self, source: Object, name: Optional[str] = None, *, replace: bool = False,
                  progress: Progress = None) -> Object:
        """Copies an object of another store or packed file: the same bytes, the same digest."""
        new = source.name if name is None else name
        Watched(progress).run(
            lambda watch: L.call("copy_object", source._handle, self._write(),
                                 new.encode(), int(replace), watch)
        )
        self._forget(new)
        return self[new]

    def compact(self, *, progress: Progress = None) -> tuple[int, int]:
        """Gives back the space that no object uses. Returns the file's bytes before and after.
        Objects and databases of the file that are still in use here, once it was written to, make
        it `Busy`."""
        sizes = L.Sizes()
        with self._lock:
            self._read()
            self._reader = self._writer = None
            self._objects.clear()
            try:
                Watched(progress).run(
                    lambda watch: L.call("compact_store", L.path_bytes(self.path), watch,
                                         C.byref(sizes))
                )
            finally:
                self._reader = self._open()
        return sizes.bytes_before, sizes.bytes_after

    def pack(self, path: "str | os.PathLike[str]", names: Optional[Sequence[str]] = None, *,
             progress: Progress = None) -> int:
        """One file of the objects for any web server (docs/packed.md). Returns its bytes."""
        array, count = _names(names)
        sizes = L.Sizes()
        Watched(progress).run(
            lambda watch: L.call("pack", self._read(), array, count,
                                 L.path_bytes(path), watch, C.byref(sizes))
        )
        return int(sizes.bytes_after)

    def unpack(self, path: "str | os.PathLike[str]", names: Optional[Sequence[str]] = None, *,
               replace: bool = False, progress: Progress = None) -> "Database":
        """Copies objects of a packed file into the store at `path`, which is made when it is not
        there."""
        array, count = _names(names)
        Watched(progress).run(
            lambda watch: L.call("unpack", self._read(), array, count, L.path_bytes(path),
                                 int(replace), watch)
        )
        return Database(path)

    def verify(self, level: str = "fast") -> dict[str, list[str]]:
        """What is wrong, by object; nothing when it is empty."""
        found = {name: self[name].verify(level) for name in self}
        return {name: failures for name, failures in found.items() if failures}

    def serve(self, *, address: str = "127.0.0.1", port: int = 0, threads: int = 0,
              allowed_origin: Optional[str] = None) -> "Server":
        """Serves the store over HTTP in threads of its own, until the server is closed."""
        self._read()
        return Server(self.path, address=address, port=port, threads=threads,
                      allowed_origin=allowed_origin, cache=self._cache)

    def __repr__(self) -> str:
        if self._reader is None:
            return f"<mtdb.Database {L.shown(self.path)!r}, closed>"
        return f"<mtdb.Database {L.shown(self.path)!r}: {len(self)} objects>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{o.name}</td><td>{o.triangles:,}</td></tr>" for o in self.values()
        )
        return f"<table><tr><th>object</th><th>triangles</th></tr>{rows}</table>"


def _names(names: Optional[Sequence[str]]) -> tuple[Any, int]:
    """As C takes them; none: all."""
    chosen = [] if names is None else [L.without_zero(n.encode()) for n in names]
    if names is not None and not chosen:
        raise InvalidArgument("names: is empty")
    return (L.Text * max(1, len(chosen)))(*chosen), len(chosen)


class Ingest:
    """One ingest: its options, and the callback that hands chunks over."""

    def __init__(self, name: str, *, attribute_steps: Optional[Mapping[str, float]] = None,
                 bits: Optional[int] = None, step: Optional[float] = None,
                 weld: Union[float, bool, None] = None, orient: bool = False,
                 normal_bits: Optional[int] = None, replace: bool, lossless: bool = False, memory_bytes: int, threads: int,
                 tmp_directory: Optional[str], journal_path: Optional[str] = None,
                 resume: bool = False, height_step: Optional[float], fill: int,
                 terrain: bool = False, max_tmp_bytes: Optional[int],
                 up: Union[str, Sequence[float], None] = None,
                 units: Optional[str] = None) -> None:
        self._name = name.encode()
        listed = [(n.encode(), float(s)) for n, s in (attribute_steps or {}).items()]
        self._steps = (L.AttributeStep * max(1, len(listed)))(
            *(L.AttributeStep(name=n, step=s) for n, s in listed)
        )
        for key, value in (("bits", bits), ("step", step), ("normal_bits", normal_bits),
                           ("height_step", height_step), ("max_tmp_bytes", max_tmp_bytes)):
            if value is not None and value <= 0:
                raise InvalidArgument(f"{key}: expected a number above 0, found {value}")
        if not 0 <= fill < 1 << 32:
            raise InvalidArgument(f"fill: expected a number of columns and rows, found {fill}")
        self._options = L.IngestOptions(
            replace=int(replace), lossless=int(lossless), bits=bits or 0, step=step or 0.0,
            weld=0 if weld is None else -1 if weld is False else 1,
            orient=int(orient),
            weld_distance=0.0 if weld is None or isinstance(weld, bool) else weld, normal_bits=normal_bits or 0,
            attribute_steps=self._steps, attribute_step_count=len(listed), threads=threads, memory_bytes=memory_bytes,
            tmp_directory=None if tmp_directory is None else L.path_bytes(tmp_directory),
            journal_path=None if journal_path is None else L.path_bytes(journal_path), resume=int(resume),
            height_step=height_step or 0.0, fill=fill, terrain=int(terrain),
            max_tmp_bytes=max_tmp_bytes or 0,
            up=(C.c_double * 3)(*up_vector(up)), units=None if units is None else units.encode(),
        )

    def run(self, database: L.Handle, vertices: Any, faces: Any,
            attributes: Optional[Mapping[str, npt.ArrayLike]], watched: Watched) -> None:
        if isinstance(vertices, (str, os.PathLike)):
            path = L.path_bytes(vertices)
            watched.run(lambda watch: L.call("ingest_file", database, self._name, path,
                                             C.byref(self._options), watch))
            return
        if isinstance(vertices, (list, tuple)) and vertices and all(
                isinstance(v, (str, os.PathLike)) for v in vertices):
            paths = (L.Text * len(vertices))(*(L.path_bytes(v) for v in vertices))
            watched.run(lambda watch: L.call("ingest_rasters", database, self._name, paths,
                                             len(vertices), C.byref(self._options), watch))
            return
        origin: Any = (0.0, 0.0, 0.0)
        if isinstance(vertices, Mesh):
            mesh = vertices
            attributes = mesh.attributes if attributes is None else attributes
            vertices, faces, origin = mesh.vertices, mesh.faces, mesh.origin
        chunks: Iterator[_Arrays]
        if faces is None:
            chunks = (_chunk(c) for c in vertices)
        else:
            chunks = _parts(_chunk((vertices, faces, attributes or {})))
        self._ingest(database, chunks, origin, watched)

    def run_heights(self, database: L.Handle, array: L.HeightArray, watched: Watched) -> None:
        watched.run(lambda watch: L.call("ingest_heights", database, self._name, C.byref(array),
                                         C.byref(self._options), watch))

    def _ingest(self, database: L.Handle, chunks: Iterator[_Arrays], origin: Any,
                watched: Watched) -> None:
        try:
            first = next(chunks)
        except StopIteration:
            raise InvalidArgument("vertices: there is no chunk") from None
        layout = Layout.of(first[2])
        structs = layout.structs()

        def all_parts() -> Iterator[_Arrays]:
            yield first
            yield from chunks

        def produce(_user: Any, ingest: Any) -> int:
            try:
                for points, corners, values in all_parts():
                    with Packed(points, corners, values, origin, layout) as part:
                        L.call("ingest_part", ingest, C.byref(part.struct))
                return 0
            except BaseException as error:  # KeyboardInterrupt, too
                watched.keep(error)
                return 1

        function = L.ProduceFunction(produce)
        source = L.Source(
            produce=function, attributes=structs, attribute_count=len(layout.names),
            double_positions=int(first[0].dtype != np.float32 or bool(np.any(origin))),
        )
        watched.run(lambda watch: L.call("ingest_source", database, self._name,
                                         C.byref(source), C.byref(self._options), watch))


_Arrays = Tuple[Array, Array, Mapping[str, Array]]


def _chunk(chunk: Any) -> _Arrays:
    if not isinstance(chunk, (tuple, list)) or len(chunk) not in (2, 3):
        raise InvalidArgument("expected chunks (vertices, faces) or (vertices, faces, attributes)")
    points = np.asarray(chunk[0])
    corners = np.asarray(chunk[1])
    if corners.size == 0:
        corners = corners.reshape(0, 3).astype(np.int32)
    if points.size == 0:
        points = points.reshape(0, 3)
    points, corners = checked(points, corners)
    values = {n: np.asarray(a) for n, a in (chunk[2] if len(chunk) == 3 else {}).items()}
    for name, array in values.items():
        if array.shape != (len(points),):
            raise InvalidArgument(
                f"attributes[{name!r}]: expected the shape ({len(points)},), found {array.shape}"
            )
    return points, corners, values


def _parts(whole: _Arrays) -> Iterator[_Arrays]:
    """Views, so that conversions take little memory at a time."""
    points, corners, values = whole
    for at in range(0, max(len(points), len(corners), 1), _PART):
        rows = slice(at, at + _PART)
        yield points[rows], corners[rows], {n: a[rows] for n, a in values.items()}


class Server:
    """`mtdb serve` in this process. Close it, or use it as a context."""

    def __init__(self, path: str, *, address: str = "127.0.0.1", port: int = 0, threads: int = 0,
                 allowed_origin: Optional[str] = None,
                 cache: tuple[Optional[bytes], int] = (None, 0)) -> None:
        options = L.ServeOptions(
            address=address.encode(), port=port, threads=threads,
            allowed_origin=None if allowed_origin is None else allowed_origin.encode(),
            cache_directory=cache[0], cache_directory_bytes=cache[1],
        )
        self._handle: Optional[L.Handle] = L.Handle(
            "server", "serve", L.path_bytes(path), C.byref(options)
        )
        url: bytes = L.ask("get_server_url", self._handle)
        #: "http://127.0.0.1:8080"
        self.url = url.decode()

    def close(self, grace_seconds: float = 1.0) -> None:
        """Lets running requests finish for so long, cancels the rest, and waits."""
        handle, self._handle = self._handle, None
        if handle is not None:
            L.call("stop_server", handle, grace_seconds)

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def open_database(path: "str | os.PathLike[str]", *, create: bool = False, cache_bytes: int = 0,
                  threads: int = 0, cache_directory: "str | os.PathLike[str] | None" = None,
                  cache_directory_bytes: int = 4 << 30) -> Database:
    """Opens a store, a packed file, or the URL of one (http, https, s3).

    create: makes the store when it is not there. cache_bytes: of decoded clusters, for each object
    (0: 256 MiB). threads: that read and decode for one query (0: as many as the machine has).
    cache_directory: what is read of a URL is kept in this folder, which databases and processes may
    share, at most cache_directory_bytes of it.
    """
    return Database(path, create=create, cache_bytes=cache_bytes, threads=threads,
                    cache_directory=cache_directory, cache_directory_bytes=cache_directory_bytes)
