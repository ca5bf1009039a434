// SPDX-License-Identifier: Apache-2.0
#include "tests/query/mt_fixture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "codecs/cluster/cluster_codec.h"
#include "codecs/cluster/root_codec.h"
#include "store/base/surface_digest.h"

namespace mtdb::testing {
namespace {

using Corners3 = std::array<uint32_t, 3>;

struct Mesh {
  std::vector<Vec3d> positions;
  std::vector<Corners3> triangles;
};

// A grid of quads, closed or not along either side.
Mesh GridMesh(int w, int h, bool close_u, bool close_v,
              const std::function<Vec3d(double, double)>& at) {
  Mesh mesh;
  const int nu = close_u ? w : w + 1;
  const int nv = close_v ? h : h + 1;
  for (int v = 0; v < nv; ++v) {
    for (int u = 0; u < nu; ++u) mesh.positions.push_back(at(1.0 * u / w, 1.0 * v / h));
  }
  const auto id = [&](int u, int v) { return static_cast<uint32_t>((v % nv) * nu + u % nu); };
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const uint32_t a = id(u, v), b = id(u + 1, v), c = id(u + 1, v + 1), d = id(u, v + 1);
      if ((u + v) % 2 == 0) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, c, d});
      }
    }
  }
  return mesh;
}

