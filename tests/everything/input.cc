// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/input.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <numeric>
#include <random>
#include <set>

#include "store/base/hash.h"
#include "tests/everything/input_files.h"
#include "tests/support/cut_mesh.h"
#include "tests/support/mesh_changes.h"
#include "tests/support/oriented_mesh.h"

namespace mtdb::everything {

namespace {

// A number from 0 to 1 that belongs to a vertex and an attribute.
double Chance(uint64_t vertex, uint64_t salt) {
  return static_cast<double>(Mix64(Mix64(vertex + 1) ^ (salt * 0x9e3779b97f4a7c15u)) >> 11) *
         0x1p-53;
}

struct Place {
  const char* name;
  double scale;
  Vec3d offset;
};
constexpr Place kPlaces[] = {
    {"unit", 1, {0, 0, 0}},           {"tiny", 1e-7, {0, 0, 0}},
    {"huge", 1e12, {-3e12, 0, 5e11}}, {"utm", 180, {500123.25, 4649776.5, 120}},
    {"side", 1, {300, -200, 40}},
};

// One kind of attribute: its scalars, and a vertex's value of the i-th.
struct AttributeKind {
  const char* name;
  std::vector<VertexAttribute> scalars;
  double (*value)(uint64_t vertex, Vec3d p, uint64_t seed, size_t i);
};

double Smooth(uint64_t vertex, Vec3d p, uint64_t seed, size_t i) {
  const auto turn = static_cast<double>(seed % 17 + 3 * i);
  return std::sin(3 * p.x + turn) + std::cos(4 * p.y) + p.z + 0.01 * Chance(vertex, seed + i);
}
double Colour(uint64_t vertex, Vec3d p, uint64_t seed, size_t i) {
  return std::clamp(128 + 40 * Smooth(vertex, p, seed, i), 2.0, 250.0);
}
// The same in 16 bits, and from 0 to 1.
double ShortColour(uint64_t vertex, Vec3d p, uint64_t seed, size_t i) {
  return 257 * Colour(vertex, p, seed, i);
}
double PartColour(uint64_t vertex, Vec3d p, uint64_t seed, size_t i) {
  return Colour(vertex, p, seed, i) / 255;
}
double Normal(uint64_t vertex, Vec3d p, uint64_t seed, size_t i) {
  Vec3d n{Smooth(vertex, p, seed, 0), Smooth(vertex, p, seed, 1), Smooth(vertex, p, seed, 2)};
  const double length = Length(n);
  if (!(length > 1e-6)) n = {0, 0, 1};
  return n[static_cast<int>(i)] / (length > 1e-6 ? length : 1);
}
double Wild(uint64_t vertex, Vec3d, uint64_t seed, size_t i) {
  switch (Mix64(vertex + seed + i) % 6) {
    case 0: return std::numeric_limits<double>::infinity();
    case 1: return -std::numeric_limits<double>::infinity();
    case 2: return 1e-42;
    case 3: return 0;
    default: return 1e30 * (Chance(vertex, seed) - 0.5);
  }
}
double Label(uint64_t vertex, Vec3d, uint64_t seed, size_t i) {
  return std::floor(1e4 * Chance(vertex / 7, seed + i)) - 5000;
}

double Sevenths(uint64_t vertex, Vec3d, uint64_t seed, size_t i) {
  return std::floor(100 * Chance(vertex / 7, seed + i));
}

const std::vector<AttributeKind>& Kinds() {
  static const std::vector<AttributeKind> kKinds = {
      {"rgb",
       {{"red", ScalarType::kUint8}, {"green", ScalarType::kUint8}, {"blue", ScalarType::kUint8}},
       Colour},
      {"normal",
       {{"nx", ScalarType::kFloat32}, {"ny", ScalarType::kFloat32}, {"nz", ScalarType::kFloat32}},
       Normal},
      {"rgb16",
       {{"diffuse_red", ScalarType::kUint16},
        {"diffuse_green", ScalarType::kUint16},
        {"diffuse_blue", ScalarType::kUint16}},
       ShortColour},
      {"rgba",
       {{"r", ScalarType::kFloat32},
        {"g", ScalarType::kFloat32},
        {"b", ScalarType::kFloat32},
        {"a", ScalarType::kFloat32}},
       PartColour},
      {"normald",
       {{"normal_x", ScalarType::kFloat64},
        {"normal_y", ScalarType::kFloat64},
        {"normal_z", ScalarType::kFloat64}},
       Normal},
      {"odd",
       {{"caf\xc3\xa9", ScalarType::kInt8},
        {"list", ScalarType::kUint16},
        {"%s%n", ScalarType::kFloat32},
        {"X", ScalarType::kFloat32}},
       Sevenths},
      {"float", {{"quality", ScalarType::kFloat32}}, Smooth},
      {"double", {{"height", ScalarType::kFloat64}}, Smooth},
      {"wild", {{"wild", ScalarType::kFloat32}}, Wild},
      {"int", {{"label", ScalarType::kInt32}}, Label},
      {"short", {{"class", ScalarType::kInt16}}, Label},
      {"byte", {{"flags", ScalarType::kUint8}}, Colour},
  };
  return kKinds;
}

template <typename T>
void Append(Bytes* rows, double value) {
  // Outside of integers' ranges there is nothing here.
  const auto typed = static_cast<T>(value);
  const auto* bytes = reinterpret_cast<const std::byte*>(&typed);
  rows->insert(rows->end(), bytes, bytes + sizeof(typed));
}

void AppendScalar(Bytes* rows, ScalarType type, double value) {
  switch (type) {
    case ScalarType::kInt8: return Append<int8_t>(rows, value);
    case ScalarType::kUint8: return Append<uint8_t>(rows, value);
    case ScalarType::kInt16: return Append<int16_t>(rows, value);
    case ScalarType::kUint16: return Append<uint16_t>(rows, value);
    case ScalarType::kInt32: return Append<int32_t>(rows, value);
    case ScalarType::kUint32: return Append<uint32_t>(rows, value);
    case ScalarType::kFloat32: return Append<float>(rows, value);
    case ScalarType::kFloat64: return Append<double>(rows, value);
  }
}

void AddAttributes(const Step& step, TriangleMesh* mesh) {
  const auto seed = static_cast<uint64_t>(step.Int("attrseed", 1));
  std::vector<const AttributeKind*> kinds;
  mesh->header.attributes.attributes.clear();
  mesh->rows.clear();
  for (const std::string& name : Split(step.Text("attr"), ',')) {
    for (const AttributeKind& k : Kinds()) {
      if (k.name != name || std::ranges::find(kinds, &k) != kinds.end()) continue;
      kinds.push_back(&k);
      for (const VertexAttribute& a : k.scalars) mesh->header.attributes.attributes.push_back(a);
    }
  }
  const auto wide = static_cast<size_t>(std::clamp<int64_t>(step.Int("wide", 0), 0, 4000));
  for (size_t i = 0; i < wide; ++i) {
    mesh->header.attributes.attributes.push_back({"w" + std::to_string(i), ScalarType::kFloat64});
  }
  mesh->rows.reserve(mesh->positions.size() * mesh->header.attributes.row_bytes());
  for (size_t v = 0; v < mesh->positions.size(); ++v) {
    for (const AttributeKind* k : kinds) {
      for (size_t i = 0; i < k->scalars.size(); ++i) {
        AppendScalar(&mesh->rows, k->scalars[i].type, k->value(v, mesh->positions[v], seed, i));
      }
    }
    for (size_t i = 0; i < wide; ++i) Append<double>(&mesh->rows, Chance(v, seed + 1000 + i));
  }
}

void MovePositions(const Step& step, TriangleMesh* mesh) {
  const std::string name = step.Text("place", "unit");
  const Place* place = &kPlaces[0];
  for (const Place& p : kPlaces) {
    if (name == p.name) place = &p;
  }
  const double cell = std::ldexp(place->scale, -static_cast<int>(step.Int("snap", 0)));
  for (Vec3d& p : mesh->positions) {
    for (int i = 0; i < 3; ++i) {
      double x = p[i] * place->scale;
      if (step.has("snap")) x = std::round(x / cell) * cell;
      p[i] = x + place->offset[i] + 0.0;  // no -0
    }
  }
  mesh->header.double_positions = step.Flag("double");
}

void Spoil(const Step& step, TriangleMesh* mesh) {
  const size_t count = mesh->positions.size();
  if (step.Flag("twins") && count > 8) {
    for (size_t v = 1; v < count; v += 7) mesh->positions[v] = mesh->positions[v - 1];
  }
  if (step.has("flipped")) {
    std::mt19937_64 random(mesh->triangles.size());
    const double part = std::clamp(step.Number("flipped", 0), 0.0, 1.0);
    for (TriangleVertices& t : mesh->triangles) {
      if (static_cast<double>(random() >> 11) * 0x1p-53 < part) std::swap(t[0], t[1]);
    }
  }
  if (step.Flag("spoilt")) {
    const TriangleVertices t = mesh->triangles[mesh->triangles.size() / 2];
    mesh->triangles.push_back({t[1], t[2], t[0]});
    mesh->triangles.insert(mesh->triangles.begin(), {t[0], t[0], t[1]});
    mesh->triangles.push_back({t[2], t[2], t[2]});
  }
}

// Some of the triangles, with the vertices that they use.
TriangleMesh Part(const TriangleMesh& whole, size_t begin, size_t end) {
  TriangleMesh part;
  part.header = whole.header;
  const size_t row = whole.header.attributes.row_bytes();
  std::map<VertexIndex, VertexIndex> number;
  for (size_t t = begin; t < end; ++t) {
    TriangleVertices corners = whole.triangles[t];
    for (VertexIndex& v : corners) {
      const auto [at, is_new] = number.emplace(v, part.positions.size());
      if (is_new) {
        part.positions.push_back(whole.positions[v]);
        const auto from = whole.rows.begin() + static_cast<std::ptrdiff_t>(v * row);
        part.rows.insert(part.rows.end(), from, from + static_cast<std::ptrdiff_t>(row));
      }
      v = at->second;
    }
    part.triangles.push_back(corners);
  }
  return part;
}

// A file without shared vertices: those of the same position are one.
TriangleMesh JoinedSoup(const TriangleMesh& mesh) {
  TriangleMesh joined;
  joined.header = mesh.header;
  std::map<Vec3d, VertexIndex> number;
  for (TriangleVertices t : mesh.triangles) {
    for (VertexIndex& v : t) {
      const Vec3d p = mesh.positions[v];
      const auto [at, is_new] = number.emplace(p, joined.positions.size());
      if (is_new) joined.positions.push_back(p);
      v = at->second;
    }
    joined.triangles.push_back(t);
  }
  return joined;
}

void AppendPart(const TriangleMesh& part, TriangleMesh* all) {
  const VertexIndex first = all->positions.size();
  all->positions.insert(all->positions.end(), part.positions.begin(), part.positions.end());
  for (TriangleVertices t : part.triangles) {
    for (VertexIndex& v : t) v += first;
    all->triangles.push_back(t);
  }
  all->header.double_positions |= part.header.double_positions;
  // Of the part's rows, what all parts have.
  const auto& theirs = part.header.attributes;
  for (size_t v = 0; v < part.positions.size(); ++v) {
    for (const VertexAttribute& a : all->header.attributes.attributes) {
      size_t offset = v * theirs.row_bytes();
      for (const VertexAttribute& b : theirs.attributes) {
        if (b == a) break;
        offset += ScalarSize(b.type);
      }
      const auto from = part.rows.begin() + static_cast<std::ptrdiff_t>(offset);
      all->rows.insert(all->rows.end(), from,
                       from + static_cast<std::ptrdiff_t>(ScalarSize(a.type)));
    }
  }
}

}  // namespace

namespace {

// For each vertex the first one that a chain of distances of at most `tolerance` connects with it.
std::vector<VertexIndex> Welded(const std::vector<Vec3d>& positions, double tolerance) {
  std::vector<VertexIndex> first(positions.size()), by_x(positions.size());
  std::iota(first.begin(), first.end(), VertexIndex{0});
  std::iota(by_x.begin(), by_x.end(), VertexIndex{0});
  std::ranges::sort(by_x, {}, [&](VertexIndex v) { return positions[v].x; });
  const auto find = [&](VertexIndex v) {
    while (first[v] != v) v = first[v] = first[first[v]];
    return v;
  };
  for (size_t i = 0; i < by_x.size(); ++i) {
    const Vec3d p = positions[by_x[i]];
    for (size_t k = i + 1; k < by_x.size() && positions[by_x[k]].x - p.x <= tolerance; ++k) {
      if (SquaredLength(positions[by_x[k]] - p) > tolerance * tolerance) continue;
      const VertexIndex a = find(by_x[i]), b = find(by_x[k]);
      first[std::max(a, b)] = std::min(a, b);
    }
  }
  for (VertexIndex& v : first) v = find(v);
  return first;
}

// Returns the number of vertices that became others.
uint64_t Weld(double tolerance, Truth* truth) {
  TriangleMesh& mesh = truth->mesh;
  const std::vector<VertexIndex> first = Welded(mesh.positions, tolerance);
  truth->weld = tolerance;
  truth->surface.positions = mesh.positions;
  uint64_t gone = 0;
  for (size_t v = 0; v < first.size(); ++v) {
    gone += first[v] != v ? 1 : 0;
    truth->moved = std::max(truth->moved, Length(mesh.positions[v] - mesh.positions[first[v]]));
  }
  truth->surface.triangles = mesh.triangles;
  for (TriangleVertices& t : mesh.triangles) {
    for (VertexIndex& v : t) v = first[v];
  }
  return gone;
}

// Where it was cut. Returns the number of vertices that became others.
uint64_t Join(Truth* truth) {
  TriangleMesh& mesh = truth->mesh;
  const mtdb::testing::JoinedSeams joined = mtdb::testing::JoinSeamsByDefinition(mesh);
  if (joined.gone == 0) return 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (VertexIndex& v : mesh.triangles[t]) v = joined.first[v];
    if (!joined.has_area[t]) mesh.triangles[t][1] = mesh.triangles[t][0];
  }
  return joined.gone;
}

}  // namespace

