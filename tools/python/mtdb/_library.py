# SPDX-License-Identifier: Apache-2.0
"""libmtdb.so by ctypes: tools/c/mtdb*.h word by word, and nothing more."""
from __future__ import annotations

import ctypes as C
import json
import os
from typing import Any

from ._errors import InvalidArgument, make_error

Pointer = C.c_void_p
Text = C.c_char_p

ABI_VERSION = 1


class Error(C.Structure):
    _fields_ = [("message", C.c_char * 1024)]


def without_zero(text: bytes) -> bytes:
    """C would take what comes before a zero byte for the whole."""
    if b"\0" in text:
        raise InvalidArgument(f"{text!r}: a name or path cannot hold a zero byte")
    return text


class Struct(C.Structure):
    """Refuses what C would cut: numbers that a member has no room for, and zero bytes in texts."""

    def __init__(self, *members: Any, **named: Any) -> None:
        super().__init__(*members, **named)
        for name, value in [*zip((field[0] for field in self._fields_), members), *named.items()]:
            held = getattr(self, name)
            if isinstance(value, bytes):
                without_zero(value)
            elif isinstance(held, int) and hasattr(value, "__index__") and held != value:
                raise InvalidArgument(f"{name}: {value} is out of range")


class Sized(Struct):
    """A struct that begins with its size, which is set here."""

    def __init__(self, **members: Any) -> None:
        super().__init__(C.sizeof(type(self)), **members)


class OpenOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("cache_directory", Text),
        ("cache_directory_bytes", C.c_uint64),
    ]


class ObjectOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("cache_bytes", C.c_uint64),
        ("threads", C.c_uint32),
        ("form", C.c_int),
    ]


class Info(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("vertices", C.c_uint64),
        ("triangles", C.c_uint64),
        ("root_triangles", C.c_uint64),
        ("clusters", C.c_uint64),
        ("bounds_min", C.c_double * 3),
        ("bounds_max", C.c_double * 3),
        ("rounding_error", C.c_double),
        ("error_max", C.c_double),
        ("attributes", C.c_uint32),
        ("row_bytes", C.c_uint32),
    ]


class Attribute(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("name", Text),
        ("type", C.c_int),
        ("offset", C.c_uint32),
    ]


class Stats(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("vertices", C.c_uint64),
        ("triangles", C.c_uint64),
        ("error_bound", C.c_double),
        ("limit", C.c_int),
        ("row_bytes", C.c_uint32),
        ("active_triangles", C.c_uint64),
        ("nodes_applied", C.c_uint64),
        ("nodes_visited", C.c_uint64),
        ("nodes_forced", C.c_uint64),
        ("clusters_read", C.c_uint64),
        ("clusters_cached", C.c_uint64),
        ("clusters_used", C.c_uint64),
        ("clusters_total", C.c_uint64),
        ("bytes_read", C.c_uint64),
        ("select_seconds", C.c_double),
        ("load_seconds", C.c_double),
        ("read_seconds", C.c_double),
        ("decode_seconds", C.c_double),
        ("emit_seconds", C.c_double),
        ("shortfall_triangles", C.c_uint64),
        ("shortfall_excess", C.c_double),
        ("shortfall_bounds_min", C.c_double * 3),
        ("shortfall_bounds_max", C.c_double * 3),
    ]


class ProbeOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("error", C.c_double),
        ("control", Pointer),
    ]


class CompareOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("has_tolerance", C.c_int),
        ("tolerance", C.c_double),
        ("width", C.c_double),
        ("reach", C.c_double),
        ("has_max_milliseconds", C.c_int),
        ("max_milliseconds", C.c_double),
        ("query", Pointer),
        ("transform", Pointer),
        ("asks", C.c_int),
        ("as_stored", C.c_int),
        ("threads", C.c_uint32),
        ("control", Pointer),
    ]


class HeightChangeOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("has_tolerance", C.c_int),
        ("tolerance", C.c_double),
        ("has_width", C.c_int),
        ("width", C.c_double),
        ("has_max_milliseconds", C.c_int),
        ("max_milliseconds", C.c_double),
        ("window", Pointer),
        ("as_stored", C.c_int),
        ("threads", C.c_uint32),
        ("control", Pointer),
    ]


class Hit(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("found", C.c_int),
        ("front", C.c_int),
        ("point", C.c_double * 3),
        ("distance", C.c_double),
        ("parameter", C.c_double),
        ("triangle", C.c_double * 9),
        ("error_bound", C.c_double),
        ("excess", C.c_double),
    ]


class FileOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("normals", C.c_int),
        ("double_positions", C.c_int),
    ]


