// SPDX-License-Identifier: Apache-2.0
// ServerSession: what `mtdb serve` keeps for a client between queries, without the transport: a cut
// and the encoder of the stream that leads the client along.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "codecs/stream/update_stream.h"
#include "query/query.h"
#include "query/session.h"
#include "query/surface.h"
#include "store/base/bytes.h"
#include "store/base/status.h"
#include "tools/client/session_message.h"

namespace mtdb::internal {

// One thread at a time.
class ServerSession {
 public:
  struct Options {
    uint64_t remembered_vertices = 0;
    uint64_t max_triangles = 0;  // of the cut
    bool coded_holes = false;    // of terrains: the client is not to compute triangles
  };
  // At the coarsest mesh. Errors: those of reading it; kInvalidArgument when it is too large.
  static Result<std::unique_ptr<ServerSession>> Open(std::shared_ptr<const Surface> surface,
                                                     const Options& options);

  SessionHello Hello() const;
  // The update stream's first bytes.
  const Bytes& start() const { return encoder_.start(); }
  const Surface& surface() const { return *surface_; }
  uint64_t max_triangles() const { return options_.max_triangles; }

  // How an update shares its way with others. Called by Update's thread.
  struct Pace {
    std::function<bool()> superseded;  // asked before each round but the first
    // Asked before each round: whether the session may take so much memory. Told after it what it
    // takes, whatever the answer.
    std::function<bool(uint64_t bytes)> may_take;
    std::function<void(uint64_t bytes)> takes;
    std::function<bool()> pause;      // asked after each round: it is to go on later
    std::function<void(Bytes)> send;  // whole records of the stream
  };
  enum class End : uint8_t { kDone, kSuperseded, kPaused, kTooLarge, kNoMemory };
  struct Progress {
    uint64_t rounds = 0;
    uint64_t insertions = 0;
    uint64_t removals = 0;
  };
  // Moves the cut to that of `query`, the client to what Query::clip leaves of it, and adds what it
  // did to `progress`. Whatever ends it, the cut is the one that was sent: paused, it goes on when
  // called again. `query` has a control, which is cancelled to pause. Errors: those of
  // Session::Update.
  Result<End> Update(const Query& query, const Pace& pace, Progress* progress,
                     SessionUpdate* update);

  // What it takes between updates, about; the cut's own part is guessed.
  uint64_t memory_bytes() const;

  // The client's mesh, when it has read everything.
  const ClientMesh& mesh() const { return encoder_.mesh(); }

 private:
  ServerSession(std::shared_ptr<const Surface> surface, std::unique_ptr<Session> session,
                const BaseMesh& base, const Options& options);
  // Of the cut after `batches`.
  uint64_t TrianglesAfter(std::span<const UpdateBatch> batches) const;
  // Of the session, about, with a cut of so many triangles.
  uint64_t MemoryAfter(uint64_t triangles, bool clipped) const;
  void Send(std::span<const UpdateBatch> batches, const MeetsRegion& region, const Pace& pace);

  const std::shared_ptr<const Surface> surface_;
  const Options options_;
  const std::unique_ptr<Session> session_;
  UpdateEncoder encoder_;
  bool sending_ = false;  // a round is half encoded
  uint64_t triangles_;    // of the cut
  bool clipped_ = false;  // the client holds a part of it
};

}  // namespace mtdb::internal
