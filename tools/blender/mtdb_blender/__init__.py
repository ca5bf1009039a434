# SPDX-License-Identifier: Apache-2.0
"""Blender's view of an mtdb store: the smallest mesh that is fine where one looks."""
from __future__ import annotations

import importlib
import json
import os
import sys
import urllib.request
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy_extras.io_utils import ExportHelper
from mathutils import Matrix, Vector

from . import query as Q

bl_info = {
    "name": "mtdb",
    "author": "mtdb",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > mtdb",
    "description": "Shows parts of huge meshes, each as fine as it is looked at",
    "category": "Import-Export",
}

_TIMEOUT_SECONDS = 30
_open: dict[tuple[str, str], Any] = {}  # objects of stores, by source and name


class Problem(Exception):
    """A sentence for the user."""


# ---- mtdb ----------------------------------------------------------------------------------------


def _mtdb(context: bpy.types.Context) -> Any:
    addon = context.preferences.addons.get(__package__)
    if addon is not None:
        if addon.preferences.library:
            os.environ["MTDB_LIBRARY"] = bpy.path.abspath(addon.preferences.library)
        folder = bpy.path.abspath(addon.preferences.package)
        if folder and folder not in sys.path:
            sys.path.append(folder)
    try:
        return importlib.import_module("mtdb")
    except (ImportError, OSError) as error:
        raise Problem(
            f"Blender's Python has no mtdb ({error}). Install it there (pip install), or name the folder that "
            "holds the package in the add-on's preferences"
        ) from None


def _object_of(context: bpy.types.Context) -> Any:
    """The chosen object of the chosen store, opened once as long as it is the same file."""
    settings = context.scene.mtdb
    if not settings.source:
        raise Problem("Choose a store first: a file, a packed file's URL, or a server of mtdb serve")
    mtdb = _mtdb(context)
    is_url = "://" in settings.source
    path = settings.source if is_url else bpy.path.abspath(settings.source)
    key = (path, settings.object_name)
    try:
        held = _open.get(key)
        if held is None or held.digest != mtdb.open(Q.source_of(*key)).open_object(_name(key)).digest:
            held = _open[key] = mtdb.open(Q.source_of(*key)).open_object(_name(key))
        return held
    except mtdb.MtdbError as error:
        raise Problem(str(error)) from None


def _name(key: tuple[str, str]) -> Any:
    return key[1] or None


def _names(context: bpy.types.Context) -> list[str]:
    source = context.scene.mtdb.source
    catalog = Q.catalog_of(source)
    if catalog is not None:
        try:
            with urllib.request.urlopen(catalog, timeout=_TIMEOUT_SECONDS) as answer:
                return [o["object"] for o in json.load(answer)["objects"]]
        except (OSError, ValueError, KeyError) as error:
            raise Problem(f"{catalog}: no server of mtdb serve answers there ({error})") from None
    mtdb = _mtdb(context)
    try:
        return list(mtdb.open(source if "://" in source else bpy.path.abspath(source)))
    except mtdb.MtdbError as error:
        raise Problem(str(error)) from None


# ---- places --------------------------------------------------------------------------------------


def _to_store(shown: Any, point: Any) -> list[float]:
    """Where a point of the world is in the store's coordinates."""
    local = shown.matrix_world.inverted() @ Vector(point)
    return [x + o for x, o in zip(local, shown["mtdb_origin"])]


def _scale_of(shown: Any) -> float:
    scale = shown.matrix_world.to_scale()
    if max(scale) - min(scale) > 1e-4 * max(scale):
        raise Problem(f"{shown.name}: is scaled differently along its axes, where errors have no meaning")
    return float(scale[0])


