// SPDX-License-Identifier: Apache-2.0
// BlockingConnection: a TCP connection for one thread, which waits for each operation, but not for
// ever, however little the server does at a time.
#pragma once

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <string>
#include <utility>

#include "store/base/status.h"
#include "tools/client/http_client.h"
#include "tools/client/network.h"

namespace mtdb::internal {

class BlockingConnection {
 public:
  // `idle_seconds`: how long may be waited without progress.
  BlockingConnection(HttpUrl url, double idle_seconds)
      : url_(std::move(url)), idle_(Seconds(idle_seconds)) {}

  // kIoError.
  Status Connect();
  // Runs `start(handler)`, an asynchronous operation on the stream, to its end. One that takes too
  // long closes the connection and is beast::error::timeout.
  template <typename Start>
  ErrorCode Await(Start&& start) {
    Progress();
    return AwaitMore(std::forward<Start>(start));
  }
  // Likewise; but what was waited since the last progress counts.
  template <typename Start>
  ErrorCode AwaitMore(Start&& start) {
    ErrorCode result;
    bool late = false;
    const Clock::time_point begin = Clock::now();
    asio::steady_timer timer(io_, std::max(idle_ - waited_, Clock::duration::zero()));
    timer.async_wait([&](ErrorCode error) {
      if (error) return;
      late = true;
      stream_.close();
    });
    start([&](ErrorCode error, auto&&...) {
      result = error;
      timer.cancel();
    });
    io_.restart();
    io_.run();
    waited_ += Clock::now() - begin;
    return late ? ErrorCode(beast::error::timeout) : result;
  }
  // The time begins anew: there was something worth waiting for.
  void Progress() {
    waited_ = Clock::duration::zero();
    received_ = 0;
  }
  // A KiB is progress, fewer bytes are a part of it.
  void Received(size_t bytes) {
    received_ += bytes;
    if (received_ >= kProgressBytes) Progress();
  }
  // kIoError: the server, what was tried, and why it failed.
  Status Failure(const std::string& what, ErrorCode error) const;
  const HttpUrl& url() const { return url_; }
  beast::tcp_stream& stream() { return stream_; }

 private:
  static constexpr size_t kProgressBytes = 1024;
  const HttpUrl url_;
  const Clock::duration idle_;
  Clock::duration waited_{};  // since the last progress
  size_t received_ = 0;       // likewise
  asio::io_context io_{1};
  beast::tcp_stream stream_{io_};
};

}  // namespace mtdb::internal
