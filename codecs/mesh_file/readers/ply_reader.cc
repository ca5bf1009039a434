// SPDX-License-Identifier: Apache-2.0
// PLY: elements of any order, properties of any order and type. What is common and large (binary
// vertices of fixed size, binary triangles) has a path of its own; everything else goes value by
// value through a PlyBinarySource or PlyTextSource.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include "codecs/mesh_file/input/ply_header.h"
#include "codecs/mesh_file/input/ply_source.h"
#include "codecs/mesh_file/polygons/face_emitter.h"
#include "codecs/mesh_file/polygons/left_out_vertices.h"
#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/vertex_positions.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/ply_textures.h"
#include "store/base/coordinate_limit.h"

namespace mtdb::internal {
namespace {

constexpr int kAxes = 3;
constexpr const char* kAxisNames[kAxes] = {"x", "y", "z"};

// What becomes of each vertex property.
struct VertexPlan {
  struct Column {
    int axis = -1;          // of a coordinate
    int attribute = -1;     // of an attribute
    int texture = -1;       // 0: of u, 1: of v
    size_t row_offset = 0;  // of an attribute in its row
  };
  std::vector<Column> columns;  // one per property
  AttributeLayout attributes;
  bool double_positions = false;
};

// Whatever text declares coordinates to be, it gives decimals.
void ReadAsDouble(PlyHeader* header) {
  for (PlyElement& element : header->elements) {
    for (PlyProperty& p : element.properties) {
      const bool axis =
          std::find(std::begin(kAxisNames), std::end(kAxisNames), p.name) != std::end(kAxisNames);
      if (element.name != "vertex" || !axis || p.is_list || p.type != ScalarType::kFloat32)
        continue;
      p.type = ScalarType::kFloat64;
      p.declared_float = true;
    }
  }
}

Result<VertexPlan> PlanVertices(const std::string& path, const PlyElement& element,
                                const PlyTextures& textures, MeshReadReport* report) {
  VertexPlan plan;
  std::array<bool, kAxes> found{};
  size_t row_bytes = 0;
  for (const PlyProperty& p : element.properties) {
    VertexPlan::Column column;
    const auto* const name = std::find(std::begin(kAxisNames), std::end(kAxisNames), p.name);
    if (name != std::end(kAxisNames)) {
      if (p.is_list) {
        return BadInput(path + ": vertex property " + p.name + ": expected a number, found a list");
      }
      column.axis = static_cast<int>(name - kAxisNames);
      found[column.axis] = true;
      // Integers of 32 bits do not survive float32 either.
      plan.double_positions = plan.double_positions ||
                              (p.type == ScalarType::kFloat64 && !p.declared_float) ||
                              p.type == ScalarType::kInt32 || p.type == ScalarType::kUint32;
    } else if (p.is_list) {
      AddIgnored(report, "vertex list property " + p.name);
    } else if (column.texture = textures.PartOf(p); column.texture < 0) {
      column.attribute = static_cast<int>(plan.attributes.attributes.size());
      column.row_offset = row_bytes;
      row_bytes += ScalarSize(p.type);
      plan.attributes.attributes.push_back({p.name, p.type});
    }
    plan.columns.push_back(column);
  }
  for (int axis = 0; axis < kAxes; ++axis) {
    if (!found[axis]) {
      return BadInput(path + ": the vertex element has no property " + kAxisNames[axis]);
    }
  }
  return plan;
}

// Decodes the coordinates of n rows. False when one is not finite.
template <typename T, bool kSwap>
bool DecodePositions(const std::byte* rows, size_t n, size_t stride,
                     const std::array<size_t, kAxes>& offsets, Vec3d* out) {
  using Bits = std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t>;
  bool fit = true;
  for (size_t i = 0; i < n; ++i, rows += stride) {
    for (int axis = 0; axis < kAxes; ++axis) {
      Bits bits;
      std::memcpy(&bits, rows + offsets[axis], sizeof(T));
      if constexpr (kSwap) {
        bits = sizeof(T) == 4 ? static_cast<Bits>(__builtin_bswap32(static_cast<uint32_t>(bits)))
                              : static_cast<Bits>(__builtin_bswap64(bits));
      }
      const double value = static_cast<double>(std::bit_cast<T>(bits));
      fit &= std::abs(value) <= kMaxCoordinate;
      out[i][axis] = value;
    }
  }
  return fit;
}

// Gathers attributes of n rows: one run of bytes, or one value when the byte order is to be turned.
struct RowCopy {
  size_t from = 0;  // in the file's row
  size_t to = 0;    // in the attribute row
  size_t size_bytes = 0;
};

template <size_t kSize>
void CopyColumn(const std::byte* in, size_t in_stride, std::byte* out, size_t out_stride, size_t n,
                bool swap) {
  for (size_t i = 0; i < n; ++i, in += in_stride, out += out_stride) {
    if (swap) {
      std::reverse_copy(in, in + kSize, out);
    } else {
      std::memcpy(out, in, kSize);
    }
  }
}

void CopyRows(const RowCopy& copy, const std::byte* in, size_t in_stride, std::byte* out,
              size_t out_stride, size_t n, bool swap) {
  in += copy.from;
  out += copy.to;
  switch (copy.size_bytes) {
    case 1: return CopyColumn<1>(in, in_stride, out, out_stride, n, false);
    case 2: return CopyColumn<2>(in, in_stride, out, out_stride, n, swap);
    case 3: return CopyColumn<3>(in, in_stride, out, out_stride, n, false);
    case 4: return CopyColumn<4>(in, in_stride, out, out_stride, n, swap);
    case 8: return CopyColumn<8>(in, in_stride, out, out_stride, n, swap);
    default:
      for (size_t i = 0; i < n; ++i, in += in_stride, out += out_stride) {
        std::memcpy(out, in, copy.size_bytes);
      }
  }
}

// Where the coordinates of binary vertices of one size lie.
struct VertexBytes {
  uint64_t begin = 0;  // of the first vertex in the file
  uint64_t count = 0;
  size_t stride = 0;
  std::array<size_t, kAxes> offsets{};  // of the coordinates in a vertex
};

// Positions that are read from the file itself.
template <typename T, bool kSwap>
class PlyPositions final : public VertexPositions {
 public:
  PlyPositions(const InputFile& file, const VertexBytes& place) : file_(file), place_(place) {}
  uint64_t block_vertices() const override {
    return BlockOf(place_.count * place_.stride, place_.stride);
  }
  Status Read(uint64_t first, std::span<Vec3d> out) override {
    rows_.resize(out.size() * place_.stride);
    MTDB_ASSIGN_OR_RETURN(const size_t n,
                          file_.ReadAt(place_.begin + first * place_.stride, rows_));
    if (n < rows_.size()) return BadInput(file_.path() + ": became shorter while it was read");
    DecodePositions<T, kSwap>(rows_.data(), out.size(), place_.stride, place_.offsets, out.data());
    return Status::Ok();
  }