def _camera_of(context: bpy.types.Context, shown: Any) -> dict[str, Any]:
    camera = context.scene.camera
    if camera is None:
        raise Problem("The scene has no camera: add one, or choose an empty as the focus")
    if camera.data.type != "PERSP":
        raise Problem(f"{camera.name}: only perspective cameras tell how large a pixel is")
    render = context.scene.render
    width = max(1, render.resolution_x * render.resolution_percentage // 100)
    height = max(1, render.resolution_y * render.resolution_percentage // 100)
    projection = camera.calc_matrix_camera(context.evaluated_depsgraph_get(), x=width, y=height)
    at = camera.matrix_world
    eye = at.translation
    ahead = eye + at.to_quaternion() @ Vector((0, 0, -1))
    above = eye + at.to_quaternion() @ Vector((0, 1, 0))
    places = [_to_store(shown, p) for p in (eye, ahead, above)]
    return {
        "eye": places[0],
        "direction": [b - a for a, b in zip(places[0], places[1])],
        "up": [b - a for a, b in zip(places[0], places[2])],
        "fov": Q.vertical_fov(projection[1][1]),
        "viewport": [width, height],
    }


def _query_of(context: bpy.types.Context, shown: Any) -> dict[str, Any]:
    settings = context.scene.mtdb
    limit = settings.max_triangles
    if settings.mode == "CAMERA":
        return Q.camera_query(_camera_of(context, shown), settings.pixels, limit, settings.clip)
    if settings.focus is None:
        raise Problem("Choose an object as the focus, an empty for example: around it the mesh is fine")
    scale = _scale_of(shown)
    place = _to_store(shown, settings.focus.matrix_world.translation)
    return Q.focus_query(
        place, settings.radius / scale, settings.error / scale, settings.fall_off, limit, settings.clip
    )


# ---- meshes --------------------------------------------------------------------------------------


def _show(context: bpy.types.Context, source: Any) -> Any:
    """Blender's object for what comes from the store: the one that is there, or a new one that stands upright."""
    settings = context.scene.mtdb
    shown = settings.shown
    if shown is not None and shown.get("mtdb_digest") == source.digest and shown.name in context.scene.objects:
        return shown
    name = settings.object_name or "mtdb"
    shown = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    shown["mtdb_digest"] = source.digest
    shown["mtdb_origin"] = [float(x) for x in source.bounds.mean(0)]
    if source.up is not None:
        turn = Vector([float(x) for x in source.up]).rotation_difference(Vector((0, 0, 1)))
        shown.matrix_world = turn.to_matrix().to_4x4()
    else:
        shown.matrix_world = Matrix.Identity(4)
    context.collection.objects.link(shown)
    context.view_layer.update()
    settings.shown = shown
    return shown


def _fill(mesh: bpy.types.Mesh, found: Any) -> None:
    """Blender's mesh becomes the one from the store."""
    import numpy as np

    mesh.clear_geometry()
    corners = np.ascontiguousarray(found.faces, np.int32).ravel()
    mesh.vertices.add(len(found.vertices))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(found.vertices, np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", corners)
    mesh.polygons.add(len(found.faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    if bpy.app.version < (4, 1, 0):
        mesh.polygons.foreach_set("loop_total", np.full(len(found.faces), 3, np.int32))
    colours = found.colours
    if colours is not None and colours.dtype == np.uint8:
        rgba = np.ones((len(colours), 4), np.float32)
        rgba[:, :3] = colours / np.float32(255)
        layer = mesh.color_attributes.new(name="Color", type="BYTE_COLOR", domain="POINT")
        layer.data.foreach_set("color_srgb", rgba.ravel())
        if not mesh.materials:
            mesh.materials.append(_coloured())
    mesh.update(calc_edges=True)
    mesh.validate()


def _coloured() -> bpy.types.Material:
    """A material that shows the vertices' colours."""
    material = bpy.data.materials.get("mtdb") or bpy.data.materials.new("mtdb")
    material.use_nodes = True
    tree = material.node_tree
    surface = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if surface is not None and not surface.inputs["Base Color"].is_linked:
        colour = tree.nodes.new("ShaderNodeVertexColor")
        colour.layer_name = "Color"
        tree.links.new(colour.outputs["Color"], surface.inputs["Base Color"])
    return material


# ---- what the user does --------------------------------------------------------------------------


class _Operator(bpy.types.Operator):
    """An operator whose problems are sentences."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.report({"INFO"}, self.work(context))
            return {"FINISHED"}
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}


class MTDB_OT_list(_Operator):
    """Look which objects the store has"""

    bl_idname = "mtdb.list"
    bl_label = "List objects"

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.mtdb
        names = _names(context)
        settings.names.clear()
        for name in names:
            settings.names.add().name = name
        if settings.object_name not in names:
            settings.object_name = names[0] if names else ""
        return f"{len(names)} objects"


class MTDB_OT_refresh(_Operator):
    """Fetch the smallest mesh that is as fine as asked for, here and now"""

    bl_idname = "mtdb.refresh"
    bl_label = "Refresh"
    bl_options = {"REGISTER", "UNDO"}

    def work(self, context: bpy.types.Context) -> str:
        mtdb = _mtdb(context)
        source = _object_of(context)
        shown = _show(context, source)
        query = _query_of(context, shown)
        try:
            found = source.extract(query, dtype="float32", origin=list(shown["mtdb_origin"]))
        except mtdb.MtdbError as error:
            raise Problem(str(error)) from None
        _fill(shown.data, found)
        shown["mtdb_error_bound"] = found.error_bound
        short = found.shortfall
        more = "" if short is None else f"; {short.triangles:,} triangles are coarser than asked for"
        return f"{len(found.faces):,} triangles, at most {found.error_bound:.6g} off there{more}"


class MTDB_OT_export_box(_Operator, ExportHelper):
    """Write the store's full resolution in the box around the selected objects to a mesh file"""

    bl_idname = "mtdb.export_box"
    bl_label = "Export box at full resolution"
    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply;*.obj;*.stl;*.off;*.glb;*.drc", options={"HIDDEN"})
    check_extension = None  # of any format that mtdb writes

    def work(self, context: bpy.types.Context) -> str:
        mtdb = _mtdb(context)
        source = _object_of(context)
        shown = context.scene.mtdb.shown
        if shown is None or shown.get("mtdb_digest") != source.digest:
            raise Problem("Refresh first: then it is known where the store's object lies in the scene")
        boxes = [o for o in context.selected_objects if o != shown]
        if not boxes:
            raise Problem("Select what marks the box, a cube for example; the mesh itself does not count")
        corners = [_to_store(shown, o.matrix_world @ Vector(c)) for o in boxes for c in o.bound_box]
        try:
            stats = source.extract_to(self.filepath, Q.box_query(corners))
        except mtdb.MtdbError as error:
            raise Problem(str(error)) from None
        return f"{self.filepath}: {stats.active_triangles:,} triangles in the box"


class MTDB_PT_panel(bpy.types.Panel):
    bl_label = "mtdb"
    bl_idname = "MTDB_PT_panel"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "mtdb"

    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.mtdb
        layout = self.layout
        layout.prop(settings, "source")
        layout.operator("mtdb.list")
        layout.prop_search(settings, "object_name", settings, "names", text="Object")
        layout.prop(settings, "mode", expand=True)
        if settings.mode == "CAMERA":
            layout.prop(settings, "pixels")
        else:
            for name in ("focus", "radius", "error", "fall_off"):
                layout.prop(settings, name)
        layout.prop(settings, "max_triangles")
        layout.prop(settings, "clip")
        layout.operator("mtdb.refresh")
        layout.operator("mtdb.export_box")


class MtdbName(bpy.types.PropertyGroup):
    name: StringProperty()


class MtdbSettings(bpy.types.PropertyGroup):
    source: StringProperty(
        name="Store",
        description="A store, a packed file or its URL, or the URL of a server of mtdb serve",
        subtype="FILE_PATH",
    )
    object_name: StringProperty(name="Object", description="In the store; empty: the only one")
    names: CollectionProperty(type=MtdbName)
    shown: PointerProperty(type=bpy.types.Object)
    mode: EnumProperty(
        name="Fine",
        items=[
            ("FOCUS", "Around a focus", "Fine around an object, an empty for example"),
            ("CAMERA", "For the camera", "As fine as the scene's camera can tell"),
        ],
    )
    focus: PointerProperty(name="Focus", type=bpy.types.Object, description="Around it the mesh is fine")
    radius: FloatProperty(
        name="Radius", description="So far around the focus the error holds", default=1, min=0, subtype="DISTANCE"
    )
    error: FloatProperty(
        name="Error", description="How far the mesh may be off there; 0: full resolution", min=0, precision=5,
        subtype="DISTANCE",
    )
    fall_off: FloatProperty(
        name="Fall-off",
        description="How much more error each unit of distance permits beyond the radius; 0: as coarse as can be",
        default=0.01, min=0, precision=4,
    )
    pixels: FloatProperty(name="Pixels", description="How many pixels the mesh may be off", default=1, min=0.01)
    max_triangles: IntProperty(
        name="Triangles", description="At most so many, with evenly more error; 0: as many as it takes", min=0,
        default=1_000_000,
    )
    clip: BoolProperty(name="Nothing else", description="Leave out what lies beyond the radius, or the picture")


class MtdbPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__
    package: StringProperty(
        name="Folder of the package", subtype="DIR_PATH",
        description="That has mtdb/__init__.py; empty: it is installed where Blender's Python finds it",
    )
    library: StringProperty(
        name="libmtdb.so", subtype="FILE_PATH", description="Empty: beside the package, or where the system looks"
    )

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.prop(self, "package")
        self.layout.prop(self, "library")


_CLASSES = (
    MtdbName, MtdbSettings, MtdbPreferences, MTDB_OT_list, MTDB_OT_refresh, MTDB_OT_export_box, MTDB_PT_panel,
)


def register() -> None:
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.mtdb = PointerProperty(type=MtdbSettings)


def unregister() -> None:
    del bpy.types.Scene.mtdb
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
    _open.clear()
