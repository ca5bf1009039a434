# SPDX-License-Identifier: Apache-2.0
"""Sessions: meshes that follow queries, beside the store or at a server."""
from __future__ import annotations

import ctypes as C
import os
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any, Callable, Iterator, Mapping, Optional, Union

import numpy as np

from . import _library as L
from . import _query
from ._errors import InvalidArgument
from ._mesh import LIMITS, Array, Mesh, Shortfall, layout, shortfall_of, view
from ._work import Progress, Watched, interruptible

if TYPE_CHECKING:
    from ._database import Object


@dataclass(frozen=True)
class Update:
    """What an update did to the mesh."""

    triangles: int  #: of the whole cut
    vertices: int
    active_triangles: int
    region_missed: bool  #: nothing of the surface is in the region that was asked for
    insertions: int  #: of vertices
    removals: int
    bytes: int  #: of the update stream
    error_bound: float
    milliseconds: float
    limit: str  #: "accuracy", "triangles", "bytes", "time" or "missing"
    shortfall: Optional[Shortfall]
    #: (k, 2) uint32 each: the slots begin to end that were written, ascending; for a GPU's buffers.
    changed_faces: Array
    changed_vertices: Array


class Session:
    """A mesh in slots that are used again, as a GPU has it, which follows queries. One thread.

    `faces` and `vertices` are copies of all slots; `update(...).changed_faces` says which of them
    were written. A slot without a triangle has the face 0, 0, 0. `mesh()` has no such gaps.
    """

    def __init__(self, client: L.Handle, session: Optional[L.Handle], object_: Optional["Object"]):
        self._client: Optional[L.Handle] = client
        self._session = session
        self._object = object_
        self._stream: Optional[Callable[[bytes], None]] = None

    @classmethod
    def _local(cls, object_: "Object", remembered_vertices: int, coded_holes: bool) -> "Session":
        options = L.SessionOptions(remembered_vertices=remembered_vertices,
                                   coded_holes=coded_holes)
        session = L.Handle("session", "open_session", object_._handle, C.byref(options))
        return cls(L.Handle("client", "create_client", None), session, object_)

    def _open(self) -> L.Handle:
        if self._client is None:
            raise InvalidArgument("the session is closed")
        return self._client

    def close(self) -> None:
        """Meshes that it gave go on."""
        self._client = self._session = None

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def update(self, query: Union[str, Mapping[str, Any], None] = None, *,
               stream: Optional[Callable[[bytes], None]] = None, progress: Progress = None,
               **asked: Any) -> Update:
        """Moves to the query, which is given as in `Object.extract`, and says what changed.

        stream: also gets the bytes of the update stream, for clients elsewhere (of a session beside
        the store). progress: is called after each message (of a server's)."""
        text = _query.build(query, **asked)
        client = self._open()
        made = L.Update()
        if self._session is None:
            if stream is not None:
                raise InvalidArgument("stream: a server's session has none")
            Watched(progress).run(
                lambda watch: L.call("update_client", client, text.encode(), watch,
                                     C.byref(made))
            )
        else:
            self._move(client, text, stream, made)
        changes = L.Changes()
        L.call("take_changes", client, C.byref(changes))
        return Update(
            made.triangles, made.vertices, made.active_triangles,
            text.has_region and made.active_triangles == 0, made.insertions, made.removals,
            made.bytes, made.error_bound, made.milliseconds, LIMITS[made.limit],
            shortfall_of(made),
            view(changes.triangles, (changes.triangle_ranges, 2), "<u4", None).copy(),
            view(changes.vertices, (changes.vertex_ranges, 2), "<u4", None).copy(),
        )

    def _move(self, client: L.Handle, text: _query.Text, stream: Optional[Callable[[bytes], None]],
              made: L.Update) -> None:
        assert self._session is not None and self._object is not None
        raised: list[BaseException] = []

        def receive(_user: Any, data: Any, size: int) -> int:
            try:
                L.call("feed_client", client, data, size)
                if stream is not None:
                    stream(C.string_at(data, size))
                return 0
            except BaseException as error:  # KeyboardInterrupt, too
                raised.append(error)
                return 1

        function = L.ReceiveFunction(receive)
        query = self._object._query(text)
        try:
            with interruptible() as control:
                L.call("update_session", self._session, query, control, function, None,
                       C.byref(made))
        except Exception:
            if raised:
                raise raised[0] from None
            raise

    def _look(self) -> L.ClientView:
        look = L.ClientView()
        L.call("view_client", self._open(), C.byref(look))
        return look

    @property
    def vertices(self) -> Array:
        """(slots, 3) float32, less `origin`: a copy."""
        look = self._look()
        return view(look.positions, (look.vertex_slots, 3), "<f4", None).copy()

    @property
    def faces(self) -> Array:
        """(slots, 3) int32, vertex slots: a copy."""
        look = self._look()
        return view(look.indices, (look.triangle_slots, 3), "<i4", None).copy()

    @property
    def origin(self) -> Array:
        return np.array(self._look().origin)

    @property
    def attributes(self) -> Mapping[str, Array]:
        """(slots,) each: copies."""
        look = self._look()
        dtype = layout("get_client_attribute", self._open(), look.attributes, look.row_bytes)
        if dtype is None or dtype.names is None:
            return MappingProxyType({})
        rows = view(look.rows, (look.vertex_slots, look.row_bytes), "|u1", None)
        table = rows.view(dtype)[:, 0] if len(rows) else np.empty(0, dtype)
        return MappingProxyType({n: table[n].copy() for n in dtype.names})

    def mesh(self) -> Mesh:
        """The mesh without gaps, in float64."""
        return Mesh._of(L.Handle("mesh", "get_client_mesh", self._open()))

    def __repr__(self) -> str:
        if self._client is None:
            return "<mtdb.Session, closed>"
        look = self._look()
        return f"<mtdb.Session: {look.triangles} triangles>"