 private:
  const InputFile& file_;
  VertexBytes place_;
  Bytes rows_;
};

template <typename Source>
class PlyBody {
 public:
  PlyBody(const InputFile& file, const MeshFileStart& start, const PlyHeader& header,
          Source& source, MeshSink& sink, MeshReadReport* report)
      : file_(file),
        path_(file.path()),
        header_(header),
        source_(&source),
        emitter_(sink),
        report_(report),
        textures_(start.tmp),
        faces_(emitter_, report, left_out_, [this, tmp = start.tmp] { return Positions(tmp); }) {}

  Status Read() {
    const PlyElement* const vertices = header_.Find("vertex");
    if (vertices == nullptr) return BadInput(path_ + ": the header has no vertex element");
    if (vertices->count == 0) return BadInput(path_ + ": no vertices");
    vertex_count_ = vertices->count;
    MTDB_RETURN_IF_ERROR(textures_.Plan(path_, header_, report_));
    MTDB_ASSIGN_OR_RETURN(plan_, PlanVertices(path_, *vertices, textures_, report_));
    MeshHeader mesh;
    if (textures_.are_used()) textures_.PutInto(&mesh);
    mesh.attributes = plan_.attributes;
    mesh.double_positions = plan_.double_positions;
    mesh.from_text = !Source::kBinary;
    mesh.vertex_count = vertex_count_;
    MTDB_RETURN_IF_ERROR(emitter_.Begin(mesh));
    if (FacesComeFirst()) MTDB_RETURN_IF_ERROR(LookAhead());
    for (const PlyElement& element : header_.elements) {
      element_ = &element;
      if (element.name == "vertex") {
        MTDB_RETURN_IF_ERROR(ReadVertices());
      } else if (element.name == "face") {
        MTDB_RETURN_IF_ERROR(ReadLists(/*strips=*/false));
      } else if (element.name == "tristrips") {
        MTDB_RETURN_IF_ERROR(ReadLists(/*strips=*/true));
      } else {
        if (element.count > 0) AddIgnored(report_, "element " + element.name);
        MTDB_RETURN_IF_ERROR(SkipElement());
      }
    }
    MTDB_RETURN_IF_ERROR(faces_.End());
    AddWrongCorners(emitter_.wrong_corners(), report_);
    if (left_out_.count() == vertex_count_) return NoVertexLeft(path_, left_out_);
    report_->left_out_vertices = left_out_.count();
    if (const uint64_t left = source_->remaining(); left > 0) {
      if (source_->NumberFollows()) {
        return BadInput(path_ + ": " + source_->Problem() + source_->Doubt());
      }
      AddIgnored(report_, std::to_string(left) + " bytes after the last element");
    }
    return emitter_.End();
  }

