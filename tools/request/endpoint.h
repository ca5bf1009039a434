// SPDX-License-Identifier: Apache-2.0
// Endpoint: where a server listens.
#pragma once

#include <cstdint>
#include <string>

namespace mtdb {

struct Endpoint {
  std::string address;  // IPv4 or IPv6
  uint16_t port = 0;
  std::string text() const;  // "127.0.0.1:8080", "[::1]:8080"
};

}  // namespace mtdb
