// SPDX-License-Identifier: Apache-2.0
#include "query/answer/cut_impl.h"

#include <algorithm>
#include <array>
#include <string>

#include "query/cut/search.h"
#include "query/fields/promise.h"
#include "query/fields/stopwatch.h"
#include "query/fields/work_meter.h"
#include "store/base/vertex_meaning.h"
#include "store/texture_pages.h"

namespace mtdb::internal {
namespace {

constexpr VertexIndex kUnset = ~VertexIndex{0};
constexpr size_t kSumsPerLook = 1 << 16;  // some ns each
constexpr std::array<const char*, 3> kNormalNames{"nx", "ny", "nz"};

}  // namespace

CutImpl::CutImpl(std::shared_ptr<const Surface> surface, const Query& query, double sink_rounding)
    : surface_(std::move(surface)),
      index_(surface_->index()),
      query_(query),
      rounding_(surface_->record().rounding_error),
      sink_rounding_(sink_rounding),
      clip_(query.clip && query.region != nullptr && !query.region->whole()),
      cut_(*surface_->source(), false),
      root_numbers_(index_.root_vertices()),
      reader_(surface_->cache(),
              {query.control, query.max_bytes, query.available_only, !query.available_only}) {}

MeshHeader CutImpl::HeaderOf(const ObjectRecord& record) {
  MeshHeader header;
  header.attributes = record.attributes;
  header.double_positions = record.double_positions;
  header.bounds = record.bounds;
  header.textured = record.texture.has_value();
  if (record.texture) header.texture_step = record.texture->step;
  if (record.grid.mode == PositionMode::kGrid) header.position_step = record.grid.step;
  return header;
}

bool CutImpl::MakesNormals() const {
  return query_.normals && !mtdb::FindNormals(surface_->record().attributes).found;
}

bool CutImpl::WantsEverything() const {
  const bool whole = query_.region == nullptr || query_.region->whole();
  const bool full = query_.threshold == nullptr || query_.threshold->full_resolution();
  const bool fits = !query_.max_triangles || *query_.max_triangles >= surface_->record().triangles;
  // Where some nodes have no vertex, numbers of vertices have gaps.
  const ObjectRecord& record = surface_->record();
  const bool gaps = record.vertices < record.vertex_numbers();
  return whole && full && fits && !gaps && !query_.available_only && !query_.max_bytes &&
         !query_.max_milliseconds;
}

Status CutImpl::Select() {
  const Stopwatch watch;
  const bool makes_normals = MakesNormals();
  for (const VertexAttribute& a : surface_->record().attributes.attributes) {
    if (makes_normals && std::ranges::find(kNormalNames, a.name) != kNormalNames.end()) {
      return InvalidArgument(surface_->record().name + ": has an attribute " + a.name +
                             " of its own; ask without normals");
    }
  }
  if (query_.available_only) {
    MTDB_RETURN_IF_ERROR(CheckLimits(surface_->record(), query_));
    reader_.available()->Begin(query_.control, DeadlineOf(query_));
  }
  MTDB_RETURN_IF_ERROR(reader_.Check());
  everything_ = WantsEverything();
  if (!everything_) {
    Search search(*surface_->source(), reader_, query_, rounding_ + sink_rounding_, &cut_);
    MTDB_ASSIGN_OR_RETURN(outcome_, search.Run());
    outputs_.resize(cut_.open().size());
    if (clip_) MTDB_RETURN_IF_ERROR(MarkClipped());
    MTDB_RETURN_IF_ERROR(NumberVertices());
  }
  FillStats();
  stats_.seconds.select = watch.Seconds() - stats_.seconds.load;
  return Status::Ok();
}

void CutImpl::FillStats() {
  const ObjectRecord& record = surface_->record();
  stats_.clusters_total = index_.cluster_count();
  reader_.FillStats(&stats_);
  SetBounds(sink_rounding_);
  if (everything_) {
    stats_.triangles = stats_.active_triangles = record.triangles;
    stats_.vertices = record.vertices;
    stats_.nodes_visited = stats_.nodes_applied = record.nodes;
    stats_.clusters_used = index_.cluster_count();
    return;
  }
  stats_.limit = outcome_.limit;
  stats_.missing = outcome_.missing;
  stats_.nodes_visited = outcome_.nodes_visited;
  stats_.nodes_applied = cut_.counts().applied;
  stats_.nodes_forced = outcome_.nodes_forced;
  for (const UnitId id : cut_.open()) {
    stats_.clusters_used += cut_.Find(id)->applied_count > 0 ? 1 : 0;
  }
  stats_.vertices = root_numbers_.count();
  if (!clip_) {
    stats_.vertices += cut_.counts().vertices;
    stats_.triangles = cut_.counts().triangles;
    stats_.active_triangles = outcome_.active.count;
    return;
  }
  for (const Output& o : outputs_) {
    stats_.vertices += o.used.Count();
    stats_.triangles += o.kept.Count();
  }
  stats_.active_triangles = stats_.triangles;
}

void CutImpl::SetBounds(double rounding) {
  const ObjectRecord& record = surface_->record();
  if (!everything_ && !clip_ && query_.region != nullptr) {
    stats_.error_bound_outside = BoundOf(record.grid, LargestCodeLeft(cut_), rounding_ + rounding);
  }
  stats_.error_bound = BoundOf(record.grid, outcome_.active.largest_code, rounding_ + rounding);
  stats_.shortfall = outcome_.active.shortfall;
  const ThresholdPtr& asked = query_.threshold;
  if (asked == nullptr || rounding == sink_rounding_) return;
  Shortfall& shortfall = stats_.shortfall;
  if (const std::optional<double> value = asked->constant()) {
    if (*value < 0) return;
    shortfall.excess = stats_.error_bound - *value;
  } else {
    // What was expected and did not come makes up for a part of it.
    shortfall.excess += rounding - sink_rounding_;
  }
  if (!(shortfall.excess > 0)) {
    shortfall = {};
  } else if (!shortfall.any()) {
    shortfall.triangles = stats_.active_triangles;
    shortfall.bounds = record.bounds;
  }
}

bool CutImpl::applied(UnitId cluster, NodeIndex node) const {
  MTDB_CHECK(cluster < index_.cluster_count() &&
                 (!index_.Has(cluster) || node < index_.unit(cluster).nodes),
             "no such node");
  if (everything_) return true;
  const CutUnit* const u = cut_.Find(cluster);
  return u != nullptr && u->applied.Test(node);
}

// A triangle that meets the region is active, whatever its error.
Status CutImpl::MarkClipped() {
  WorkMeter meter([this] { return reader_.Check(); });
  const Grid& grid = surface_->record().grid;
  root_used_ = Bits(static_cast<uint32_t>(index_.root_vertices()));
  for (const UnitId id : cut_.open()) output(id).used = Bits(index_.unit(id).nodes);
  for (const UnitId id : cut_.open()) {
    const CutUnit& u = *cut_.Find(id);
    reader_.Release();
    MTDB_RETURN_IF_ERROR(reader_.Check());
    if (u.active.empty()) continue;
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader_.Get(id));
    Output& out = output(id);
    out.kept = Bits(unit->own_slots());
    const LocalPositions& positions = unit->positions();
    u.active.ForEach([&](uint32_t own) {
      const uint32_t slot = own + u.first_own;
      const std::array<uint32_t, 3> corners = unit->corners(slot, unit->creator(slot));
      Triangle3d t;
      for (size_t c = 0; c < 3; ++c) t[c] = grid.Position(positions[corners[c]]);
      if (!meter.Spend(1) || !query_.region->Within(t, 0)) return;
      out.kept.Set(own);
      for (const uint32_t local : corners) {
        const uint32_t external = unit->cluster.external_vertices();
        if (local >= external) {
          out.used.Set(local - external);
          continue;
        }
        const VertexIndex v = unit->vertex(local);
        const UnitId owner = unit->owner(local);
        if (owner == kNone32) {
          root_used_.Set(static_cast<uint32_t>(v));
        } else {
          output(owner).used.Set(static_cast<uint32_t>(v - index_.first_vertex(owner)));
        }
      }
    });
    MTDB_RETURN_IF_ERROR(meter.status());
  }
  return Status::Ok();
}

