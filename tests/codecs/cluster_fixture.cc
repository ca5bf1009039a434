// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/cluster_fixture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <set>

#include "store/base/attribute_grid.h"
#include "store/base/grid.h"
#include "store/base/in_circle.h"
#include "tests/codecs/book_fixture.h"

namespace mtdb::testing {

namespace {

using Corners = std::array<uint32_t, 3>;

Corners FromSmallest(Corners t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

class Decimator {
 public:
  Decimator(const ClusterOptions& options, ClusterUpdates& updates)
      : options_(options), updates_(updates), random_(options.seed) {}

  void MakeSurface() {
    const int side = options_.side;
    const bool torus = options_.surface == Surface::kTorus;
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) updates_.positions.push_back(Place(x, y));
    }
    const int cells = torus ? side : side - 1;
    const auto at = [&](int x, int y) { return static_cast<uint32_t>(y % side * side + x % side); };
    for (int y = 0; y < cells; ++y) {
      for (int x = 0; x < cells; ++x) {
        Add({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
        if (options_.pierced && x == side / 2 && y == side / 2) {
          pierced_corner_ = at(x, y);
          continue;
        }
        Add({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
      }
    }
  }

  void Decimate() {
    std::vector<uint32_t> order(updates_.positions.size());
    for (uint32_t v = 0; v < order.size(); ++v) order[v] = v;
    const auto stay = static_cast<size_t>(options_.keep * static_cast<double>(order.size()));
    size_t left = order.size();
    if (options_.pierced) left -= Remove(pierced_corner_, true);
    for (int pass = 0; pass < 4 && left > stay; ++pass) {
      std::shuffle(order.begin(), order.end(), random_);
      for (const uint32_t v : order) {
        if (left > stay) left -= Remove(v, false);
      }
    }
  }

 private:
  Vec3i Place(int x, int y) {
    const auto wild = [&] { return static_cast<int32_t>(random_()); };
    const auto noise = [&](int amount) {
      return static_cast<int32_t>(random_() % static_cast<uint32_t>(amount)) - amount / 2;
    };
    switch (options_.numbers) {
      case Numbers::kWild: return {wild(), wild(), wild()};
      case Numbers::kCoincident: return {x / 4, y / 4, 0};
      case Numbers::kLossless:
        return {OrderedFromFloat(static_cast<float>(x - 7) * 0.37f),
                OrderedFromFloat(static_cast<float>(y - 9) * 0.21f),
                OrderedFromFloat(static_cast<float>(noise(1000)) * 1e-3f)};
      case Numbers::kGrid: break;
    }
    return {256 * x + noise(120), 256 * y + noise(120), noise(40) + 3 * (x - y) * (x - y)};
  }

  void Add(Corners t) {
    const auto id = static_cast<uint32_t>(updates_.triangles.size());
    updates_.triangles.push_back(t);
    for (size_t i = 0; i < 3; ++i) {
      around_[t[i]].insert(id);
      edges_.insert({t[i], t[(i + 1) % 3]});
    }
  }
  void Erase(uint32_t id) {
    const Corners& t = updates_.triangles[id];
    for (size_t i = 0; i < 3; ++i) {
      around_[t[i]].erase(id);
      edges_.erase({t[i], t[(i + 1) % 3]});
    }
  }
  bool Joined(uint32_t a, uint32_t b) const {
    return edges_.contains({a, b}) || edges_.contains({b, a});
  }

  // Returns whether it removed `v`.
  bool Remove(uint32_t v, bool may_close) {
    std::map<uint32_t, uint32_t> next;
    std::set<uint32_t> targets;
    for (const uint32_t id : around_[v]) {
      Corners t = updates_.triangles[id];
      std::rotate(t.begin(), std::find(t.begin(), t.end(), v), t.end());
      if (!next.emplace(t[1], t[2]).second) return false;
      targets.insert(t[2]);
    }
    std::vector<uint32_t> starts;
    for (const auto& [from, to] : next) {
      if (!targets.contains(from)) starts.push_back(from);
    }
    if (next.empty() || starts.size() > 1) return false;
    const bool boundary = !starts.empty();
    std::vector<uint32_t> ring{boundary ? starts[0] : next.begin()->first};
    while (next.contains(ring.back()) && next[ring.back()] != ring[0]) {
      ring.push_back(next[ring.back()]);
    }
    const size_t k = ring.size();
    if (k < 3 || k > 9 || next.size() != (boundary ? k - 1 : k)) return false;
    if (boundary && !may_close && Joined(ring[0], ring[k - 1])) return false;
    const size_t turn = random_() % k;
    std::vector<uint32_t> fan;
    for (size_t i = 0; i < k; ++i) fan.push_back(ring[(turn + i) % k]);
    for (size_t i = 2; i + 1 < k; ++i) {
      if (Joined(fan[0], fan[i])) return false;
    }
    ClusterUpdates::Node node;
    node.vertex = v;
    node.error_code = static_cast<uint8_t>(110 + random_() % 24);
    node.star_begin = static_cast<uint32_t>(updates_.stars.size());
    node.star_count = static_cast<uint32_t>(next.size());
    node.hole_begin = static_cast<uint32_t>(updates_.holes.size());
    node.hole_count = static_cast<uint32_t>(k - 2);
    const std::set<uint32_t> star = around_[v];
    updates_.stars.insert(updates_.stars.end(), star.begin(), star.end());
    for (const uint32_t id : star) Erase(id);
    for (size_t i = 1; i + 1 < k; ++i) {
      updates_.holes.push_back(static_cast<uint32_t>(updates_.triangles.size()));
      Add({fan[0], fan[i], fan[i + 1]});
    }
    updates_.nodes.push_back(node);
    return true;
  }

  const ClusterOptions& options_;
  ClusterUpdates& updates_;
  std::mt19937 random_;
  uint32_t pierced_corner_ = 0;
  std::map<uint32_t, std::set<uint32_t>> around_;
  std::set<std::pair<uint32_t, uint32_t>> edges_;
};

void AddAttributes(ClusterFixture& fixture, uint32_t seed) {
  const ScalarType types[] = {ScalarType::kInt8,    ScalarType::kUint8,  ScalarType::kInt16,
                              ScalarType::kUint16,  ScalarType::kInt32,  ScalarType::kUint32,
                              ScalarType::kFloat32, ScalarType::kFloat64};
  int n = 0;
  for (const ScalarType type : types) {
    fixture.attributes.attributes.push_back({std::string(1, static_cast<char>('a' + n++)), type});
  }
  std::mt19937 random(seed);
  const size_t row = fixture.attributes.row_bytes();
  fixture.updates.rows.resize(fixture.updates.positions.size() * row);
  for (size_t v = 0; v < fixture.updates.positions.size(); ++v) {
    std::byte* p = fixture.updates.rows.data() + v * row;
    for (size_t i = 0; i + 12 < row; ++i) p[i] = static_cast<std::byte>(random() % 32);
    const float specials[] = {std::nanf(""), std::numeric_limits<float>::infinity(), -0.0f, 3e38f,
                              -1.5f};
    const float f = v % 3 == 0 ? specials[v / 3 % 5] : static_cast<float>(random() % 1000) * 0.01f;
    const double d = v % 7 == 0 ? std::nan("") : static_cast<double>(f) * 1e200;
    std::memcpy(p + row - 12, &f, sizeof(f));
    std::memcpy(p + row - 8, &d, sizeof(d));
  }
}

// Of a smooth surface with noise, and normals all around the sphere.
void AddRoundedAttributes(ClusterFixture& fixture, uint32_t seed) {
  constexpr int kBits = 10;
  constexpr double kSteps[] = {0.01, 3e-5};
  fixture.attributes.attributes = {{"red", ScalarType::kUint8},
                                   {"green", ScalarType::kUint8},
                                   {"blue", ScalarType::kUint8},
                                   {"nx", ScalarType::kFloat32, 0, kBits},
                                   {"ny", ScalarType::kFloat32},
                                   {"nz", ScalarType::kFloat32},
                                   {"a", ScalarType::kFloat32, kSteps[0]},
                                   {"b", ScalarType::kFloat64, kSteps[1]}};
  std::mt19937 random(seed);
  const auto noise = [&] { return static_cast<double>(random() % 1000) * 1e-3 - 0.5; };
  ByteWriter w;
  for (const Vec3i& p : fixture.updates.positions) {
    const Vec3d q{p.x / 5000.0, p.y / 5000.0, p.z / 5000.0};
    for (int i = 0; i < 3; ++i) {
      w.Put(static_cast<uint8_t>(static_cast<int>(400 * (q.x + q.y) + 9 * noise()) & 255));
    }
    const Vec3d wave{std::sin(5 * q.x) + 0.1 * noise(), std::cos(5 * q.y) + 0.1 * noise(),
                     std::sin(3 * (q.x + q.y))};
    const Vec3d normal = DecodeOctahedral(EncodeOctahedral(wave, kBits), kBits);
    for (int i = 0; i < 3; ++i) w.Put(static_cast<float>(normal[i]));
    w.Put(Float32OfCode(ScalarCode(100 * q.x + noise(), kSteps[0]), kSteps[0]));
    w.Put(Float64OfCode(ScalarCode(-7 * q.y + 0.01 * noise(), kSteps[1]), kSteps[1]));
  }
  fixture.updates.rows = w.Take();
}

// Inserts the vertices of a square one by one, in random order.
class Insertions {
 public:
  Insertions(const ClusterOptions& options, ClusterUpdates& updates)
      : options_(options), updates_(updates), random_(options.seed) {}

  void Run() {
    updates_.is_height_field = true;
    const int side = options_.side;
    for (const auto& [x, y] : {std::pair(0, 0), {side, 0}, {side, side}, {0, side}}) Add(x, y);
    updates_.triangles = {{0, 1, 2}, {0, 2, 3}};
    alive_ = {0, 1};
    std::vector<std::pair<int, int>> places;
    for (int x = 0; x <= side; ++x) {
      for (int y = 0; y <= side; ++y) {
        if ((x != 0 && x != side) || (y != 0 && y != side)) places.emplace_back(x, y);
      }
    }
    std::shuffle(places.begin(), places.end(), random_);
    places.resize(static_cast<size_t>(static_cast<double>(places.size()) * (1 - options_.keep)));
    for (const auto& [x, y] : places) Insert(x, y);
  }

 private:
  LatticePoint At(uint32_t v) const {
    return {updates_.positions[v].x - kWest, updates_.positions[v].y - kSouth};
  }
  void Add(int x, int y) {
    const double height =
        300 * std::sin(x * 0.2) * std::cos(y * 0.15) + static_cast<double>(random_() % 8);
    updates_.positions.push_back({x + kWest, y + kSouth, static_cast<int32_t>(height)});
  }
  bool IsInHole(uint32_t t, LatticePoint p) const {
    const auto& c = updates_.triangles[t];
    const LatticePoint a = At(c[0]), b = At(c[1]), d = At(c[2]);
    if (options_.surface == Surface::kOtherTerrain) {
      return Turn(a, b, p) >= 0 && Turn(b, d, p) >= 0 && Turn(d, a, p) >= 0;
    }
    const int sign = CircleSign<int64_t>(a, b, d, p);
    return sign > 0 || (sign == 0 && TieIsInCircle(a, b, d, p));
  }
  void Insert(int x, int y) {
    const auto vertex = static_cast<uint32_t>(updates_.positions.size());
    Add(x, y);
    const LatticePoint p = At(vertex);
    ClusterUpdates::Node node;
    node.vertex = vertex;
    node.error_code = static_cast<uint8_t>(100 - std::min(90u, vertex / 8));
    node.hole_begin = static_cast<uint32_t>(updates_.holes.size());
    std::set<std::pair<uint32_t, uint32_t>> edges;  // around the hole
    std::vector<uint32_t> left;
    for (const uint32_t t : alive_) {
      if (!IsInHole(t, p)) {
        left.push_back(t);
        continue;
      }
      updates_.holes.push_back(t);
      const auto& c = updates_.triangles[t];
      for (size_t i = 0; i < 3; ++i) {
        const uint32_t from = c[i], to = c[(i + 1) % 3];
        if (edges.erase({to, from}) == 0) edges.insert({from, to});
      }
    }
    node.hole_count = static_cast<uint32_t>(updates_.holes.size()) - node.hole_begin;
    node.star_begin = static_cast<uint32_t>(updates_.stars.size());
    for (const auto& [from, to] : edges) {
      if (Turn(At(from), At(to), p) == 0) continue;  // the border's edge that it splits
      left.push_back(static_cast<uint32_t>(updates_.triangles.size()));
      updates_.stars.push_back(left.back());
      updates_.triangles.push_back({vertex, from, to});
    }
    node.star_count = static_cast<uint32_t>(updates_.stars.size()) - node.star_begin;
    updates_.nodes.push_back(node);
    alive_ = std::move(left);
  }

  static constexpr int32_t kWest = -40;
  static constexpr int32_t kSouth = 1000;
  const ClusterOptions& options_;
  ClusterUpdates& updates_;
  std::mt19937 random_;
  std::vector<uint32_t> alive_;
};

}  // namespace

ClusterFixture MakeCluster(const ClusterOptions& options) {
  ClusterFixture fixture;
  if (options.surface == Surface::kTerrain || options.surface == Surface::kOtherTerrain) {
    Insertions(options, fixture.updates).Run();
    ClusterUpdates& updates = fixture.updates;
    updates.consumers.resize(updates.triangles.size());
    for (uint32_t t = 0; t < updates.triangles.size(); ++t) {
      const auto column = static_cast<uint32_t>(updates.positions[updates.triangles[t][0]].x + 40);
      const auto child = static_cast<int>(column) * (options.children + 1) / (options.side + 1);
      if (child < options.children) updates.consumers[t] = {static_cast<UnitId>(3 + 5 * child), t};
    }
    return fixture;
  }
  ClusterUpdates& updates = fixture.updates;
  if (options.surface == Surface::kBook) {
    MakeBook(options, updates);
  } else {
    Decimator decimator(options, updates);
    decimator.MakeSurface();
    decimator.Decimate();
  }
  updates.consumers.resize(updates.triangles.size());
  std::vector<bool> made(updates.triangles.size(), false);
  for (const uint32_t t : updates.holes) made[t] = true;
  for (uint32_t t = 0; t < made.size(); ++t) {
    if (made[t]) continue;
    const auto column = updates.triangles[t][0] % static_cast<uint32_t>(options.side);
    const auto child = static_cast<int>(column) * (options.children + 1) / options.side;
    if (child == options.children) continue;  // the drain
    const bool explicit_arc = options.numbers == Numbers::kCoincident;
    updates.consumers[t] = {static_cast<UnitId>(3 + 5 * child), t, explicit_arc};
  }
  if (options.attributes) AddAttributes(fixture, options.seed);
  if (options.rounded_attributes) AddRoundedAttributes(fixture, options.seed);
  return fixture;
}

InPatch MakeIn(const ClusterFixture& fixture, const EncodedCluster& encoded) {
  const ClusterUpdates& updates = fixture.updates;
  std::vector<InSlot> slots(encoded.in_triangles.size());
  for (size_t s = 0; s < slots.size(); ++s) {
    slots[s] = {encoded.in_triangles[s], encoded.in_rotations[s]};
  }
  InPatch patch = MakeInPatch(updates.triangles, updates.positions, slots);
  const auto row = static_cast<std::ptrdiff_t>(fixture.attributes.row_bytes());
  for (const VertexIndex v : patch.vertices) {
    const auto from = updates.rows.begin() + static_cast<std::ptrdiff_t>(v) * row;
    patch.rows.insert(patch.rows.end(), from, from + row);
  }
  return patch;
}

std::string Difference(const ClusterFixture& fixture, const EncodedCluster& encoded,
                       const Cluster& cluster) {
  const ClusterUpdates& updates = fixture.updates;
  const size_t row = fixture.attributes.row_bytes();
  if (cluster.nodes() != updates.nodes.size()) return "nodes";
  const uint32_t external = cluster.external_vertices();
  const auto vertex = [&](uint32_t local) {
    return local < external ? static_cast<uint32_t>(cluster.in.vertices[local])
                            : updates.nodes[encoded.node_order[local - external]].vertex;
  };
  std::map<Corners, uint32_t> ids;
  for (uint32_t t = 0; t < updates.triangles.size(); ++t) {
    ids[FromSmallest(updates.triangles[t])] = t;
  }
  std::vector<uint32_t> triangle_of_slot;
  const auto find = [&](const Corners& t) {
    const auto it = ids.find(FromSmallest({vertex(t[0]), vertex(t[1]), vertex(t[2])}));
    return it == ids.end() ? kNone32 : it->second;
  };
  for (const Corners& t : cluster.in.triangles) triangle_of_slot.push_back(find(t));
  for (NodeIndex i = 0; i < cluster.nodes(); ++i) {
    const ClusterUpdates::Node& node = updates.nodes[encoded.node_order[i]];
    const std::string where = " of node " + std::to_string(i);
    if (cluster.position(external + i) != updates.positions[node.vertex]) return "position" + where;
    if (cluster.error_codes[i] != node.error_code) return "error" + where;
    if (cluster.boundary(i) != node.boundary()) return "kind" + where;
    if (row != 0 && std::memcmp(cluster.in.rows.data() + (external + i) * row,
                                updates.rows.data() + node.vertex * row, row) != 0) {
      return "attributes" + where;
    }
    for (uint32_t s = cluster.star_begin[i]; s < cluster.star_begin[i + 1]; ++s) {
      triangle_of_slot.push_back(find(cluster.created_triangle(i, s)));
    }
    std::set<uint32_t> hole;
    for (const uint32_t s : cluster.hole(i)) hole.insert(triangle_of_slot[s]);
    const auto begin = updates.holes.begin() + node.hole_begin;
    if (hole != std::set<uint32_t>(begin, begin + node.hole_count)) return "hole" + where;
  }
  for (uint32_t s = cluster.in_triangles(); s < cluster.slots(); ++s) {
    if (triangle_of_slot[s] == kNone32) return "triangle of slot " + std::to_string(s);
    if (RemovedByNode(cluster.removers[s])) continue;
    const UnitId child = updates.consumers[triangle_of_slot[s]].child;
    const UnitId found = cluster.removers[s] == kDrain
                             ? kNone32
                             : cluster.children[ChildOrdinal(cluster.removers[s])];
    if (child != found) return "arc of slot " + std::to_string(s);
  }
  return "";
}

}  // namespace mtdb::testing
