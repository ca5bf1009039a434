// SPDX-License-Identifier: Apache-2.0
// Meshes in memory and in files.
#include "tools/c/internal/mesh.h"

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/attribute_layout.h"
#include "tools/c/internal/handles.h"
#include "tools/request/mesh_output.h"

namespace mtdb::internal {

namespace {

static_assert(TextureCorner::kNoPage == MTDB_NO_PAGE);
constexpr size_t kBlock = size_t{1} << 16;

// Fills a mesh whose size is known.
class MeshFiller final : public MeshSink {
 public:
  explicit MeshFiller(std::unique_ptr<mtdb_mesh>* mesh, const double* origin)
      : mesh_(*mesh), origin_(origin) {}

  Status Begin(const MeshHeader& header) override {
    MTDB_ASSIGN_OR_RETURN(mesh_, MakeMesh(header, origin_));
    row_bytes_ = header.attributes.row_bytes();
    return Status::Ok();
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    if (double* to = mesh_->positions.get()) {
      std::memcpy(to + 3 * vertex_, positions.data(), positions.size_bytes());
    } else {
      float* out = mesh_->positions_float.get() + 3 * vertex_;
      for (const Vec3d& p : positions) {
        for (int c = 0; c < 3; ++c) *out++ = static_cast<float>(p[c] - mesh_->origin[c]);
      }
    }
    if (!rows.empty()) {
      std::memcpy(mesh_->rows.get() + vertex_ * row_bytes_, rows.data(), rows.size());
    }
    vertex_ += positions.size();
    return Status::Ok();
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    for (const TriangleVertices& t : triangles) {
      for (const VertexIndex v : t) mesh_->indices.get()[index_++] = static_cast<uint32_t>(v);
    }
    return Status::Ok();
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    for (size_t i = 0; i < corners.size(); ++i) {
      mesh_->corners.get()[2 * corner_] = corners[i].u;
      mesh_->corners.get()[2 * corner_ + 1] = corners[i].v;
      if (corner_ % 3 == 0) mesh_->pages.get()[corner_ / 3] = corners[i].page;
      ++corner_;
    }
    return Status::Ok();
  }
  Status End() override { return Status::Ok(); }

 private:
  std::unique_ptr<mtdb_mesh>& mesh_;
  const double* const origin_;
  size_t row_bytes_ = 0;
  uint64_t vertex_ = 0;
  uint64_t index_ = 0;
  uint64_t corner_ = 0;
};

// Reads a part's positions as doubles, block after block.
Status SendVertices(const mtdb_input& part, size_t row_bytes, MeshSink& sink) {
  std::vector<Vec3d> block;
  for (uint64_t at = 0; at < part.vertices; at += kBlock) {
    const auto count = static_cast<size_t>(std::min<uint64_t>(kBlock, part.vertices - at));
    block.resize(count);
    for (size_t i = 0; i < count; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        const uint64_t from = 3 * (at + i) + c;
        block[i][static_cast<int>(c)] = part.positions != nullptr
                                            ? part.positions[from]
                                            : part.origin[c] + double{part.positions_float[from]};
      }
    }
    const auto* rows = reinterpret_cast<const std::byte*>(part.rows);
    MTDB_RETURN_IF_ERROR(sink.AddVertices(
        block, row_bytes == 0 ? ByteSpan() : ByteSpan(rows + at * row_bytes, count * row_bytes)));
  }
  return Status::Ok();
}

Status SendTriangles(const mtdb_input& part, MeshSink& sink) {
  std::vector<TriangleVertices> block;
  for (uint64_t at = 0; at < part.triangles; at += kBlock) {
    const auto count = static_cast<size_t>(std::min<uint64_t>(kBlock, part.triangles - at));
    block.resize(count);
    for (size_t i = 0; i < count; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        const uint64_t from = 3 * (at + i) + c;
        block[i][c] = part.indices != nullptr ? part.indices[from] : part.indices_long[from];
      }
    }
    MTDB_RETURN_IF_ERROR(sink.AddTriangles(block));
  }
  return Status::Ok();
}

// Whether some position is no float32 value.
bool NeedsDouble(const mtdb_input& input) {
  if (input.positions == nullptr) {
    return input.origin[0] != 0 || input.origin[1] != 0 || input.origin[2] != 0;
  }
  return std::any_of(input.positions, input.positions + 3 * input.vertices,
                     [](double p) { return double{static_cast<float>(p)} != p; });
}

// What of an mtdb_input makes no sense.
Status CheckInput(const mtdb_input& input, size_t row_bytes) {
  constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max() / 1024;
  if (input.vertices > kMost || input.triangles > kMost) {
    return InvalidArgument("input: more vertices or triangles than memory has bytes");
  }
  if (input.vertices > 0 && (input.positions == nullptr) == (input.positions_float == nullptr)) {
    return InvalidArgument("input.positions: give either positions or positions_float");
  }
  if (input.triangles > 0 && (input.indices == nullptr) == (input.indices_long == nullptr)) {
    return InvalidArgument("input.indices: give either indices or indices_long");
  }
  if (input.vertices > 0 && row_bytes > 0 && input.rows == nullptr) {
    return InvalidArgument("input.rows: is NULL, but there are attributes");
  }
  return NeedFinite(ToVec(input.origin), "input.origin");
}

}  // namespace

