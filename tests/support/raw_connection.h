// SPDX-License-Identifier: Apache-2.0
// Raw HTTP over TCP, for tests of the server.
#pragma once

#include <arpa/inet.h>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <netinet/in.h>
#include <poll.h>
#include <sstream>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

#include "tests/support/json.h"

namespace mtdb::test {

constexpr int kSocketTimeoutMs = 60'000;

struct HttpAnswer {
  int status = 0;  // 0: the server closed without a whole answer
  std::map<std::string, std::string> headers;
  std::string body;

  std::string header(const std::string& name) const {
    const auto at = headers.find(name);
    return at == headers.end() ? "" : at->second;
  }
  Json json() const { return ParseJson(body); }
  std::string error() const;
  std::string code() const;
};

// A TCP connection that sends what it is told.
class RawConnection {
 public:
  // With `receive_bytes`, so small a receive buffer that the server soon has to wait. From
  // 127.0.0.`from`: each is a client of its own to the server.
  explicit RawConnection(int port, int receive_bytes = 0, int from = 1);
  ~RawConnection() { Close(); }
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;

  bool connected() const { return connected_; }
  void Close() {
    if (socket_ >= 0) ::close(std::exchange(socket_, -1));
  }
  void CloseSending() { ::shutdown(socket_, SHUT_WR); }
  // Sends what goes without waiting; false when that is not all.
  bool SendNow(std::string_view bytes) {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) ==
           static_cast<ssize_t>(bytes.size());
  }

  bool Send(std::string_view bytes);

  // More bytes of what was received; false at the end.
  bool Receive();
  // The next `size` bytes; fewer when the server closes.
  std::string Take(size_t size);
  // All that comes until the server closes.
  std::string ReceiveAll();

  HttpAnswer ReceiveAnswer(bool head = false);

 private:
  int socket_;
  bool connected_ = false;
  std::string received_;
};

std::string RequestText(const std::string& method, const std::string& target,
                        const std::string& body = "", const std::string& more = "");

}  // namespace mtdb::test