double Truth::longest() const {
  const Vec3d size = bounds.max - bounds.min;
  return std::max({size.x, size.y, size.z});
}

std::vector<std::string> AttributeKinds() {
  std::vector<std::string> names;
  for (const AttributeKind& k : Kinds()) names.emplace_back(k.name);
  return names;
}

Truth MakeTruth(const std::vector<TriangleMesh>& parts, const std::vector<bool>& soup,
                std::optional<double> weld, bool keep_apart, bool orient) {
  Truth truth;
  truth.orient = orient;
  truth.keep_apart = keep_apart;
  TriangleMesh& mesh = truth.mesh;
  mesh.header.attributes = parts[0].header.attributes;
  for (const TriangleMesh& part : parts) {
    const auto& theirs = part.header.attributes.attributes;
    std::erase_if(mesh.header.attributes.attributes, [&](const VertexAttribute& a) {
      return std::ranges::find(theirs, a) == theirs.end();
    });
  }
  const bool all_soup = std::ranges::find(soup, false) == soup.end();
  for (size_t i = 0; i < parts.size(); ++i) {
    AppendPart(soup[i] && !all_soup ? JoinedSoup(parts[i]) : parts[i], &mesh);
  }
  if (all_soup) mesh = JoinedSoup(mesh);
  truth.report.vertices = mesh.positions.size();
  truth.report.triangles = mesh.triangles.size();
  for (const Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i)
      truth.fits_float &= static_cast<double>(static_cast<float>(p[i])) == p[i];
  }
  uint64_t gone = 0;
  if (weld) {
    gone = Weld(*weld, &truth);
  } else if (!keep_apart && !all_soup) {
    gone = Join(&truth);
  }
  if (orient) {
    const auto oriented = mtdb::testing::OrientByDefinition(mesh.triangles);
    mtdb::testing::TurnOver(oriented, &mesh.triangles);
    truth.report.turned_triangles = oriented.turned_triangles;
    truth.report.unorientable_sheets = oriented.unorientable_sheets;
  }
  // Degenerate and duplicate triangles are none.
  std::set<TriangleVertices> seen;
  std::vector<TriangleVertices> kept, kept_before;
  std::vector<bool> used(mesh.positions.size(), false);
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const TriangleVertices& t = mesh.triangles[i];
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      ++truth.report.degenerate_triangles;
      continue;
    }
    const TriangleVertices rotated =
        std::min({t, TriangleVertices{t[1], t[2], t[0]}, TriangleVertices{t[2], t[0], t[1]}});
    if (!seen.insert(rotated).second) {
      ++truth.report.duplicate_triangles;
      continue;
    }
    const auto [a, b, c] = rotated;
    truth.report.two_sided_triangles += seen.contains({a, c, b});
    kept.push_back(rotated);
    if (weld) kept_before.push_back(truth.surface.triangles[i]);
    for (const VertexIndex v : t) used[v] = true;
  }
  mesh.triangles = std::move(kept);
  truth.surface.triangles = std::move(kept_before);
  for (size_t v = 0; v < used.size(); ++v) {
    if (used[v]) truth.bounds.Add(mesh.positions[v]);
    if (!used[v]) ++truth.report.unreferenced_vertices;
  }
  truth.report.unreferenced_vertices -= gone;
  mesh.header.vertex_count = mesh.positions.size();
  mesh.header.triangle_count = mesh.triangles.size();
  truth.topology = mtdb::testing::CheckMesh(mesh);
  truth.tree = std::make_shared<DistanceTree>(truth.original());
  return truth;
}

