// SPDX-License-Identifier: Apache-2.0
// The base is divided into blocks of 18 x 5 cells. Of the five rows of vertices of a block the
// second and third may bear a fin, the fifth bears flaps, and crumbs float between the fourth and
// the fifth; so nothing meets anything but the base.
#include "tools/generate/internal/sheets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tools/generate/internal/sheets_base.h"
#include "tools/generate/noise.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kBlockColumns = 18, kBlockRows = 5;
constexpr uint64_t kFlapsOfBlock = 2, kCrumbsOfBlock = 5;
// Of 400,000 triangles there are 1,000 fins, 1,500 flaps and 5,000 crumbs.
constexpr uint64_t kTrianglesOfFin = 400, kTrianglesOfCrumb = 80;
constexpr uint64_t kMinTriangles = 800;  // of a mesh with anything but the base
// Of the circumferences of ring and tube.
constexpr double kAspect = 2.5;
constexpr size_t kBlock = 60'000;

// Random numbers of the thing `index` of a kind.
class Dice {
 public:
  enum Kind : uint64_t { kFin = 1, kFlap = 2, kCrumb = 3 };
  Dice(uint64_t seed, Kind kind, uint64_t index)
      : seed_(seed), stream_((kind << 56) + (index << 8)) {}
  double Unit() { return static_cast<double>(UnitFloat(StreamSeed(seed_, stream_++))); }
  uint64_t Below(uint64_t end) {
    return std::min(end - 1, static_cast<uint64_t>(Unit() * static_cast<double>(end)));
  }

 private:
  uint64_t seed_, stream_;
};

// A fin hangs along a path of the base that leads along a row and once, somewhere, along a
// diagonal.
struct Fin {
  Fin(uint64_t seed, uint64_t index)
      : dice(seed, Dice::kFin, index),
        length(6 + dice.Below(11)),
        height(3 + dice.Below(4)),
        step_at(dice.Below(length + 1)),
        first(dice.Below(kBlockColumns - length)),
        lean(0.4 * dice.Unit() - 0.2),
        pitch(0.6 + 0.3 * dice.Unit()) {}
  uint64_t triangles() const { return 2 * length * height; }

  Dice dice;
  uint64_t length, height;  // in edges
  uint64_t step_at, first;
  double lean, pitch;  // the height of a row of triangles in edges of the base
};

constexpr std::array<Vec3d, 4> kTetrahedron = {Vec3d{1, 1, 1}, Vec3d{1, -1, -1}, Vec3d{-1, 1, -1},
                                               Vec3d{-1, -1, 1}};
constexpr std::array<Vec3d, 6> kOctahedron = {Vec3d{1, 0, 0},  Vec3d{-1, 0, 0}, Vec3d{0, 1, 0},
                                              Vec3d{0, -1, 0}, Vec3d{0, 0, 1},  Vec3d{0, 0, -1}};

bool IsOctahedron(uint64_t seed, uint64_t crumb) {
  return Dice(seed, Dice::kCrumb, crumb).Unit() < 0.5;
}

class SheetsWriter {
 public:
  SheetsWriter(const SheetsPlan& plan, uint64_t seed, MeshSink& sink)
      : plan_(plan),
        seed_(seed),
        sink_(sink),
        base_(plan.columns, plan.rows, seed),
        blocks_across_(plan.columns / kBlockColumns),
        blocks_(blocks_across_ * (plan.rows / kBlockRows)) {}
  Status Write();

 private:
  struct Corner {
    uint64_t column = 0, row = 0;
  };
  struct Frame {  // of length 1; right along the row, up outward
    Vec3d right, ahead, up;
    double edge = 0;  // the length of the base's edge along the row
  };

  Status WriteBase();
  Status WriteFin(uint64_t index);
  Status WriteFlap(uint64_t index);
  Status WriteCrumb(uint64_t index);
  // With vertices from `v` on, in the order of kOctahedron or kTetrahedron.
  void AddOctahedron(uint64_t v);
  void AddTetrahedron(uint64_t v);
  // The first corner of the block of which the thing is, when things are spread over all blocks
  // with room for `of_block` each; and its place among these.
  Corner BlockOf(uint64_t index, uint64_t count, uint64_t of_block, uint64_t* place) const;
  Frame FrameAt(Corner corner) const;
  uint64_t AddVertex(Vec3d p);
  void AddTriangle(uint64_t a, uint64_t b, uint64_t c) { triangles_.push_back({a, b, c}); }
  Status FlushWhenFull() {
    return std::max(vertices_.size(), triangles_.size()) < kBlock ? Status::Ok() : Flush();
  }
  Status Flush();

  const SheetsPlan plan_;
  const uint64_t seed_;
  MeshSink& sink_;
  const SheetsBase base_;
  const uint64_t blocks_across_, blocks_;
  uint64_t next_vertex_ = 0;
  std::vector<Vec3d> vertices_;
  std::vector<TriangleVertices> triangles_;
};

