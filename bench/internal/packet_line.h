// SPDX-License-Identifier: Apache-2.0
// PacketLine: two hosts with a slow line between, on one machine, without tc netem, which many
// kernels have not.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "store/base/status.h"

namespace mtdb {

struct LineOptions {
  double round_trip_seconds = 0.05;
  double bytes_per_second = 20e6 / 8;  // each way
};

// Each host is a network namespace with a TUN device. Two threads carry the packets from one device
// to the other, each after half of the round trip, one after the other at the line's rate; what
// would wait behind more than kQueuePackets is lost, as in netem. So TCP is the kernel's, with its
// handshakes, slow start and congestion control (set to cubic, the kernel's usual one).
class PacketLine {
 public:
  static constexpr size_t kQueuePackets = 1000;

  // Puts the process, which may have one thread only, into a namespace of its own, which is the
  // near host. Without rights of root it needs user namespaces. kUnsupported where a machine does
  // not allow it; then the process may be in a namespace with a loopback device nevertheless.
  static Result<std::unique_ptr<PacketLine>> Make(const LineOptions& options);
  ~PacketLine();
  PacketLine(const PacketLine&) = delete;
  PacketLine& operator=(const PacketLine&) = delete;

  // Of processes that are to run on the far host: setns.
  int far_namespace() const { return far_namespace_; }
  static const char* far_address() { return "10.77.0.2"; }

 private:
  PacketLine() = default;
  void Carry(int from, int to, const LineOptions& options);

  int near_device_ = -1, far_device_ = -1, far_namespace_ = -1;
  std::atomic<bool> stopping_{false};
  std::thread there_, back_;
};

}  // namespace mtdb