namespace {

// Whether the text of a coordinate, the shortest that there is, is that of the nearest float32,
// rounded to as many digits: then --lossless takes it for that float32.
bool IsTextOfFloat(double value) {
  const std::string text = NumberText(value);
  const std::string mantissa = text.substr(0, text.find('e'));
  int digits = 0, zeros = 0;
  for (const char c : mantissa) {
    if (c < '0' || c > '9') continue;
    if (c == '0' && digits == 0) continue;
    ++digits;
    zeros = c == '0' ? zeros + 1 : 0;
  }
  if (digits == 0) return true;
  const int power = static_cast<int>(std::floor(std::log10(std::abs(value))));
  const double unit = std::pow(10.0, power + 1 - (digits - zeros));
  return std::abs(static_cast<double>(static_cast<float>(value)) - value) <=
         0.5 * unit * (1 + 1e-9);
}

// Of the box of the vertices that triangles use.
double LongestSide(const TriangleMesh& mesh) {
  Box3d bounds;
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex v : t) bounds.Add(mesh.positions[v]);
  }
  if (bounds.empty()) return 0;
  const Vec3d size = bounds.max - bounds.min;
  return std::max({size.x, size.y, size.z});
}

}  // namespace

TextDress DressOf(const Step& step) {
  const std::string end = step.Text("lineend", "lf");
  return {step.Flag("polygons"), step.Flag("bom"),
          end == "cr"     ? "\r"
          : end == "crlf" ? "\r\n"
                          : "\n"};
}

