// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/model.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "store/base/attribute_grid.h"
#include "store/base/bytes.h"
#include "store/base/hash.h"

namespace mtdb::everything {

namespace {

constexpr double kMaxSteps = 1 << 24;
constexpr double kHalf = 0.5 * (1 + 1e-9);

bool HasNormals(const AttributeLayout& layout) {
  const auto at = std::ranges::find(layout.attributes, "nx", &VertexAttribute::name);
  return at != layout.attributes.end();
}

// What `round` applies to: floats that are neither normals nor wild.
bool IsRounded(const VertexAttribute& a) { return a.name == "quality" || a.name == "height"; }

template <typename T>
T Load(const std::byte* p) {
  T value;
  std::memcpy(&value, p, sizeof(T));
  return value;
}
template <typename T>
void Store(T value, std::byte* p) {
  std::memcpy(p, &value, sizeof(T));
}

// Rounds a vertex's row in place; says what is wrong with the rule's own answer.
std::string RoundRow(const AttributeLayout& layout, std::byte* row) {
  for (const VertexAttribute& a : layout.attributes) {
    if (a.normal_bits > 0) {
      const Vec3d n{Load<float>(row), Load<float>(row + 4), Load<float>(row + 8)};
      const Vec3d unit = DecodeOctahedral(EncodeOctahedral(n, a.normal_bits), a.normal_bits);
      const double cosine = Dot(n, unit) / (Length(n) * Length(unit));
      const double largest = 2.13 / OctahedralCentre(a.normal_bits) + 1e-3;
      if (std::acos(std::clamp(cosine, -1.0, 1.0)) > largest) return "a normal turns too far";
      for (int i = 0; i < 3; ++i) Store(static_cast<float>(unit[i]), row + 4 * i);
    } else if (a.step > 0) {
      const bool single = a.type == ScalarType::kFloat32;
      const double value = single ? Load<float>(row) : Load<double>(row);
      const int64_t code = ScalarCode(value, a.step);
      const double rounded = single ? Float32OfCode(code, a.step) : Float64OfCode(code, a.step);
      const double ulp = std::abs(value) * (single ? 0x1p-23 : 0x1p-51);
      if (std::abs(rounded - value) > a.step * kHalf + ulp) return "a scalar moves too far";
      if (single) Store(static_cast<float>(rounded), row);
      if (!single) Store(rounded, row);
    }
    row += ScalarSize(a.type);
  }
  return "";
}

double StepOf(const Truth& truth, int bits) {
  return truth.longest() / static_cast<double>((int64_t{1} << bits) - 1);
}

// The part of the triangles that have an area, and that rounding to `step` leaves without one, or
// nearly.
double FlatShare(const Truth& truth, double step) {
  const auto height = [](Vec3d a, Vec3d b, Vec3d c) {
    const double longest = std::max({Length(b - a), Length(c - b), Length(a - c)});
    return longest > 0 ? Length(Cross(b - a, c - a)) / longest : 0.0;
  };
  uint64_t solid = 0, flat = 0;
  for (const TriangleVertices& t : truth.mesh.triangles) {
    std::array<Vec3d, 3> p, rounded;
    for (size_t c = 0; c < 3; ++c) {
      p[c] = truth.mesh.positions[t[c]];
      for (int i = 0; i < 3; ++i) rounded[c][i] = std::nearbyint(p[c][i] / step);
    }
    if (height(p[0], p[1], p[2]) < 1e-6 * truth.longest()) continue;
    ++solid;
    flat += height(rounded[0], rounded[1], rounded[2]) < 0.5;
  }
  return solid == 0 ? 0 : static_cast<double>(flat) / static_cast<double>(solid);
}

// The part of the triangles that have an area as exact as their coordinates are, and none on the
// grid.
double LostShare(const Truth& truth, const Grid& grid) {
  uint64_t solid = 0, lost = 0;
  for (const TriangleVertices& t : truth.mesh.triangles) {
    std::array<Vec3d, 3> p, on;
    double far = 0;
    for (size_t c = 0; c < 3; ++c) {
      p[c] = truth.mesh.positions[t[c]];
      on[c] = ToDouble(grid.Quantize(p[c]));
      far = std::max(far, Length(p[c]));
    }
    const double longest = std::max({Length(p[1] - p[0]), Length(p[2] - p[0]), 1e-300});
    if (Length(Cross(p[1] - p[0], p[2] - p[0])) / longest < 1e-5 * far) continue;
    ++solid;
    lost += Cross(on[1] - on[0], on[2] - on[0]) == Vec3d{};
  }
  return solid == 0 ? 0 : static_cast<double>(lost) / static_cast<double>(solid);
}

}  // namespace

std::vector<std::string> StoredObject::Options() const {
  std::vector<std::string> options;
  if (lossless) options.emplace_back("--lossless");
  if (step > 0) {
    options.push_back("--step=" + NumberText(step));
  } else if (!lossless && bits > 0) {
    options.push_back("--bits=" + std::to_string(bits));
  }
  if (truth.weld) options.push_back("--weld=" + NumberText(*truth.weld));
  if (truth.keep_apart) options.emplace_back("--no-weld");
  if (truth.orient) options.emplace_back("--orient");
  if (normal_bits > 0) options.push_back("--normal-bits=" + std::to_string(normal_bits));
  for (const VertexAttribute& a : truth.mesh.header.attributes.attributes) {
    if (round > 0 && IsRounded(a)) {
      options.push_back("--attribute-step=" + a.name + "=" + NumberText(round));
    }
  }
  return options;
}

std::string StoredObject::Refusal() const {
  if (truth.mesh.triangles.empty()) return "no triangles";
  if (lossless && !truth.fits_float) return "doubles cannot be kept lossless";
  if (step > 0 && !(truth.longest() / step < kMaxSteps * (1 - 1e-9))) return "too many steps";
  return "";
}

StoredObject Planned(const Step& step, const Truth& truth) {
  StoredObject object;
  object.truth = truth;
  object.lossless = step.Flag("lossless");
  object.bits = static_cast<int>(std::clamp<int64_t>(step.Int("bits", 16), 0, 24));
  if (step.has("step") && !object.lossless && truth.longest() > 0) {
    object.step = step.Number("step", 0.001) * truth.longest();
  }
  // Half of the triangles without area would be refused.
  while (object.step > 0 && FlatShare(truth, object.step) > 0.3) object.step /= 2;
  while (object.step == 0 && object.bits > 0 && object.bits < 16 && !object.lossless &&
         FlatShare(truth, StepOf(truth, object.bits)) > 0.3) {
    ++object.bits;
  }
  if (HasNormals(truth.mesh.header.attributes)) {
    object.normal_bits = step.has("normals")
                             ? static_cast<int>(std::clamp<int64_t>(step.Int("normals", 8), 4, 16))
                             : 0;
  }
  object.round = std::max(0.0, step.Number("round", 0));
  return object;
}

std::string Settle(const ObjectRecord& record, StoredObject* object) {
  const Truth& truth = object->truth;
  object->grid = record.grid;
  object->layout = truth.mesh.header.attributes;
  object->root_triangles = record.root_triangles;
  object->diagonal = record.diagonal();
  for (VertexAttribute& a : object->layout.attributes) {
    if (a.name == "nx") a.normal_bits = static_cast<uint8_t>(object->normal_bits);
    if (IsRounded(a)) a.step = object->round;
  }
  if (record.attributes != object->layout) return "the record's attributes are not the input's";
  const Grid& grid = record.grid;
  if ((grid.mode == PositionMode::kLossless) != object->lossless) return "another grid";
  if (!object->lossless) {
    const double wanted =
        object->step > 0 ? object->step : StepOf(truth, std::max(1, object->bits));
    if ((object->step > 0 || object->bits > 0) && truth.longest() > 0 &&
        std::abs(grid.step - wanted) > 1e-12 * wanted) {
      return "the grid's step is " + NumberText(grid.step) + ", not " + NumberText(wanted);
    }
  }
  if (grid.mode == PositionMode::kGrid && LostShare(truth, grid) > 0.55) {
    return "most triangles lost their area, and nobody said so";
  }
  const InputReport& in = record.input;
  const auto same = [](uint64_t found, uint64_t expected, const char* what) {
    return found == expected ? std::string()
                             : std::string(what) + ": " + std::to_string(found) + ", expected " +
                                   std::to_string(expected);
  };
  for (const std::string& fault :
       {same(in.vertices, truth.report.vertices, "input vertices"),
        same(in.triangles, truth.report.triangles, "input triangles"),
        same(in.degenerate_triangles, truth.report.degenerate_triangles, "degenerate triangles"),
        same(in.duplicate_triangles, truth.report.duplicate_triangles, "duplicate triangles"),
        same(in.turned_triangles, truth.report.turned_triangles, "turned triangles"),
        truth.orient
            ? same(in.unorientable_sheets, truth.report.unorientable_sheets, "unorientable sheets")
            : "",
        same(in.two_sided_triangles, truth.report.two_sided_triangles, "two-sided triangles"),
        same(in.unreferenced_vertices, truth.report.unreferenced_vertices, "unused vertices"),
        same(record.triangles, truth.mesh.triangles.size(), "triangles"),
        same(record.components, truth.topology.components, "components"),
        same(static_cast<uint64_t>(record.euler_characteristic),
             static_cast<uint64_t>(truth.topology.euler_characteristic), "Euler characteristic")}) {
    if (!fault.empty()) return fault;
  }
  // The input on the grid.
  TriangleMesh mesh = truth.mesh;
  const size_t row_bytes = object->layout.row_bytes();
  object->displaced = 0;
  object->vertices.clear();
  std::vector<bool> used(mesh.positions.size(), false);
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex v : t) used[v] = true;
  }
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    if (!used[v]) continue;
    Vec3d& p = mesh.positions[v];
    const Vec3d before = p;
    if (!object->lossless) {
      for (int i = 0; i < 3; ++i) {
        p[i] = grid.origin[i] + grid.step * std::floor((p[i] - grid.origin[i]) / grid.step + 0.5);
      }
    }
    object->displaced = std::max(object->displaced, Length(p - before));
    const std::string fault = RoundRow(object->layout, mesh.rows.data() + v * row_bytes);
    if (!fault.empty()) return fault;
    object->vertices.insert(VertexKey(mesh, v, false, row_bytes));
  }
  object->displaced += truth.moved;
  object->mesh = std::move(mesh);
  return "";
}