Status CutImpl::NumberVertices() {
  root_numbers_ = RootNumbering(index_.root_vertices());
  for (UnitId id = index_.cluster_count(); id < index_.unit_count(); ++id) {
    reader_.Release();
    MTDB_RETURN_IF_ERROR(reader_.Check());
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader_.Get(id));
    for (const VertexIndex v : unit->cluster.vertices) {
      if (!clip_ || root_used_.Test(static_cast<uint32_t>(v))) root_numbers_.Add(v);
    }
  }
  reader_.Release();
  if (!clip_ && root_numbers_.count() != index_.root_vertices()) {
    return Corrupt(surface_->record().name + ": the root pieces have " +
                   std::to_string(root_numbers_.count()) + " vertices, the index says " +
                   std::to_string(index_.root_vertices()));
  }
  numbered_ = true;
  if (everything_) return Status::Ok();  // all vertices, by their own numbers
  VertexIndex next = root_numbers_.count();
  for (UnitId u = 0; u < index_.unit_count(); ++u) {
    if (cut_.Find(u) != nullptr) {
      MTDB_RETURN_IF_ERROR(reader_.Check());
      Output& out = output(u);
      if (!clip_ && !cut_.Find(u)->without_vertex.empty()) {
        out.used = cut_.Find(u)->applied;
        out.used.RemoveAll(cut_.Find(u)->without_vertex.words());
      }
      const Bits& nodes = Nodes(u);
      out.first = next;
      out.nodes = nodes.words().data();
      out.ranks = nodes.Ranks();
      next += nodes.Count();
    }
  }
  return Status::Ok();
}

