// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: a payload against fixed in-patches, as a reader with a damaged store would
// meet it. The first byte chooses the patch.
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

#include "codecs/cluster/cluster_codec.h"
#include "tests/fuzz/cluster_fuzz_targets.h"

using mtdb::testing::ClusterFixture;
using mtdb::testing::MakeCluster;

namespace {

struct Target {
  explicit Target(const mtdb::testing::ClusterOptions& options)
      : fixture(MakeCluster(options)),
        in(mtdb::testing::MakeIn(fixture,
                                 mtdb::EncodeCluster(fixture.updates, fixture.attributes))) {}
  ClusterFixture fixture;
  mtdb::InPatch in;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const std::vector<Target> kTargets(std::begin(mtdb::testing::kClusterFuzzTargets),
                                            std::end(mtdb::testing::kClusterFuzzTargets));
  if (size == 0) return 0;
  const Target& target = kTargets[data[0] % kTargets.size()];
  const auto payload = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(1);
  const auto nodes = static_cast<uint32_t>(target.fixture.updates.nodes.size());
  const auto cluster =
      mtdb::DecodeCluster(payload, target.in, target.fixture.attributes, nodes, "fuzz");
  if (cluster.ok() && cluster->nodes() > nodes) __builtin_trap();
  return 0;
}