Result<std::unique_ptr<mtdb_mesh>> MakeMesh(const MeshHeader& header, const double* origin) {
  if (!header.vertex_count || !header.triangle_count) {
    return InvalidArgument("the counts of the mesh are not known");
  }
  if (*header.vertex_count > uint64_t{1} << 32) {
    return InvalidArgument("32-bit indices cannot number " + std::to_string(*header.vertex_count) +
                           " vertices; take the mesh in blocks (mtdb_emit_cut)");
  }
  auto mesh = std::make_unique<mtdb_mesh>();
  mesh->position_step = header.position_step;
  mesh->attributes = header.attributes;
  mesh->vertices = *header.vertex_count;
  mesh->triangles = *header.triangle_count;
  if (origin == nullptr) {
    mesh->positions.Resize(3 * mesh->vertices);
  } else {
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(origin), "origin"));
    std::copy(origin, origin + 3, mesh->origin);
    mesh->positions_float.Resize(3 * mesh->vertices);
  }
  mesh->indices.Resize(3 * mesh->triangles);
  mesh->rows.Resize(mesh->vertices * header.attributes.row_bytes());
  if (header.textured) {
    mesh->corners.Resize(6 * mesh->triangles);
    mesh->pages.Resize(mesh->triangles);
  }
  return mesh;
}

Result<AttributeLayout> LayoutOf(const mtdb_attribute* attributes, size_t count) {
  AttributeLayout layout;
  if (count > kMaxAttributes) {
    return InvalidArgument("attributes: " + std::to_string(count) + " are more than " +
                           std::to_string(kMaxAttributes));
  }
  MTDB_ASSIGN_OR_RETURN(const std::vector<mtdb_attribute> all,
                        TakeAll(attributes, count, "attributes"));
  for (size_t i = 0; i < count; ++i) {
    const std::string where = "attributes[" + std::to_string(i) + "]";
    const int type = all[i].type;
    if (all[i].name == nullptr || all[i].name[0] == '\0') {
      return InvalidArgument(where + ": has no name");
    }
    if (type < MTDB_INT8 || type > MTDB_FLOAT64) {
      return InvalidArgument(where + ".type: expected an mtdb_scalar, found " +
                             std::to_string(type));
    }
    VertexAttribute attribute;
    attribute.name = all[i].name;
    attribute.type = static_cast<ScalarType>(type);
    for (const VertexAttribute& other : layout.attributes) {
      if (other.name == attribute.name) return InvalidArgument(where + ": the name is given twice");
    }
    layout.attributes.push_back(std::move(attribute));
  }
  if (const std::string fault = AttributeNamesFault(layout); !fault.empty()) {
    return InvalidArgument("attributes: " + fault);
  }
  return layout;
}

Status SendPart(const mtdb_input& part, size_t row_bytes, MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckInput(part, row_bytes));
  MTDB_RETURN_IF_ERROR(SendVertices(part, row_bytes, sink));
  return SendTriangles(part, sink);
}

Status SendInput(const mtdb_input& input, const AttributeLayout& layout, MeshSink& sink) {
  return SendInput(input, layout, 0, sink);
}

Status SendInput(const mtdb_input& input, const AttributeLayout& layout, double position_step,
                 MeshSink& sink) {
  MTDB_RETURN_IF_ERROR(CheckInput(input, layout.row_bytes()));
  MeshHeader header;
  header.position_step = position_step;
  for (uint64_t i = 0; i < input.vertices && input.positions != nullptr; ++i) {
    const double* const p = input.positions + 3 * i;
    header.bounds.Add(Vec3d{p[0], p[1], p[2]});
  }
  header.attributes = layout;
  header.double_positions = NeedsDouble(input);
  header.vertex_count = input.vertices;
  header.triangle_count = input.triangles;
  MTDB_RETURN_IF_ERROR(sink.Begin(header));
  MTDB_RETURN_IF_ERROR(SendPart(input, layout.row_bytes(), sink));
  return sink.End();
}

Status Send(const mtdb_mesh& mesh, MeshSink& sink) {
  mtdb_input input;
  MTDB_INIT(input);
  input.vertices = mesh.vertices;
  input.triangles = mesh.triangles;
  input.positions = mesh.positions.get();
  input.positions_float = mesh.positions_float.get();
  std::copy(mesh.origin, mesh.origin + 3, input.origin);
  input.indices = mesh.indices.get();
  input.rows = mesh.rows.get();
  return SendInput(input, mesh.attributes, mesh.position_step, sink);
}

Result<TriangleMesh> ToTriangleMesh(const mtdb_mesh& mesh) {
  TriangleMesh made;
  TriangleMeshSink sink(&made);
  MTDB_RETURN_IF_ERROR(Send(mesh, sink));
  return made;
}

}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;