Status SheetsWriter::Write() {
  MTDB_RETURN_IF_ERROR(sink_.Begin(MeshHeader{}));
  MTDB_RETURN_IF_ERROR(WriteBase());
  for (uint64_t i = 0; i < plan_.fins; ++i) MTDB_RETURN_IF_ERROR(WriteFin(i));
  for (uint64_t i = 0; i < plan_.flaps; ++i) MTDB_RETURN_IF_ERROR(WriteFlap(i));
  for (uint64_t i = 0; i < plan_.crumbs; ++i) MTDB_RETURN_IF_ERROR(WriteCrumb(i));
  MTDB_RETURN_IF_ERROR(Flush());
  return sink_.End();
}

// The cells of a row are written when the next row's vertices were; those of the last row, which
// need the first one's, at the end.
Status SheetsWriter::WriteBase() {
  for (uint64_t row = 0; row <= base_.rows(); ++row) {
    for (uint64_t column = 0; row < base_.rows() && column < base_.columns(); ++column) {
      AddVertex(base_.PositionAt(column, row));
      MTDB_RETURN_IF_ERROR(FlushWhenFull());
    }
    for (uint64_t column = 0; row > 0 && column < base_.columns(); ++column) {
      const std::array<TriangleVertices, 2> cell = base_.CellAt(column, row - 1);
      const std::array<bool, 2> two_sided = base_.TwoSidedAt(column, row - 1);
      for (size_t i = 0; i < 2; ++i) {
        const auto [a, b, c] = cell[i];
        AddTriangle(a, b, c);
        if (two_sided[i]) AddTriangle(a, c, b);
      }
      MTDB_RETURN_IF_ERROR(FlushWhenFull());
    }
  }
  return Status::Ok();
}

Status SheetsWriter::WriteFin(uint64_t index) {
  const Fin fin(seed_, index);
  uint64_t place = 0;
  const Corner block = BlockOf(index, plan_.fins, 1, &place);
  std::vector<uint64_t> below, above;
  std::vector<Vec3d> foot;
  std::vector<Frame> frames;
  for (uint64_t k = 0; k <= fin.length; ++k) {
    const Corner at{block.column + fin.first + k, block.row + (k <= fin.step_at ? 1u : 2u)};
    below.push_back(base_.VertexAt(at.column, at.row));
    foot.push_back(base_.PositionAt(at.column, at.row));
    frames.push_back(FrameAt(at));
  }
  for (uint64_t h = 1; h <= fin.height; ++h) {
    above.clear();
    for (uint64_t k = 0; k <= fin.length; ++k) {
      const auto up = static_cast<double>(h);
      const double wave = 1 + 0.1 * std::round(0x1p20 * std::sin(static_cast<double>(k))) * 0x1p-20;
      const Vec3d way = frames[k].up * wave + frames[k].ahead * (fin.lean * up / 6);
      above.push_back(AddVertex(foot[k] + way * (fin.pitch * up * frames[k].edge)));
    }
    for (uint64_t k = 0; k < fin.length; ++k) {
      AddTriangle(below[k], below[k + 1], above[k + 1]);
      AddTriangle(below[k], above[k + 1], above[k]);
    }
    std::swap(below, above);
  }
  return FlushWhenFull();
}

// Half of the flaps hang on an edge, half on a point.
Status SheetsWriter::WriteFlap(uint64_t index) {
  Dice dice(seed_, Dice::kFlap, index);
  uint64_t place = 0;
  Corner at = BlockOf(index, plan_.flaps, kFlapsOfBlock, &place);
  at.column += 2 + place * 8 + dice.Below(3);
  at.row += 4;
  const Frame frame = FrameAt(at);
  const Vec3d p = base_.PositionAt(at.column, at.row);
  const double size = (0.4 + 0.4 * dice.Unit()) * frame.edge;
  const uint64_t a = base_.VertexAt(at.column, at.row);
  uint64_t b = 0, c = 0;
  if (index % 2 == 0) {
    b = base_.VertexAt(at.column + 1, at.row);
    c = AddVertex(p + frame.right * (0.5 * frame.edge) + frame.up * size);
  } else {
    b = AddVertex(p + frame.right * (0.3 * size) + frame.up * size);
    c = AddVertex(p + frame.right * (-0.4 * size) + frame.up * size);
  }
  AddTriangle(a, b, c);
  AddTriangle(a, c, b);
  return FlushWhenFull();
}

