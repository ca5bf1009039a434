// SPDX-License-Identifier: Apache-2.0
// CutUnits: what a cut knows of its units, and rounds of changes that can be undone.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "query/cache/loaded_unit.h"
#include "query/cut/bits.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// What a cut knows of one unit. "Own slot" s is the unit's slot first_own + s: in-triangles are
// counted where they are created. The last four are empty in a cut that is not to move.
struct CutFlags {
  Bits applied;   // per node
  Bits present;   // per own slot: in the mesh; empty until the unit has been pinned
  Bits known;     // per node: what follows is known of it; all that are applied, and more
  Bits refusing;  // per node: removes a refused triangle
  Bits refused;   // per place in Cluster::hole_slots: that triangle is refused
  Bits strong;    // per node: applied, and refused triangles alone are why; see strength.h
  uint32_t applied_count = 0;
  uint32_t forced = 0;  // applied and not refusing; at the end of a round
};

struct CutUnit : CutFlags {
  virtual ~CutUnit() = default;

  UnitId id = 0;
  uint32_t place = 0;  // in CutUnits::open(), as long as no unit has been closed
  uint32_t first_own = 0;
  bool looked = false;  // all its in-triangles have been looked at
  bool fresh = true;    // opened in this round
  bool queued = false;  // in the UnitQueue
  bool prefetched = false;
  const LoadedUnit* pin = nullptr;   // while UnitPins holds it
  std::unique_ptr<CutFlags> before;  // at the end of the last round, where it differs
  Bits active;                       // per own slot: see Survey
  // Per node, as far as it was applied once: its number has no vertex. Mostly empty.
  Bits without_vertex;
  // Work: arcs whose triangles have come or gone, and nodes that may have to be applied.
  std::vector<Arc> arrivals;
  Bits wanted;
};

// The units that a cut reaches, open as long as something is kept of them. Changes of their flags
// belong to a round, which is ended or undone as a whole. One thread.
class CutUnits {
 public:
  // With `remembers` CutFlags::known, refusing, refused and strong have room.
  CutUnits(const ClusterSource& source, bool remembers);
  virtual ~CutUnits() = default;
  CutUnits(const CutUnits&) = delete;
  CutUnits& operator=(const CutUnits&) = delete;

  const ClusterIndex& index() const { return index_; }
  bool remembers() const { return remembers_; }
  // Of a node of the unit.
  uint8_t LargestCode(UnitId unit) const { return index_.unit(unit).error_code_max; }
  std::span<const UnitId> open() const { return open_; }
  CutUnit* Find(UnitId unit) const { return units_[unit].get(); }
  // One that has been looked at: it knows the errors of its in-triangles.
  bool Looked(UnitId unit) const { return units_[unit] != nullptr && units_[unit]->looked; }
  // Finds the unit, or opens it: no node applied, no triangle present.
  virtual CutUnit& Open(UnitId unit);
  // For UnitPins: room for what only the loaded unit tells.
  void Size(CutUnit& u, const LoadedUnit& unit) const;

  // Before the flags of a unit change in a round.
  void Save(CutUnit& u) {
    if (!u.fresh && u.before == nullptr) Keep(u);
  }
  // Saved or opened in this round.
  std::span<const UnitId> touched() const { return touched_; }
  // Forgets a unit without applied nodes; it stays in open() until DropClosed.
  void Close(CutUnit& u) { units_[u.id].reset(); }

  Status Inconsistent(UnitId unit, const char* what) const;
  Status NotArriving(UnitId unit) const;  // an arc to it

 protected:
  // In all lists or in none.
  CutUnit& Add(UnitId id, std::unique_ptr<CutUnit> unit);
  // EndRound then needs no memory, as Undo.
  void PrepareEnd() { spare_.reserve(touched_.size()); }
  void EndRound();
  void Undo();
  void DropClosed();

 private:
  void Keep(CutUnit& u);

  const ClusterSource& source_;
  const ClusterIndex& index_;
  const bool remembers_;
  std::vector<std::unique_ptr<CutUnit>> units_;
  std::vector<UnitId> open_;
  std::vector<UnitId> touched_;
  // For CutUnit::before; as many as the last round's.
  std::vector<std::unique_ptr<CutFlags>> spare_;
};

}  // namespace mtdb::internal
