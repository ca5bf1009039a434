// SPDX-License-Identifier: Apache-2.0
#include "query/cut/cut_units.h"

#include <string>
#include <utility>

#include "query/fields/make_room.h"

namespace mtdb::internal {

CutUnits::CutUnits(const ClusterSource& source, bool remembers)
    : source_(source),
      index_(source.index()),
      remembers_(remembers),
      units_(source.index().unit_count()) {}

CutUnit& CutUnits::Open(UnitId id) {
  return units_[id] != nullptr ? *units_[id] : Add(id, std::make_unique<CutUnit>());
}

CutUnit& CutUnits::Add(UnitId id, std::unique_ptr<CutUnit> unit) {
  CutUnit& u = *unit;
  u.id = id;
  u.place = static_cast<uint32_t>(open_.size());
  u.applied = u.wanted = Bits(index_.unit(id).nodes);
  if (remembers_) u.known = u.refusing = u.strong = u.applied;
  MakeRoomForOne(open_);
  MakeRoomForOne(touched_);
  units_[id] = std::move(unit);
  open_.push_back(id);
  touched_.push_back(id);
  return u;
}

void CutUnits::Size(CutUnit& u, const LoadedUnit& unit) const {
  Bits present(unit.own_slots());
  if (remembers_) u.refused = Bits(static_cast<uint32_t>(unit.cluster.hole_slots.size()));
  u.first_own = unit.first_own_slot();
  u.present = std::move(present);
}

void CutUnits::Keep(CutUnit& u) {
  MakeRoomForOne(touched_);
  if (spare_.empty()) {
    u.before = std::make_unique<CutFlags>(u);
  } else {
    *spare_.back() = u;
    u.before = std::move(spare_.back());
    spare_.pop_back();
  }
  touched_.push_back(u.id);
}

void CutUnits::EndRound() {
  spare_.clear();
  for (const UnitId id : touched_) {
    CutUnit& u = *units_[id];
    if (u.before != nullptr) spare_.push_back(std::move(u.before));
    u.fresh = false;
  }
  touched_.clear();
}

void CutUnits::Undo() {
  for (const UnitId id : touched_) {
    CutUnit& u = *units_[id];
    if (u.fresh) {
      units_[id].reset();
    } else {
      static_cast<CutFlags&>(u) = std::move(*u.before);
      u.before.reset();
    }
  }
  touched_.clear();
  DropClosed();
  for (const UnitId id : open_) {
    CutUnit& u = *units_[id];
    u.queued = false;
    u.arrivals.clear();
    u.wanted.ClearAll();
  }
}

void CutUnits::DropClosed() {
  std::erase_if(open_, [&](UnitId id) { return units_[id] == nullptr; });
}

Status CutUnits::Inconsistent(UnitId unit, const char* what) const {
  return Corrupt(UnitName(source_.record(), unit) + ": " + what + "; rebuild the object");
}

Status CutUnits::NotArriving(UnitId unit) const {
  return Inconsistent(unit, "an arc to it does not arrive");
}

}  // namespace mtdb::internal
