// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/verbs/merge.h"

#include <algorithm>
#include <cstring>
#include <unistd.h>
#include <utility>

namespace mtdb {

namespace {

// Takes a file's header and stops its reader at the first block.
class HeaderSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader& header) override {
    header_ = header;
    return Status::Ok();
  }
  Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Stop(); }
  Status AddTriangles(std::span<const TriangleVertices>) override { return Stop(); }
  Status End() override { return Status::Ok(); }
  bool joins_soup() const override { return true; }
  const MeshHeader& header() const { return header_; }

 private:
  static Status Stop() { return Status(StatusCode::kCancelled, "header read"); }
  MeshHeader header_;
};

// Appends a file to the common mesh: vertices numbered on, rows cut to the common attributes.
class PartSink final : public MeshSink {
 public:
  // `first_page`: of the file's pages among all.
  PartSink(MeshSink& sink, const MeshHeader& common, VertexIndex first, uint32_t first_page,
           uint64_t soup_bytes)
      : sink_(sink),
        common_(common),
        soup_bytes_(soup_bytes),
        first_(first),
        first_page_(first_page) {}

  Status Begin(const MeshHeader& header) override {
    from_row_ = header.attributes.row_bytes();
    textured_ = header.textured;
    for (const VertexAttribute& a : common_.attributes.attributes) {
      size_t offset = 0;
      for (const VertexAttribute& b : header.attributes.attributes) {
        if (a == b) break;
        offset += ScalarSize(b.type);
      }
      fields_.push_back({offset, ScalarSize(a.type)});
    }
    return Status::Ok();
  }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    rows_.clear();
    for (size_t i = 0; i < positions.size(); ++i) {
      for (const auto& [offset, size] : fields_) {
        const std::byte* field = rows.data() + i * from_row_ + offset;
        rows_.insert(rows_.end(), field, field + size);
      }
    }
    count_ += positions.size();
    return sink_.AddVertices(positions, rows_);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    triangles_.assign(triangles.begin(), triangles.end());
    for (TriangleVertices& t : triangles_) {
      for (VertexIndex& v : t) v += first_;
    }
    MTDB_RETURN_IF_ERROR(sink_.AddTriangles(triangles_));
    if (!common_.textured || textured_) return Status::Ok();
    corners_.assign(3 * triangles.size(), TextureCorner{0, 0, TextureCorner::kNoPage});
    return sink_.AddCorners(corners_);
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    if (!common_.textured) return Status::Ok();
    corners_.assign(corners.begin(), corners.end());
    for (TextureCorner& corner : corners_) {
      if (corner.page != TextureCorner::kNoPage) corner.page += first_page_;
    }
    return sink_.AddCorners(corners_);
  }
  Status End() override { return Status::Ok(); }
  bool joins_soup() const override { return common_.soup; }
  uint64_t soup_bytes() const override { return soup_bytes_; }
  uint64_t count() const { return count_; }

 private:
  MeshSink& sink_;
  const MeshHeader& common_;
  uint64_t soup_bytes_;
  VertexIndex first_;
  uint32_t first_page_;
  bool textured_ = false;
  uint64_t count_ = 0;
  size_t from_row_ = 0;
  std::vector<std::pair<size_t, size_t>> fields_;  // offset and size in a file's row
  Bytes rows_;
  std::vector<TriangleVertices> triangles_;
  std::vector<TextureCorner> corners_;
};

// Appends a file's pages. Names that are there already get a number before them.
void AddPages(const MeshHeader& file, MeshHeader& common) {
  common.textured |= file.textured;
  for (const Texture& page : file.textures) {
    const auto is_there = [&](const std::string& name) {
      return std::ranges::find(common.textures, name, &Texture::name) != common.textures.end();
    };
    Texture& added = common.textures.emplace_back(page);
    const std::string name = std::exchange(added.name, "");
    std::string unique = name;
    for (int n = 2; is_there(unique); ++n) unique = std::to_string(n) + "_" + name;
    added.name = unique;
  }
}

