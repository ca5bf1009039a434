// SPDX-License-Identifier: Apache-2.0
// What the update target's records are decoded after: the start of each of these meshes, alone or
// with a record that clips the client to one half of it.
#pragma once

#include <iterator>
#include <memory>

#include "codecs/stream/update_stream.h"
#include "tests/codecs/update_fixture.h"
#include "tests/fuzz/cluster_fuzz_targets.h"

namespace mtdb::testing {

inline constexpr size_t kUpdateFuzzTargets = 2 * std::size(kClusterFuzzTargets);

struct UpdateFuzzTarget {
  explicit UpdateFuzzTarget(size_t choice)
      : fixture(kClusterFuzzTargets[choice / 2]),
        encoder(std::make_unique<UpdateEncoder>(fixture.options(9), fixture.base())),
        prefix(encoder->start()) {
    if (choice % 2 == 0) return;
    const Bytes clip = encoder->Encode({}, Half());
    prefix.insert(prefix.end(), clip.begin(), clip.end());
  }
  MeetsRegion Half() const {
    Box3d box;
    for (const Vec3i p : fixture.base().positions) box.Add(Grid().Position(p));
    return [x = 0.5 * (box.min.x + box.max.x)](const Triangle3d& t) {
      return t[0].x < x || t[1].x < x || t[2].x < x;
    };
  }

  UpdateFixture fixture;
  std::unique_ptr<UpdateEncoder> encoder;  // of a client that has read the prefix
  Bytes prefix;
};

}  // namespace mtdb::testing