VertexIndex CutImpl::NumberOf(VertexIndex vertex, UnitId owner) const {
  if (owner == kNone32) return root_numbers_.number(vertex);
  if (everything_) return vertex;
  const auto node = static_cast<NodeIndex>(vertex - index_.first_vertex(owner));
  return output(owner).Of(node);
}

// Out of line: called once for a vertex, in a loop that needs its registers.
[[gnu::noinline]] VertexIndex CutImpl::NumberOther(const LoadedUnit& unit, uint32_t local) {
  return numbers_[local] = NumberOf(unit.vertex(local), unit.owner(local));
}

Status CutImpl::Emit(MeshSink& sink) {
  const Stopwatch watch;
  const double load_before = stats_.seconds.load;
  const ObjectRecord& record = surface_->record();
  if (everything_ && !numbered_) MTDB_RETURN_IF_ERROR(NumberVertices());
  MeshHeader header = HeaderOf(record);
  header.textures = TexturesOf(record, surface_->source());
  header.vertex_count = stats_.vertices;
  header.triangle_count = stats_.triangles;
  std::vector<Vec3f> normals;
  if (MakesNormals()) {
    for (const char* name : kNormalNames) {
      header.attributes.attributes.push_back({name, ScalarType::kFloat32});
    }
    MTDB_RETURN_IF_ERROR(FindNormals(&normals));
  }
  MTDB_RETURN_IF_ERROR(sink.Begin(header));
  BlockWriter out(sink, record.grid, record.attributes.row_bytes(), normals);
  const std::vector<UnitId> units = OutputUnits();
  const bool all_active = stats_.active_triangles == stats_.triangles;
  // Without room for all units they are loaded for their vertices and triangles together.
  const auto file = reader_.SpillBeside(units);
  keeps_ = file == nullptr || header.textured ? 0 : all_active ? 1 : 2;
  for (size_t k = 0; k < kept_.size(); ++k) {
    kept_[k].Begin(k < keeps_ ? file : nullptr, units.size(), stats_.vertices);
  }
  MTDB_RETURN_IF_ERROR(EmitVertices(units, out));
  MTDB_RETURN_IF_ERROR(EmitTriangles(units, out, true));
  if (!all_active) MTDB_RETURN_IF_ERROR(EmitTriangles(units, out, false));
  if (out.vertices() != stats_.vertices || out.triangles() != stats_.triangles) {
    return Corrupt(record.name + ": expected " + std::to_string(stats_.vertices) +
                   " vertices and " + std::to_string(stats_.triangles) + " triangles, found " +
                   std::to_string(out.vertices()) + " and " + std::to_string(out.triangles()));
  }
  MTDB_RETURN_IF_ERROR(sink.End());
  SetBounds(sink.rounding());
  reader_.FillStats(&stats_);
  stats_.seconds.emit += watch.Seconds() - (stats_.seconds.load - load_before);
  return Status::Ok();
}