class MeshView(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("vertices", C.c_uint64),
        ("triangles", C.c_uint64),
        ("positions", Pointer),
        ("positions_float", Pointer),
        ("origin", C.c_double * 3),
        ("indices", Pointer),
        ("rows", Pointer),
        ("row_bytes", C.c_uint32),
        ("attributes", C.c_uint32),
        ("corners", Pointer),
        ("pages", Pointer),
    ]


ProgressFunction = C.CFUNCTYPE(C.c_int, Pointer, Text, C.c_double)
ProduceFunction = C.CFUNCTYPE(C.c_int, Pointer, Pointer)
ReceiveFunction = C.CFUNCTYPE(C.c_int, Pointer, Pointer, C.c_size_t)


class Watch(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("user", Pointer),
        ("progress", ProgressFunction),
        ("control", Pointer),
    ]


class AttributeStep(Sized):
    _fields_ = [("struct_bytes", C.c_size_t), ("name", Text), ("step", C.c_double)]


class IngestOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("replace", C.c_int),
        ("lossless", C.c_int),
        ("bits", C.c_uint32),
        ("step", C.c_double),
        ("weld", C.c_int),
        ("weld_distance", C.c_double),
        ("normal_bits", C.c_uint32),
        ("attribute_steps", C.POINTER(AttributeStep)),
        ("attribute_step_count", C.c_size_t),
        ("threads", C.c_uint32),
        ("memory_bytes", C.c_uint64),
        ("tmp_directory", Text),
        ("journal_path", Text),
        ("resume", C.c_int),
        ("height_step", C.c_double),
        ("terrain", C.c_int),
        ("fill", C.c_uint32),
        ("max_tmp_bytes", C.c_uint64),
        ("up", C.c_double * 3),
        ("units", Text),
        ("orient", C.c_int),
    ]


class Input(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("vertices", C.c_uint64),
        ("triangles", C.c_uint64),
        ("positions", Pointer),
        ("positions_float", Pointer),
        ("origin", C.c_double * 3),
        ("indices", Pointer),
        ("indices_long", Pointer),
        ("rows", Pointer),
        ("attributes", C.POINTER(Attribute)),
        ("attribute_count", C.c_size_t),
    ]


class Source(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("user", Pointer),
        ("produce", ProduceFunction),
        ("attributes", C.POINTER(Attribute)),
        ("attribute_count", C.c_size_t),
        ("double_positions", C.c_int),
    ]


class Sizes(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("bytes_before", C.c_uint64),
        ("bytes_after", C.c_uint64),
        ("first_bytes", C.c_uint64),
    ]


class Update(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("triangles", C.c_uint64),
        ("vertices", C.c_uint64),
        ("active_triangles", C.c_uint64),
        ("insertions", C.c_uint64),
        ("removals", C.c_uint64),
        ("bytes", C.c_uint64),
        ("error_bound", C.c_double),
        ("milliseconds", C.c_double),
        ("limit", C.c_int),
        ("shortfall_triangles", C.c_uint64),
        ("shortfall_excess", C.c_double),
        ("shortfall_bounds_min", C.c_double * 3),
        ("shortfall_bounds_max", C.c_double * 3),
    ]


class SessionOptions(Sized):
    _fields_ = [("struct_bytes", C.c_size_t), ("remembered_vertices", C.c_uint32),
                ("coded_holes", C.c_uint32)]


class ConnectOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("name", Text),
        ("remembered_vertices", C.c_uint32),
        ("max_triangles", C.c_uint32),
        ("timeout_seconds", C.c_double),
        ("reconnect_seconds", C.c_double),
    ]


class FetchOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("name", Text),
        ("format", Text),
        ("timeout_seconds", C.c_double),
    ]


class ClientView(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("triangle_slots", C.c_uint64),
        ("vertex_slots", C.c_uint64),
        ("triangles", C.c_uint64),
        ("vertices", C.c_uint64),
        ("indices", Pointer),
        ("positions", Pointer),
        ("origin", C.c_double * 3),
        ("rows", Pointer),
        ("row_bytes", C.c_uint32),
        ("attributes", C.c_uint32),
    ]


class Changes(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("triangles", Pointer),
        ("triangle_ranges", C.c_size_t),
        ("vertices", Pointer),
        ("vertex_ranges", C.c_size_t),
    ]


class HeightArray(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("columns", C.c_uint32),
        ("rows", C.c_uint32),
        ("heights", Pointer),
        ("geotransform", C.c_double * 6),
        ("crs", Text),
        ("height_units", Text),
    ]


class HeightCost(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("error_bound", C.c_double),
        ("clusters_read", C.c_uint64),
        ("bytes_read", C.c_uint64),
    ]


