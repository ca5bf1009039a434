#include "query/session.h"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>

#include "query/internal/bits.h"
#include "query/internal/search.h"
#include "query/surface.h"
#include "query/unit_reader.h"

namespace mtdb {
namespace {

constexpr TriangleKey KeyOf(UnitId unit, uint32_t slot) { return TriangleKey{unit} << 32 | slot; }

// Nodes of the clusters that change in one direction, and in which batch each of them goes.
class Difference {
 public:
  explicit Difference(const ClusterIndex& index) : index_(index) {}

  // Notes the nodes of `to` that are not in `from`.
  void AddCluster(UnitId unit, const Bits& from, const Bits& to) {
    for (size_t w = 0; w < to.words().size(); ++w) {
      uint64_t rest = to.words()[w] & ~(from.empty() ? 0 : from.words()[w]);
      if (rest == 0) continue;
      if (clusters_.empty() || clusters_.back().unit != unit) {
        place_[unit] = clusters_.size();
        clusters_.push_back({unit, {}, {}});
      }
      Cluster& c = clusters_.back();
      for (; rest != 0; rest &= rest - 1) {
        const auto bit = static_cast<uint32_t>(std::countr_zero(rest));
        c.nodes.push_back(static_cast<NodeIndex>(w * 64 + bit));
      }
      c.levels.resize(c.nodes.size());
    }
  }
  uint64_t count() const {
    uint64_t n = 0;
    for (const Cluster& c : clusters_) n += c.nodes.size();
    return n;
  }

  // Appends the batches. A node's level is the length of the longest chain of nodes that have to
  // be inserted (removed) before it.
  Status Collect(UnitReader& reader, size_t row_bytes, bool insert,
                 std::vector<UpdateBatch>* batches);

 private:
  struct Cluster {
    UnitId unit;
    std::vector<NodeIndex> nodes;  // ascending
    std::vector<uint32_t> levels;
  };
  // Null when the node does not change.
  uint32_t* Level(UnitId unit, NodeIndex node) {
    const auto at = place_.find(unit);
    if (at == place_.end()) return nullptr;
    Cluster& c = clusters_[at->second];
    const auto found = std::lower_bound(c.nodes.begin(), c.nodes.end(), node);
    if (found == c.nodes.end() || *found != node) return nullptr;
    return &c.levels[static_cast<size_t>(found - c.nodes.begin())];
  }
  void AddNode(const LoadedUnit& unit, NodeIndex node, size_t row_bytes, UpdateBatch& batch) const;

  const ClusterIndex& index_;
  std::vector<Cluster> clusters_;
  std::unordered_map<UnitId, size_t> place_;
};

Status Difference::Collect(UnitReader& reader, size_t row_bytes, bool insert,
                           std::vector<UpdateBatch>* batches) {
  const size_t first = batches->size();
  // Parents have the larger numbers.
  std::sort(clusters_.begin(), clusters_.end(), [&](const Cluster& a, const Cluster& b) {
    return insert ? a.unit > b.unit : a.unit < b.unit;
  });
  for (size_t i = 0; i < clusters_.size(); ++i) place_[clusters_[i].unit] = i;
  for (Cluster& c : clusters_) {
    reader.Release();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader.Get(c.unit));
    const auto count = c.nodes.size();
    for (size_t n = 0; n < count; ++n) {
      const size_t i = insert ? n : count - 1 - n;
      const NodeIndex node = c.nodes[i];
      for (const uint32_t slot : unit->cluster.hole(node)) {
        uint32_t* parent = nullptr;
        if (slot >= unit->first_own_slot()) {
          parent = Level(c.unit, unit->creator(slot));
        } else if (const SlotOrigin& origin = unit->origins[slot]; origin.creator != kNone32) {
          parent = Level(unit->parents[origin.parent], origin.creator);
        }
        if (parent == nullptr) continue;
        if (insert) {
          c.levels[i] = std::max(c.levels[i], *parent + 1);
        } else {
          *parent = std::max(*parent, c.levels[i] + 1);
        }
      }
      const size_t batch = first + c.levels[i];
      while (batches->size() <= batch) batches->emplace_back().insert = insert;
      AddNode(*unit, node, row_bytes, (*batches)[batch]);
    }
  }
  reader.Release();
  return Status::Ok();
}

void Difference::AddNode(const LoadedUnit& unit, NodeIndex node, size_t row_bytes,
                         UpdateBatch& batch) const {
  const mtdb::Cluster& c = unit.cluster;
  const uint32_t external = c.external_vertices();
  const VertexIndex first_vertex = index_.first_vertex(ClusterId(unit.id));
  const uint32_t local = external + node;
  UpdateBatch::Node& out = batch.nodes.emplace_back();
  out.vertex = first_vertex + node;
  out.position = c.position(local);
  out.boundary = c.boundary(node);
  out.first_star = KeyOf(unit.id, c.star_begin[node]);
  out.ring_begin = static_cast<uint32_t>(batch.ring.size());
  const std::span<const uint32_t> ring = c.ring(node);
  out.ring_count = static_cast<uint32_t>(ring.size());
  for (const uint32_t v : ring) {
    batch.ring.push_back(v < external ? c.in.vertices[v] : first_vertex + (v - external));
  }
  out.hole_begin = static_cast<uint32_t>(batch.holes.size());
  for (const uint32_t slot : c.hole(node)) {
    UpdateBatch::HoleTriangle& t = batch.holes.emplace_back();
    const bool own = slot >= unit.first_own_slot();
    if (own) {
      t.key = KeyOf(unit.id, slot);
    } else {
      t.key = KeyOf(unit.parents[unit.origins[slot].parent], unit.origins[slot].slot);
    }
    const std::array<uint32_t, 3> corners = unit.corners(slot, own ? unit.creator(slot) : 0);
    for (size_t i = 0; i < 3; ++i) {
      t.corners[i] =
          static_cast<uint8_t>(std::find(ring.begin(), ring.end(), corners[i]) - ring.begin());
    }
  }
  const auto row = c.in.rows.begin() + static_cast<std::ptrdiff_t>(local * row_bytes);
  batch.rows.insert(batch.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes));
}

}  // namespace