Input MakeInput(const Step& step, const std::string& folder) {
  const int64_t size = std::clamp<int64_t>(step.Int("size", 100), 1, 4'000'000);
  TriangleMesh mesh =
      MakeShape(step.Text("shape", "sheet"), size, static_cast<uint64_t>(step.Int("shapeseed", 1)));
  if (step.Flag("polygons")) AddDarts(static_cast<uint64_t>(step.Int("shapeseed", 1)), &mesh);
  Spoil(step, &mesh);
  AddAttributes(step, &mesh);
  MovePositions(step, &mesh);
  // Draco's library encodes some meshes of loose triangles so that it cannot decode them.
  if (step.has("cut") && step.Text("format", "ply").find("drc") == std::string::npos) {
    mesh = mtdb::testing::CutMesh(mesh, std::clamp(step.Number("cut", 1), 0.0, 1.0), 1);
  }
  if (step.has("far")) {
    mesh.positions.push_back(mesh.positions[0] -
                             Vec3d{1, 0.5, 0} * (step.Number("far", 1e6) * LongestSide(mesh)));
    mesh.rows.insert(mesh.rows.end(), mesh.header.attributes.row_bytes(), std::byte{1});
    const TriangleVertices first = mesh.triangles[0];
    mesh.triangles.push_back({first[0], first[1], mesh.positions.size() - 1});
  }
  if (step.Flag("stray")) {
    mesh.positions.push_back(mesh.positions[0] +
                             Vec3d{1, -2, 3} * (1e9 * Length(mesh.positions[0] + Vec3d{1, 1, 1})));
    mesh.rows.insert(mesh.rows.end(), mesh.header.attributes.row_bytes(), std::byte{1});
  }
  std::optional<double> weld;
  if (step.has("weld")) weld = std::max(0.0, step.Number("weld", 0)) * LongestSide(mesh);
  const auto files = static_cast<size_t>(std::clamp<int64_t>(step.Int("files", 1), 1, 20));
  const std::vector<std::string> formats = Split(step.Text("format", "ply"), ',');
  Input input;
  std::vector<TriangleMesh> parts;
  std::vector<bool> soup;
  bool text = false, says_double = false;
  for (size_t i = 0; i < files; ++i) {
    const size_t n = mesh.triangles.size();
    parts.push_back(files == 1 ? mesh : Part(mesh, n * i / files, n * (i + 1) / files));
    if (parts.back().triangles.empty()) {
      parts.pop_back();
      continue;
    }
    const FileFormat& format = FormatOf(formats[std::min(i, formats.size() - 1)]);
    const std::string stem = step.Text("stem", "mesh");
    input.paths.push_back(folder + "/" + stem + (i == 0 ? "" : std::to_string(i)) +
                          format.extension);
    if (step.Flag("gzip")) input.paths.back() += ".gz";
    WriteInputFile(format, input.paths.back(), DressOf(step), &parts.back());
    if (input.standard_input.empty() && step.Flag("stdin")) {
      input.standard_input = std::exchange(input.paths.back(), "-");
      input.format = format.extension + 1;
    }
    soup.push_back(format.soup);
    text |= format.is_text;
    says_double |= format.typed && !format.floats_only && step.Flag("double");
  }
  if (step.Flag("order")) {
    std::ranges::reverse(parts);
    std::ranges::reverse(input.paths);
    std::reverse(soup.begin(), soup.end());
  }
  // Attributes that are rounded may agree when those of the files do not.
  const bool keep_apart = !weld && (step.Flag("apart") || step.has("normals") || step.has("round"));
  input.truth = MakeTruth(parts, soup, weld, keep_apart, step.Flag("orient"));
  // Text does not say whether its numbers are float32; what may be is taken for it.
  const auto meant = [](Vec3d p) {
    return IsTextOfFloat(p.x) && IsTextOfFloat(p.y) && IsTextOfFloat(p.z);
  };
  if (step.Flag("lossless") && !input.truth.fits_float && text && !says_double &&
      std::ranges::all_of(input.truth.mesh.positions, meant)) {
    for (TriangleMesh& part : parts) mtdb::testing::RoundToFloat32(&part);
    input.truth = MakeTruth(parts, soup, weld, keep_apart, step.Flag("orient"));
  }
  return input;
}

}  // namespace mtdb::everything
