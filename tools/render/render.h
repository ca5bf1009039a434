// Pictures of meshes: flat-shaded, so that the level of detail is visible, ray-cast by Embree.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "query/camera.h"
#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

struct RenderOptions {
  int width = 1200;  // pixels, 1 .. 16384
  int height = 900;
  bool wireframe = false;
  // What fills the picture; default: the mesh. Pass the same box for pictures that are compared.
  std::optional<Box3d> frame;
  // From the eye to the mesh; need not have length 1. z points up.
  Vec3d view_direction{-0.42, 0.86, -0.34};
  // Draws what it sees instead; its viewport, near and far do not matter.
  std::optional<Camera> camera;
};

struct RenderImage {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;  // rows from the top, 3 * width * height bytes
};

// Draws `mesh` under a soft key light, a sky and ambient occlusion. Vertex attributes "red",
// "green", "blue" of type uint8 colour it. Sides that face away from the viewer are drawn too, a
// little bluish. With `wireframe`, triangle edges are lines of one pixel, which fade where
// triangles are hardly larger than that. Deterministic. Uses all cores. Memory: some 100 bytes a
// triangle. Errors: kInvalidArgument (no triangles, a triangle without its vertices, a bad size or
// view), kNoSpace when Embree runs out of memory.
Status RenderMesh(const TriangleMesh& mesh, const RenderOptions& options, RenderImage* image);

// Writes `image` to `path`, which appears when it is complete. Errors: kIoError, kNoSpace.
Status WritePng(const std::string& path, const RenderImage& image);

}  // namespace mtdb
