# SPDX-License-Identifier: Apache-2.0
"""Runs in Blender (test_blender.py): installs the add-on, uses it as a user does, and writes down what
there is then, as JSON."""
from __future__ import annotations

import json
import sys
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

archive, package, library, store, server, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.preferences.addon_install(filepath=archive)
bpy.ops.preferences.addon_enable(module="mtdb_blender")
preferences = bpy.context.preferences.addons["mtdb_blender"].preferences
preferences.package, preferences.library = package, library
settings = bpy.context.scene.mtdb
told: dict[str, Any] = {}


def refused(operator: Any, **arguments: Any) -> str:
    try:
        operator(**arguments)
    except RuntimeError as error:
        return str(error)
    raise AssertionError("was not refused")


def state() -> dict[str, Any]:
    mesh = settings.shown.data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    colours = mesh.color_attributes.get("Color")
    rgba = np.empty(4 * len(mesh.vertices), np.float32)
    if colours is not None:
        colours.data.foreach_get("color_srgb", rgba)
    return {
        "name": settings.shown.name, "mesh": mesh.name, "vertices": len(mesh.vertices), "faces": len(mesh.polygons),
        "sides": sorted({p.loop_total for p in mesh.polygons}),
        "points": points.tolist(), "colours": None if colours is None else np.round(rgba * 255).tolist(),
        "origin": list(settings.shown["mtdb_origin"]), "bound": settings.shown["mtdb_error_bound"],
        "matrix": [list(row) for row in settings.shown.matrix_world],
    }


told["no_store"] = refused(bpy.ops.mtdb.refresh)
settings.source = store + ".not"
told["no_file"] = refused(bpy.ops.mtdb.list)
settings.source = store
bpy.ops.mtdb.list()
told["names"] = [n.name for n in settings.names]
settings.object_name = "hills"
settings.max_triangles = 0
told["no_focus"] = refused(bpy.ops.mtdb.refresh)

focus = bpy.data.objects.new("focus", None)
bpy.context.collection.objects.link(focus)
settings.focus = focus
settings.radius, settings.error, settings.fall_off = 5, 0, 0.02
# The object is where it was put when the focus was missing; the empty stands at the store's (20, 30, 0).
origin = Vector(settings.shown["mtdb_origin"])
focus.location = Vector((20, 30, 0)) - origin
bpy.context.view_layer.update()
bpy.ops.mtdb.refresh()
told["focus"] = state()

# The same place, the object turned, moved and of twice the size: the same mesh.
turned = Matrix.Translation((7, 8, 9)) @ Euler((0.3, 0.2, 1)).to_matrix().to_4x4() @ Matrix.Scale(2, 4)
settings.shown.matrix_world = turned
focus.matrix_world = Matrix.Translation(turned @ (Vector((20, 30, 0)) - origin))
settings.radius = 10
settings.fall_off = 0.02
bpy.context.view_layer.update()
bpy.ops.mtdb.refresh()
told["turned"] = state()
settings.shown.scale = (2, 2, 3)
bpy.context.view_layer.update()
told["stretched"] = refused(bpy.ops.mtdb.refresh)
settings.shown.matrix_world = Matrix.Identity(4)
focus.matrix_world = Matrix.Translation(Vector((20, 30, 0)) - origin)
bpy.context.view_layer.update()

settings.radius, settings.error, settings.fall_off, settings.clip = 5, 0.25, 0, True
bpy.ops.mtdb.refresh()
told["clipped"] = state()
settings.clip = False
settings.max_triangles = 500
bpy.ops.mtdb.refresh()
told["limited"] = state()
settings.max_triangles = 0

told["no_camera"] = ""
bpy.context.scene.camera = None
settings.mode = "CAMERA"
told["no_camera"] = refused(bpy.ops.mtdb.refresh)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
bpy.context.collection.objects.link(camera)
bpy.context.scene.camera = camera
camera.location = Vector((10, -20, 30)) - origin
camera.rotation_euler = (0.9, 0, 0)
camera.data.angle = 0.7
render = bpy.context.scene.render
render.resolution_x, render.resolution_y, render.resolution_percentage = 640, 480, 50
settings.pixels = 2
bpy.context.view_layer.update()
bpy.ops.mtdb.refresh()
told["camera"] = state()
camera.data.type = "ORTHO"
told["orthographic"] = refused(bpy.ops.mtdb.refresh)
camera.data.type = "PERSP"

for each in bpy.context.scene.objects:
    each.select_set(False)
told["nothing_selected"] = refused(bpy.ops.mtdb.export_box, filepath=out + "/box.ply")
bpy.ops.mesh.primitive_cube_add(size=2)
cube = bpy.context.object
cube.location = Vector((25, 25, 0)) - origin
cube.scale = (4, 3, 30)
bpy.context.view_layer.update()
bpy.ops.mtdb.export_box(filepath=out + "/box.ply")

# A server, and an object without colours.
settings.source = server
bpy.ops.mtdb.list()
told["served"] = [n.name for n in settings.names]
settings.object_name = "small"
settings.mode = "FOCUS"
settings.radius, settings.error, settings.fall_off = 1000, 0, 0
bpy.ops.mtdb.refresh()
told["small"] = state()
settings.source = server.rsplit(":", 1)[0] + ":1"
told["no_server"] = refused(bpy.ops.mtdb.list)
bpy.ops.preferences.addon_disable(module="mtdb_blender")

with open(out + "/told.json", "w", encoding="utf-8") as file:
    json.dump(told, file)