 private:
  // An error in element `index` of element_.
  Status ErrorAt(uint64_t index, const std::string& what) const {
    return BadInput(path_ + ": " + (element_->name == "tristrips" ? "strip" : element_->name) +
                    " " + std::to_string(index) + source_->Place() + ": " + what +
                    source_->Doubt());
  }
  // After the source failed.
  Status SourceError(uint64_t index, const PlyProperty& property) const {
    MTDB_RETURN_IF_ERROR(source_->status());
    return ErrorAt(index, "property " + property.name + ": " + source_->Problem());
  }

  Status SkipProperty(uint64_t index, const PlyProperty& property) {
    uint64_t count = 1;
    if (property.is_list) MTDB_RETURN_IF_ERROR(ListCount(index, property, &count));
    return source_->Skip(property.type, count) ? Status::Ok() : SourceError(index, property);
  }

  Status ListCount(uint64_t index, const PlyProperty& property, uint64_t* count) {
    PlyValue value;
    if (!source_->Get(property.count_type, &value)) return SourceError(index, property);
    const int64_t n = value.ToInteger(property.count_type);
    if (n < 0) {
      return ErrorAt(index, "list " + property.name + ": expected a count of 0 or more, found " +
                                std::to_string(n));
    }
    *count = static_cast<uint64_t>(n);
    if (source_->Fits(property.type, *count)) return Status::Ok();
    return ErrorAt(index, "list " + property.name + " of " + std::to_string(n) +
                              " items, but only " + std::to_string(source_->remaining()) +
                              " bytes are left; the file is cut short or damaged");
  }

  Status SkipElement() {
    if (element_->properties.empty()) return Status::Ok();
    if (Source::kBinary && !element_->has_list()) {
      // In one step; the header's counts were compared with the file's size, lists may have
      // taken more since.
      const uint64_t each = element_->min_bytes();
      const uint64_t there = source_->remaining() / each;
      if (there < element_->count || !source_->Skip(ScalarType::kUint8, each * element_->count)) {
        MTDB_RETURN_IF_ERROR(source_->status());
        return ErrorAt(there, "the file ends in the middle of it; the file is cut short");
      }
      return Status::Ok();
    }
    for (uint64_t i = 0; i < element_->count; ++i) {
      for (const PlyProperty& p : element_->properties) MTDB_RETURN_IF_ERROR(SkipProperty(i, p));
      source_->EndInstance();
    }
    return Status::Ok();
  }

  bool FacesComeFirst() const {
    for (const PlyElement& element : header_.elements) {
      if (element.name == "vertex") return false;
      if ((element.name == "face" || element.name == "tristrips") && element.count > 0) return true;
    }
    return false;
  }