bool CutImpl::Skips(UnitId unit) const {
  if (everything_) return false;
  const CutUnit* const u = cut_.Find(unit);
  return u == nullptr || u->applied_count == 0;
}

std::span<const uint64_t> CutImpl::Slots(const LoadedUnit& unit, bool active) {
  if (everything_) return unit.drain;
  const CutUnit& u = *cut_.Find(unit.id);
  if (outcome_.active.all) return u.present.words();
  if (active) return (clip_ ? output(unit.id).kept : u.active).words();
  inactive_.assign(u.present.words().begin(), u.present.words().end());
  for (size_t w = 0; w < u.active.words().size(); ++w) inactive_[w] &= ~u.active.words()[w];
  return inactive_;
}

std::vector<UnitId> CutImpl::OutputUnits() const {
  std::vector<UnitId> units;
  for (UnitId id = index_.cluster_count(); id < index_.unit_count(); ++id) units.push_back(id);
  for (UnitId id = 0; id < index_.cluster_count(); ++id) {
    if (!Skips(id)) units.push_back(id);
  }
  return units;
}

template <typename F, typename After>
Status CutImpl::ForEachUnit(std::span<const UnitId> units, F&& f, After&& after) {
  const size_t ahead = reader_.prefetch_units() / 2;
  for (size_t i = 0; i < units.size(); ++i) {
    MTDB_RETURN_IF_ERROR(reader_.Check());
    if (ahead > 0 && i % ahead == 0) {
      // The half window after this one; the first time both.
      const size_t begin = i == 0 ? 1 : std::min(i + ahead, units.size());
      const size_t end = std::min(i + 2 * ahead, units.size());
      reader_.Prefetch(units.subspan(begin, end - begin));
    }
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader_.Get(units[i]));
    f(*unit);
    reader_.Release();
    MTDB_RETURN_IF_ERROR(after());
  }
  return Status::Ok();
}

// Clusters come finest first, so that when one has been sent, nothing is decoded from it any more.
Status CutImpl::EmitVertices(std::span<const UnitId> units, BlockWriter& out) {
  uint64_t next = 0;
  size_t i = 0;
  bool done = false;
  MTDB_RETURN_IF_ERROR(ForEachUnit(
      units,
      [&](const LoadedUnit& unit) {
        if (unit.nodes() == 0) {
          EmitRootVertices(unit, out, &next);
        } else {
          EmitClusterVertices(unit, out);
        }
        done = KeepTriangles(unit, i++) && everything_ && unit.nodes() > 0;
      },
      [&] {
        if (done) reader_.Forget(units[i - 1]);
        return out.FlushBlocks();
      }));
  return out.FlushVertices();
}

bool CutImpl::KeepTriangles(const LoadedUnit& unit, size_t i) {
  bool kept = keeps_ > 0;
  for (size_t k = 0; k < keeps_; ++k) {
    kept = kept && kept_[k].open();
    if (!kept) break;
    to_keep_.resize(std::max<size_t>(to_keep_.size(), unit.own_slots()));
    const TriangleVertices* const end = PutTriangles(unit, k == 0, to_keep_.data());
    kept = kept_[k].Keep(i, {to_keep_.data(), end});
  }
  return kept;
}

