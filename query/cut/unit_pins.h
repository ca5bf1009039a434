// SPDX-License-Identifier: Apache-2.0
// UnitPins: the loaded units that a step of work on a cut holds.
#pragma once

#include <vector>

#include "query/cache/unit_reader.h"
#include "query/cut/cut_state.h"
#include "query/fields/make_room.h"
#include "query/fields/work_meter.h"

namespace mtdb::internal {

// Work on a cut goes in steps, each of which holds the units that it uses; between two steps all
// may be let go of. One thread.
class UnitPins {
 public:
  UnitPins(CutState& cut, UnitReader& reader, WorkMeter& meter)
      : cut_(cut), reader_(reader), meter_(meter) {}
  ~UnitPins() { Release(); }
  UnitPins(const UnitPins&) = delete;
  UnitPins& operator=(const UnitPins&) = delete;

  UnitReader& reader() { return reader_; }

  // Within a step: the unit, until the step ends.
  Result<const LoadedUnit*> Pin(CutUnit& u) {
    if (u.pin != nullptr) return u.pin;
    MTDB_RETURN_IF_ERROR(meter_.status());
    MakeRoomForOne(pinned_);
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader_.Get(u.id));
    if (u.present.empty()) cut_.Size(u, *unit);
    pinned_.push_back(u.id);
    return u.pin = unit;
  }
  // Runs a step, which can be run again when pinning fails: it then goes on with nothing else held,
  // as long as it inserts nodes. So the largest node decides whether there is room, and not what
  // happened to be held.
  template <typename Step>
  Status Run(Step&& step) {
    MTDB_RETURN_IF_ERROR(reader_.Check());
    Status status = step();
    bool goes_on = true;
    while (!status.ok() && reader_.crowded() && goes_on) {
      const uint64_t before = cut_.counts().applied;
      Release();
      MTDB_RETURN_IF_ERROR(reader_.WaitForRoom());
      status = step();
      goes_on = cut_.counts().applied != before;
    }
    if (reader_.ShouldRelease()) Release();
    return status.ok() ? meter_.status() : status;
  }
  // A step with one unit: f(unit), which gives a Status.
  template <typename F>
  Status RunOn(CutUnit& u, F&& f) {
    return Run([&]() -> Status {
      MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
      return f(*unit);
    });
  }
  // Between steps: the unit, until the next call of any function.
  Result<const LoadedUnit*> PinOne(CutUnit& u) {
    if (u.pin != nullptr) return u.pin;
    MTDB_RETURN_IF_ERROR(reader_.Check());
    if (reader_.ShouldRelease()) Release();
    Result<const LoadedUnit*> unit = Pin(u);
    if (unit.ok() || !reader_.crowded()) return unit;
    Release();
    return Pin(u);
  }
  // Between steps: lets go of all units.
  void Release() {
    for (const UnitId id : pinned_) {
      if (CutUnit* const u = cut_.Find(id); u != nullptr) u->pin = nullptr;
    }
    pinned_.clear();
    reader_.Release();
  }

 private:
  CutState& cut_;
  UnitReader& reader_;
  WorkMeter& meter_;
  std::vector<UnitId> pinned_;
};

}  // namespace mtdb::internal