def connect(url: str, *, name: Optional[str] = None, remembered_vertices: int = 65536,
            max_triangles: int = 1 << 24, timeout_seconds: float = 600.0,
            reconnect_seconds: float = 0.0) -> Session:
    """A session at `mtdb serve`: "http://HOST:PORT/objects/NAME". Seconds for the server to answer,
    and for which an update tries to replace a lost connection."""
    options = L.ConnectOptions(
        name=None if name is None else name.encode(), remembered_vertices=remembered_vertices,
        max_triangles=max_triangles, timeout_seconds=timeout_seconds, reconnect_seconds=reconnect_seconds,
    )
    return Session(L.Handle("client", "connect", url.encode(), C.byref(options)), None, None)


def fetch(url: str, query: Union[str, Mapping[str, Any], None] = None, *,
          path: "str | os.PathLike[str]", name: Optional[str] = None, timeout_seconds: float = 600.0, **asked: Any) -> Update:
    """Gets one mesh of a server into a file, in the format of its suffix (.ply, .glb ...). The file
    appears when it is complete. `read_mesh` reads it."""
    raised: list[BaseException] = []
    options = L.FetchOptions(
        name=None if name is None else name.encode(), timeout_seconds=timeout_seconds,
        format=os.fspath(path).rsplit(".", 1)[-1].lower().encode(),
    )
    made = L.Update()
    text = _query.build(query, **asked)
    with _complete(path) as file:

        def receive(_user: Any, data: Any, size: int) -> int:
            try:
                file.write(C.string_at(data, size))
                return 0
            except BaseException as error:
                raised.append(error)
                return 1

        function = L.ReceiveFunction(receive)
        try:
            L.call("fetch", url.encode(), text.encode(), C.byref(options), function, None,
                   C.byref(made))
        except Exception:
            if raised:
                raise raised[0] from None
            raise
    none = np.empty((0, 2), np.uint32)
    return Update(made.triangles, made.vertices, made.active_triangles,
                  text.has_region and made.active_triangles == 0, 0, 0, made.bytes,
                  made.error_bound, 0.0, LIMITS[made.limit], shortfall_of(made), none,
                  none)


@contextmanager
def _complete(path: "str | os.PathLike[str]") -> Iterator[IO[bytes]]:
    """A file that appears, or replaces the one that is there, when nothing went wrong."""
    partial = f"{os.fspath(path)}.{os.getpid()}.{threading.get_ident()}.tmp"
    try:
        with open(partial, "wb") as file:
            yield file
        os.replace(partial, path)
    except BaseException:
        with suppress(OSError):
            os.remove(partial)
        raise