Status CutImpl::EmitTriangles(std::span<const UnitId> units, BlockWriter& out, bool active) {
  KeptTriangles& kept = kept_[active ? 0 : 1];
  const auto sent = [&] {
    if (query_.control != nullptr) {
      query_.control->triangles_emitted_.store(out.triangles(), std::memory_order_relaxed);
    }
    return out.FlushBlocks();
  };
  for (size_t i = 0; i < units.size();) {
    if (kept.Has(i)) {
      MTDB_RETURN_IF_ERROR(reader_.Check());
      const size_t count = kept.size(i);
      TriangleVertices* const room = out.TriangleRoom(count);
      if (kept.Read(i, room)) {
        out.AddTriangles(room + count);
        MTDB_RETURN_IF_ERROR(sent());
        ++i;
        continue;
      }
    }
    size_t end = i + 1;
    while (end < units.size() && !kept.Has(end)) ++end;
    MTDB_RETURN_IF_ERROR(ForEachUnit(
        units.subspan(i, end - i),
        [&](const LoadedUnit& unit) {
          out.AddTriangles(PutTriangles(unit, active, out.TriangleRoom(unit.own_slots())));
          if (!unit.cluster.corner_places.empty()) PutCorners(unit, active, out);
        },
        sent));
    i = end;
  }
  return out.FlushTriangles();
}

// A vertex that several pieces share is emitted with the first of them.
void CutImpl::EmitRootVertices(const LoadedUnit& unit, BlockWriter& out, uint64_t* next) const {
  const CompactCluster& piece = unit.cluster;
  const size_t row_bytes = surface_->record().attributes.row_bytes();
  out.ReserveVertices(piece.vertices.size());
  for (size_t i = 0; i < piece.vertices.size(); ++i) {
    const VertexIndex v = piece.vertices[i];
    if (clip_ && !root_used_.Test(static_cast<uint32_t>(v))) continue;
    if (root_numbers_.number(v) != *next) continue;
    out.AddVertex(piece.positions[i], piece.rows.data() + i * row_bytes);
    ++*next;
  }
}

void CutImpl::EmitClusterVertices(const LoadedUnit& unit, BlockWriter& out) const {
  const size_t row_bytes = surface_->record().attributes.row_bytes();
  const uint32_t external = unit.cluster.external_vertices();
  const std::byte* rows = unit.cluster.rows.data() + external * row_bytes;
  out.ReserveVertices(unit.nodes());
  ForEachNode(unit, [&](NodeIndex i) {
    out.AddVertex(unit.cluster.position(external + i), rows + i * row_bytes);
  });
}

template <typename F>
void CutImpl::ForEachTriangle(const LoadedUnit& unit, std::span<const uint64_t> slots, F&& f) {
  const CompactCluster& cluster = unit.cluster;
  const uint32_t external = cluster.external_vertices();
  const uint32_t first_own = unit.first_own_slot();
  for (uint32_t slot = first_own; slot < cluster.listed(); ++slot) {
    if (!slots.empty() && BitsAt(slots, slot - first_own, 1) != 0) f(cluster.listed_triangle(slot));
  }
  if (unit.nodes() == 0) return;
  if (!cluster.created_corners.empty()) {
    for (uint32_t own = 0; own < unit.own_slots() && !slots.empty(); ++own) {
      if (BitsAt(slots, own, 1) != 0) f(cluster.created_corners[own]);
    }
    return;
  }
  FindCreators(unit);
  const LocalNumber* const ring_begin = cluster.ring_begin.data();
  const LocalNumber* const star_begin = cluster.star_begin.data();
  const LocalNumber* const ring = cluster.ring_vertices.data();
  for (uint32_t w = 0; w < slots.size(); ++w) {
    for (uint64_t rest = slots[w]; rest != 0; rest &= rest - 1) {
      const uint32_t own = w * 64 + static_cast<uint32_t>(std::countr_zero(rest));
      const NodeIndex i = creators_[own];
      const uint32_t begin = ring_begin[i];
      const uint32_t j = begin + own + first_own - star_begin[i];
      const uint32_t k = j + 1 == ring_begin[i + 1] ? begin : j + 1;
      f(std::array<uint32_t, 3>{external + i, ring[j], ring[k]});
    }
  }
}