Mesh SphereMesh(int n) {
  // A tube of quads with two caps.
  Mesh mesh = GridMesh(n, n, true, false, [n](double u, double v) {
    const double phi = 2 * M_PI * u;
    const double theta = M_PI * (v * n + 1) / (n + 2);
    return Vec3d{std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
  });
  const auto top = static_cast<uint32_t>(mesh.positions.size());
  mesh.positions.push_back({0, 0, 1});
  mesh.positions.push_back({0, 0, -1});
  const auto side = static_cast<uint32_t>(n);
  for (uint32_t u = 0; u < side; ++u) {
    const uint32_t next = (u + 1) % side;
    mesh.triangles.push_back({top, next, u});
    mesh.triangles.push_back({top + 1, side * side + u, side * side + next});
  }
  return mesh;
}

Mesh MakeShape(Shape shape, int n) {
  switch (shape) {
    case Shape::kSphere: return SphereMesh(n);
    case Shape::kTorus:
      return GridMesh(n, n, true, true, [](double u, double v) {
        const double r = 1 + 0.4 * std::cos(2 * M_PI * v);
        return Vec3d{r * std::cos(2 * M_PI * u), r * std::sin(2 * M_PI * u),
                     0.4 * std::sin(2 * M_PI * v)};
      });
    case Shape::kSheet:
      return GridMesh(n, n, false, false, [](double u, double v) {
        return Vec3d{2 * u - 1, 2 * v - 1, 0.3 * std::sin(7 * u) * std::cos(5 * v)};
      });
    case Shape::kTube:
      return GridMesh(n, n, true, false, [](double u, double v) {
        return Vec3d{std::cos(2 * M_PI * u), std::sin(2 * M_PI * u), 2 * v - 1};
      });
  }
  return {};
}

// Decimates tile after tile, round after round, and writes down what it does.
class MtBuilder {
 public:
  explicit MtBuilder(const MtOptions& options)
      : options_(options),
        random_(options.seed),
        source_(std::make_shared<MemoryClusterSource>()) {}

  MtFixture Build() {
    MakeInput();
    int tiles = options_.tiles;
    for (int round = 1; round <= options_.rounds; ++round) {
      DecimateRound(round, tiles);
      tiles = std::max(1, tiles / 2);
    }
    MakeRoot();
    FillRecord();
    return {std::move(mt_), std::move(rows_), source_};
  }

 private:
  struct Live {
    uint32_t tile = 0;
    ClusterUpdates::Consumer consumer;
  };

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  uint32_t Below(size_t n) {
    return std::uniform_int_distribution<uint32_t>(0, static_cast<uint32_t>(n) - 1)(random_);
  }

  void MakeInput() {
    const Mesh mesh = MakeShape(options_.shape, options_.resolution);
    const double scale = options_.coincident ? 3 : 20000;
    for (const Vec3d& p : mesh.positions) {
      const auto round = [&](double x) {
        return static_cast<int32_t>(std::lround(scale * (x + Uniform(-0.02, 0.02))));
      };
      mt_.positions.push_back({round(p.x), round(p.y), round(p.z)});
      for (int i = 0; i < 5; ++i) rows_.push_back(static_cast<std::byte>(Below(256)));
    }
    if (!options_.attributes) rows_.clear();
    around_.resize(mt_.positions.size());
    for (const Corners3& t : mesh.triangles) AddTriangle(t, {});
    input_triangles_ = static_cast<uint32_t>(mt_.triangles.size());
  }

  void AddTriangle(Corners3 corners, ClusterUpdates::Consumer consumer) {
    const auto id = static_cast<uint32_t>(mt_.triangles.size());
    mt_.triangles.push_back({corners, -1, -1});
    live_.push_back({0, consumer});
    Attach(id);
  }
  void Attach(uint32_t id) {
    const Corners3& t = mt_.triangles[id].vertices;
    current_.insert(id);
    for (size_t c = 0; c < 3; ++c) {
      around_[t[c]].insert(id);
      ++edges_[std::minmax(t[c], t[(c + 1) % 3])];
    }
  }
  void Detach(uint32_t id) {
    const Corners3& t = mt_.triangles[id].vertices;
    current_.erase(id);
    for (size_t c = 0; c < 3; ++c) {
      around_[t[c]].erase(id);
      const auto it = edges_.find(std::minmax(t[c], t[(c + 1) % 3]));
      if (--it->second == 0) edges_.erase(it);
    }
  }

  void DecimateRound(int round, int tiles) {
    // Tiles: Voronoi cells of random centres.
    std::vector<Vec3d> centres;
    for (int i = 0; i < tiles; ++i) {
      centres.push_back(ToDouble(mt_.positions[Below(mt_.positions.size())]));
    }
    for (const uint32_t id : current_) {
      const Vec3d p = ToDouble(mt_.positions[mt_.triangles[id].vertices[0]]);
      const auto nearest =
          std::min_element(centres.begin(), centres.end(), [&](const Vec3d& a, const Vec3d& b) {
            return SquaredLength(a - p) < SquaredLength(b - p);
          });
      live_[id].tile = static_cast<uint32_t>(nearest - centres.begin());
    }
    for (uint32_t tile = 0; tile < static_cast<uint32_t>(tiles); ++tile) {
      DecimateTile(round, tile);
    }
  }

  void DecimateTile(int round, uint32_t tile) {
    std::set<uint32_t> vertices;
    std::set<uint32_t> locked;
    for (uint32_t v = 0; v < around_.size(); ++v) {
      bool here = false;
      bool elsewhere = false;
      for (const uint32_t id : around_[v]) (live_[id].tile == tile ? here : elsewhere) = true;
      if (here && elsewhere) locked.insert(v);
      if (here && !elsewhere) vertices.insert(v);
    }
    const auto target = static_cast<size_t>(static_cast<double>(vertices.size()) * options_.keep);
    const auto first_node = static_cast<int>(mt_.nodes.size());
    for (size_t tries = 0; vertices.size() > target && tries < 400; ++tries) {
      if (mt_.nodes.size() >= options_.max_nodes) break;
      auto it = vertices.begin();
      std::advance(it, Below(vertices.size()));
      if (RemoveVertex(*it, tile, locked)) vertices.erase(it);
    }
    if (static_cast<int>(mt_.nodes.size()) > first_node) MakeCluster(round, first_node);
  }

  // The vertices around v in order; empty when they are not one cycle or one path.
  std::vector<uint32_t> Ring(uint32_t v, bool* boundary) const {
    std::map<uint32_t, uint32_t> next;
    std::set<uint32_t> arrivals;
    for (const uint32_t id : around_[v]) {
      const Corners3& t = mt_.triangles[id].vertices;
      const size_t c = static_cast<size_t>(std::find(t.begin(), t.end(), v) - t.begin());
      const uint32_t a = t[(c + 1) % 3];
      const uint32_t b = t[(c + 2) % 3];
      if (!next.emplace(a, b).second || !arrivals.insert(b).second) return {};
    }
    if (next.empty()) return {};
    uint32_t start = next.begin()->first;
    *boundary = false;
    for (const auto& [a, b] : next) {
      if (!arrivals.contains(a)) {
        start = a;
        *boundary = true;
      }
    }
    std::vector<uint32_t> ring{start};
    uint32_t at = start;
    for (size_t i = 0; i < next.size(); ++i) {
      if (!next.contains(at)) return {};
      at = next.at(at);
      if (at == start) break;
      ring.push_back(at);
    }
    const size_t expected = next.size() + (*boundary ? 1 : 0);
    return ring.size() == expected ? ring : std::vector<uint32_t>{};
  }

  // A random triangulation of ring[i..j]; false when a diagonal is forbidden.
  bool Triangulate(const std::vector<uint32_t>& ring, size_t i, size_t j,
                   const std::set<uint32_t>& locked, std::vector<Corners3>& out) {
    if (j - i < 2) return true;
    const size_t m = i + 1 + Below(j - i - 1);
    out.push_back({ring[i], ring[m], ring[j]});
    for (const auto& [a, b] : {std::pair(i, m), std::pair(m, j)}) {
      if (b - a > 1 && !MayCreateEdge(ring[a], ring[b], locked)) return false;
    }
    return Triangulate(ring, i, m, locked, out) && Triangulate(ring, m, j, locked, out);
  }
  bool MayCreateEdge(uint32_t a, uint32_t b, const std::set<uint32_t>& locked) const {
    return !edges_.contains(std::minmax(a, b)) && !(locked.contains(a) && locked.contains(b));
  }

  bool RemoveVertex(uint32_t v, uint32_t tile, const std::set<uint32_t>& locked) {
    bool boundary = false;
    const std::vector<uint32_t> ring = Ring(v, &boundary);
    if (ring.size() < 3 || ring.size() > 12) return false;
    if (boundary && !MayCreateEdge(ring.front(), ring.back(), locked)) return false;
    std::vector<Corners3> hole;
    if (!Triangulate(ring, 0, ring.size() - 1, locked, hole)) return false;
    if (ring.size() == 3 && !boundary) {
      for (const uint32_t id : around_[ring[0]]) {
        const Corners3& t = mt_.triangles[id].vertices;
        if (std::count(t.begin(), t.end(), ring[1]) + std::count(t.begin(), t.end(), ring[2]) == 2)
          return false;
      }
    }
    const auto node_id = static_cast<int>(mt_.nodes.size());
    InMemoryMt::Node node;
    node.vertex = v;
    node.boundary = boundary;
    node.code = static_cast<uint8_t>(
        options_.code_min + Below(static_cast<size_t>(options_.code_max - options_.code_min + 1)));
    node.star.assign(around_[v].begin(), around_[v].end());
    for (const uint32_t id : node.star) {
      mt_.triangles[id].creator = node_id;
      Detach(id);
    }
    for (const Corners3& t : hole) {
      node.hole.push_back(static_cast<uint32_t>(mt_.triangles.size()));
      AddTriangle(t, {});
      mt_.triangles.back().remover = node_id;
      live_.back().tile = tile;
    }
    mt_.nodes.push_back(std::move(node));
    return true;
  }

  void AppendRow(uint32_t v, Bytes& rows) const {
    if (rows_.empty()) return;
    rows.insert(rows.end(), rows_.begin() + v * 5, rows_.begin() + v * 5 + 5);
  }

  void MakeCluster(int round, int first_node) {
    ClusterUpdates updates;
    std::map<uint32_t, uint32_t> vertices;
    std::map<uint32_t, uint32_t> triangles;
    std::vector<uint32_t> triangle_ids;
    UnitEntry entry;
    const auto local = [&](uint32_t v) {
      const auto [it, added] = vertices.emplace(v, static_cast<uint32_t>(vertices.size()));
      if (added) {
        updates.positions.push_back(mt_.positions[v]);
        AppendRow(v, updates.rows);
        entry.bounds.Add(mt_.positions[v]);
      }
      return it->second;
    };
    const auto local_triangle = [&](uint32_t id) {
      const auto [it, added] = triangles.emplace(id, static_cast<uint32_t>(triangles.size()));
      if (added) {
        const Corners3& t = mt_.triangles[id].vertices;
        triangle_ids.push_back(id);
        updates.triangles.push_back({local(t[0]), local(t[1]), local(t[2])});
        updates.consumers.push_back(live_[id].consumer);
      }
      return it->second;
    };
    entry.error_code_min = 255;
    for (auto i = static_cast<size_t>(first_node); i < mt_.nodes.size(); ++i) {
      const InMemoryMt::Node& node = mt_.nodes[i];
      ClusterUpdates::Node out;
      out.vertex = local(node.vertex);
      out.error_code = node.code;
      out.hole_begin = static_cast<uint32_t>(updates.holes.size());
      out.hole_count = static_cast<uint32_t>(node.hole.size());
      for (const uint32_t id : node.hole) updates.holes.push_back(local_triangle(id));
      out.star_begin = static_cast<uint32_t>(updates.stars.size());
      out.star_count = static_cast<uint32_t>(node.star.size());
      for (const uint32_t id : node.star) updates.stars.push_back(local_triangle(id));
      updates.nodes.push_back(out);
      entry.error_code_min = std::min(entry.error_code_min, node.code);
      entry.error_code_max = std::max(entry.error_code_max, node.code);
      source_->record_.max_degree =
          std::max(source_->record_.max_degree,
                   static_cast<uint32_t>(node.star.size() + (node.boundary ? 1 : 0)));
    }
    EncodedCluster encoded = EncodeCluster(updates, Attributes());
    const auto id = static_cast<UnitId>(source_->payloads_.size());
    for (uint32_t i = 0; i < encoded.node_order.size(); ++i) {
      InMemoryMt::Node& node = mt_.nodes[static_cast<size_t>(first_node) + encoded.node_order[i]];
      node.cluster = id;
      node.index = i;
    }
    for (uint32_t slot = 0; slot < encoded.in_triangles.size(); ++slot) {
      const uint32_t t = triangle_ids[encoded.in_triangles[slot]];
      live_[t].consumer = {id, slot, encoded.explicit_arcs};
      Corners3& corners = mt_.triangles[t].vertices;
      std::rotate(corners.begin(), corners.begin() + encoded.in_rotations[slot], corners.end());
    }
    entry.round = static_cast<uint8_t>(round);
    entry.hilbert = id;
    entry.nodes = static_cast<uint32_t>(updates.nodes.size());
    entry.in_triangles = static_cast<uint32_t>(encoded.in_triangles.size());
    entry.out_triangles = encoded.out_triangles;
    entry.external_vertices = encoded.external_vertices;
    entry.explicit_arcs = encoded.explicit_arcs;
    const auto length = static_cast<uint32_t>(encoded.payload.size());
    source_->index_.Add(entry, {0, 0, length}, encoded.children);
    source_->payloads_.push_back(std::move(encoded.payload));
  }

  void MakeRoot() {
    mt_.root_triangles.assign(current_.begin(), current_.end());
    std::map<uint32_t, VertexIndex> numbers;
    const size_t pieces = std::min(static_cast<size_t>(options_.root_pieces), current_.size());
    for (size_t p = 0; p < pieces; ++p) {
      Cluster piece;
      UnitEntry entry;
      entry.round = kRootRound;
      std::map<uint32_t, uint32_t> vertices;
      std::set<UnitId> children;
      const size_t begin = p * mt_.root_triangles.size() / pieces;
      const size_t end = (p + 1) * mt_.root_triangles.size() / pieces;
      for (size_t i = begin; i < end; ++i) {
        const UnitId child = live_[mt_.root_triangles[i]].consumer.child;
        if (child != kNone32) children.insert(child);
      }
      piece.children.assign(children.begin(), children.end());
      for (size_t i = begin; i < end; ++i) {
        const uint32_t id = mt_.root_triangles[i];
        Corners3 corners;
        for (size_t c = 0; c < 3; ++c) {
          const uint32_t v = mt_.triangles[id].vertices[c];
          numbers.emplace(v, numbers.size());
          const auto [it, added] = vertices.emplace(v, static_cast<uint32_t>(vertices.size()));
          if (added) {
            piece.in.positions.push_back(mt_.positions[v]);
            piece.in.vertices.push_back(numbers.at(v));
            AppendRow(v, piece.in.rows);
            entry.bounds.Add(mt_.positions[v]);
          }
          corners[c] = it->second;
        }
        const ClusterUpdates::Consumer& consumer = live_[id].consumer;
        uint32_t remover = kDrain;
        if (consumer.child != kNone32) {
          const auto at =
              std::lower_bound(piece.children.begin(), piece.children.end(), consumer.child);
          remover = kChildFlag | static_cast<uint32_t>(at - piece.children.begin());
          if (consumer.explicit_arc) {
            piece.explicit_arcs.push_back(
                {static_cast<uint32_t>(piece.in.triangles.size()), consumer.child_slot, 0});
          }
        }
        piece.in.triangles.push_back(corners);
        piece.removers.push_back(remover);
      }
      entry.out_triangles = static_cast<uint32_t>(piece.in.triangles.size());
      entry.external_vertices = static_cast<uint32_t>(piece.in.vertices.size());
      source_->payloads_.push_back(EncodeRootPiece(piece, Attributes()));
      const auto length = static_cast<uint32_t>(source_->payloads_.back().size());
      source_->index_.Add(entry, {0, 0, length}, piece.children);
    }
    source_->index_.Finish(numbers.size());
  }

  AttributeLayout Attributes() const {
    AttributeLayout layout;
    if (options_.attributes) {
      layout.attributes = {{"red", ScalarType::kUint8}, {"quality", ScalarType::kInt32}};
    }
    return layout;
  }

  void FillRecord() {
    ObjectRecord& r = source_->record_;
    r.id = ObjectId(7);
    r.name = "fixture";
    r.grid.origin = {-1, -2, 3};
    r.grid.step = options_.coincident ? 0.25 : 1.0 / 16384;
    r.grid.error_unit = 1e-4;
    // Nothing, what the step would do, and as if the input had been on another grid.
    r.rounding_error = std::array{0.0, r.grid.cell_error(), r.grid.Error(60)}[options_.seed % 3];
    r.attributes = Attributes();
    r.vertices = mt_.positions.size();
    r.triangles = input_triangles_;
    r.nodes = mt_.nodes.size();
    r.clusters = source_->index_.cluster_count();
    r.root_pieces = source_->index_.root_piece_count();
    r.root_vertices = source_->index_.root_vertices();
    r.root_triangles = mt_.root_triangles.size();
    for (const Vec3i& p : mt_.positions) r.bounds.Add(r.grid.Position(p));
    SurfaceDigest digest;
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    for (uint32_t i = 0; i < input_triangles_; ++i) {
      const Corners3& t = mt_.triangles[i].vertices;
      digest.AddTriangle({mt_.positions[t[0]], mt_.positions[t[1]], mt_.positions[t[2]]});
      for (size_t c = 0; c < 3; ++c) ++edges[std::minmax(t[c], t[(c + 1) % 3])];
    }
    for (const auto& [edge, count] : edges) r.boundary_edges += count == 1 ? 1 : 0;
    r.surface_digest = digest.surface_digest();
    r.border_digest = digest.border_digest();
    r.components = 1;
    r.euler_characteristic = static_cast<int64_t>(r.vertices) - static_cast<int64_t>(edges.size()) +
                             static_cast<int64_t>(r.triangles);
    std::vector<uint32_t> depth(mt_.nodes.size(), 1);
    for (size_t i = mt_.nodes.size(); i-- > 0;) {
      for (const int p : mt_.Parents(static_cast<int>(i))) {
        depth[i] = std::max(depth[i], depth[static_cast<size_t>(p)] + 1);
      }
      r.depth = std::max(r.depth, depth[i]);
      r.error_code_max = std::max(r.error_code_max, mt_.nodes[i].code);
    }
  }

  const MtOptions options_;
  std::mt19937 random_;
  std::shared_ptr<MemoryClusterSource> source_;
  InMemoryMt mt_;
  Bytes rows_;
  std::vector<Live> live_;                  // per triangle
  std::vector<std::set<uint32_t>> around_;  // per vertex: current triangles
  std::set<uint32_t> current_;
  std::map<std::pair<uint32_t, uint32_t>, int> edges_;
  uint32_t input_triangles_ = 0;
};

}  // namespace

