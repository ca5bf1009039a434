// SPDX-License-Identifier: Apache-2.0
// What a client's mesh is, apart from slots; and whether its parts agree. For tests.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>
#include <string>

#include "codecs/stream/client_mesh.h"
#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// A triangle as its corners' positions and rows, rotated to the smallest.
inline std::string TriangleText(const std::array<Vec3i, 3>& positions,
                                const std::array<ByteSpan, 3>& rows) {
  std::array<std::string, 3> corner;
  for (size_t c = 0; c < 3; ++c) {
    char bytes[sizeof(Vec3i)];
    std::memcpy(bytes, &positions[c], sizeof(bytes));
    corner[c] = std::string(bytes, sizeof(bytes)) + std::string(AsString(rows[c]));
  }
  return std::min({corner[0] + corner[1] + corner[2], corner[1] + corner[2] + corner[0],
                   corner[2] + corner[0] + corner[1]});
}

inline std::multiset<std::string> ClientTriangles(const ClientMesh& mesh) {
  std::multiset<std::string> set;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot)) continue;
    const auto& c = mesh.triangle(slot).corners;
    set.insert(TriangleText({mesh.position(c[0]), mesh.position(c[1]), mesh.position(c[2])},
                            {mesh.row(c[0]), mesh.row(c[1]), mesh.row(c[2])}));
  }
  return set;
}

// As a mesh without gaps, for CheckMesh.
inline TriangleMesh Compacted(const ClientMesh& mesh) {
  TriangleMesh result;
  std::vector<VertexIndex> number(mesh.vertex_slots(), ~VertexIndex{0});
  for (uint32_t v = 0; v < mesh.vertex_slots(); ++v) {
    if (!mesh.has_vertex(v)) continue;
    number[v] = result.positions.size();
    result.positions.push_back(mesh.options().grid.Position(mesh.position(v)));
  }
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot)) continue;
    const auto& c = mesh.triangle(slot).corners;
    result.triangles.push_back({number[c[0]], number[c[1]], number[c[2]]});
  }
  return result;
}

// Empty when the arrays for a GPU say what triangles and vertices say.
inline std::string DrawnFault(const ClientMesh& mesh) {
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    const uint32_t* indices = mesh.indices().data() + 3 * size_t{slot};
    const bool here = mesh.has_triangle(slot);
    if (!here && (indices[0] != 0 || indices[1] != 0 || indices[2] != 0)) {
      return "an empty slot is drawn";
    }
    for (uint32_t i = 0; here && i < 3; ++i) {
      if (indices[i] != mesh.triangle(slot).corners[i]) return "indices";
    }
  }
  for (uint32_t v = 0; v < mesh.vertex_slots(); ++v) {
    const Vec3d p = mesh.options().grid.Position(mesh.position(v)) - mesh.origin();
    for (int i = 0; i < 3; ++i) {
      const float f = mesh.positions()[3 * size_t{v} + static_cast<size_t>(i)];
      if (f != static_cast<float>(p[i])) return "float positions";
    }
  }
  return "";
}

// Empty when adjacency and counts say what the triangles say.
inline std::string MeshFault(const ClientMesh& mesh) {
  std::vector<uint32_t> degree(mesh.vertex_slots(), 0);
  uint32_t triangles = 0;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot)) continue;
    ++triangles;
    const ClientMesh::Triangle& t = mesh.triangle(slot);
    for (uint32_t i = 0; i < 3; ++i) {
      if (t.corners[i] >= mesh.vertex_slots()) return "a corner is no vertex";
      if (t.corners[i] == t.corners[(i + 1) % 3]) return "a degenerate triangle";
      ++degree[t.corners[i]];
      const uint32_t o = t.opposite[i];
      if (o == kNone32) continue;
      if (!mesh.has_triangle(o >> 2)) return "a neighbour is gone";
      const ClientMesh::Triangle& n = mesh.triangle(o >> 2);
      if (n.opposite[o & 3] != 4 * slot + i || n.corners[o & 3] != t.corners[(i + 1) % 3] ||
          n.corners[((o & 3) + 1) % 3] != t.corners[i]) {
        return "neighbours disagree";
      }
    }
  }
  uint32_t vertices = 0;
  for (uint32_t v = 0; v < mesh.vertex_slots(); ++v) {
    if (degree[v] != mesh.degree(v)) return "triangles at a vertex";
    vertices += degree[v] > 0 ? 1 : 0;
    if (degree[v] > 0 && mesh.is_remembered(v)) return "a vertex of the mesh is remembered";
  }
  if (triangles != mesh.triangle_count() || vertices != mesh.vertex_count()) return "counts";
  if (mesh.remembered().size() > mesh.options().remembered_vertices) return "memory";
  return "";
}

// Of a client's.
inline std::string ClientMeshFault(const ClientMesh& mesh) {
  const std::string fault = MeshFault(mesh);
  return fault.empty() ? DrawnFault(mesh) : fault;
}

// Of a sender's, which nobody draws.
inline std::string SenderMeshFault(const ClientMesh& mesh) {
  if (!mesh.indices().empty() || !mesh.positions().empty()) return "a sender has arrays for a GPU";
  return MeshFault(mesh);
}

}  // namespace mtdb::testing