class Raster(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("x0", C.c_double),
        ("y0", C.c_double),
        ("dx", C.c_double),
        ("dy", C.c_double),
        ("columns", C.c_uint32),
        ("rows", C.c_uint32),
    ]


class RenderOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("width", C.c_uint32),
        ("height", C.c_uint32),
        ("wireframe", C.c_int),
        ("smooth", C.c_int),
        ("hillshade", C.c_int),
        ("draft", C.c_int),
        ("has_frame", C.c_int),
        ("frame_min", C.c_double * 3),
        ("frame_max", C.c_double * 3),
        ("view_direction", C.c_double * 3),
        ("view", Text),
        ("up", C.c_double * 3),
        ("has_camera", C.c_int),
        ("eye", C.c_double * 3),
        ("target", C.c_double * 3),
        ("fov", C.c_double),
        ("colour", C.c_int),
        ("attribute", Text),
        ("reference", Pointer),
        ("height_scale", C.c_double),
        ("height_units", Text),
        ("has_range", C.c_int),
        ("range", C.c_double * 2),
        ("no_legend", C.c_int),
        ("scale_bar", C.c_int),
        ("has_background", C.c_int),
        ("background", C.c_ubyte * 3),
        ("transparent", C.c_int),
    ]


class ServeOptions(Sized):
    _fields_ = [
        ("struct_bytes", C.c_size_t),
        ("address", Text),
        ("port", C.c_uint32),
        ("threads", C.c_uint32),
        ("cache_bytes", C.c_uint64),
        ("max_triangles", C.c_uint64),
        ("allowed_origin", Text),
        ("cache_directory", Text),
        ("cache_directory_bytes", C.c_uint64),
    ]


def _load() -> C.CDLL:
    """$MTDB_LIBRARY; else the library beside this file, as wheels have it; else the system's."""
    chosen = os.environ.get("MTDB_LIBRARY")
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "libmtdb.so")
    path = chosen or (beside if os.path.exists(beside) else "libmtdb.so.0")
    try:
        return C.CDLL(path)
    except OSError as error:
        raise ImportError(
            f"{path}: cannot be loaded: {error}; install libmtdb0, or say in MTDB_LIBRARY where "
            "libmtdb.so is"
        ) from error


library = _load()

_p = Pointer
_double3 = C.POINTER(C.c_double)
# Functions that return an mtdb_code and take an mtdb_error at last: what they take before it.
_SIGNATURES: dict[str, list[Any]] = {
    "open_abi": [C.c_uint32, Text, _p, _p],
    "open_writable_abi": [C.c_uint32, Text, _p],
    "list_objects": [_p, _p],
    "open_object": [_p, Text, _p, _p],
    "get_object_info": [_p, _p],
    "get_object_attribute": [_p, C.c_uint32, _p],
    "get_object_json": [_p, _p],
    "read_page": [_p, C.c_uint32, ReceiveFunction, _p],
    "verify": [_p, C.c_int, _p, _p],
    "create_query": [_p, Text, _p],
    "create_control": [_p],
    "select": [_p, _p, _p, _p],
    "get_cut_stats": [_p, _p],
    "get_cut_mesh": [_p, _p, _p],
    "write_cut": [_p, Text, _p, _p],
    "view_mesh": [_p, _p],
    "get_mesh_attribute": [_p, C.c_uint32, _p],
    "read_mesh": [Text, _p],
    "write_mesh": [_p, Text, _p, _p],
    "create_mesh": [_p, _p],
    "find_closest_point": [_p, _p, C.c_double, _p, _p],
    "compare": [_p, _p, _p, _p],
    "cast_ray": [_p, _p, _p, C.c_double, _p, _p],
    "ingest_source": [_p, Text, _p, _p, _p],
    "ingest_part": [_p, _p],
    "ingest_file": [_p, Text, Text, _p, _p],
    "ingest_rasters": [_p, Text, C.POINTER(Text), C.c_size_t, _p, _p],
    "ingest_heights": [_p, Text, _p, _p, _p],
    "find_heights": [_p, _p, C.c_size_t, _p, _p, _p],
    "get_raster": [_p, _p, _p, _p],
    "sample_heights": [_p, _p, _p, _p, C.c_size_t, _p],
    "compare_heights": [_p, _p, _p, _p],
    "find_profile": [_p, _p, C.c_size_t, _p, _p, _p],
    "remove_object": [_p, Text],
    "rename_object": [_p, Text, Text],
    "copy_object": [_p, _p, Text, C.c_int, _p],
    "copy_store": [_p, Text, _p],
    "compact_store": [Text, _p, _p],
    "hide_secrets": [Text, _p, C.c_size_t],
    "pack": [_p, _p, C.c_size_t, Text, _p, _p],
    "unpack": [_p, _p, C.c_size_t, Text, C.c_int, _p],
    "open_session": [_p, _p, _p],
    "update_session": [_p, _p, _p, ReceiveFunction, _p, _p],
    "create_client": [_p, _p],
    "feed_client": [_p, _p, C.c_size_t],
    "connect": [Text, _p, _p],
    "update_client": [_p, Text, _p, _p],
    "view_client": [_p, _p],
    "get_client_attribute": [_p, C.c_uint32, _p],
    "take_changes": [_p, _p],
    "get_client_mesh": [_p, _p],
    "fetch": [Text, Text, _p, ReceiveFunction, _p, _p],
    "render": [_p, _p, _p, C.c_size_t],
    "serve": [Text, _p, _p],
    "stop_server": [_p, C.c_double],
}
_OTHERS: dict[str, tuple[Any, list[Any]]] = {
    "get_abi_version": (C.c_uint32, []),
    "get_version": (Text, []),
    "count_texts": (C.c_size_t, [_p]),
    "get_text": (Text, [_p, C.c_size_t]),
    "get_json_text": (Text, [_p]),
    "get_object_name": (Text, [_p]),
    "cancel": (None, [_p]),
    "get_server_url": (Text, [_p]),
    "count_profile_points": (C.c_size_t, [_p]),
    "get_profile_points": (_p, [_p]),
}
for _kind in "database texts json object query control cut mesh session client server profile".split():
    _OTHERS["free_" + _kind] = (None, [_p])


