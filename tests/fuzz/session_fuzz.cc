// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: the control messages of a session. The first byte chooses which end reads them.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "tools/client/session_message.h"

namespace {

// What was understood is understood again from what it is written as.
void Check(std::string_view text, bool from_client) {
  if (from_client) {
    std::optional<uint64_t> id;
    const auto request = mtdb::ParseSessionRequest(text, &id);
    if (!request.ok()) return;
    if (id != request->id || request->id > mtdb::kLargestId) __builtin_trap();
    const auto again = mtdb::ParseSessionRequest(mtdb::SessionRequestText(*request), &id);
    if (!again.ok() || again->id != request->id || again->query != request->query) {
      __builtin_trap();
    }
    return;
  }
  const auto reply = mtdb::ParseSessionReply(text);
  if (!reply.ok()) return;
  const std::string written = mtdb::SessionReplyText(*reply);
  const auto again = mtdb::ParseSessionReply(written);
  if (!again.ok() || mtdb::SessionReplyText(*again) != written) __builtin_trap();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  Check({reinterpret_cast<const char*>(data) + 1, size - 1}, data[0] % 2 == 0);
  return 0;
}