Session::Session(std::shared_ptr<const Surface> surface)
    : surface_(std::move(surface)), applied_(surface_->index().cluster_count()) {}

Session::~Session() = default;

Result<std::unique_ptr<Session>> Session::Open(std::shared_ptr<const Surface> surface) {
  MTDB_CHECK(surface != nullptr, "a session needs a surface");
  return std::unique_ptr<Session>(new Session(std::move(surface)));
}

Result<BaseMesh> Session::Base() const {
  const ClusterIndex& index = surface_->index();
  const size_t row_bytes = surface_->record().attributes.row_bytes();
  UnitReader reader(surface_->cache(), {});
  BaseMesh base;
  std::unordered_map<VertexIndex, uint32_t> numbers;
  for (UnitId id = index.cluster_count(); id < UnitCount(index); ++id) {
    reader.Release();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader.Get(id));
    const RootPiece& piece = unit->piece;
    std::vector<uint32_t> number_of(piece.vertices.size());
    for (size_t v = 0; v < piece.vertices.size(); ++v) {
      const auto next = static_cast<uint32_t>(base.vertices.size());
      const auto [at, added] = numbers.try_emplace(piece.vertices[v], next);
      number_of[v] = at->second;
      if (!added) continue;
      base.vertices.push_back(piece.vertices[v]);
      base.positions.push_back(piece.positions[v]);
      const auto row = piece.rows.begin() + static_cast<std::ptrdiff_t>(v * row_bytes);
      base.rows.insert(base.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes));
    }
    for (uint32_t t = 0; t < piece.triangles.size(); ++t) {
      const auto& corners = piece.triangles[t];
      base.triangles.push_back(
          {number_of[corners[0]], number_of[corners[1]], number_of[corners[2]]});
      base.triangle_keys.push_back(KeyOf(id, t));
    }
  }
  return base;
}

Result<SessionUpdate> Session::Update(const Query& query, std::vector<UpdateBatch>* batches) {
  batches->clear();
  const ObjectRecord& record = surface_->record();
  const ClusterIndex& index = surface_->index();
  UnitReader reader(surface_->cache(), {query.control, query.max_bytes});
  Search search(*surface_->source(), reader, query);
  MTDB_RETURN_IF_ERROR(search.Run());
  const CutState cut = search.TakeState();

  SessionUpdate result;
  Difference removals(index);
  Difference insertions(index);
  for (UnitId c = 0; c < index.cluster_count(); ++c) {
    static const Bits kNone;
    const uint32_t s = cut.state_of[c];
    const Bits& wanted = s == kNone32 ? kNone : cut.state(s).applied;
    removals.AddCluster(c, wanted, applied_[c]);
    insertions.AddCluster(c, applied_[c], wanted);
  }
  result.removals = removals.count();
  result.insertions = insertions.count();
  const size_t row_bytes = record.attributes.row_bytes();
  // What the updates need was in the search's reach, or is what the client holds: no budget.
  UnitReader updates(surface_->cache(), {query.control, std::nullopt});
  std::vector<UpdateBatch> found;
  MTDB_RETURN_IF_ERROR(removals.Collect(updates, row_bytes, false, &found));
  MTDB_RETURN_IF_ERROR(insertions.Collect(updates, row_bytes, true, &found));

  for (UnitId c = 0; c < index.cluster_count(); ++c) {
    const uint32_t s = cut.state_of[c];
    if (s == kNone32 || cut.state(s).applied_count == 0) {
      applied_[c] = Bits();
    } else {
      applied_[c] = cut.state(s).applied;
    }
  }
  applied_count_ = cut.nodes_applied;
  *batches = std::move(found);

  ExtractStats& stats = result.stats;
  stats.triangles = cut.triangles;
  stats.vertices = index.root_vertices() + cut.nodes_applied;
  stats.active_triangles = cut.active_triangles;
  stats.error_bound = record.grid.cell_error() + record.grid.Error(cut.largest_code);
  stats.limit = cut.limit;
  stats.nodes_visited = cut.nodes_visited;
  stats.nodes_applied = cut.nodes_applied;
  stats.nodes_forced = cut.nodes_forced;
  stats.clusters_total = index.cluster_count();
  for (const Bits& bits : applied_) stats.clusters_used += bits.empty() ? 0 : 1;
  reader.FillStats(&stats);
  return result;
}

Result<SessionUpdate> Session::Update(const Query& query, const BatchSink& sink) {
  std::vector<UpdateBatch> batches;
  const std::vector<Bits> applied = applied_;
  const uint64_t applied_count = applied_count_;
  MTDB_ASSIGN_OR_RETURN(SessionUpdate update, Update(query, &batches));
  const Status status = sink(batches);
  if (!status.ok()) {
    applied_ = applied;
    applied_count_ = applied_count;
    return status;
  }
  return update;
}

bool Session::applied(ClusterId cluster, NodeIndex node) const {
  MTDB_CHECK(cluster.value < applied_.size() && node < surface_->index().cluster(cluster).nodes,
             "no such node");
  return !applied_[cluster.value].empty() && applied_[cluster.value].Test(node);
}

}  // namespace mtdb