def _functions_of(loaded: C.CDLL) -> dict[str, Any]:
    """What the package calls. ImportError where the library is of another version."""
    found: dict[str, Any] = {}
    signatures: dict[str, tuple[Any, list[Any]]] = {
        name: (C.c_int, arguments + [_p]) for name, arguments in _SIGNATURES.items()
    }
    for name, (result, arguments) in {**_OTHERS, **signatures}.items():
        try:
            function = getattr(loaded, "mtdb_" + name)
        except AttributeError as error:
            raise ImportError(
                f"{loaded._name}: is not the libmtdb of this package: it has no mtdb_{name}; "
                "install libmtdb0 and python3-mtdb of one version"
            ) from error
        function.restype, function.argtypes = result, arguments
        found[name] = function
    return found


_functions = _functions_of(library)
if _functions["get_abi_version"]() != ABI_VERSION:
    raise ImportError(
        f"{library._name}: this package is for libmtdb of the ABI version {ABI_VERSION}, but the "
        f"library's is {_functions['abi_version']()}"
    )


def version() -> str:
    """The version of the library."""
    text: bytes = _functions["get_version"]()
    return text.decode()


def call(name: str, *arguments: Any) -> None:
    """Calls a function that can fail; its error becomes an exception. The GIL is released."""
    for argument in arguments:
        if isinstance(argument, bytes):
            without_zero(argument)
    error = Error()
    code = _functions[name](*arguments, C.byref(error))
    if code:
        raise make_error(code, error.message.decode("utf-8", "replace"))


def shown(path: "str | os.PathLike[str]") -> str:
    """A path or a URL as messages show it: without passwords and signatures."""
    text = path_bytes(path)
    room = C.create_string_buffer(2 * len(text) + 64)
    call("hide_secrets", text, room, len(room))
    return os.fsdecode(room.value)


def ask(name: str, *arguments: Any) -> Any:
    """Calls a function that cannot fail."""
    return _functions[name](*arguments)


class Handle:
    """A handle of the library, freed when nothing refers to it any more."""

    __slots__ = ("value", "_free", "__weakref__")

    def __init__(self, kind: str, make: str, *before: Any, after: tuple[Any, ...] = ()) -> None:
        self._free: Any = None
        self.value = Pointer()
        call(make, *before, C.byref(self.value), *after)
        self._free = _functions["free_" + kind]

    def __del__(self) -> None:
        free, self._free = self._free, None
        if free is not None:
            free(self.value)

    @property
    def _as_parameter_(self) -> C.c_void_p:
        return self.value


def texts(make: str, *before: Any) -> list[str]:
    """The texts that a function makes."""
    made = Handle("texts", make, *before)
    count: int = ask("count_texts", made.value)
    return [ask("get_text", made.value, i).decode() for i in range(count)]


def json_of(make: str, *before: Any) -> Any:
    """The JSON that a function makes."""
    made = Handle("json", make, *before)
    return json.loads(ask("get_json_text", made))


def path_bytes(path: str | os.PathLike[str]) -> bytes:
    return os.fsencode(path)
