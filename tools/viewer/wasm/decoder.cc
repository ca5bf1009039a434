// SPDX-License-Identifier: Apache-2.0
// The client of an update stream for the page (src/decoder.ts): one session's mesh, with vertex
// normals, and what changed in it since the page asked last. Compiled to WebAssembly with
// codecs/client_sources.txt. One instance for each session; nothing here outlives it.
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "codecs/stream/update_stream.h"
#include "tools/viewer/wasm/slot_ranges.h"

#ifdef __wasm__
#define MTDB_EXPORT(name) __attribute__((export_name(name)))
#else
#define MTDB_EXPORT(name)
#endif

namespace mtdb {

namespace {

struct State {
  explicit State(const UpdateDecoder::Limits& limits) : decoder(limits) {}
  UpdateDecoder decoder;
  Bytes input;
  std::string error;
  std::vector<Normal> normals;  // a vertex slot
  std::vector<float> sums;      // of the normals of triangles, by area
  std::array<float, 3> stretch{1, 1, 1};
  std::array<uint32_t, 5> counts{};
  std::array<double, 3> origin{};
  // How many ranges of triangles, vertices and normals there are, then their bounds.
  std::vector<uint32_t> changes;
};
std::unique_ptr<State> state;

uint32_t AddRanges(std::span<const ClientMesh::Range> ranges, std::vector<uint32_t>* changes) {
  const size_t first = changes->size();
  for (const ClientMesh::Range& range : ranges) {
    AddSlot(range.begin, first, changes);
    changes->back() = range.end;
  }
  return static_cast<uint32_t>((changes->size() - first) / 2);
}

}  // namespace

// A new mesh, of at most so many triangles and vertices.
MTDB_EXPORT("open") extern "C" void Open(uint32_t triangles, uint32_t vertices) {
  state = std::make_unique<State>(UpdateDecoder::Limits{triangles, vertices});
}

// Positions are drawn times this; normals are those of what is drawn.
MTDB_EXPORT("stretch") extern "C" void Stretch(double x, double y, double z) {
  state->stretch = {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
}

// Where the next `size` bytes of the stream go.
MTDB_EXPORT("input") extern "C" std::byte* Input(uint32_t size) {
  state->input.resize(size);
  return state->input.data();
}

// Applies what is in the input. 0, or 1 after an error, which error() tells.
MTDB_EXPORT("feed") extern "C" uint32_t Feed() {
  const Status status = state->decoder.Feed(state->input);
  if (!status.ok()) state->error = status.message();
  return status.ok() ? 0 : 1;
}

MTDB_EXPORT("error") extern "C" const char* Error() { return state->error.c_str(); }
MTDB_EXPORT("error_size") extern "C" uint32_t ErrorSize() {
  return static_cast<uint32_t>(state->error.size());
}

// Whether there is a mesh yet.
MTDB_EXPORT("started") extern "C" uint32_t Started() { return state->decoder.started() ? 1 : 0; }

// Triangles, vertices, slots of triangles, slots of vertices, bytes of a vertex's attributes.
MTDB_EXPORT("counts") extern "C" const uint32_t* Counts() {
  const ClientMesh& mesh = state->decoder.mesh();
  state->counts = {mesh.triangle_count(), mesh.vertex_count(), mesh.triangle_slots(),
                   mesh.vertex_slots(),
                   static_cast<uint32_t>(mesh.options().attributes.row_bytes())};
  return state->counts.data();
}

MTDB_EXPORT("origin") extern "C" const double* Origin() {
  const Vec3d origin = state->decoder.mesh().origin();
  state->origin = {origin.x, origin.y, origin.z};
  return state->origin.data();
}

MTDB_EXPORT("indices") extern "C" const uint32_t* Indices() {
  return state->decoder.mesh().indices().data();
}
MTDB_EXPORT("positions") extern "C" const float* Positions() {
  return state->decoder.mesh().positions().data();
}
MTDB_EXPORT("normals") extern "C" const int16_t* Normals() {
  return reinterpret_cast<const int16_t*>(state->normals.data());
}
MTDB_EXPORT("rows") extern "C" const std::byte* Rows() {
  return state->decoder.mesh().rows().data();
}

// Brings the normals up to date; see State::changes.
MTDB_EXPORT("take_changes") extern "C" const uint32_t* TakeChanges() {
  const ClientMesh::Changes changes = state->decoder.TakeChanges();
  std::vector<uint32_t>& list = state->changes;
  list.assign(3, 0);
  const uint32_t triangles = AddRanges(changes.triangles, &list);
  const uint32_t vertices = AddRanges(changes.vertices, &list);
  const ClientMesh& mesh = state->decoder.mesh();
  SlotMarks all;
  all.MarkBelow(static_cast<uint32_t>(mesh.positions().size() / 3));
  const uint32_t normals = UpdateNormals(mesh.positions(), mesh.indices(), state->stretch, all,
                                         &state->sums, &state->normals, &list);
  list[0] = triangles;
  list[1] = vertices;
  list[2] = normals;
  return list.data();
}

}  // namespace mtdb