std::string VertexKey(const TriangleMesh& mesh, VertexIndex v, bool as_float, size_t row_bytes) {
  std::string key;
  const Vec3d p = mesh.positions[v];
  for (int i = 0; i < 3; ++i) {
    const double value = p[i] + 0.0;
    const auto single = static_cast<float>(value);
    key.append(
        as_float ? reinterpret_cast<const char*>(&single) : reinterpret_cast<const char*>(&value),
        as_float ? sizeof(single) : sizeof(value));
  }
  const size_t stride = mesh.header.attributes.row_bytes();
  const ByteSpan row = ByteSpan(mesh.rows).subspan(v * stride, row_bytes);
  constexpr size_t kMaxRow = 64;
  if (row_bytes <= kMaxRow) {
    key += AsString(row);
  } else {
    key += std::to_string(Hash64(row));
  }
  return key;
}

std::vector<std::string> TriangleKeys(const TriangleMesh& mesh, bool as_float, size_t row_bytes) {
  std::vector<std::string> keys;
  for (const TriangleVertices& t : mesh.triangles) {
    std::array<std::string, 3> corner;
    for (size_t c = 0; c < 3; ++c) corner[c] = VertexKey(mesh, t[c], as_float, row_bytes);
    keys.push_back(std::min({corner[0] + corner[1] + corner[2], corner[1] + corner[2] + corner[0],
                             corner[2] + corner[0] + corner[1]}));
  }
  std::ranges::sort(keys);
  return keys;
}

}  // namespace mtdb::everything
