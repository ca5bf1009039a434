// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/explicit_arcs.h"

namespace mtdb::internal {

void EncodeExplicitArcs(std::span<const ExplicitArc> arcs, StreamWriter& streams) {
  ByteWriter& out = streams.stream(StreamTag::kExplicitArcs);
  uint32_t last_slot = 0;
  for (const ExplicitArc& arc : arcs) {
    out.PutVarint(arc.slot - last_slot);
    out.PutVarint(arc.child_slot);
    out.Put<uint8_t>(arc.rotation);
    last_slot = arc.slot;
  }
}

bool DecodeExplicitArcs(const StreamReader& streams, Cluster* unit) {
  ByteReader in = streams.stream(StreamTag::kExplicitArcs);
  uint64_t slot = 0;
  while (in.remaining() != 0) {
    slot += in.GetVarint();
    const uint64_t child_slot = in.GetVarint();
    const auto rotation = in.Get<uint8_t>();
    if (in.failed() || slot >= unit->removers.size() || child_slot >= kNone32 || rotation > 2 ||
        !RemovedByChild(unit->removers[slot])) {
      return false;
    }
    unit->explicit_arcs.push_back(
        {static_cast<uint32_t>(slot), static_cast<uint32_t>(child_slot), rotation});
  }
  return true;
}

}  // namespace mtdb::internal
