// libFuzzer target: an update stream as a client would meet it. The first byte chooses the base
// mesh, or none; the rest is the body of a record (without: the stream itself), whose length and
// checksum are made right, so that the decoder is reached.
#include <cstddef>
#include <cstdint>

#include "codecs/update_stream.h"
#include "tests/codecs/update_fixture.h"
#include "tests/support/client_mesh_check.h"

using mtdb::testing::Numbers;
using mtdb::testing::Surface;
using mtdb::testing::UpdateFixture;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  struct Target {
    explicit Target(const mtdb::testing::ClusterOptions& options)
        : fixture(options),
          start(mtdb::UpdateEncoder(fixture.options(9), fixture.base()).start()) {}
    UpdateFixture fixture;
    mtdb::Bytes start;
  };
  static const Target kTargets[] = {
      Target({.side = 8}),
      Target({.surface = Surface::kSheet, .side = 8, .pierced = true}),
      Target({.side = 8, .numbers = Numbers::kWild, .attributes = true}),
  };
  if (size == 0) return 0;
  const auto body = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(1);
  mtdb::UpdateDecoder decoder({.triangles = 100000, .vertices = 100000});
  if (data[0] % 4 == 3) {
    static_cast<void>(decoder.Feed(body));
  } else {
    if (!decoder.Feed(kTargets[data[0] % 4].start).ok()) __builtin_trap();
    // Twice, so that a good record is met in the wrong place.
    const mtdb::Bytes record = mtdb::testing::UpdateRecord(body);
    if (decoder.Feed(record).ok()) static_cast<void>(decoder.Feed(record));
  }
  if (!mtdb::testing::ClientMeshFault(decoder.mesh()).empty()) __builtin_trap();
  return 0;
}