void CutImpl::FindCreators(const LoadedUnit& unit) {
  const CompactCluster& cluster = unit.cluster;
  const uint32_t first_own = unit.first_own_slot();
  creators_.resize(std::max<size_t>(creators_.size(), unit.own_slots() + kLongStar));
  const auto fill = [&](NodeIndex i) {
    NodeIndex* const star = creators_.data() + cluster.star_begin[i] - first_own;
    const uint32_t size = cluster.star_begin[i + 1] - cluster.star_begin[i];
    // Of no varying length, which would be hard to predict; later stars come later.
    std::fill_n(star, kLongStar, i);
    if (size > kLongStar) std::fill_n(star, size, i);
  };
  if (everything_) {
    for (NodeIndex i = 0; i < unit.nodes(); ++i) fill(i);
  } else {
    cut_.Find(unit.id)->applied.ForEach(fill);
  }
}

void CutImpl::NumberOwn(const LoadedUnit& unit) {
  const uint32_t external = unit.cluster.external_vertices();
  numbers_.assign(external + unit.nodes(), kUnset);
  VertexIndex next = everything_ ? index_.first_vertex(unit.id) : output(unit.id).first;
  ForEachNode(unit, [&](NodeIndex i) { numbers_[external + i] = next++; });
}

TriangleVertices* CutImpl::PutTriangles(const LoadedUnit& unit, bool active,
                                        TriangleVertices* next) {
  NumberOwn(unit);
  VertexIndex* const numbers = numbers_.data();
  const auto number = [&](uint32_t local) {
    const VertexIndex n = numbers[local];
    return n != kUnset ? n : NumberOther(unit, local);
  };
  ForEachTriangle(unit, Slots(unit, active), [&](const std::array<uint32_t, 3>& t) {
    *next++ = {number(t[0]), number(t[1]), number(t[2])};
  });
  return next;
}

void CutImpl::PutCorners(const LoadedUnit& unit, bool active, BlockWriter& out) {
  const std::span<const uint64_t> slots = Slots(unit, active);
  const uint32_t first_own = unit.first_own_slot();
  for (uint32_t own = 0; own < unit.own_slots() && !slots.empty(); ++own) {
    if (BitsAt(slots, own, 1) != 0) out.AddCorners(unit.cluster.texture(first_own + own));
  }
}

bool CutImpl::InOutput(VertexIndex vertex, UnitId owner) const {
  if (!clip_) return true;
  if (owner == kNone32) return root_used_.Test(static_cast<uint32_t>(vertex));
  return output(owner).used.Test(static_cast<uint32_t>(vertex - index_.first_vertex(owner)));
}

// Triangles come in the order of the units, so that the sums' roundings do not vary.
Status CutImpl::FindNormals(std::vector<Vec3f>* normals) {
  std::vector<Vec3d> sums(stats_.vertices);
  const Grid& grid = surface_->record().grid;
  MTDB_RETURN_IF_ERROR(ForEachUnit(
      OutputUnits(),
      [&](const LoadedUnit& unit) {
        NumberOwn(unit);
        const uint32_t external = unit.cluster.external_vertices();
        const LocalPositions& positions = unit.positions();
        const std::span<const uint64_t> slots = everything_ ? std::span<const uint64_t>(unit.drain)
                                                            : cut_.Find(unit.id)->present.words();
        ForEachTriangle(unit, slots, [&](const std::array<uint32_t, 3>& t) {
          const Vec3d a = grid.Position(positions[t[0]]);
          const Vec3d normal =
              Cross(grid.Position(positions[t[1]]) - a, grid.Position(positions[t[2]]) - a);
          for (const uint32_t local : t) {
            VertexIndex& n = numbers_[local];
            if (n == kUnset) {
              if (local >= external) continue;  // an own vertex that is clipped away
              const VertexIndex vertex = unit.vertex(local);
              const UnitId owner = unit.owner(local);
              if (!InOutput(vertex, owner)) continue;
              n = NumberOf(vertex, owner);
            }
            if (n < sums.size()) sums[n] += normal;
          }
        });
      },
      [] { return Status::Ok(); }));
  normals->reserve(sums.size());
  for (const Vec3d& sum : sums) {
    if (normals->size() % kSumsPerLook == 0) MTDB_RETURN_IF_ERROR(reader_.Check());
    const double length = Length(sum);
    const Vec3d n = length > 0 ? sum * (1 / length) : Vec3d{0, 0, 1};
    normals->push_back({static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)});
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