std::vector<int> InMemoryMt::Parents(int node) const {
  std::set<int> parents;
  for (const uint32_t id : nodes[static_cast<size_t>(node)].hole) {
    if (triangles[id].creator >= 0) parents.insert(triangles[id].creator);
  }
  return {parents.begin(), parents.end()};
}

void InMemoryMt::Close(int node, std::vector<bool>& applied) const {
  std::vector<int> open{node};
  while (!open.empty()) {
    const int i = open.back();
    open.pop_back();
    if (applied[static_cast<size_t>(i)]) continue;
    applied[static_cast<size_t>(i)] = true;
    for (const int p : Parents(i)) open.push_back(p);
  }
}

std::vector<uint32_t> InMemoryMt::Mesh(const std::vector<bool>& applied) const {
  const auto is_applied = [&](int node) { return applied[static_cast<size_t>(node)]; };
  std::vector<uint32_t> mesh;
  for (uint32_t id = 0; id < triangles.size(); ++id) {
    const Triangle& t = triangles[id];
    if (t.creator >= 0 && !is_applied(t.creator)) continue;
    if (t.remover >= 0 && is_applied(t.remover)) continue;
    mesh.push_back(id);
  }
  return mesh;
}

void MemoryClusterSource::Read(std::span<const UnitId> units,
                               std::shared_ptr<PayloadReceiver> receiver) {
  for (const UnitId unit : units) {
    ++reads_;
    const Status status = on_read_ ? on_read_(unit) : Status::Ok();
    receiver->Receive(unit, status.ok() ? Result<Bytes>(payloads_[unit]) : Result<Bytes>(status));
  }
}

MtFixture MakeMt(const MtOptions& options) { return MtBuilder(options).Build(); }

MtFixture MakeTorus(int resolution, int tiles) {
  MtOptions o;
  o.shape = Shape::kTorus;
  o.resolution = resolution;
  o.rounds = 5;
  o.tiles = tiles;
  return MakeMt(o);
}

}  // namespace mtdb::testing