  // Where faces come before the vertices: finds these, and those that are left out.
  Status LookAhead() {
    Source ahead = *source_;
    Source* const here = std::exchange(source_, &ahead);
    Status status = Status::Ok();
    for (const PlyElement& element : header_.elements) {
      element_ = &element;
      if (element.name != "vertex") {
        status = SkipElement();
        if (!status.ok()) break;
        continue;
      }
      vertices_at_.emplace(ahead);
      status = ForEachVertex([&](uint64_t i, Vec3d position, ByteSpan) {
        if (!AreCoordinates(position)) LeaveOut(i, position);
        return Status::Ok();
      });
      break;
    }
    source_ = here;
    return status;
  }

  void LeaveOut(uint64_t vertex, Vec3d position) {
    left_out_.Add(vertex, "vertex " + std::to_string(vertex) + source_->Place() + ": " +
                              CoordinateFault(position));
  }

  // Whether vertices are binary and of one size; their coordinates have the type PositionType().
  bool IsFixed() const {
    return Source::kBinary && !element_->has_list() &&
           element_->min_bytes() <= BlockReader::kBufferBytes && PositionType().has_value();
  }

  // Calls visit with T, the type of the coordinates of vertices of one size, and their byte order.
  template <typename Visit>
  auto VisitFixed(Visit&& visit) {
    const bool swap = source_->big_endian();
    if (PositionType() == ScalarType::kFloat32) {
      return swap ? visit.template operator()<float, true>()
                  : visit.template operator()<float, false>();
    }
    return swap ? visit.template operator()<double, true>()
                : visit.template operator()<double, false>();
  }

  Status ReadVertices() {
    const bool looked_ahead = vertices_at_.has_value();
    if (!looked_ahead) vertices_at_.emplace(*source_);
    if constexpr (Source::kBinary) {
      if (IsFixed()) {
        return VisitFixed(
            [&]<typename T, bool kSwap>() { return ReadFixedVertices<T, kSwap>(looked_ahead); });
      }
    }
    return ForEachVertex([&](uint64_t i, Vec3d position, ByteSpan row) {
      if (AreCoordinates(position)) return emitter_.AddVertex(position, row);
      if (!looked_ahead) LeaveOut(i, position);
      return Status::Ok();
    });
  }

  // Calls receive(index, position, row) for each vertex of element_.
  template <typename Receive>
  Status ForEachVertex(Receive&& receive) {
    Bytes row(plan_.attributes.row_bytes());
    for (uint64_t i = 0; i < element_->count; ++i) {
      Vec3d position;
      std::array<float, 2> place{};
      for (size_t k = 0; k < element_->properties.size(); ++k) {
        const PlyProperty& property = element_->properties[k];
        const VertexPlan::Column& column = plan_.columns[k];
        if (property.is_list) {
          MTDB_RETURN_IF_ERROR(SkipProperty(i, property));
          continue;
        }
        PlyValue value;
        if (!source_->Get(property.type, &value)) return SourceError(i, property);
        if (column.axis >= 0) {
          position[column.axis] = value.ToReal(property.type);
        } else if (column.texture >= 0) {
          place[column.texture] = static_cast<float>(value.ToReal(property.type));
        } else {
          std::memcpy(row.data() + column.row_offset, value.bytes, ScalarSize(property.type));
        }
      }
      source_->EndInstance();
      if (textures_.of_vertices()) {
        MTDB_RETURN_IF_ERROR(textures_.SetVertex(i, {place[0], place[1]}));
      }
      MTDB_RETURN_IF_ERROR(receive(i, position, ByteSpan(row)));
    }
    return Status::Ok();
  }

  // In a pass of its own where vertices have no fixed size, which files without polygons are
  // spared.
  Result<std::unique_ptr<VertexPositions>> Positions(ReaderSpace tmp) {
    tmp.max_bytes -= std::min(tmp.max_bytes, textures_.temporary_bytes());
    const PlyElement* const face = std::exchange(element_, header_.Find("vertex"));
    if constexpr (Source::kBinary) {
      if (IsFixed()) {
        VertexBytes place;
        place.begin = vertices_at_->reader().offset();
        place.count = element_->count;
        place.stride = element_->min_bytes();
        place.offsets = CoordinateOffsets();
        auto positions = VisitFixed([&]<typename T, bool kSwap>() {
          return std::unique_ptr<VertexPositions>(
              std::make_unique<PlyPositions<T, kSwap>>(file_, place));
        });
        element_ = face;
        return positions;
      }
    }
    auto positions = std::make_unique<PositionSpool>(tmp);
    Source vertices = *vertices_at_;
    Source* const here = std::exchange(source_, &vertices);
    const Status status = ForEachVertex(
        [&](uint64_t, Vec3d position, ByteSpan) { return positions->Append(position); });
    source_ = here;
    element_ = face;
    MTDB_RETURN_IF_ERROR(status);
    MTDB_RETURN_IF_ERROR(positions->Finish());
    return std::unique_ptr<VertexPositions>(std::move(positions));
  }

