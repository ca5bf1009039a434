// SPDX-License-Identifier: Apache-2.0
#include "query/verify_object.h"

#include <algorithm>
#include <string>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/cache/unit_reader.h"
#include "query/cut/bits.h"
#include "store/base/out_of_memory.h"
#include "store/base/surface_digest.h"

namespace mtdb {

using namespace internal;

namespace {

class Verifier {
 public:
  // What one step decodes is there for the next.
  Verifier(const Surface& surface, CheckReport* report, QueryControl* control)
      : reader_(surface.cache(), {control, std::nullopt}),
        record_(surface.record()),
        index_(surface.index()),
        cache_(surface.cache()),
        report_(report),
        failed_(index_.unit_count()),
        depths_(index_.unit_count()),
        children_left_(index_.unit_count()) {}

  Status Full() {
    MTDB_RETURN_IF_ERROR(ForEachUnit([&](const LoadedUnit& unit) {
      CountRemovers(unit);
      CheckUnit(unit);
    }));
    if (!complete_) return Status::Ok();
    Expect("nodes", record_.nodes, nodes_);
    Expect("vertices", record_.vertices, index_.root_vertices() + nodes_ - without_vertex_);
    Expect("root triangles", record_.root_triangles, root_triangles_);
    Expect("triangles at full resolution", record_.triangles, drain_);
    Expect("arcs that leave a cluster or the root", in_triangles_, arcs_out_);
    Expect("the largest degree", record_.max_degree, max_degree_);
    Expect("the largest error code", record_.error_code_max, error_code_max_);
    Expect("the depth", record_.depth, depth_);
    if (!(record_.grid.Bounds(bounds_) == record_.bounds))
      Fail("the bounds in the catalog are not those of the vertices");
    Check("clusters and root pieces decode and agree with the index: " +
          std::to_string(index_.cluster_count()) + " and " +
          std::to_string(index_.root_piece_count()));
    Check("each arc that leaves a cluster arrives once: " + std::to_string(arcs_out_));
    Check("counts, bounds, errors, degrees and depth agree with the catalog");
    return Status::Ok();
  }

  Status Global() {
    MTDB_RETURN_IF_ERROR(ForEachUnit([&](const LoadedUnit& unit) { AddToDigest(unit); }));
    if (!complete_) return Status::Ok();
    Expect("triangles at full resolution", record_.triangles, digest_.triangles());
    Expect("the surface digest", record_.surface_digest, digest_.surface_digest());
    Expect("the border digest", record_.border_digest, digest_.border_digest());
    Check("the full-resolution mesh has the surface and the border of the input");
    if (record_.input.nonmanifold_edges == 0 && record_.input.two_sided_triangles == 0) {
      ExpectEuler("of the full-resolution mesh", record_.vertices, digest_.triangles(),
                  record_.boundary_edges);
      if (crumbs_ > 0) {
        Check("the Euler characteristic is that of the input at full resolution");
        return Status::Ok();
      }
      // Each insertion into the border adds one edge to it.
      ExpectEuler("of the root mesh", index_.root_vertices(), root_triangles_,
                  record_.boundary_edges - boundary_nodes_);
      Check("the Euler characteristic is that of the input, at full resolution and in the root");
    }
    return Status::Ok();
  }

 private:
  // Coarsest first, so that parents come before children.
  template <typename F>
  Status ForEachUnit(F&& f) {
    LoadStats stats;
    for (UnitId unit = index_.unit_count(); unit-- > 0;) {
      MTDB_RETURN_IF_ERROR(reader_.Check());
      bool skip = false;
      if (index_.Has(unit)) {
        for (const UnitId p : index_.parents(unit)) skip |= failed_.Test(p);
      }
      if (skip) {
        failed_.Set(unit);
        continue;
      }
      const Result<LoadedUnitPtr> loaded = cache_.Get(unit, &stats);
      if (loaded.ok()) {
        f(**loaded);
        continue;
      }
      const StatusCode code = loaded.status().code();
      if (code != StatusCode::kCorrupt && code != StatusCode::kUnsupported) return loaded.status();
      report_->failures.push_back(loaded.status().message());
      failed_.Set(unit);
      complete_ = false;
    }
    return Status::Ok();
  }

  void Check(const std::string& what) { report_->checks.push_back(record_.name + ": " + what); }
  void Fail(const std::string& what) { report_->failures.push_back(record_.name + ": " + what); }
  void Expect(const char* what, uint64_t expected, uint64_t found) {
    if (expected == found) return;
    Fail(std::string(what) + ": expected " + std::to_string(expected) + ", found " +
         std::to_string(found));
  }
  void ExpectEuler(const char* of, uint64_t vertices, uint64_t triangles, uint64_t border) {
    const uint64_t twice_edges = 3 * triangles + border;
    const int64_t found = static_cast<int64_t>(vertices) - static_cast<int64_t>(twice_edges / 2) +
                          static_cast<int64_t>(triangles);
    if (twice_edges % 2 == 0 && found == record_.euler_characteristic) return;
    Fail("the Euler characteristic " + std::string(of) + ": expected " +
         std::to_string(record_.euler_characteristic) + ", found " + std::to_string(found) + " (" +
         std::to_string(vertices) + " vertices, " + std::to_string(triangles) + " triangles, " +
         std::to_string(border) + " border edges)");
  }

