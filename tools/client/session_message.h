// SPDX-License-Identifier: Apache-2.0
// The control messages of a session (docs/protocol.md): JSON, in both directions. Safe on any
// bytes; time about linear in their number.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/shortfall.h"
#include "store/base/status.h"

namespace mtdb {

inline constexpr int kSessionProtocol = 1;
inline constexpr size_t kMaxSessionMessageBytes = 1 << 20;
inline constexpr uint64_t kLargestId = (uint64_t{1} << 53) - 1;  // exact in every JSON reader

// ---- from the client ----

struct SessionRequest {
  uint64_t id = 0;    // at most kLargestId; answers bear it
  std::string query;  // as docs/query.md has it; JSON, but not yet checked as a query
};
// kInvalidArgument; then `*id` is the message's, if it has one that can be read.
Result<SessionRequest> ParseSessionRequest(std::string_view text, std::optional<uint64_t>* id);
// `query` must be JSON.
std::string SessionRequestText(const SessionRequest& request);

// ---- from the server ----

// The first message.
struct SessionHello {
  std::string object;
  uint64_t triangles = 0;  // of the object at full resolution
  uint64_t vertices = 0;
  double diagonal = 0;            // of its bounds, model units
  double rounding_error = 0;      // what rounding at ingest makes positions off by, model units
  bool double_positions = false;  // positions need more than float32
  uint64_t remembered_vertices = 0;
  uint64_t max_triangles = 0;  // of the cut: before clipping
  uint64_t max_message_bytes = kMaxSessionMessageBytes;
};

// What an update did.
struct SessionDone {
  uint64_t triangles = 0;  // of the client's mesh, now
  uint64_t vertices = 0;
  uint64_t active_triangles = 0;
  double error_bound = 0;  // model units
  Shortfall shortfall;
  std::string limit;  // what ended the refinement
  uint64_t insertions = 0;
  uint64_t removals = 0;
  uint64_t messages = 0;    // with the update's bytes
  uint64_t bytes = 0;       // in them
  double milliseconds = 0;  // from the query's arrival to its last update
};

struct SessionReply {
  enum class Kind : uint8_t { kHello, kDone, kSuperseded, kError };
  Kind kind = Kind::kError;
  std::optional<uint64_t> id;  // none for a hello, or where the server could not read it
  SessionHello hello;
  SessionDone done;
  std::string error, code;  // a sentence; a word for programs
};
// kBadInput.
Result<SessionReply> ParseSessionReply(std::string_view text);
std::string SessionReplyText(const SessionReply& reply);

}  // namespace mtdb