void DropMissing(AttributeLayout& layout, const AttributeLayout& other, const std::string& path,
                 std::vector<std::string>* notes) {
  std::erase_if(layout.attributes, [&](const VertexAttribute& a) {
    const auto& there = other.attributes;
    if (std::find(there.begin(), there.end(), a) != there.end()) return false;
    notes->push_back("attribute " + a.name + " dropped: " + path +
                     " has none of that name and type");
    return true;
  });
}

void Note(const std::string& path, const MeshReadReport& report, std::vector<std::string>* notes) {
  std::string list;
  for (const std::string& what : report.ignored) list += (list.empty() ? "" : ", ") + what;
  if (!list.empty()) notes->push_back(path + ": not carried: " + list);
  if (report.short_faces != 0) {
    notes->push_back(path + ": " + std::to_string(report.short_faces) +
                     " faces of fewer than three corners dropped");
  }
  if (report.fans != 0) {
    notes->push_back(path + ": " + std::to_string(report.fans) + " of " +
                     std::to_string(report.polygons) +
                     " polygons have outlines that cross themselves, or too many corners: they "
                     "became fans, which may lie outside of them");
  }
  if (report.left_out_vertices != 0) {
    notes->push_back(path + ": " + std::to_string(report.left_out_vertices) +
                     " vertices left out that no face uses: their coordinates are no finite "
                     "numbers");
  }
  for (const std::string& note : report.notes) notes->push_back(path + ": " + note);
}

}  // namespace

Result<std::vector<MeshInput>> OpenMeshes(const std::vector<std::string>& paths,
                                          const std::string& format, const std::string& tmp,
                                          const InputLimits& limits) {
  std::vector<MeshInput> inputs;
  uint64_t left = limits.max_tmp_bytes;
  for (const std::string& path : paths) {
    MeshReadOptions options;
    options.tmp_directory = tmp;
    options.max_tmp_bytes = left;
    options.look = limits.look;
    const bool is_standard_input = path == "-";
    if (is_standard_input) {
      options.descriptor = STDIN_FILENO;
      options.suffix = format;
    }
    MTDB_ASSIGN_OR_RETURN(MeshInput input,
                          MeshInput::Open(is_standard_input ? "standard input" : path, options));
    left -= input.temporary_bytes();
    inputs.push_back(std::move(input));
  }
  return inputs;
}

Status ReadMeshes(const std::vector<MeshInput>& inputs, MeshSink& sink,
                  std::vector<std::string>* notes, uint64_t soup_bytes) {
  if (inputs.size() == 1) {
    MeshReadReport report;
    MTDB_RETURN_IF_ERROR(inputs[0].Read(sink, &report));
    Note(inputs[0].path(), report, notes);
    return Status::Ok();
  }
  MeshHeader common;
  std::vector<uint32_t> first_pages;
  for (size_t i = 0; i < inputs.size(); ++i) {
    HeaderSink header;
    MeshReadReport report;
    const Status status = inputs[i].Read(header, &report);
    if (!status.ok() && status.code() != StatusCode::kCancelled) return status;
    const MeshHeader& h = header.header();
    first_pages.push_back(static_cast<uint32_t>(common.textures.size()));
    AddPages(h, common);
    if (i == 0) {
      common.attributes = h.attributes;
      common.double_positions = h.double_positions;
      common.from_text = h.from_text;
      common.soup = h.soup && sink.joins_soup();
      continue;
    }
    DropMissing(common.attributes, h.attributes, inputs[i].path(), notes);
    AttributeLayout theirs = h.attributes;
    DropMissing(theirs, common.attributes, inputs[0].path(), notes);
    common.double_positions |= h.double_positions;
    common.from_text |= h.from_text;
    common.soup &= h.soup;
  }
  common.soup &= !common.textured;
  MTDB_RETURN_IF_ERROR(sink.Begin(common));
  VertexIndex first = 0;
  for (size_t i = 0; i < inputs.size(); ++i) {
    const MeshInput& input = inputs[i];
    PartSink part(sink, common, first, first_pages[i], soup_bytes);
    MeshReadReport report;
    MTDB_RETURN_IF_ERROR(input.Read(part, &report));
    Note(input.path(), report, notes);
    first += part.count();
  }
  return sink.End();
}

}  // namespace mtdb