mtdb_code mtdb_get_cut_mesh(mtdb_cut* cut, const double* origin, mtdb_mesh** mesh,
                            mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}, {mesh, "mesh"}}));
    std::unique_ptr<mtdb_mesh> made;
    mtdb::internal::MeshFiller filler(&made, origin);
    MTDB_RETURN_IF_ERROR(cut->cut.Emit(filler));
    *mesh = made.release();
    return Status::Ok();
  });
}

void mtdb_free_mesh(mtdb_mesh* mesh) { delete mesh; }

mtdb_code mtdb_view_mesh(const mtdb_mesh* mesh, mtdb_mesh_view* view, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{mesh, "mesh"}}));
    mtdb_mesh_view filled{};
    filled.vertices = mesh->vertices;
    filled.triangles = mesh->triangles;
    filled.positions = mesh->positions.get();
    filled.positions_float = mesh->positions_float.get();
    std::copy(mesh->origin, mesh->origin + 3, filled.origin);
    filled.indices = mesh->indices.get();
    filled.rows = mesh->rows.get();
    filled.row_bytes = static_cast<uint32_t>(mesh->attributes.row_bytes());
    filled.attributes = static_cast<uint32_t>(mesh->attributes.attributes.size());
    filled.corners = mesh->corners.get();
    filled.pages = mesh->pages.get();
    return mtdb::internal::PutStruct(filled, "view", view);
  });
}

mtdb_code mtdb_get_mesh_attribute(const mtdb_mesh* mesh, uint32_t i, mtdb_attribute* attribute,
                                  mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{mesh, "mesh"}}));
    return mtdb::internal::PutAttribute(mesh->attributes, i, attribute);
  });
}

mtdb_code mtdb_create_mesh(const mtdb_input* input, mtdb_mesh** mesh, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{input, "input"}, {mesh, "mesh"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_input given, Take(input, "input"));
    MTDB_ASSIGN_OR_RETURN(const mtdb::AttributeLayout layout,
                          mtdb::internal::LayoutOf(given.attributes, given.attribute_count));
    std::unique_ptr<mtdb_mesh> made;
    mtdb::internal::MeshFiller filler(&made,
                                      given.positions_float == nullptr ? nullptr : given.origin);
    MTDB_RETURN_IF_ERROR(mtdb::internal::SendInput(given, layout, filler));
    for (uint64_t i = 0; i < 3 * made->triangles; ++i) {
      const uint64_t v = given.indices != nullptr ? given.indices[i] : given.indices_long[i];
      if (v < made->vertices) continue;
      return mtdb::BadInput("triangle " + std::to_string(i / 3) + ": vertex index " +
                            std::to_string(v) + ", but there are " +
                            std::to_string(made->vertices) + " vertices");
    }
    *mesh = made.release();
    return Status::Ok();
  });
}

mtdb_code mtdb_read_mesh(const char* path, mtdb_mesh** mesh, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {mesh, "mesh"}}));
    // Readers do not tell all counts at the beginning.
    mtdb::TriangleMesh read;
    mtdb::TriangleMeshSink sink(&read);
    mtdb::MeshReadReport report;
    MTDB_RETURN_IF_ERROR(mtdb::ReadMeshFile(path, sink, &report));
    read.header.vertex_count = read.positions.size();
    read.header.triangle_count = read.triangles.size();
    std::unique_ptr<mtdb_mesh> made;
    mtdb::internal::MeshFiller filler(&made, nullptr);
    MTDB_RETURN_IF_ERROR(mtdb::SendMesh(read, filler));
    *mesh = made.release();
    return Status::Ok();
  });
}

namespace {

// Opens a file, lets `send` write to it, and says what became of the mesh.
template <typename SendTo>
Status WriteFile(const char* path, mtdb::MeshWriteOptions with, const mtdb_file_options* options,
                 mtdb_json** json, SendTo&& send) {
  MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}}));
  MTDB_ASSIGN_OR_RETURN(const mtdb_file_options given, Take(options, "options"));
  with.off_normals = given.normals != 0;
  with.double_positions = given.double_positions != 0;
  MTDB_ASSIGN_OR_RETURN(const auto writer, mtdb::CreateMeshFileWriter(path, with));
  MTDB_RETURN_IF_ERROR(send(*writer));
  if (json == nullptr) return Status::Ok();
  mtdb::Json report = mtdb::MeshFileJson(writer->report());
  report["rounding"] = writer->rounding();
  *json = new mtdb_json{report.Text()};
  return Status::Ok();
}

}  // namespace

mtdb_code mtdb_write_mesh(const mtdb_mesh* mesh, const char* path, const mtdb_file_options* options,
                          mtdb_json** json, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{mesh, "mesh"}}));
    return WriteFile(path, {}, options, json,
                     [&](mtdb::MeshSink& sink) { return mtdb::internal::Send(*mesh, sink); });
  });
}

mtdb_code mtdb_write_cut(mtdb_cut* cut, const char* path, const mtdb_file_options* options,
                         mtdb_json** json, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{cut, "cut"}}));
    return WriteFile(path, mtdb::MeshOptionsOf(cut->surface->record(), false), options, json,
                     [&](mtdb::MeshSink& sink) { return cut->cut.Emit(sink); });
  });
}