  // The type of the coordinates when they share one, of float32 and float64.
  std::optional<ScalarType> PositionType() const {
    std::optional<ScalarType> type;
    for (size_t k = 0; k < plan_.columns.size(); ++k) {
      if (plan_.columns[k].axis < 0) continue;
      if (type && *type != element_->properties[k].type) return std::nullopt;
      type = element_->properties[k].type;
    }
    return type && *type >= ScalarType::kFloat32 ? type : std::nullopt;
  }

  // Of the coordinates in a vertex of one size.
  std::array<size_t, kAxes> CoordinateOffsets() const {
    std::array<size_t, kAxes> offsets{};
    size_t at = 0;
    for (size_t k = 0; k < plan_.columns.size(); ++k) {
      if (plan_.columns[k].axis >= 0) offsets[plan_.columns[k].axis] = at;
      at += ScalarSize(element_->properties[k].type);
    }
    return offsets;
  }

  // What is copied of each vertex of one size into its row.
  std::vector<RowCopy> RowCopies(bool swap) const {
    std::vector<RowCopy> copies;
    size_t at = 0;
    for (size_t k = 0; k < plan_.columns.size(); ++k) {
      const size_t size = ScalarSize(element_->properties[k].type);
      if (plan_.columns[k].attribute < 0) {
        at += size;
        continue;
      }
      if (!swap && !copies.empty() && copies.back().from + copies.back().size_bytes == at) {
        copies.back().size_bytes += size;
      } else {
        copies.push_back({at, plan_.columns[k].row_offset, size});
      }
      at += size;
    }
    return copies;
  }

  // Binary rows of one size.
  template <typename T, bool kSwap>
  Status ReadFixedVertices(bool looked_ahead) {
    const size_t stride = element_->min_bytes();
    const size_t row_bytes = plan_.attributes.row_bytes();
    const std::array<size_t, kAxes> offsets = CoordinateOffsets();
    const std::vector<RowCopy> copies = RowCopies(kSwap);
    BlockReader& reader = source_->reader();
    const size_t block = emitter_.vertices_per_block();
    std::vector<Vec3d> positions(block);
    Bytes rows(row_bytes * block);
    for (uint64_t done = 0; done < element_->count;) {
      if (!reader.Ensure(stride)) {
        MTDB_RETURN_IF_ERROR(reader.status());
        return ErrorAt(done, source_->Problem());
      }
      const size_t n = static_cast<size_t>(
          std::min<uint64_t>({element_->count - done, reader.available() / stride, block}));
      const bool all_fit =
          DecodePositions<T, kSwap>(reader.data(), n, stride, offsets, positions.data());
      for (const RowCopy& copy : copies) {
        CopyRows(copy, reader.data(), stride, rows.data(), row_bytes, n, kSwap);
      }
      if (textures_.of_vertices()) MTDB_RETURN_IF_ERROR(SetTextures(done, n));
      reader.Consume(n * stride);
      const size_t kept =
          all_fit ? n : KeepGood(done, looked_ahead, std::span(positions).first(n), rows.data());
      MTDB_RETURN_IF_ERROR(emitter_.AddVertices(std::span(positions).first(kept),
                                                ByteSpan(rows).first(kept * row_bytes)));
      done += n;
    }
    return Status::Ok();
  }

