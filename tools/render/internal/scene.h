// SPDX-License-Identifier: Apache-2.0
// What is drawn: a mesh as float32 in Embree's hands, and rays through it.
#pragma once

#include <cmath>
#include <cstdint>
#include <embree3/rtcore.h>
#include <memory>
#include <optional>
#include <type_traits>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

inline Vec3f ToFloat(Vec3d v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}
inline float Norm(Vec3f v) { return std::sqrt(Dot(v, v)); }
inline Vec3f Unit(Vec3f v) {
  const float n = Norm(v);
  return n > 0 ? v * (1 / n) : Vec3f{0, 0, 1};
}

// Embree's handles.
struct DeviceRelease {
  void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
};
struct SceneRelease {
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};

// From the model's coordinates to those of the scene: float32 around the origin, of unit size, so
// that no digits are lost to coordinates far from the origin.
struct SceneFrame {
  Vec3d centre;
  double scale = 1;
  Vec3d FromModel(Vec3d p) const { return (p - centre) * scale; }
};

// Where a ray meets a triangle.
struct Hit {
  uint32_t triangle = 0;
  float u = 0, v = 0;  // barycentric coordinates of corners 1 and 2
  float distance = 0;
};

// Triangles for rays. Load first. Then safe for many threads.
class Scene {
 public:
  // Errors as of RenderMesh. Without a `frame` it fits itself to the mesh.
  Status Load(const TriangleMesh& mesh, const std::optional<SceneFrame>& frame = std::nullopt);
  // Finds the normals that Normal() has.
  void FindNormals();

  const SceneFrame& frame() const { return frame_; }
  // Calls `visit` with every corner of every triangle.
  template <typename Visit>
  void ForEachCorner(Visit visit) const {
    for (const uint32_t v : triangles_) {
      visit(Vec3d{vertices_[v].x, vertices_[v].y, vertices_[v].z});
    }
  }
  // Calls `visit` with the number of every corner of every triangle.
  template <typename Visit>
  void ForEachVertex(Visit visit) const {
    for (const uint32_t v : triangles_) visit(v);
  }
  uint32_t VertexOf(uint32_t triangle, size_t corner) const {
    return triangles_[size_t{triangle} * 3 + corner];
  }
  Vec3f Vertex(uint32_t triangle, size_t corner) const {
    return vertices_[VertexOf(triangle, corner)];
  }
  Vec3f FaceNormal(uint32_t triangle) const;
  // At a corner, when FindNormals was called: that of the face, where the surface has an edge.
  Vec3f CornerNormal(uint32_t triangle, size_t corner, Vec3f face) const;

  // Of faces that coincide there, one that faces the origin, then the first.
  std::optional<Hit> FirstHit(Vec3f from, Vec3f direction) const;
  bool Occluded(Vec3f from, Vec3f direction, float reach) const;
  // In the scene's units.
  double DistanceTo(Vec3f point) const;

 private:
  Status Build(const TriangleMesh& mesh);

  SceneFrame frame_;
  std::vector<Vec3f> vertices_;  // and one more: Embree reads 16 bytes at a vertex
  std::vector<uint32_t> triangles_;
  std::vector<Vec3f> normals_;  // of vertices
  std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceRelease> device_;
  std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneRelease> scene_;
};

}  // namespace mtdb::internal
