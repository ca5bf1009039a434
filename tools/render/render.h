// SPDX-License-Identifier: Apache-2.0
// Pictures of meshes, ray-cast by Embree: by default flat-shaded, so that the level of detail is
// visible.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "codecs/mesh_file/draped_mesh_file.h"
#include "query/camera.h"
#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/texture_tiles.h"

namespace mtdb {

using Rgb = std::array<uint8_t, 3>;

// What a mesh's colours say.
enum class ColourBy : uint8_t {
  kOwn,        // of the texture, over those of the attributes (FindColours); else clay
  kNothing,    // clay
  kNormal,     // the normal's x, y, z from -1 to 1 as red, green, blue from 0 to 255
  kAttribute,  // RenderOptions::attribute, by ColourOfValue
  kDistance,   // of each point from RenderOptions::reference, by ColourOfValue
  kHeight,     // z by TintOfHeight, as maps have it
};

struct RenderOptions {
  int width = 1200;  // pixels, 1 .. 16384
  int height = 900;
  bool wireframe = false;
  // Normals go smoothly over triangles, but for edges of more than some 50 degrees.
  bool smooth = false;
  // One ray a pixel and light from the eye: no shadows, no soft edges, an eighth of the time.
  bool draft = false;
  // Lit as maps are: from the north-west of x and y, and less from the directions beside it, so
  // that no slope lies in the dark, whatever way it faces; with the sky's share of valleys and
  // ridges.
  bool hillshade = false;

  // What fills the picture: these points; none: the mesh. Pass the same for pictures that are
  // compared.
  std::vector<Vec3d> frame;
  // From the eye to the mesh; need not have length 1.
  Vec3d view_direction{-0.42, 0.86, -0.34};
  Vec3d up{0, 0, 1};
  // Across the shorter side. Small angles look from far away, as maps do.
  double view_angle_rad = 0.42;
  // Draws what it sees instead; its viewport, near and far do not matter.
  std::optional<Camera> camera;

  ColourBy colour = ColourBy::kOwn;
  // Of the object that the mesh is of; null: no texture is drawn.
  std::shared_ptr<const TextureTiles> texture;
  std::string attribute;
  const TriangleMesh* reference = nullptr;
  // The values with the first and the last colour; none: the least and the largest of the mesh, or
  // of the picture's distances, from 0 on.
  std::optional<std::array<double, 2>> range;

  // kHeight: what the mesh's z was multiplied by, so that legends and the range have heights.
  double height_scale = 1;
  std::string height_units;

  // An image over the mesh, seen along z, where it lies; beside it, and where the image is
  // transparent, the colours above. Not with colours that stand for values but heights.
  std::optional<MeshTexture> drape;

  std::optional<Rgb> background;  // none: a dark gradient
  bool transparent = false;       // no background: the image has alpha

  bool legend = true;      // of colours that stand for values
  bool scale_bar = false;  // a round length, at the depth of the middle of the frame or mesh
};

// A box as the frame of a picture.
std::vector<Vec3d> CornersOf(const Box3d& box);

struct RenderImage {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;    // rows from the top, 3 * width * height bytes
  std::vector<uint8_t> alpha;  // width * height bytes, or empty: all opaque
  // Of the colours, where they stand for values.
  std::optional<std::array<double, 2>> range;
};

// Draws `mesh` under a soft key light, a sky and ambient occlusion. Sides that face away from the
// viewer are drawn too, bluish, unless colours stand for values; of coincident faces one that faces
// the viewer is seen. With `wireframe`, triangle edges are lines of one pixel, which fade where
// triangles are hardly larger than that. Deterministic. Uses all cores. Memory: some 100 bytes a
// triangle, also of the reference. Errors: kInvalidArgument (no triangles, a triangle without its
// vertices, a bad size or view, no such attribute), those of the draped image's file (kBadInput,
// kUnsupported) and of the texture's tiles, kNoSpace when Embree runs out of memory.
Status RenderMesh(const TriangleMesh& mesh, const RenderOptions& options, RenderImage* image);

// The colour of a value in pictures and legends, at `t` of the range, 0 .. 1.
Rgb ColourOfValue(double t);

// Hypsometric tints: the colour of a height at `t` of the range, 0 .. 1, from green lowlands over
// browns to white.
Rgb TintOfHeight(double t);

// Writes `image` to `path`, which appears when it is complete. Errors: kIoError, kNoSpace.
Status WritePng(const std::string& path, const RenderImage& image);
// As JPEG, of quality 92. kInvalidArgument for an image with alpha, which JPEG has not.
Status WriteJpeg(const std::string& path, const RenderImage& image);
// Either, by the suffix of `path`.
Status WritePicture(const std::string& path, const RenderImage& image);
// kInvalidArgument for a name that ends neither in .png nor in .jpg or .jpeg.
Status CheckPictureName(const std::string& path);

}  // namespace mtdb