  // Of n vertices of one size, which the reader has.
  Status SetTextures(uint64_t first, size_t n) {
    std::array<size_t, 2> offsets{};
    std::array<ScalarType, 2> types{};
    size_t at = 0;
    for (size_t k = 0; k < plan_.columns.size(); ++k) {
      const ScalarType type = element_->properties[k].type;
      if (const int part = plan_.columns[k].texture; part >= 0) {
        offsets[part] = at;
        types[part] = type;
      }
      at += ScalarSize(type);
    }
    const std::byte* row = source_->reader().data();
    for (size_t i = 0; i < n; ++i, row += at) {
      std::array<float, 2> place{};
      for (size_t part = 0; part < 2; ++part) {
        PlyValue value;
        const size_t size = ScalarSize(types[part]);
        std::memcpy(value.bytes, row + offsets[part], size);
        if (source_->big_endian()) std::reverse(value.bytes, value.bytes + size);
        place[part] = static_cast<float>(value.ToReal(types[part]));
      }
      MTDB_RETURN_IF_ERROR(textures_.SetVertex(first + i, {place[0], place[1]}));
    }
    return Status::Ok();
  }

  // Moves the vertices with legal coordinates to the front; returns their number.
  size_t KeepGood(uint64_t first, bool looked_ahead, std::span<Vec3d> positions, std::byte* rows) {
    const size_t row_bytes = plan_.attributes.row_bytes();
    size_t kept = 0;
    for (size_t i = 0; i < positions.size(); ++i) {
      if (!AreCoordinates(positions[i])) {
        if (!looked_ahead) LeaveOut(first + i, positions[i]);
        continue;
      }
      positions[kept] = positions[i];
      if (row_bytes > 0) std::memmove(rows + kept * row_bytes, rows + i * row_bytes, row_bytes);
      ++kept;
    }
    return kept;
  }

  // The faces, or the strips.
  Status ReadLists(bool strips) {
    if (element_->count == 0) return Status::Ok();
    const PlyProperty* indices = nullptr;
    for (const PlyProperty& p : element_->properties) {
      if (p.name == "vertex_indices" || p.name == "vertex_index") {
        if (!p.is_list || p.type >= ScalarType::kFloat32) {
          return BadInput(path_ + ": element " + element_->name + ": property " + p.name +
                          ": expected a list of integers");
        }
        if (indices == nullptr) indices = &p;
      }
    }
    if (indices == nullptr) {
      return BadInput(path_ + ": element " + element_->name +
                      " has no list property vertex_indices or vertex_index");
    }
    for (const PlyProperty& p : element_->properties) {
      const bool is_used =
          &p == indices || (!strips && (textures_.IsCoordinates(p) || textures_.IsPage(p)));
      if (!is_used) AddIgnored(report_, element_->name + " property " + p.name);
    }
    const bool plain = !strips && element_->properties.size() == 1 &&
                       indices->count_type == ScalarType::kUint8 && ScalarSize(indices->type) == 4;
    for (uint64_t i = 0; i < element_->count; ++i) {
      if constexpr (Source::kBinary) {
        if (plain) {
          MTDB_RETURN_IF_ERROR(source_->big_endian() ? ReadPlainTriangles<true>(*indices, &i)
                                                     : ReadPlainTriangles<false>(*indices, &i));
          if (i == element_->count) break;
        }
      }
      if (!strips && textures_.are_used()) {
        MTDB_RETURN_IF_ERROR(ReadTexturedFace(i, *indices));
        source_->EndInstance();
        continue;
      }
      for (const PlyProperty& p : element_->properties) {
        if (&p != indices) {
          MTDB_RETURN_IF_ERROR(SkipProperty(i, p));
        } else {
          MTDB_RETURN_IF_ERROR(strips ? ReadStrip(i, p) : ReadFace(i, p));
        }
      }
      source_->EndInstance();
    }
    return Status::Ok();
  }