// Half of the crumbs, about, are tetrahedra, half octahedra.
Status SheetsWriter::WriteCrumb(uint64_t index) {
  const bool octahedron = IsOctahedron(seed_, index);
  Dice dice(seed_, Dice::kCrumb, index);
  dice.Unit();  // which IsOctahedron has taken
  uint64_t place = 0;
  Corner at = BlockOf(index, plan_.crumbs, kCrumbsOfBlock, &place);
  at.column += 1 + place * 3 + dice.Below(3);
  at.row += 3;
  const Frame frame = FrameAt(at);
  const Vec3d middle =
      (base_.PositionAt(at.column, at.row) + base_.PositionAt(at.column + 1, at.row + 1)) * 0.5 +
      frame.up * ((0.7 + 0.6 * dice.Unit()) * frame.edge);
  // A turn around `up`, by an angle whose tangent of the half is random.
  const double half = 2 * dice.Unit() - 1, norm = 1 / (1 + half * half);
  const double cosine = (1 - half * half) * norm, sine = 2 * half * norm;
  const double size = (octahedron ? 0.55 : 0.32) * frame.edge;
  const uint64_t first = next_vertex_;
  const auto add = [&](Vec3d corner) {
    const Vec3d turned = frame.right * (cosine * corner.x - sine * corner.y) +
                         frame.ahead * (sine * corner.x + cosine * corner.y) + frame.up * corner.z;
    AddVertex(middle + turned * size);
  };
  if (octahedron) {
    for (const Vec3d& corner : kOctahedron) add(corner);
    AddOctahedron(first);
  } else {
    for (const Vec3d& corner : kTetrahedron) add(corner);
    AddTetrahedron(first);
  }
  return FlushWhenFull();
}

void SheetsWriter::AddOctahedron(uint64_t v) {
  for (uint64_t i = 0; i < 8; ++i) {
    // One corner of each axis, in the order that is outward for their signs.
    const uint64_t x = v + (i & 1), y = v + 2 + (i >> 1 & 1), z = v + 4 + (i >> 2);
    const bool mirrored = ((i ^ i >> 1 ^ i >> 2) & 1) != 0;
    AddTriangle(x, mirrored ? z : y, mirrored ? y : z);
  }
}

void SheetsWriter::AddTetrahedron(uint64_t v) {
  AddTriangle(v, v + 1, v + 2);
  AddTriangle(v, v + 3, v + 1);
  AddTriangle(v, v + 2, v + 3);
  AddTriangle(v + 1, v + 3, v + 2);
}

SheetsWriter::Corner SheetsWriter::BlockOf(uint64_t index, uint64_t count, uint64_t of_block,
                                           uint64_t* place) const {
  const uint64_t slot = index * (blocks_ * of_block) / count;
  *place = slot % of_block;
  const uint64_t block = slot / of_block;
  return {block % blocks_across_ * kBlockColumns, block / blocks_across_ * kBlockRows};
}

SheetsWriter::Frame SheetsWriter::FrameAt(Corner corner) const {
  Frame frame;
  frame.right =
      base_.PositionAt(corner.column + 1, corner.row) - base_.PositionAt(corner.column, corner.row);
  frame.edge = Length(frame.right);
  frame.up = base_.NormalAt(corner.column, corner.row);
  frame.ahead = Cross(frame.up, frame.right);
  frame.ahead = frame.ahead * (1 / Length(frame.ahead));
  frame.right = Cross(frame.ahead, frame.up);
  return frame;
}

uint64_t SheetsWriter::AddVertex(Vec3d p) {
  vertices_.push_back({static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  return next_vertex_++;
}

Status SheetsWriter::Flush() {
  if (!vertices_.empty()) MTDB_RETURN_IF_ERROR(sink_.AddVertices(vertices_, {}));
  if (!triangles_.empty()) MTDB_RETURN_IF_ERROR(sink_.AddTriangles(triangles_));
  vertices_.clear();
  triangles_.clear();
  return Status::Ok();
}

}  // namespace

SheetsPlan PlanSheets(uint64_t triangles, uint64_t seed) {
  SheetsPlan plan;
  const bool with_all = triangles >= kMinTriangles;
  plan.fins = with_all ? triangles / kTrianglesOfFin : 0;
  plan.flaps = plan.fins * 3 / 2;
  plan.crumbs = with_all ? triangles / kTrianglesOfCrumb : 0;
  uint64_t hanging = 2 * plan.flaps;
  for (uint64_t i = 0; i < plan.fins; ++i) hanging += Fin(seed, i).triangles();
  for (uint64_t i = 0; i < plan.crumbs; ++i) hanging += IsOctahedron(seed, i) ? 8 : 4;
  // A cell has two triangles, and a third of them a copy.
  const double cells = static_cast<double>(triangles - hanging) * 3 / 8;
  const double across = std::sqrt(kAspect * cells) / static_cast<double>(kBlockColumns);
  plan.columns = kBlockColumns * std::max<uint64_t>(1, static_cast<uint64_t>(std::llround(across)));
  plan.rows = std::max<uint64_t>(
      3, static_cast<uint64_t>(std::llround(cells / static_cast<double>(plan.columns))));
  const uint64_t blocks = plan.columns / kBlockColumns * (plan.rows / kBlockRows);
  plan.fins = std::min(plan.fins, blocks);
  plan.flaps = std::min(plan.flaps, blocks * kFlapsOfBlock);
  plan.crumbs = std::min(plan.crumbs, blocks * kCrumbsOfBlock);
  for (uint64_t i = 0; i < plan.fins; ++i) {
    plan.fin_columns += Fin(seed, i).length;
    plan.fin_rows += Fin(seed, i).height;
  }
  return plan;
}

Status SendSheets(uint64_t triangles, uint64_t seed, MeshSink& sink) {
  return SheetsWriter(PlanSheets(triangles, seed), seed, sink).Write();
}

}  // namespace mtdb::internal