  void CountRemovers(const LoadedUnit& unit) {
    const LocalRemovers& removers = unit.removers();
    for (uint32_t slot = unit.first_own_slot(); slot < removers.size(); ++slot) {
      if (removers[slot] == kDrain) {
        ++drain_;
      } else if (RemovedByChild(removers[slot])) {
        ++arcs_out_;
      }
    }
  }

  void CheckBounds(const LoadedUnit& unit, const Box3i& bounds) {
    for (const Vec3i& p : unit.positions().All()) {
      bounds_.Add(p);
      if (!bounds.Contains(p)) {
        report_->failures.push_back(UnitName(record_, unit.id) +
                                    ": a vertex lies outside of the bounds in the index");
        return;
      }
    }
  }

  void CheckUnit(const LoadedUnit& unit) {
    const CompactCluster& c = unit.cluster;
    CheckBounds(unit, index_.unit(unit.id).bounds);
    root_triangles_ += c.listed() - c.in_triangles();
    nodes_ += c.nodes();
    for (NodeIndex i = 0; i < c.nodes(); ++i) without_vertex_ += c.without_vertex(i);
    in_triangles_ += c.in_triangles();
    std::vector<uint32_t>& depth = depths_[unit.id];
    depth.resize(c.nodes());
    for (NodeIndex i = 0; i < c.nodes(); ++i) {
      uint32_t above = 0;
      for (const uint32_t slot : c.hole(i)) {
        if (slot >= c.in_triangles()) {
          above = std::max(above, depth[unit.creator(slot)]);
        } else if (const SlotOrigin& o = unit.origins[slot]; o.creator() != kNone32) {
          above = std::max(above, depths_[unit.parents[o.parent]][o.creator()]);
        }
      }
      depth[i] = above + 1;
      depth_ = std::max(depth_, depth[i]);
      max_degree_ = std::max(max_degree_, static_cast<uint32_t>(c.ring(i).size()));
      error_code_max_ = std::max(error_code_max_, c.error_codes[i]);
    }
    children_left_[unit.id] = static_cast<uint32_t>(unit.children().size());
    if (unit.children().empty()) depth = {};
    for (const UnitId p : unit.parents) {
      if (--children_left_[p] == 0) depths_[p] = {};
    }
  }

  void AddToDigest(const LoadedUnit& unit) {
    const LocalRemovers& removers = unit.removers();
    const LocalPositions& positions = unit.positions();
    root_triangles_ += unit.cluster.listed() - unit.cluster.in_triangles();
    for (NodeIndex i = 0; i < unit.nodes(); ++i) {
      crumbs_ += unit.cluster.crumb(i);
      // At a seam of the texture a node has two fans, and the surface goes on.
      boundary_nodes_ +=
          unit.cluster.boundary(i) && (unit.cluster.fans.empty() || unit.cluster.fans[i] == 1);
    }
    for (uint32_t slot = unit.first_own_slot(); slot < removers.size(); ++slot) {
      if (removers[slot] != kDrain) continue;
      const std::array<uint32_t, 3> t = unit.corners(slot, unit.creator(slot));
      digest_.AddTriangle({positions[t[0]], positions[t[1]], positions[t[2]]});
    }
  }

  UnitReader reader_;
  const ObjectRecord& record_;
  const ClusterIndex& index_;
  ClusterCache& cache_;
  CheckReport* const report_;
  Bits failed_;  // units that do not decode, or descend from one
  bool complete_ = true;

  std::vector<std::vector<uint32_t>> depths_;  // per node, until the last child has been seen
  std::vector<uint32_t> children_left_;
  uint64_t nodes_ = 0;
  uint64_t in_triangles_ = 0;
  uint64_t arcs_out_ = 0;
  uint64_t drain_ = 0;
  uint64_t root_triangles_ = 0;
  uint64_t boundary_nodes_ = 0;
  uint64_t crumbs_ = 0;          // numbers of nodes that bring such
  uint64_t without_vertex_ = 0;  // of these
  uint32_t max_degree_ = 0;
  uint32_t depth_ = 0;
  uint8_t error_code_max_ = 0;
  Box3i bounds_;  // of a turned raster the catalog has those of this box
  SurfaceDigest digest_;
};

}  // namespace

Status VerifyObject(const Surface& surface, VerifyLevel level, CheckReport* report,
                    QueryControl* control) {
  return CatchOutOfMemory([&] {
    Verifier verifier(surface, report, control);
    return level == VerifyLevel::kFull ? verifier.Full() : verifier.Global();
  });
}

}  // namespace mtdb