  // Waits for all of the face, but where it has so many corners that it goes on as it comes.
  Status ReadTexturedFace(uint64_t index, const PlyProperty& indices) {
    textures_.BeginFace();
    bool is_huge = false;
    for (const PlyProperty& p : element_->properties) {
      PlyValue value;
      if (&p != &indices && !textures_.IsCoordinates(p)) {
        if (!textures_.IsPage(p)) {
          MTDB_RETURN_IF_ERROR(SkipProperty(index, p));
          continue;
        }
        if (!source_->Get(p.type, &value)) return SourceError(index, p);
        const double number = value.ToReal(p.type);
        textures_.SetPage(std::abs(number) < 0x1p31 ? static_cast<int64_t>(number) : -1);
        continue;
      }
      uint64_t count = 0;
      MTDB_RETURN_IF_ERROR(ListCount(index, p, &count));
      const bool is_long = count > 2 * PolygonTriangulator::kMostCorners;
      if (&p == &indices) is_huge = is_long;
      if (&p != &indices && is_long) {
        if (!source_->Skip(p.type, count)) return SourceError(index, p);
        count = 0;
      }
      for (uint64_t i = 0; i < count; ++i) {
        if (&p != &indices) {
          if (!source_->Get(p.type, &value)) return SourceError(index, p);
          textures_.AddNumber(value.ToReal(p.type));
          continue;
        }
        VertexIndex v = 0;
        MTDB_RETURN_IF_ERROR(GetVertex(index, p, &v));
        if (is_huge) {
          MTDB_RETURN_IF_ERROR(faces_.AddCorner(v));
        } else {
          textures_.AddCorner(v);
        }
      }
    }
    return is_huge ? faces_.EndFace() : textures_.EndFace(&faces_);
  }

  Status IndexError(uint64_t index, int64_t vertex) const {
    return ErrorAt(index, "vertex index " + std::to_string(vertex) + ", but the file has " +
                              std::to_string(vertex_count_) + " vertices");
  }

  Status CheckVertex(uint64_t index, int64_t v) const {
    if (v < 0 || static_cast<uint64_t>(v) >= vertex_count_) return IndexError(index, v);
    if (!left_out_.Has(static_cast<VertexIndex>(v))) return Status::Ok();
    return LeftOutError(path_, left_out_, static_cast<VertexIndex>(v),
                        element_->name + " " + std::to_string(index) + source_->Place());
  }
  Status CheckLeftOut(uint64_t index, std::span<const TriangleVertices> triangles) const {
    for (size_t i = 0; i < triangles.size() && left_out_.count() > 0; ++i) {
      for (const VertexIndex v : triangles[i]) {
        MTDB_RETURN_IF_ERROR(CheckVertex(index + i, static_cast<int64_t>(v)));
      }
    }
    return Status::Ok();
  }

  // Binary triangles "3 a b c" of 13 bytes, as many as follow one another; *index moves on.
  template <bool kSwap>
  Status ReadPlainTriangles(const PlyProperty& property, uint64_t* index) {
    constexpr size_t kTriangleBytes = 13;
    // A negative int is a large unsigned one.
    const uint64_t limit = property.type == ScalarType::kInt32
                               ? std::min<uint64_t>(vertex_count_, uint64_t{1} << 31)
                               : vertex_count_;
    BlockReader& reader = source_->reader();
    triangles_.resize(MeshEmitter::kBlock);
    while (*index < element_->count && reader.Ensure(kTriangleBytes)) {
      const size_t most = static_cast<size_t>(std::min<uint64_t>(
          {element_->count - *index, reader.available() / kTriangleBytes, MeshEmitter::kBlock}));
      const std::byte* p = reader.data();
      size_t n = 0;
      uint32_t largest = 0;
      for (; n < most && *p == std::byte{3}; ++n, p += kTriangleBytes) {
        uint32_t v[3];
        std::memcpy(v, p + 1, sizeof(v));
        if constexpr (kSwap) {
          for (uint32_t& u : v) u = __builtin_bswap32(u);
        }
        largest = std::max({largest, v[0], v[1], v[2]});
        triangles_[n] = {v[0], v[1], v[2]};
      }
      if (n == 0) return Status::Ok();
      if (largest >= limit) {
        for (size_t i = 0; i < n; ++i) {
          for (const VertexIndex v : triangles_[i]) {
            if (v < limit) continue;
            return IndexError(*index + i, property.type == ScalarType::kInt32
                                              ? static_cast<int32_t>(v)
                                              : static_cast<int64_t>(v));
          }
        }
      }
      reader.Consume(n * kTriangleBytes);
      const auto triangles = std::span<const TriangleVertices>(triangles_).first(n);
      MTDB_RETURN_IF_ERROR(CheckLeftOut(*index, triangles));
      if (textures_.of_vertices()) {
        for (const TriangleVertices& t : triangles) {
          MTDB_RETURN_IF_ERROR(textures_.AddTriangle(t, &faces_));
        }
      } else {
        MTDB_RETURN_IF_ERROR(faces_.AddTriangles(triangles));
      }
      *index += n;
      if (n < most) return Status::Ok();
    }
    return reader.status();
  }

  Status GetVertex(uint64_t index, const PlyProperty& property, VertexIndex* vertex) {
    PlyValue value;
    if (!source_->Get(property.type, &value)) return SourceError(index, property);
    const int64_t v = value.ToInteger(property.type);
    *vertex = static_cast<VertexIndex>(v);
    return CheckVertex(index, v);
  }

  Status ReadFace(uint64_t index, const PlyProperty& property) {
    uint64_t corners = 0;
    MTDB_RETURN_IF_ERROR(ListCount(index, property, &corners));
    for (uint64_t i = 0; i < corners; ++i) {
      VertexIndex v = 0;
      MTDB_RETURN_IF_ERROR(GetVertex(index, property, &v));
      MTDB_RETURN_IF_ERROR(faces_.AddCorner(v));
    }
    return faces_.EndFace();
  }

  // Every second triangle of a strip has its first two corners swapped; -1 starts a new strip.
  Status ReadStrip(uint64_t index, const PlyProperty& property) {
    uint64_t items = 0;
    MTDB_RETURN_IF_ERROR(ListCount(index, property, &items));
    uint64_t length = 0;
    VertexIndex a = 0, b = 0;
    for (uint64_t i = 0; i < items; ++i) {
      PlyValue value;
      if (!source_->Get(property.type, &value)) return SourceError(index, property);
      const int64_t v = value.ToInteger(property.type);
      const bool restart =
          v == -1 || (property.type == ScalarType::kUint32 && v == int64_t{0xffffffff});
      if (restart) {
        length = 0;
        continue;
      }
      MTDB_RETURN_IF_ERROR(CheckVertex(index, v));
      const auto c = static_cast<VertexIndex>(v);
      ++length;
      if (length == 3) ++report_->strips;
      // Repeated indices only stitch strips together.
      if (length >= 3 && a != b && b != c && c != a) {
        const TriangleVertices t =
            length % 2 == 1 ? TriangleVertices{a, b, c} : TriangleVertices{b, a, c};
        MTDB_RETURN_IF_ERROR(textures_.of_vertices() ? textures_.AddTriangle(t, &faces_)
                                                     : faces_.AddTriangle(t[0], t[1], t[2]));
      }
      a = b;
      b = c;
    }
    return Status::Ok();
  }

  const InputFile& file_;
  const std::string& path_;
  const PlyHeader& header_;
  Source* source_;
  std::optional<Source> vertices_at_;  // as the source stood before the vertices
  MeshEmitter emitter_;
  MeshReadReport* report_;
  LeftOutVertices left_out_;
  PlyTextures textures_;
  FaceEmitter faces_;
  VertexPlan plan_;
  uint64_t vertex_count_ = 0;
  const PlyElement* element_ = nullptr;  // being read
  std::vector<TriangleVertices> triangles_;
};

}  // namespace

MeshFileFit RecognisePly(const MeshFileStart& start) {
  if (StartsWithWord(start.text, "ply")) return MeshFileFit::kContent;
  return start.named ? MeshFileFit::kName : MeshFileFit::kNone;
}

Status ReadPly(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
               MeshReadReport* report) {
  MTDB_ASSIGN_OR_RETURN(PlyHeader header, ReadPlyHeader(file));
  if (header.encoding == PlyEncoding::kAscii) {
    report->format = "PLY ASCII";
    ReadAsDouble(&header);
    PlyTextSource source(file, header.body_offset, header.line_count);
    return PlyBody(file, start, header, source, sink, report).Read();
  }
  const bool big_endian = header.encoding == PlyEncoding::kBinaryBigEndian;
  report->format = big_endian ? "PLY binary big endian" : "PLY binary little endian";
  PlyBinarySource source(file, header.body_offset, big_endian);
  return PlyBody(file, start, header, source, sink, report).Read();
}

}  // namespace mtdb::internal
